"""The device as its encoders have it now: whoever moves the handle sees whether the picture follows."""

import math

from PySide6.QtCore import QMarginsF, QPointF, QRectF, Qt
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

MARKS = "Dashed ring: the jig. Ring: a brake. Square: an encoder. Numbers: the joints' angles."
FOLLOWS = f"Move the handle: the picture must follow. {MARKS}"
UNHOMED = "Not homed: drawn with the handle in its jig, the dashed ring. Ring: a brake. Square: an encoder."
STANDS = "A trial is running: this is the device before it. The Run page shows it now."
NO_DEVICE = "Nothing is connected."
JIG_PX, ANGLE_PX, SQUARE_PX = 14.0, 26.0, 13.5  # radius of the jig's ring; from a joint to its angle; half a square


class DeviceView(SmallView):
    """The linkage with its brakes and encoders, the joints' angles, and the force of the hand."""

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
        letters = {joint: joint for joint in status.encoders} | dict(now.device.labels)
        rings = marks.rings_of(at, letters)
        marks.paint_arms(painter, at, ARM_PX, 2.0)
        marks.paint_joints(painter, rings, now.device.labels, {})
        for joint in filter(rings.__contains__, status.encoders):
            painter.setPen(theme.pen(COLOURS.text, 1.5))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawRect(QRectF(-SQUARE_PX, -SQUARE_PX, 2.0 * SQUARE_PX, 2.0 * SQUARE_PX).translated(rings[joint]))
            if joint not in now.device.labels:
                theme.write(
                    painter, rings[joint] - QPointF(0.0, SQUARE_PX + 9.0), joint, theme.SMALL, True, COLOURS.quiet
                )
        if status.homed and len(status.theta) == len(JOINTS) and rings:
            for joint, angle in zip(JOINTS, status.theta, strict=True):
                below = rings[joint] + QPointF(0.0, ANGLE_PX)
                theme.write(painter, below, f"{math.degrees(angle):.0f}°", theme.SMALL, False, COLOURS.quiet)
        if status.force_channels and all(map(math.isfinite, status.hand_force)):
            reach = marks.arrow_of(status.hand_force)
            marks.paint_arrow(painter, self.to_screen(now.tip), reach, FORCE_COLOUR[HAND], self.sizes.path)
