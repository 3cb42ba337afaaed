"""The whole linkage on its path, small: in a corner of a larger view, or by itself."""

import math
from collections.abc import Mapping

from PySide6.QtCore import QMarginsF, QRect, QRectF, Qt
from PySide6.QtGui import QPainter

from app.window.canvas import marks
from app.window.canvas.layers import Doing, Instant, Point, extent_of_linkages
from app.window.canvas.path_marks import Sizes
from app.window.canvas.plane import Plane
from core.device import Device
from core.path import PathFile

ARM_PX = 7.0  # width of an arm
SEEN_PX = 0.5  # a smaller movement of the handle cannot be seen


class SmallView(Plane):
    """A picture that hears neither pointer nor keys; hidden until there is something to show."""

    def __init__(self, sizes: Sizes) -> None:
        super().__init__(QRectF(-0.2, 0.2, 0.4, 0.3), sizes, QMarginsF(15.0, 8.0, 15.0, 15.0), follows_mouse=False)
        self.instant: Instant | None = None
        self.doing: Mapping[str, Doing] | None = {}
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setMinimumSize(0, 0)
        self.under_handle = [self._paint_linkage]
        self.hide()

    def show_trial(self, device: Device, path: PathFile, tip: Point) -> None:
        """Another device or path, with the handle at `tip`, brakes off."""
        self.set_extent(extent_of_linkages([device], [path]))
        self.show_path(path)
        self.instant = None
        self.show_instant(Instant(device, tip), {})

    def show_instant(self, now: Instant, doing: Mapping[str, Doing] | None) -> None:
        """The device at a moment, and what its brakes do; None: nobody may see that."""
        before = self.instant
        if before is None or doing != self.doing or math.dist(now.tip, before.tip) * self.scale > SEEN_PX:
            self.instant, self.doing = now, doing
            self.update()
            self.show_handle(now.tip)

    def moving_box(self) -> QRect:
        return self.rect()

    def _paint_linkage(self, painter: QPainter) -> None:
        if (now := self.instant) is not None:
            at = {joint: self.to_screen(place) for joint, place in now.joints.items()}
            marks.paint_arms(painter, at, ARM_PX, 2.0)
            marks.paint_joints(painter, marks.rings_of(at, now.device.labels), now.device.labels, self.doing)
