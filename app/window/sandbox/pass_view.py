"""A pass of Try: the path with the band in which nothing guides, both forces, the whole linkage in a corner."""

import numpy as np
from PySide6.QtCore import QMarginsF, QPointF, QRectF, Qt
from PySide6.QtGui import QPainter, QPainterPath, QPainterPathStroker, QPolygonF, QResizeEvent

from app.window.canvas.force_view import FORCES, TRAIL, ForceView
from app.window.canvas.layers import Instant, Point, extent_of_paths
from app.window.canvas.linkage_view import LINKAGE, SmallView
from app.window.canvas.marks import Labels, points_in
from app.window.canvas.plane import Sizes
from app.window.widgets import theme
from app.window.widgets.theme import pen, shade, write
from core.device import Device
from core.path import PathFile

MARGIN_M = 0.03  # around the path, at least: the hand has its whole force 2 cm from the handle
GAP = "gap"
#: layer -> its key, what it shows
LAYERS = {
    TRAIL: ("T", "The way of the handle in this pass"),
    FORCES: ("F", "The forces of your hand and of the brakes"),
    GAP: ("G", "The band along the path in which nothing guides"),
    LINKAGE: ("L", "The whole linkage; its brakes in the colour of what they do"),
}
INSET_PX = 180  # wide, at most
HEAD_PX, FOOT_PX = 70.0, 26.0  # for what stands there in words
IN_CORNER = Sizes(path=2.0, ring=4.0, ring_pen=2.0, handle=4.5, pointer=0.0)


class PassView(ForceView):
    """The path, the gap around it, the handle, the hand's spring, both forces; the whole linkage in a corner."""

    def __init__(self) -> None:
        sizes = Sizes(path=5.0, ring_pen=4.0, handle=12.0, pointer=7.0, trail=2.5)
        labels = Labels("your hand", theme.TITLE, bold=True)
        free = QMarginsF(16.0, HEAD_PX, 16.0, FOOT_PX)
        super().__init__(QRectF(-0.2, 0.3, 0.4, 0.2), free, labels, sizes, follows_mouse=True)
        self.shown = set(LAYERS)
        self.gap_m = 0.0
        self.inset = SmallView(IN_CORNER)
        self.inset.setParent(self)

    def show_trial(self, device: Device, path: PathFile, tip: Point) -> None:
        self.inset.show_trial(device, path, tip)
        self.set_extent(extent_of_paths([path], MARGIN_M))
        super().show_trial(device, path, tip)
        self._show_inset()

    def show_handle(self, tip: Point | None, taken: bool | None = None, force_N: float = 0.0) -> None:
        super().show_handle(tip, taken, force_N)
        self._show_inset()

    def _show_inset(self) -> None:
        """The linkage in its corner; away while the handle would lie under it."""
        corner = QRectF(self.inset.geometry()).marginsAdded(QMarginsF(*4 * (self.handle_px,)))
        under = self.tip is not None and corner.contains(self.to_screen(self.tip))
        shown = LINKAGE in self.shown and self.instant is not None and not under
        if shown == self.inset.isHidden():
            self.inset.setVisible(shown)
            self.repaint_still()

    def rest(self, tip: Point) -> None:
        super().rest(tip)
        self.inset.rest(tip)

    def show_gap(self, gap_m: float) -> None:
        """The half-width of the band without control."""
        if gap_m != self.gap_m:
            self.gap_m = gap_m
            self.repaint_still()

    def show_layer(self, layer: str, shown: bool) -> None:
        super().show_layer(layer, shown)
        self._show_inset()

    def add(self, rows: np.ndarray, taken: bool | None = None) -> None:
        super().add(rows, taken)
        if self.inset.isVisible():
            self.inset.add(rows)

    def word(self) -> None:
        super().word()
        self.inset.word()

    def resizeEvent(self, event: QResizeEvent) -> None:
        wide = int(min(INSET_PX, 0.24 * self.width(), 0.4 * self.height()))
        self.inset.setGeometry(self.width() - wide - 10, 10, wide, int(0.9 * wide))
        super().resizeEvent(event)

    def solid(self, now: Instant) -> np.ndarray:
        """The linkage's corner too: it may come back at any time."""
        corner = [points_in(QRectF(self.inset.geometry()))] if LINKAGE in self.shown else []
        return np.concatenate([super().solid(now), *corner])

    @property
    def path_px(self) -> float:
        return max(super().path_px, self.gap_m * self.scale if GAP in self.shown else 0.0)

    def room(self) -> QRectF:
        return QRectF(self.rect()).adjusted(4.0, HEAD_PX, -4.0, -4.0)

    def paint_under_path(self, painter: QPainter) -> None:
        if GAP in self.shown and self.gap_m > 0.0 and len(self.outline):
            way, stroker = QPainterPath(), QPainterPathStroker()
            way.addPolygon(QPolygonF([self.to_screen(place) for place in self.outline]))
            stroker.setWidth(2.0 * self.gap_m * self.scale)
            stroker.setCapStyle(Qt.PenCapStyle.FlatCap)
            painter.setPen(pen(theme.CAUTION, 1.0, 0.5))
            painter.setBrush(shade(theme.CAUTION, 0.10))
            painter.drawPath(stroker.createStroke(way).simplified())
        right, low = self.width() - 20.0, self.height() - 14.0
        painter.setPen(pen(theme.QUIET, 1.5))
        painter.drawLine(QPointF(right - 0.02 * self.scale, low), QPointF(right, low))
        write(painter, QPointF(right - 0.01 * self.scale, low - 12.0), "2 cm", theme.NORMAL, False, theme.QUIET)
        if not self.inset.isHidden():
            painter.setPen(pen(theme.LINE, 2.0))
            painter.drawRect(self.inset.geometry())

    def paint_under_handle(self, painter: QPainter) -> None:
        if self.tip is not None and self.instant is not None:
            self.paint_forces(painter, self.instant)

    def paint_over_handle(self, painter: QPainter) -> None:
        now = self.instant
        if now is not None and self.labelled and self.labels.cover(self.marks(now), self.solid(now), self.room()):
            self.place_labels(now)  # something has moved under one of them
        super().paint_over_handle(painter)
