"""What a protocol asks of each participant, as fields to be filled in before a session."""

import math

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QGridLayout, QLineEdit, QWidget

from app.window.widgets.parts import Segments, clear, word
from experiments.protocol_file import NUMBER


class ParticipantForm(QWidget):
    """A field for each thing that is asked."""

    changed = Signal()  # somebody has filled something in

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("clear")
        self._asked: dict[str, tuple[str, ...] | str] = {}
        self.fields: dict[str, QLineEdit | Segments] = {}
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setSpacing(8)
        self.hide()

    def show_form(self, asked: dict[str, tuple[str, ...] | str]) -> None:
        """Fields for these: name -> the choices, or the kind of what is typed. The same ones keep what is in them."""
        if asked == self._asked:
            return
        clear(self._grid)
        self._asked, self.fields = asked, {}
        for at, (name, kind) in enumerate(asked.items()):
            field = QLineEdit(maxLength=200) if isinstance(kind, str) else Segments({one: one for one in kind})
            field.setAccessibleName(name)
            (field.textEdited if isinstance(field, QLineEdit) else field.chosen).connect(lambda _: self.changed.emit())
            self._grid.addWidget(word(name.replace("_", " ").capitalize(), "quiet"), at, 0)
            self._grid.addWidget(field, at, 1)
            self.fields[name] = field
        self.setVisible(bool(asked))

    def answers(self) -> dict[str, str | float]:
        """What was filled in; fields that are empty, or no number where one is asked for, are left out."""
        answers: dict[str, str | float] = {}
        for name, field in self.fields.items():
            text = field.text().strip() if isinstance(field, QLineEdit) else field.value() or ""
            if self._asked[name] != NUMBER:
                answers |= {name: text} if text else {}
            elif (number := number_of(text)) is not None:
                answers[name] = number
        return answers

    def missing(self) -> list[str]:
        """What is still to be filled in, in words."""
        answers = self.answers()
        return [name.replace("_", " ") for name in self.fields if name not in answers]


def number_of(text: str) -> float | None:
    """A number as a person types it; None: it is none."""
    try:
        number = float(text.replace(",", "."))
    except ValueError:
        return None
    return number if math.isfinite(number) else None
