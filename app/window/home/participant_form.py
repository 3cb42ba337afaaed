"""What a protocol asks of each participant, as fields to be filled in before a session."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLineEdit, QWidget

from app.window.widgets.fields import Field, NumberField, TextField, is_number
from app.window.widgets.parts import Segments, clear, grid, text_label
from experiments.protocol_file import NUMBER


class ParticipantForm(QWidget):
    """A field for each thing that is asked."""

    changed = Signal()  # the user has filled something in
    entered = Signal()  # Enter was pressed in a field

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("clear")
        self._asked: dict[str, tuple[str, ...] | str] = {}
        self.fields: dict[str, Field] = {}
        self._grid = grid(8, 8, stretched=1)
        self.setLayout(self._grid)
        self.hide()

    def show_form(self, asked: dict[str, tuple[str, ...] | str]) -> None:
        """Fields for these: name -> the choices, or the kind of what is typed. The same ones keep what is in them."""
        if asked == self._asked:
            return
        clear(self._grid)
        self._asked, self.fields = asked, {}
        for place, (name, kind) in enumerate(asked.items()):
            field: Field
            if isinstance(kind, str):
                field = NumberField(name) if kind == NUMBER else TextField(name)
            else:
                field = Segments({choice: choice for choice in kind}, name)
            self.fields[name] = field
            field.changed.connect(lambda _: self.changed.emit())
            if isinstance(field, QLineEdit):
                field.returnPressed.connect(self.entered)
            self._grid.addWidget(text_label(name.replace("_", " ").capitalize(), "quiet"), place, 0)
            self._grid.addWidget(field, place, 1)
        self.setVisible(bool(asked))

    def answers(self) -> dict[str, str | float]:
        """What was filled in and fits; the rest is left out."""
        values = {name: field.value() for name, field in self.fields.items()}
        return {
            name: float(value) if self._asked[name] == NUMBER else value
            for name, value in values.items()
            if value is not None and (is_number(value) or self._asked[name] != NUMBER)
        }

    def problems(self) -> list[str]:
        """What is still to be done, a sentence for each field."""
        answers, found = self.answers(), []
        for name, field in self.fields.items():
            words = name.replace("_", " ")
            if name not in answers:
                found.append(f"{words.capitalize()} must be a number." if field.value() else f"Fill in {words}.")
        return found
