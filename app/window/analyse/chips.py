"""A filter of Analyse: chips that are lit while what they name is shown."""

from collections.abc import Mapping, Sequence
from functools import partial

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QGridLayout, QMenu, QPushButton, QWidget, QWidgetAction

from app.window.widgets.parts import button, clear, column, holder, row, text_label, toggle

MOST_CHIPS = 8  # more are a menu


class Chips(QWidget):
    """A filter: a chip for each choice, lit while it is shown; many of them open below a button and stay open."""

    changed = Signal()

    def __init__(self, title: str) -> None:
        super().__init__()
        self._title = title
        self.chips: dict[str, QPushButton] = {}
        self.menu: QPushButton | None = None  # of many
        self._row = row(spacing=6)
        self.setLayout(self._row)
        self.hide()

    @property
    def chosen(self) -> set[str]:
        """What is to be shown."""
        return {choice for choice, chip in self.chips.items() if chip.isChecked()}

    def show_choices(self, names: Mapping[str, str], off: Sequence[str] = ()) -> None:
        """What there is to choose from, and what it is called; off: what is not shown unless it is asked for."""
        if dict(names) == {choice: chip.text() for choice, chip in self.chips.items()}:
            return
        left_out = (self.chips.keys() - self.chosen) | (set(off) - self.chips.keys())
        self.menu = None
        self.setVisible(len(names) > 1)  # of one there is no choice
        clear(self._row)
        self.chips = {
            choice: toggle(name, partial(self._switch, {choice}), choice not in left_out)
            for choice, name in names.items()
        }
        if len(names) > MOST_CHIPS:
            self.menu = QPushButton(objectName="toggle")
            self.menu.setMenu(self._menu())
            self._row.addWidget(self.menu)
            self._count()
            return
        self._row.addWidget(text_label(self._title, "quiet"))
        for chip in self.chips.values():
            self._row.addWidget(chip)

    def _menu(self) -> QMenu:
        """All chips in rows, and both ways to choose many at once."""
        menu, chips = QMenu(self), QGridLayout()
        chips.setSpacing(6)
        for at, chip in enumerate(self.chips.values()):
            chips.addWidget(chip, *divmod(at, MOST_CHIPS))
        everyone, nobody = (
            button(text, partial(self._switch, set(self.chips), on), "small")
            for text, on in (("All", True), ("None", False))
        )
        action = QWidgetAction(menu)
        action.setDefaultWidget(holder(column(row(everyone, nobody, 1), chips, margins=(11, 11, 11, 11))))
        menu.addAction(action)
        return menu

    def _count(self) -> None:
        chosen, choices = len(self.chosen), len(self.chips)
        if self.menu is not None:
            self.menu.setText(f"{self._title}: {'all' if chosen == choices else chosen} of {choices}  ▾")

    def _switch(self, choices: set[str], on: bool) -> None:
        """Show these, or leave them out; all of them together change the charts once."""
        for choice in choices:
            with QSignalBlocker(self.chips[choice]):
                self.chips[choice].setChecked(on)
        self._count()
        self.changed.emit()
