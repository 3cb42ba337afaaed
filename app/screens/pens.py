"""Typeface, colours and pens of what is painted each frame: made once, kept."""

from functools import cache, lru_cache

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QFont, QFontMetricsF, QPen

from app.screens import theme

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
