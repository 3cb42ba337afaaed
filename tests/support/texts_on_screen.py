"""Every text that a window shows, with the ink that it takes: what is cut off, and what covers what.

Labels and buttons are read from the widgets; what is painted is read from `QPainter.drawText`, and from the axes of the
plots, while the window is painted anew.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import pyqtgraph as pg
import pytest
from PySide6.QtCore import QPointF, QRect, QRectF, Qt
from PySide6.QtGui import QFontMetricsF, QPainter, QStaticText
from PySide6.QtWidgets import QAbstractButton, QAbstractScrollArea, QCheckBox, QComboBox, QLabel, QWidget
from screens import settle

from app.window.canvas.plane import Plane
from app.window.widgets.cards import OverlayCard
from app.window.widgets.parts import KeyButton, OneLine
from app.window.widgets.preflight import Banner

SLACK_PX = 1.0  # of rounding
LEAST_OVERLAP_PX = 1.5


class Ink(NamedTuple):
    text: str
    box: QRectF  # px of the window
    owner: QWidget
    cut: bool  # a part of it is not seen


def faults(window: QWidget) -> list[str]:
    """A sentence for each text that is cut, or that another one covers."""
    over = [card for kind in (OverlayCard, Banner) for card in window.findChildren(kind) if card.isVisible()]
    seen = [ink for ink in inks(window) if not _covered(ink, window, over)]
    found = [f"cut: {ink.text!r} of {_name(ink.owner)}" for ink in seen if ink.cut]
    for place, ink in enumerate(seen):
        for other in seen[place + 1 :]:
            over = ink.box & other.box
            if min(over.width(), over.height()) > LEAST_OVERLAP_PX:
                found.append(
                    f"over each other: {ink.text!r} of {_name(ink.owner)}, {other.text!r} of {_name(other.owner)}"
                )
    return found


def inks(window: QWidget) -> list[Ink]:
    """Every text on a window."""
    settle(window)
    with _painted(window) as painted:
        for plane in window.findChildren(Plane):
            plane.repaint_still()
        for graph in window.findChildren(pg.PlotWidget):
            for axis in (item for item in graph.scene().items() if isinstance(item, pg.AxisItem)):
                axis.picture = None
                axis.update()
        window.grab()
    return [ink for ink in (*_of_widgets(window), *painted) if not _scrolled_away(ink, window)]


def _scrolled_away(ink: Ink, window: QWidget) -> bool:
    """Whether a text is not seen whole, but can be scrolled to."""
    widget: QWidget | None = ink.owner
    while widget is not None:
        area = widget.parentWidget()
        if isinstance(area, QAbstractScrollArea) and area.viewport() is widget and not isinstance(area, pg.PlotWidget):
            shown = QRectF(_place(widget, window))
            return not (shown.top() <= ink.box.top() and ink.box.bottom() <= shown.bottom())
        widget = area
    return False


def _of_widgets(window: QWidget) -> Iterator[Ink]:
    for label in window.findChildren(QLabel):
        if label.isVisible() and label.text() and not isinstance(label, OneLine):
            wraps = label.wordWrap()
            fits = (
                label.height() + SLACK_PX >= label.heightForWidth(label.width())
                if wraps
                else label.width() + SLACK_PX >= label.sizeHint().width()
            )
            yield Ink(label.text(), _label_ink(label, window), label, not fits or not _inside(label))
    for button in window.findChildren(QAbstractButton):
        if button.isVisible() and button.text():
            fits = button.width() + SLACK_PX >= button.sizeHint().width()
            wide = QFontMetricsF(button.font()).tightBoundingRect(button.text())
            box = QRectF(button.rect())
            left = isinstance(button, KeyButton | QCheckBox) or button.objectName() == "key"
            x = (24.0 if isinstance(button, QCheckBox) else 12.0) if left else 0.5 * (box.width() - wide.width())
            ink = QRectF(x, 0.5 * (box.height() - wide.height()), wide.width(), wide.height())
            yield Ink(button.text(), _in(button, ink, window), button, not fits or not _inside(button))
    for choice in window.findChildren(QComboBox):
        if choice.isVisible() and choice.currentText():
            wide = QFontMetricsF(choice.font()).horizontalAdvance(choice.currentText())
            box = _in(choice, QRectF(9.0, 8.0, wide, 12.0), window)
            yield Ink(choice.currentText(), box, choice, wide + 31.0 > choice.width())


def _label_ink(label: QLabel, window: QWidget) -> QRectF:
    """The text's own box; of a text with marks of its own the label's."""
    if label.textFormat() == Qt.TextFormat.RichText:
        return _in(label, QRectF(label.contentsRect()), window)
    flags = int(label.alignment()) | int(Qt.TextFlag.TextWordWrap if label.wordWrap() else 0)
    metrics = QFontMetricsF(label.font())
    ink = metrics.boundingRect(QRectF(label.contentsRect()), flags, label.text())
    return _in(label, ink.adjusted(0.0, 0.2 * metrics.ascent(), 0.0, -metrics.descent()), window)


def _ink_of(metrics: QFontMetricsF, lies: QRectF, text: str) -> QRectF:
    """The ink of a text that takes this room."""
    tight = metrics.tightBoundingRect(text)
    one_line = tight.translated(lies.left() - tight.left(), lies.top() + metrics.ascent())
    return lies.adjusted(0.0, 0.2 * metrics.ascent(), 0.0, -metrics.descent()) if "\n" in text else one_line


@contextmanager
def _painted(window: QWidget) -> Iterator[list[Ink]]:
    """What is written with a painter meanwhile."""
    found: list[Ink] = []
    planes: list[Plane] = []  # whose background is being painted
    static = QPainter.drawStaticText
    draw, background, axis_picture = QPainter.drawText, Plane._paint_background, pg.AxisItem.drawPicture

    def note(painter: QPainter, *given) -> None:
        owner = planes[-1] if planes else painter.device()
        text = given[-1]
        seen = isinstance(owner, QWidget) and owner.isVisible() and owner.window() is window
        if seen and text and (isinstance(owner, OneLine) or not isinstance(owner, QLabel)):
            metrics = QFontMetricsF(painter.font())
            tight = metrics.tightBoundingRect(text)
            if isinstance(given[0], QPointF):
                ink, room = tight.translated(given[0]), QRectF(owner.rect())
            else:
                room = QRectF(given[0])
                ink = _ink_of(metrics, metrics.boundingRect(room, int(given[1]), text), text)
                room &= QRectF(owner.rect())
            cut = not room.adjusted(-SLACK_PX, -SLACK_PX, SLACK_PX, SLACK_PX).contains(ink)
            if isinstance(owner, OneLine):  # a path, and what has parts, may be shorter
                whole = owner.text()
                parts = text.endswith(" · …") and whole.startswith(text.removesuffix("…"))
                dots = text != whole and "/" not in whole and not parts
            else:
                dots = text.endswith("…") and not owner.toolTip() and not isinstance(owner, Plane)
            found.append(Ink(text, _in(owner, ink, window), owner, cut or dots))

    def draw_text(painter: QPainter, *given) -> object:
        note(painter, *given)
        return draw(painter, *given)

    def draw_static(painter: QPainter, at: QPointF, given: QStaticText) -> None:
        note(painter, at + QPointF(0.0, QFontMetricsF(painter.font()).ascent()), given.text())
        static(painter, at, given)

    def paint_background(plane: Plane, ratio: float) -> None:
        planes.append(plane)
        background(plane, ratio)
        planes.pop()

    def draw_picture(axis: pg.AxisItem, painter: QPainter, line, ticks, texts) -> None:
        (view,) = axis.scene().views()
        if view.isVisible() and view.window() is window and axis.isVisible():
            for box, flags, text in texts:
                metrics = QFontMetricsF(axis.style["tickFont"] or painter.font())
                ink = _ink_of(metrics, metrics.boundingRect(QRectF(box), int(flags), text), text)
                ink = QRectF(view.mapFromScene(axis.mapRectToScene(ink)).boundingRect())
                cut = not QRectF(view.viewport().rect()).adjusted(-2, -2, 2, 2).contains(ink)
                found.append(Ink(text, _in(view, ink, window), view, cut))
        axis_picture(axis, painter, line, ticks, texts)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(QPainter, "drawText", draw_text)
        patch.setattr(QPainter, "drawStaticText", draw_static)
        patch.setattr(Plane, "_paint_background", paint_background)
        patch.setattr(pg.AxisItem, "drawPicture", draw_picture)
        yield found


def _covered(ink: Ink, window: QWidget, over: list[QWidget]) -> bool:
    """Whether one of the cards, or the banner, lies over a text: it is hidden then, not cut."""
    box, owner = ink.box.toAlignedRect(), ink.owner
    return any(
        _place(card, window).intersects(box) for card in over if card is not owner and not card.isAncestorOf(owner)
    )


def _place(widget: QWidget, window: QWidget) -> QRect:
    return QRect(widget.mapTo(window, widget.rect().topLeft()), widget.size())


def _in(widget: QWidget, box: QRectF, window: QWidget) -> QRectF:
    return box.translated(QPointF(widget.mapTo(window, widget.rect().topLeft())))


def _inside(widget: QWidget) -> bool:
    """Whether a widget lies whole within all that hold it; what can be scrolled may be lower."""
    parent, box = widget.parentWidget(), QRect(widget.rect())
    while parent is not None:
        box.translate(widget.pos())
        inside = parent.rect()
        if isinstance(parent.parentWidget(), QAbstractScrollArea):
            inside = inside.adjusted(0, -100_000, 0, 100_000)
        if not inside.adjusted(-1, -1, 1, 1).contains(box):
            return False
        if isinstance(parent.parentWidget(), QAbstractScrollArea):
            return True
        widget, parent = parent, parent.parentWidget()
    return True


def _name(widget: QWidget) -> str:
    return type(widget).__name__
