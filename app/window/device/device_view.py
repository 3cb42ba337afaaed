"""The device as its encoders have it now: whoever moves the handle sees whether the picture follows."""

import math

from PySide6.QtCore import QMarginsF, QPointF
from PySide6.QtGui import QPainter, QPen

from app.ipc import messages as m
from app.window.canvas import marks
from app.window.canvas.force_view import FORCE_COLOUR, HAND
from app.window.canvas.layers import Instant, extent_of_linkages
from app.window.canvas.path_marks import AT_DESK, paint_circle
from app.window.canvas.small_view import ARM_PX, SmallView
from app.window.widgets import theme
from app.window.widgets.parts import wrapped_label
from app.window.widgets.theme import COLOURS
from core.mechanism import JOINTS
from experiments.protocol import Protocol, home_of

FOLLOWS = "Move the handle: the picture must follow. Dashed ring: the jig. Ringed letters: joints with an encoder."
UNHOMED = "Not homed: drawn with the handle in its jig, the dashed ring."
STANDS = "A trial is running: this is the device before it. The Run page shows it now."
NO_DEVICE = "Nothing is connected."
JIG_PX, ANGLE_PX = 14.0, 24.0  # radius of the jig's ring; from a joint down to its angle


class DeviceView(SmallView):
    """The linkage with the letters of the joints that have an encoder, their angles, and the force of the hand."""

    def __init__(self) -> None:
        super().__init__(AT_DESK)
        self.under_handle = [self._paint_device]
        self._keep_free = QMarginsF(30.0, 20.0, 30.0, ANGLE_PX + 16.0)
        self.caption = wrapped_label("", "quiet", theme.SMALL)
        self._status, self._jig = m.DeviceStatus(), (0.0, 0.0)  # m

    def show_device(self, status: m.DeviceStatus | None, protocol: Protocol, runs: bool) -> None:
        """What the board has reported; None: no device is reached. runs: a trial does, in which it reports nothing."""
        device = next((device for device in protocol.devices if status and device.name == status.device), None)
        self.show()
        if device is None or status is None:
            self.instant = None
            self.show_handle(None)
            self.caption.setText("")
            self.update()
            return
        self._status, self._jig = status, home_of(device, protocol.paths)
        known = status.homed and math.isfinite(sum(status.tip))
        if self.instant is None or self.instant.device is not device:
            self.set_extent(extent_of_linkages([device], protocol.paths.values()))
            self.instant = None  # the other one's
        self.caption.setText(STANDS if runs else FOLLOWS if known else UNHOMED)
        self.show_instant(Instant(device, status.tip if known else self._jig), {})
        self.update()

    def _paint_device(self, painter: QPainter) -> None:
        if (now := self.instant) is None:
            middle = QPointF(self.rect().center())
            theme.write(painter, middle, NO_DEVICE, theme.NORMAL, False, COLOURS.quiet)
            return
        status, places = self._status, now.joints
        at = {joint: self.to_screen(place) for joint, place in places.items()}
        line = QPen(theme.pen(COLOURS.accent, 2.0))  # its own: the other one is kept for everybody
        line.setDashPattern([3.0, 3.0])
        paint_circle(painter, self.to_screen(self._jig), JIG_PX, line)
        letters = {joint: joint for joint in JOINTS if joint in status.encoders}
        rings = marks.rings_of(at, letters)
        marks.paint_arms(painter, at, ARM_PX, 2.0)
        marks.paint_joints(painter, rings, letters, {})
        if status.homed and len(status.theta) == len(JOINTS) and rings:
            for joint, angle in zip(JOINTS, status.theta, strict=True):
                below = rings[joint] + QPointF(0.0, ANGLE_PX)
                theme.write(painter, below, f"{math.degrees(angle):.0f}°", theme.SMALL, False, COLOURS.quiet)
        if status.force_channels and all(map(math.isfinite, status.hand_force)):
            reach = marks.arrow_of(status.hand_force)
            marks.paint_arrow(painter, self.to_screen(now.tip), reach, FORCE_COLOUR[HAND], self.sizes.path)
