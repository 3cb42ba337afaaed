"""What the pages are made of: panels, buttons, rows that scroll."""

from collections.abc import Callable, Sequence

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QButtonGroup,
    QFrame,
    QHBoxLayout,
    QLayout,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from app.window.painting import theme
from app.window.painting.labels import word


def button(text: str, do: Callable[[], object], name: str = "", hint: str = "") -> QPushButton:
    """A button that does something. name: "main" or "small"; hint: its tooltip."""
    made = QPushButton(text, objectName=name)
    made.setToolTip(hint)
    made.clicked.connect(lambda: do())
    return made


def panel(title: str) -> tuple[QFrame, QVBoxLayout]:
    """A panel with a title, and the column in it."""
    frame = QFrame(objectName="panel")
    inside = QVBoxLayout(frame)
    inside.setContentsMargins(16, 12, 16, 14)
    inside.setSpacing(8)
    inside.addWidget(word(title, size=theme.HEAD, bold=True))
    return frame, inside


def scrolled(inside: QWidget) -> QScrollArea:
    """What may be higher than its place."""
    area = QScrollArea(widgetResizable=True)
    inside.setObjectName("clear")
    area.viewport().setObjectName("clear")
    area.setWidget(inside)
    return area


def row(*parts: QWidget | int, spacing: int = 8) -> QHBoxLayout:
    """Widgets side by side; a number is a stretch."""
    layout = QHBoxLayout()
    layout.setSpacing(spacing)
    for part in parts:
        if isinstance(part, QWidget):
            layout.addWidget(part, int(part.sizePolicy().horizontalPolicy() == QSizePolicy.Policy.Ignored))
        else:
            layout.addStretch(part)
    return layout


def clear(layout: QLayout) -> None:
    """Take everything out of a layout."""
    while (item := layout.takeAt(0)) is not None:
        if (widget := item.widget()) is not None:
            widget.hide()
            widget.deleteLater()
        elif (inner := item.layout()) is not None:
            clear(inner)


class Segments(QWidget):
    """One of a few, side by side."""

    chosen = Signal(str)

    def __init__(self, choices: Sequence[str], value: str = "") -> None:
        """value: chosen at first; "": none."""
        super().__init__()
        self.setObjectName("clear")
        self._group = QButtonGroup(self)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(4)
        for choice in choices:
            one = QPushButton(choice, objectName="segment", checkable=True)
            one.setChecked(choice == value)
            self._group.addButton(one)
            layout.addWidget(one, 1)
        self._group.buttonClicked.connect(lambda one: self.chosen.emit(one.text()))

    def value(self) -> str:
        """What is chosen."""
        one = self._group.checkedButton()
        return one.text() if one else ""

    def choose(self, value: str) -> None:
        """Show this as chosen."""
        for one in self._group.buttons():
            one.setChecked(one.text() == value)
