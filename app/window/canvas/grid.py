"""A grid over the plane, for pictures whose places are read in numbers."""

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QPainter

from app.window.canvas.plane import Plane
from app.window.widgets import theme
from app.window.widgets.theme import COLOURS, font, pen

SCALE_PX = 58.0  # wide, of the names of the lines
RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter


MIDDLE = Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignTop


def beside_names(plane: Plane) -> QRectF:
    """The part (px) of the plane's field that the names of the lines leave free."""
    return plane.field.adjusted(SCALE_PX, 0.0, -14.0, 0.0)


def paint_grid(painter: QPainter, plane: Plane) -> None:
    """Lines every 10 cm with their names, as far as those have room."""
    field, half = beside_names(plane), 10.0
    left, right, top, bottom = field.left(), field.right(), field.top() + 5.0, field.bottom()
    painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
    painter.setFont(font(theme.SMALL))
    for i in range(-20, 21):
        at = plane.to_screen((0.1 * i, 0.1 * i))
        x, y = round(at.x()) + 0.5, round(at.y()) + 0.5
        painter.setPen(pen(COLOURS.line, 1.0, 0.55))
        if left < x < right:
            painter.drawLine(QPointF(x, top), QPointF(x, bottom))
            painter.setPen(pen(COLOURS.quiet, 1.0))
            if left + half < x < right - half:
                painter.drawText(QRectF(x - 30.0, bottom + 4.0, 60.0, 2.0 * half), MIDDLE, f"{10 * i}")
            painter.setPen(pen(COLOURS.line, 1.0, 0.55))
        if i >= 0 and top + half < y < bottom - half:
            painter.drawLine(QPointF(left, y), QPointF(right, y))
            painter.setPen(pen(COLOURS.quiet, 1.0))
            painter.drawText(QRectF(0.0, y - half, left - 8.0, 2.0 * half), RIGHT, f"{10 * i} cm")
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
