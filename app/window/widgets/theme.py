"""The look of every screen: palette, typeface, sizes."""

import os
from collections.abc import Callable, Mapping
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path

from PySide6.QtCore import QObject, QPointF, Qt, Signal
from PySide6.QtGui import QColor, QFont, QFontDatabase, QFontMetricsF, QPainter, QPen, QStaticText, QTransform
from PySide6.QtWidgets import QApplication, QWidget

from app.window.widgets import palette
from app.window.widgets.sheet import SHEET
from core.control.controllers import Preset
from experiments.analysis.colours import colour_places

COLOURS = palette.ROLES
JOINT = dict(zip("AEBC", COLOURS.joints, strict=True))
STATUS = {
    "done": COLOURS.good, "timeout": COLOURS.caution, "aborted": COLOURS.bad, "redone": COLOURS.quiet,
    "recovered": COLOURS.caution, "skipped": COLOURS.quiet, "stopped": COLOURS.bad, "excluded": COLOURS.quiet,
}  # fmt: skip

SMALL, NORMAL, TITLE, HEAD, LARGE = 12, 14, 16, 20, 30  # px
LEAST_PX = 12  # of a text that becomes smaller where it has no room
GAP, RADIUS = 12, 6  # px, between panels, of their corners

FAMILIES = ["Inter", "DejaVu Sans"]  # the second comes along: the same on every machine


@cache
def font(size: int = NORMAL, bold: bool = False) -> QFont:
    """The typeface at a size (px), in one of its two weights."""
    chosen = QFont(FAMILIES)
    chosen.setPixelSize(size)
    chosen.setWeight(QFont.Weight.DemiBold if bold else QFont.Weight.Normal)
    return chosen


def mono() -> QFont:
    """The typeface of text in columns."""
    chosen = QFont(["DejaVu Sans Mono", "monospace"])
    chosen.setPixelSize(NORMAL)
    return chosen


@cache
def shade(role: str, alpha: float = 1.0) -> QColor:
    """A colour of the palette, more or less transparent."""
    colour = role.removesuffix(LETTERS)
    chosen = QColor(palette.colour_for(colour)) if colour == role else mixed(colour, COLOURS.text, OF_TEXT)
    chosen.setAlphaF(alpha)
    return chosen


def is_dark() -> bool:
    """Whether what is lighter stands out from the ground."""
    return palette.chosen is palette.DARK


OF_TEXT = 0.3  # share of the colour of text in that of letters
LETTERS = " of letters"


@cache
def mixed(a: str, b: str, share: float) -> QColor:
    """A colour between two of the palette."""
    p, q = shade(a), shade(b)
    parts = ((p.redF(), q.redF()), (p.greenF(), q.greenF()), (p.blueF(), q.blueF()))
    return QColor.fromRgbF(*((1.0 - share) * x + share * y for x, y in parts))


def as_text(colour: str) -> str:
    """The colour of a curve, nearer to that of text: letters are thin and need more contrast."""
    return f"{colour}{LETTERS}"


def set_style(widget: QWidget, name: str) -> None:
    """Let a widget look like another kind of its class (the `#name` rules of the sheet)."""
    if widget.objectName() != name:
        widget.setObjectName(name)
        widget.style().unpolish(widget)
        widget.style().polish(widget)
        widget.update()


def apply_theme(application: QApplication) -> None:
    """Give the application its typeface and colours, and let it paint in one thread."""
    os.environ.setdefault("QT_NO_GUI_THREADPOOL", "1")  # shared out, our small areas cost more than they gain
    matplotlib = find_spec("matplotlib")  # not imported, which takes a fifth of a second
    assert matplotlib is not None and matplotlib.origin is not None
    folder = Path(matplotlib.origin).parent / "mpl-data" / "fonts" / "ttf"
    for name in ("DejaVuSans.ttf", "DejaVuSans-Bold.ttf", "DejaVuSansMono.ttf"):
        QFontDatabase.addApplicationFont(str(folder / name))
    application.setStyle("Fusion")
    application.setFont(font())
    colour_all()


def colour_all() -> None:
    """Give every window the colours of the chosen palette, at once."""
    application = QApplication.instance()
    assert isinstance(application, QApplication)
    for kept in (shade, mixed, pen):
        kept.cache_clear()
    rules = (
        f"QFrame#{role} {{ background: {colour}; }} QLabel#{role} {{ background: transparent; color: {colour}; }}"
        for role, colour in zip(COLOURS.controllers, palette.chosen.controllers, strict=True)
    )
    application.setStyleSheet(SHEET.substitute(palette.chosen._asdict(), radius=RADIUS) + "\n".join(rules))
    _look.changed.emit()


class _Look(QObject):
    changed = Signal()


_look = _Look()


def follow(colour: Callable[[], object]) -> None:
    """Call this method of a widget whenever the palette has changed: it keeps colours beyond the next painting."""
    _look.changed.connect(colour)


@cache
def pen(name: str, width: float, alpha: float = 1.0, round_cap: bool = False) -> QPen:
    """A pen in a colour of the palette. Opaque or at most 1 px wide, with flat ends, is ten times as fast as others."""
    line = QPen(shade(name, alpha), width)
    line.setCapStyle(Qt.PenCapStyle.RoundCap if round_cap else Qt.PenCapStyle.FlatCap)
    line.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
    return line


@lru_cache(maxsize=4096)
def text_width(text: str, size: int, bold: bool = False) -> float:
    """How wide (px) a text is."""
    return QFontMetricsF(font(size, bold)).horizontalAdvance(text)


@lru_cache(maxsize=1024)
def laid_out(text: str, size: int, bold: bool) -> QStaticText:
    """A text whose letters have their places already: drawing it takes a third of the time."""
    letters = QStaticText(text)
    letters.setTextFormat(Qt.TextFormat.PlainText)
    letters.prepare(QTransform(), font(size, bold))
    return letters


def write(painter: QPainter, middle: QPointF, text: str, size: int, bold: bool, colour: str) -> None:
    """A short text about its middle (px)."""
    letters = laid_out(text, size, bold)
    painter.setFont(font(size, bold))
    painter.setPen(shade(colour))
    left, top = middle.x() - 0.5 * letters.size().width(), middle.y() - 0.5 * letters.size().height()
    painter.drawStaticText(QPointF(round(left), round(top)), letters)


def write_from(painter: QPainter, left: QPointF, text: str, size: int, bold: bool, colour: str) -> None:
    """As `write`, from the middle of its left edge (px) on."""
    write(painter, left + QPointF(0.5 * text_width(text, size, bold), 0.0), text, size, bold, colour)


FRAME = (8, 44)  # px across, down. Our choice: what borders and title bar of the common desktops take at most


def show_fitted(window: QWidget, width: int, height: int) -> None:
    """Show it this large (px), or over all of a screen that has no room for that and a frame."""
    room = window.screen().availableSize()
    across, down = room.width() - FRAME[0], room.height() - FRAME[1]
    window.resize(min(width, across), min(height, down))
    if width > across or height > down:
        window.showMaximized()
    else:
        window.show()


def colour_at(place: int | None) -> str:
    """The colour of a controller by its place in the palette; a code of a blind session has none of its own."""
    return COLOURS.quiet if place is None else COLOURS.controllers[place]


def colour_of(controller: int | str, controllers: Mapping[int, Preset]) -> str:
    """A controller's own colour, which it has in every protocol."""
    return colour_at(colour_places(controllers).get(controller))
