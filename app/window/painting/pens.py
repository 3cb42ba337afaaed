"""Typeface, colours and pens of what is painted each frame: made once, kept."""

from functools import cache, lru_cache

from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QColor, QFont, QFontMetricsF, QPainter, QPen, QPixmap

from app.window.painting import theme

SHADES = 32  # of the spring


@cache
def font(size: int, bold: bool = False) -> QFont:
    """The typeface at a size in px."""
    return theme.font(size, bold)


@cache
def shade(name: str, alpha: float = 1.0) -> QColor:
    """A colour of the palette."""
    return theme.colour(name, alpha)


@cache
def pen(name: str, width: float, alpha: float = 1.0, round_cap: bool = False) -> QPen:
    """A pen in a colour of the palette. Opaque or at most 1 px wide, with flat ends, is ten times as fast as others."""
    made = QPen(theme.colour(name, alpha), width)
    made.setCapStyle(Qt.PenCapStyle.RoundCap if round_cap else Qt.PenCapStyle.FlatCap)
    made.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
    return made


@cache
def spring_pen(width: float, step: int) -> QPen:
    """From green (step 0) over yellow to red (SHADES - 1)."""
    share = 2.0 * step / (SHADES - 1)
    ends = (theme.GOOD, theme.CAUTION) if share < 1.0 else (theme.CAUTION, theme.BAD)
    made = QPen(theme.mixed(*ends, share if share < 1.0 else share - 1.0), width)
    made.setCapStyle(Qt.PenCapStyle.FlatCap)
    return made


@lru_cache(maxsize=4096)
def text_width(text: str, size: int, bold: bool = False) -> float:
    """How wide (px) a text is."""
    return QFontMetricsF(font(size, bold)).horizontalAdvance(text)


@lru_cache(maxsize=512)
def written(text: str, size: int, bold: bool, name: str, ratio: float) -> QPixmap:
    """A short text as a picture: laid out once, then drawn in a fraction of the time. ratio: device px / px."""
    metrics = QFontMetricsF(font(size, bold))
    width, height = round(metrics.horizontalAdvance(text) + 2.0), round(metrics.height())
    pixmap = QPixmap(round(width * ratio), round(height * ratio))
    pixmap.setDevicePixelRatio(ratio)
    pixmap.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixmap)
    painter.setFont(font(size, bold))
    painter.setPen(shade(name))
    painter.drawText(QPointF(1.0, round(metrics.ascent())), text)
    painter.end()
    return pixmap


def write(painter: QPainter, middle: QPointF, text: str, size: int, bold: bool, name: str) -> None:
    """A short text that comes often, about its middle (px)."""
    pixmap = written(text, size, bold, name, painter.device().devicePixelRatioF())
    room = pixmap.deviceIndependentSize()
    painter.drawPixmap(
        QPointF(round(middle.x() - 0.5 * room.width()), round(middle.y() - 0.5 * room.height())), pixmap
    )
