"""What one tick of a device says, worked out once for all that is drawn from it."""

import math
from typing import NamedTuple

import numpy as np

from app.window.painting.extent import Point, joints_at
from app.window.painting.layers import Wedge, force_map, wedge
from core import tick_log
from core.device import Device
from core.mechanism import JOINTS

OFF, SLIPPING, STUCK = "off", "slipping", "stuck"


class Doing(NamedTuple):
    """What a brake does: off (without current), slipping or stuck; its torque, N m, >= 0."""

    state: str = OFF
    torque: float = 0.0


def doing(device: Device, rows: np.ndarray) -> dict[str, Doing]:
    """What each brake did during most of some ticks (n, WIDTH): joint -> state and mean torque. None: all off."""
    found = {}
    for joint in device.braked:
        i = JOINTS.index(joint)
        on = rows[:, tick_log.CURRENT + i] > 0.0
        if 2 * np.count_nonzero(on) <= len(rows):
            found[joint] = Doing()
            continue
        stuck = (rows[on, tick_log.STUCK].astype(int) >> i & 1).mean() > 0.5
        found[joint] = Doing(STUCK if stuck else SLIPPING, float(np.abs(rows[on, tick_log.TORQUE + i]).mean()))
    return found


class Instant:
    """A device with its tip at a place (m); with a tick (tick_log.WIDTH,) also velocity and forces.

    blind: nothing that would tell the controllers apart; the brakes then seem to do nothing.
    """

    def __init__(self, device: Device, tip: Point, tick: np.ndarray | None = None, blind: bool = False) -> None:
        self.device, self.tip, self.blind = device, tip, blind
        self.running = tick is not None
        self.joints = joints_at(device.mechanism, tip)  # m; empty out of reach
        self.g = force_map(device, *tip)
        now = np.zeros(tick_log.WIDTH).tolist() if tick is None else tick.tolist()
        self.velocity: Point = (now[tick_log.TIP_VX], now[tick_log.TIP_VY])  # m/s
        self.hand: Point = (now[tick_log.HAND_FX], now[tick_log.HAND_FY])  # N
        self.brakes: Point = (0.0, 0.0)  # N, what they exert on the tip
        self.wanted: Point | None = None  # m, where the hand wants the tip to be
        self._stuck = int(now[tick_log.STUCK])
        if tick is None:
            return
        wanted = (now[tick_log.TARGET_X], now[tick_log.TARGET_Y])
        self.wanted = wanted if 1e-3 < math.dist(wanted, tip) < 1.0 else None
        if not blind:
            x, y = (self.g.T @ now[tick_log.TORQUE : tick_log.TORQUE + 4]).tolist()
            self.brakes = (x, y)

    def reachable(self) -> Wedge | None:
        """The forces that the brakes can exert against the present motion; None at rest, and while blind: with the
        stuck ones it would tell the controllers apart, without them it would be wrong."""
        return wedge(self.device, self.g, *self.velocity, self._stuck) if self.running and not self.blind else None
