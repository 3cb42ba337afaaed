"""A panel that is painted, not built of widgets: what stands still once into a background, what moves each frame."""

from PySide6.QtCore import QRect, QRectF, Qt
from PySide6.QtGui import QPainter, QPaintEvent, QPixmap, QResizeEvent
from PySide6.QtWidgets import QWidget

from app.window.painting import theme
from app.window.painting.theme import font, pen, shade, text_width

LEFT = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
CENTRE = Qt.AlignmentFlag.AlignCenter
PAD = 12.0  # px between the panel's edge and what is on it
HEAD = 30.0  # px, of the title's line, from the top
GUTTER = 44.0  # px at the right of a plot, for its scale
WORDS_EVERY_S = 0.1  # numbers that change faster cannot be read


class Panel(QWidget):
    """A rounded panel with a title and, at the right of it, a value that changes."""

    def __init__(self, title: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._title, self._value, self._unit = title, "", ""
        self._still: QPixmap | None = None
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)

    @property
    def value(self) -> str:
        """The value beside the title, as it reads."""
        return f"{self._value} {self._unit}".strip()

    def show_value(self, value: str, unit: str = "") -> None:
        """The value beside the title: a number, its unit more quietly."""
        if (value, unit) != (self._value, self._unit):
            self._value, self._unit = value, unit
            self.update(self.head)

    @property
    def head(self) -> QRect:
        """The title's line."""
        return QRect(1, 1, max(self.width() - 2, 0), int(HEAD))

    @property
    def inside(self) -> QRectF:
        """The room under the title's line, px."""
        return QRectF(PAD, HEAD + 2.0, self.width() - 2.0 * PAD, self.height() - HEAD - 2.0 - 0.7 * PAD)

    @property
    def plot(self) -> QRectF:
        """The room for curves, px: beside it, in the gutter, stands their scale."""
        inside = self.inside
        return QRectF(
            round(inside.x()), round(inside.y()), int(inside.width() - GUTTER), max(int(inside.height()), 1)
        )

    def paint_scale(self, painter: QPainter, y: float, says: str) -> None:
        """The value of the line at this height (px), in the gutter."""
        plot = self.plot
        painter.drawText(QRectF(plot.right(), y - 7.0, GUTTER, 14.0), RIGHT, says)

    def repaint_still(self) -> None:
        """What stands still has changed."""
        self._still = None
        self.update()

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._still = None
        super().resizeEvent(event)

    def paintEvent(self, event: QPaintEvent) -> None:
        ratio = self.devicePixelRatioF()
        if self._still is None or self._still.devicePixelRatio() != ratio:
            self._still = QPixmap(self.size() * ratio)
            self._still.setDevicePixelRatio(ratio)
            self._still.fill(shade(theme.GROUND))
            painter = QPainter(self._still)
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            self._paint_frame(painter)
            self.paint_still(painter)
            painter.end()
        painter = QPainter(self)
        dirty = event.rect()
        if not self.covers(dirty):
            source = QRectF(dirty.x() * ratio, dirty.y() * ratio, dirty.width() * ratio, dirty.height() * ratio)
            painter.drawPixmap(QRectF(dirty), self._still, source)
        if dirty.intersects(self.head):
            self._paint_value(painter)
        self.paint_moving(painter, dirty)

    def paint_still(self, painter: QPainter) -> None:
        """What stands still, besides frame and title."""

    def covers(self, dirty: QRect) -> bool:
        """Whether what moves covers all of this, so that nothing need be painted under it."""
        return False

    def paint_moving(self, painter: QPainter, dirty: QRect) -> None:
        """What moves, at least inside `dirty`."""

    def _paint_frame(self, painter: QPainter) -> None:
        painter.setPen(pen(theme.LINE, 1.0))
        painter.setBrush(shade(theme.PANEL))
        painter.drawRoundedRect(QRectF(self.rect()).adjusted(0.5, 0.5, -0.5, -0.5), theme.RADIUS, theme.RADIUS)
        painter.setFont(font(theme.NORMAL, bold=True))
        painter.setPen(shade(theme.TEXT))
        painter.drawText(QRectF(PAD, 2.0, self.width() - 2.0 * PAD, HEAD - 2.0), LEFT, self._title)

    def _paint_value(self, painter: QPainter) -> None:
        box = QRectF(PAD, 2.0, self.width() - 2.0 * PAD, HEAD - 2.0)
        if self._unit:
            painter.setFont(font(theme.NORMAL))
            painter.setPen(shade(theme.QUIET))
            painter.drawText(box, RIGHT, self._unit)
            box.setRight(box.right() - text_width(self._unit, theme.NORMAL) - 4.0)
        painter.setFont(font(theme.NORMAL, bold=True))
        painter.setPen(shade(theme.TEXT))
        painter.drawText(box, RIGHT, self._value)
