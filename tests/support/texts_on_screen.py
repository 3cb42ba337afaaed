"""The texts of a window's labels, buttons and lists: what is cut off, and what lies over what."""

from collections.abc import Iterator
from typing import NamedTuple

from PySide6.QtCore import QPoint, QRect, QRectF, Qt
from PySide6.QtGui import QFontMetricsF
from PySide6.QtWidgets import QAbstractButton, QAbstractScrollArea, QCheckBox, QComboBox, QLabel, QWidget
from screens import settle

from app.window.main_window import SMALLEST
from app.window.widgets.cards import OverlayCard
from app.window.widgets.parts import KeyButton, OneLine
from app.window.widgets.preflight import Banner

SIZES = SMALLEST, (1920, 1080)
SLACK_PX = 1.0  # of rounding
LEAST_OVERLAP_PX = 1.5


class Text(NamedTuple):
    words: str
    box: QRectF  # px of the window
    owner: QWidget
    cut: bool  # a part of it is not seen


def faults(window: QWidget) -> list[str]:
    """A sentence for each text that is cut, or that another one covers; one under a card is hidden, not cut."""
    settle(window)
    over = [card for kind in (OverlayCard, Banner) for card in window.findChildren(kind) if card.isVisible()]
    seen = [text for text in texts(window) if not covered(text, window, over)]
    found = [f"cut: {text.words!r} of {type(text.owner).__name__}" for text in seen if text.cut]
    for place, text in enumerate(seen):
        for other in seen[place + 1 :]:
            shared = text.box & other.box
            if min(shared.width(), shared.height()) > LEAST_OVERLAP_PX:
                found.append(f"over each other: {text.words!r} and {other.words!r}")
    return found


def faults_by_size(window: QWidget) -> dict[tuple[int, int], list[str]]:
    """The faults of a window as on a small screen and on a large one, of those where there are any."""
    found, before, least = {}, window.size(), window.minimumSize()
    for size in SIZES:
        window.setMinimumSize(1, 1)
        window.resize(*size)
        if said := faults(window):
            found[size] = said
        assert (window.width(), window.height()) == size
    window.setMinimumSize(least)
    window.resize(before)
    return found


def texts(window: QWidget) -> Iterator[Text]:
    """What is seen of a window; what can be scrolled to its place is not looked at."""
    for widget in (one for kind in (QLabel, QAbstractButton, QComboBox) for one in window.findChildren(kind)):
        words = widget.currentText() if isinstance(widget, QComboBox) else widget.text()
        if not words or not widget.isVisible() or isinstance(widget, OneLine):
            continue
        if isinstance(widget, QLabel):
            box, fits = label_box(widget), label_fits(widget)
        elif isinstance(widget, QAbstractButton):
            box, fits = button_box(widget), widget.width() + SLACK_PX >= widget.sizeHint().width()
        else:
            wide = QFontMetricsF(widget.font()).horizontalAdvance(words)
            box, fits = QRectF(9.0, 8.0, wide, 12.0), wide + 31.0 <= widget.width()
        text = Text(words, box.translated(widget.mapTo(window, QPoint())), widget, not fits or not inside(widget))
        if not scrolled_away(text, window):
            yield text


def label_fits(label: QLabel) -> bool:
    if label.wordWrap():
        return label.height() + SLACK_PX >= label.heightForWidth(label.width())
    return label.width() + SLACK_PX >= label.sizeHint().width()


def label_box(label: QLabel) -> QRectF:
    """The text's own box; of a text with marks of its own the label's."""
    if label.textFormat() == Qt.TextFormat.RichText:
        return QRectF(label.contentsRect())
    flags = int(label.alignment()) | int(Qt.TextFlag.TextWordWrap if label.wordWrap() else 0)
    metrics = QFontMetricsF(label.font())
    box = metrics.boundingRect(QRectF(label.contentsRect()), flags, label.text())
    return box.adjusted(0.0, 0.2 * metrics.ascent(), 0.0, -metrics.descent())


def button_box(button: QAbstractButton) -> QRectF:
    wide, box = QFontMetricsF(button.font()).tightBoundingRect(button.text()), QRectF(button.rect())
    left = isinstance(button, KeyButton | QCheckBox) or button.objectName() == "key"
    x = (24.0 if isinstance(button, QCheckBox) else 12.0) if left else 0.5 * (box.width() - wide.width())
    return QRectF(x, 0.5 * (box.height() - wide.height()), wide.width(), wide.height())


def scrolled_away(text: Text, window: QWidget) -> bool:
    """Whether a text is not seen whole, but can be scrolled to."""
    widget: QWidget | None = text.owner
    while widget is not None:
        area = widget.parentWidget()
        if isinstance(area, QAbstractScrollArea) and area.viewport() is widget:
            shown = place_of(widget, window)
            return not (shown.top() <= text.box.top() and text.box.bottom() <= shown.bottom())
        widget = area
    return False


def covered(text: Text, window: QWidget, over: list[QWidget]) -> bool:
    box, owner = text.box.toAlignedRect(), text.owner
    others = (card for card in over if card is not owner and not card.isAncestorOf(owner))
    return any(place_of(card, window).intersects(box) for card in others)


def place_of(widget: QWidget, window: QWidget) -> QRect:
    return QRect(widget.mapTo(window, QPoint()), widget.size())


def inside(widget: QWidget) -> bool:
    """Whether a widget lies whole within all that hold it; what can be scrolled may be lower."""
    parent, box = widget.parentWidget(), QRect(widget.rect())
    while parent is not None:
        box.translate(widget.pos())
        scrolls = isinstance(parent.parentWidget(), QAbstractScrollArea)
        room = parent.rect().adjusted(-1, -100_001 if scrolls else -1, 1, 100_001 if scrolls else 1)
        if not room.contains(box):
            return False
        if scrolls:
            return True
        widget, parent = parent, parent.parentWidget()
    return True
