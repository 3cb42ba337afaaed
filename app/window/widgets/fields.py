"""Fields: what can be typed, ticked or chosen."""

import math
from typing import Any

from PySide6.QtCore import QPointF, QRectF, Signal
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtWidgets import QCheckBox, QLineEdit, QStyle, QStyleOptionButton

from app.window.widgets.parts import Segments
from app.window.widgets.theme import COLOURS, pen

LONGEST = 200  # letters of a text


class TextField(QLineEdit):
    """A text in one line."""

    changed = Signal(object)

    def __init__(self, label: str) -> None:
        super().__init__(accessibleName=label, maxLength=LONGEST)
        self.textEdited.connect(lambda _: self.changed.emit(self.value()))

    def value(self) -> Any:
        """What was typed; None: nothing."""
        return self.text().strip() or None


class NumberField(TextField):
    """A number; text that is none is kept as it is, for the reader of the value to refuse."""

    def value(self) -> Any:
        return number_of(self.text())


class Tick(QCheckBox):
    """Yes or no; a tick in its box, which colour alone would not say."""

    def paintEvent(self, event: QPaintEvent) -> None:
        super().paintEvent(event)
        if not self.isChecked():
            return
        option = QStyleOptionButton()
        self.initStyleOption(option)
        box = QRectF(self.style().subElementRect(QStyle.SubElement.SE_CheckBoxIndicator, option, self))
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(pen(COLOURS.panel, 2.0))
        corners = ((0.22, 0.52), (0.43, 0.73), (0.8, 0.28))  # shares of the box
        painter.drawPolyline([box.topLeft() + QPointF(x * box.width(), y * box.height()) for x, y in corners])


Field = TextField | Segments


def number_of(text: str) -> Any:
    """A number as a person types it, 3.5 or 3,5; None: nothing; any other text as it is."""
    text = text.strip()
    for kind in (int, float):
        try:
            number = kind(text.replace(",", "."))
        except ValueError:
            continue
        return number if math.isfinite(number) else text
    return text or None


def is_number(value: Any) -> bool:
    """Whether it is a number, and no yes or no."""
    return isinstance(value, int | float) and not isinstance(value, bool)
