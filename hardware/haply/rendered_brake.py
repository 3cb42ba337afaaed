"""One motor as a brake: an elasto-plastic hold, and a guard that never lets it give more energy than a fixed sum.

The hold is Hayward and Armstrong's (2000): a spring between the joint and an anchor, which is dragged along once the
spring's torque would exceed what the brake holds now. Our choice over Dahl's equation: it depends on displacements
alone, so it needs no velocity (which steps of 1.3 mrad a count do not give in a millisecond), and below its largest
torque its anchor does not move, where Dahl's creeps with every tremor: here only the guard makes it slip.

A spring that is sampled gives energy: its torque belongs to a place that the joint has left. The board applies a torque
and reads its encoders at once (`wire`), so the work of each torque between two readings is known but for the encoder's
step, and the guard keeps account of it (time-domain passivity, Hannaford and Ryu 2002). It books the worst that the
readings allow. With q the encoder's step, D the largest turn in a tick, tau a torque:

    true work of all torques <= sum of tau (turn that is read) + sum of |change of tau| q / 2 + |last tau| q / 2

A torque answers the last reading and acts from the next one on, so there must be credit for the one that acts now, over
a turn that may be read as D + q, and for the next; with their shares of q / 2 that is |acting| (D + 1.5 q) and
|next| (D + 2 q). The credit at the start, `allowance`, is that of two ticks at full torque; it rises with what the hand
spends, to no more than what the hold's spring has stored above it. So

    energy given since any moment of a trial <= allowance + energy that the hold had stored then,

whatever the hand and the commands do, as long as no joint turns further than D between two readings. Where credit is
short the brake holds less, and slips.
"""

import math

from core.tick_log import TICK_S

FLOOR = 0.05  # share of the allowance that a debt leaves: with none the brake could never earn again. Our choice


class RenderedBrake:
    """A motor's torque, reading by reading. Angles in rad, torques in N m, energies in J."""

    def __init__(self, torque_max: float, stiffness: float, speed_max: float, step: float) -> None:
        """stiffness: of the hold, N m/rad; speed_max: at which its driver stops it, rad/s; step: of the encoder."""
        self._stiffness, self._step = stiffness, step
        self.most_turned = speed_max * TICK_S
        self._acting_turn, self._next_turn = self.most_turned + 1.5 * step, self.most_turned + 2.0 * step
        self.allowance = torque_max * (self._acting_turn + self._next_turn)
        self.credit = self.allowance
        self.given = 0.0  # net energy given so far by the readings (below zero: taken)
        self.guarded = 0  # torques that the guard made smaller
        self.beyond = 0.0  # energy that a late tick, or a joint that was too fast, gave beyond the credit
        self._acting = 0.0  # torque between the last reading and the next
        self._angle: float | None = None  # last reading
        self._anchor = 0.0

    def begin(self) -> None:
        """Begin a trial with the full allowance."""
        self.credit = self.allowance

    @property
    def stored(self) -> float:
        """Energy of the hold's spring."""
        return 0.5 * self._stiffness * (self._angle - self._anchor) ** 2 if self._angle is not None else 0.0

    def read(self, angle: float, begins: float) -> None:
        """Take a reading, from which on the torque `begins` acts, and book the work of the torque before it."""
        if self._angle is None:
            self._anchor = angle
        else:
            self._book(self._acting * (angle - self._angle))
        self._angle, self._acting = angle, begins

    def read_after_loss(self, angle: float, largest: float) -> None:
        """Take a reading after lost ones, no torque acting now, and book the worst work of torques up to `largest`."""
        if self._angle is not None:
            self._book(largest * abs(angle - self._angle))
        self._angle = self._anchor = angle
        self._acting = 0.0

    def _book(self, work: float) -> None:
        self.given += work
        self.credit -= work
        if self.credit < 0.0:
            self.beyond -= self.credit
            self.credit = FLOOR * self.allowance

    def torque(self, holds: float) -> float:
        """The torque (N m) to act from the next reading on, of a brake that now holds `holds`."""
        if self._angle is None:
            return 0.0
        affordable = max(self.credit - abs(self._acting) * self._acting_turn, 0.0) / self._next_turn
        most = min(holds, affordable)
        longest = most / self._stiffness
        stretched = self._angle - self._anchor
        if abs(stretched) > longest:
            self.guarded += affordable < holds
            stretched = math.copysign(longest, stretched)
            self._anchor = self._angle - stretched
        coming, half = 0.0 - self._stiffness * stretched, 0.5 * self._step
        self.credit -= half * abs(coming - self._acting)
        self.credit = min(self.credit, self.allowance + self.stored - half * abs(self._acting))
        return coming
