"""From encoder counts to the pose of the linkage, with any two or four encoders.

Each encoder says that the tip lies on a circle: one at a base, around its elbow with the distal link as radius; one at
an elbow, around its base with the arm's reach as radius. Two encoders of one arm give the tip by themselves; two of
different arms, where their circles meet: of the two places the one whose elbows bulge as the device's do, and then the
nearer to the last. Four give the tip twice; it is the middle, and the distance between the two says whether they agree.
"""

import math
from typing import NamedTuple

import numpy as np

from core.device import Device
from core.files import InputError
from core.linkage import joint_angles
from core.mechanism import Arm
from core.simulator.state import pack_mechanism
from core.workspace import tip_is_free

TURN = 2.0 * math.pi
OPEN_M = 0.002  # four encoders whose two tips are further apart than this do not belong to one closed chain
A, E, B, C = range(4)
Circle = tuple[float, float, float]  # centre x, y, radius, m


class Pose(NamedTuple):
    """The pose of the linkage."""

    tip: tuple[float, float]  # m
    theta: tuple[float, float, float, float]  # rad
    closed: bool  # False: these counts match no position; tip and theta are the last ones


class PoseSensing:
    """Converts encoder counts, in the order A, E, B, C, to poses; remembers the last pose."""

    def __init__(self, device: Device, joints: tuple[int, ...], counts_per_rev: tuple[int, ...]) -> None:
        """joints: with an encoder; counts_per_rev (4,). InputError if they do not determine the tip."""
        if joints == (E, C) and device.mechanism.coaxial:
            raise InputError(
                f"device {device.name}: encoders at E and C alone do not say where the tip is (the bases coincide)"
            )
        if len(joints) not in (2, 4):
            raise InputError(f"device {device.name}: two or four encoders are needed, not {len(joints)}")
        self.joints = joints
        self._device = device
        self._arms = (device.mechanism.arm_1, device.mechanism.arm_2)
        self._mechanism = pack_mechanism(device.mechanism)[0]
        self._per_rev = counts_per_rev
        self._theta = np.zeros(4)
        self._last: Pose | None = None

    def counts_at(self, tip: tuple[float, float]) -> tuple[int, ...]:
        """The counts of the encoders with the handle at a tip (m); 0: no encoder."""
        joint_angles(self._mechanism, tip[0], tip[1], self._theta)
        turns = (self._theta / TURN).tolist()
        return tuple(round(turns[i] * self._per_rev[i]) if i in self.joints else 0 for i in range(4))

    def pose(self, counts: tuple[int, ...]) -> Pose:
        """The pose at the counts of `joints`, in that order."""
        angle = {i: TURN * n / self._per_rev[i] for i, n in zip(self.joints, counts, strict=True)}
        apart = 0.0
        if len(angle) == 4:
            first, second = self._tip_by_arm(0, angle), self._tip_by_arm(1, angle)
            apart = math.dist(first, second)
            tip: tuple[float, float] | None = (0.5 * (first[0] + second[0]), 0.5 * (first[1] + second[1]))
        elif self.joints == (A, E) or self.joints == (B, C):
            tip = self._tip_by_arm(self.joints[0] // 2, angle)
        else:
            tip = self._intersection(*(self._circle(i, angle[i]) for i in self.joints))
        if tip is None or apart > OPEN_M:
            last = self._last or Pose((math.nan, math.nan), (math.nan,) * 4, False)
            return last._replace(closed=False)
        joint_angles(self._mechanism, tip[0], tip[1], self._theta)
        a, e, b, c = self._theta.tolist()
        self._last = Pose(tip, (a, e, b, c), True)
        return self._last

    def forget(self) -> None:
        """Forget the last pose: the encoders were set, or the link was lost."""
        self._last = None

    def _tip_by_arm(self, arm: int, angle: dict[int, float]) -> tuple[float, float]:
        """The tip by both encoders of one arm."""
        x, y, radius = self._circle(2 * arm, angle[2 * arm])
        elbow = angle[2 * arm] + angle[2 * arm + 1]
        return x + radius * math.cos(elbow), y + radius * math.sin(elbow)

    def _circle(self, joint: int, angle: float) -> Circle:
        """The circle that the tip lies on."""
        arm: Arm = self._arms[joint // 2]
        if joint % 2 == 0:
            return (
                arm.base_x + arm.length_1 * math.cos(angle),
                arm.base_y + arm.length_1 * math.sin(angle),
                arm.length_2,
            )
        square = arm.length_1**2 + arm.length_2**2 + 2.0 * arm.length_1 * arm.length_2 * math.cos(angle)
        return arm.base_x, arm.base_y, math.sqrt(max(square, 0.0))

    def _intersection(self, first: Circle, second: Circle) -> tuple[float, float] | None:
        """The intersection of two circles on the side of the device's elbows; None: there is none."""
        dx, dy = second[0] - first[0], second[1] - first[1]
        square = dx * dx + dy * dy
        if square == 0.0:
            return None
        along = 0.5 + 0.5 * (first[2] ** 2 - second[2] ** 2) / square
        across = first[2] ** 2 / square - along * along
        if across < 0.0:
            return None
        across = math.sqrt(across)
        places = [
            (first[0] + along * dx - side * across * dy, first[1] + along * dy + side * across * dx) for side in (1, -1)
        ]
        fitting = [p for p in places if self._elbows_fit(p, first, second)]
        if not fitting:
            return None
        if self._last is None:
            free = [p for p in fitting if bool(tip_is_free(self._device.mechanism, *p))]
            return max(free or fitting, key=lambda p: p[1])
        last = self._last.tip
        return min(fitting, key=lambda p: math.dist(p, last))

    def _elbows_fit(self, tip: tuple[float, float], *circles: Circle) -> bool:
        """Whether the elbows shown by encoders at the bases lie on the device's sides."""
        for joint, (x, y, _) in zip(self.joints, circles, strict=True):
            if joint % 2 == 0:
                arm = self._arms[joint // 2]
                cross = (tip[0] - arm.base_x) * (y - arm.base_y) - (tip[1] - arm.base_y) * (x - arm.base_x)
                if cross * arm.side < 0.0:
                    return False
        return True


def load_kernels(device: Device) -> None:
    """Compile or load what a pose needs, before samples flow."""
    joint_angles(pack_mechanism(device.mechanism)[0], 0.0, 0.0, np.zeros(4))
