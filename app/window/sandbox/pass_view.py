"""A pass of Try: the path with the band in which nothing guides, both forces, the whole linkage in a corner."""

from PySide6.QtCore import QMarginsF, QPointF, QRectF, Qt
from PySide6.QtGui import QPainter, QPainterPath, QPainterPathStroker

from app.window.canvas.force_view import FORCES, LINKAGE, TRAIL, ForceView
from app.window.canvas.layers import Point, extent_of_paths
from app.window.canvas.path_marks import Sizes, polygon
from app.window.widgets import theme
from app.window.widgets.theme import COLOURS, pen, shade, write
from core.device import Device
from core.path import PathFile

MARGIN_M = 0.03  # around the path, at least: the hand has its whole force 2 cm from the handle
GAP = "gap"
#: layer -> its key, what it shows
LAYERS = {
    TRAIL: ("T", "Where the handle has been in this pass"),
    FORCES: ("W", "The forces of your hand and of the brakes"),
    GAP: ("G", "The band along the path in which nothing guides"),
    LINKAGE: ("L", "The whole linkage; its brakes in the colour of what they do"),
}
ROOM = QMarginsF(16.0, 70.0, 16.0, 22.0)  # px: at the top and at the foot the page writes


class PassView(ForceView):
    """The path, the gap around it, the handle, the hand's spring, both forces; the whole linkage in a corner."""

    def __init__(self) -> None:
        sizes = Sizes(path=5.0, ring_pen=4.0, handle=12.0, pointer=7.0, trail=2.5)
        super().__init__(QRectF(-0.2, 0.3, 0.4, 0.2), ROOM, sizes, follows_mouse=True)
        self.shown = {TRAIL, FORCES, GAP}
        self.gap_m = 0.0
        self.under_path = [self._paint_gap, self._paint_scale, *self.under_path]
        self.under_handle = self.of_instant(self.paint_forces)

    def show_trial(self, device: Device, path: PathFile, tip: Point) -> None:
        self.set_extent(extent_of_paths([path], MARGIN_M))
        super().show_trial(device, path, tip)

    def show_gap(self, gap_m: float) -> None:
        """The half-width of the band without control."""
        if gap_m != self.gap_m:
            self.gap_m = gap_m
            self.repaint_still()

    def _paint_gap(self, painter: QPainter) -> None:
        if GAP in self.shown and self.gap_m > 0.0 and len(self.outline):
            way, stroker = QPainterPath(), QPainterPathStroker()
            way.addPolygon(polygon(self.pixels(self.outline)))
            stroker.setWidth(2.0 * self.gap_m * self.scale)
            stroker.setCapStyle(Qt.PenCapStyle.FlatCap)
            painter.setPen(pen(COLOURS.caution, 1.0, 0.5))
            painter.setBrush(shade(COLOURS.caution, 0.10))
            painter.drawPath(stroker.createStroke(way).simplified())

    def _paint_scale(self, painter: QPainter) -> None:
        if self.path is not None:
            right = (self.width() if self.inset.isHidden() else self.inset.x()) - 20.0
            low = self.height() - 14.0
            painter.setPen(pen(COLOURS.quiet, 1.5))
            painter.drawLine(QPointF(right - 0.02 * self.scale, low), QPointF(right, low))
            write(painter, QPointF(right - 0.01 * self.scale, low - 12.0), "2 cm", theme.NORMAL, False, COLOURS.quiet)
