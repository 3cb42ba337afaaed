"""The constants of one five-bar and its brakes, as the kernels read them (SI units, radians).

Joint order everywhere: A, E, B, C. Arm 1 is A-E-D, arm 2 is B-C-D, D is the tip. A brake or stop acts on the rate of
one of seven places: A, E, B, C; D, the angle between the distal links, which has a stop but no brake; and the elbows E
and C once more, for their stops, where the brake of a coupling has their place.
"""

from typing import NamedTuple

import numpy as np

from core.torque_table import FROM, NO_CURVE

JOINTS = "AEBC"
A, E, B, C, D, STOP_E, STOP_C = range(7)
PLACES = 7


class Arm(NamedTuple):
    """One arm: base joint, proximal link, elbow, distal link.

    With e1 = elbow - base, e2 = tip - elbow, rates w1, w2 of the two links (absolute), its kinetic energy is
    1/2 proximal w1^2 + (coupling e1.e2 - rotor) w1 w2 + 1/2 distal w2^2.
    """

    base_x: float
    base_y: float
    length_1: float  # m, proximal link
    length_2: float  # m, distal link
    side: float  # +1: the elbow lies to the left of base -> tip; -1: to the right
    proximal: float  # kg m2: I_1 + m_1 c_1^2 + (m_elbow + m_2) L_1^2 + rotors of base, elbow, couplings
    distal: float  # kg m2: I_2 + m_2 c_2^2 + elbow rotor
    coupling: float  # kg: m_2 c_2 / L_2
    rotor: float  # kg m2: rotor inertia at a braked elbow (it turns at w2 - w1), else 0


class Mechanism(NamedTuple):
    """The linkage: two arms, the tip, and where it must stop."""

    arm_1: Arm
    arm_2: Arm
    tip_mass: float  # kg, point mass at D
    coaxial: bool  # bases coincide: g_E and g_C are parallel at every tip
    margin: float  # hard stop: |sin| of both elbows and of the angle between the distal links
    theta_low: np.ndarray  # (4,) rad, -inf where there is no stop
    theta_high: np.ndarray  # (4,) rad, +inf where there is no stop
    has_theta_stops: bool
    coupled: int  # bit i: brake i acts on a combination of the base rates instead of its joint
    combination: np.ndarray  # (4, 2) that combination of the rates of A and B; else 0
    coupling: float  # kg m2, by their rotors: kinetic energy coupling omega_A omega_B beside that of the arms
    lines: int  # bit PLACES i + j: the rows of places i and j are parallel at every tip


def parallel_rows(combination: np.ndarray, coupled: int, coaxial: bool) -> int:
    """`Mechanism.lines` for combinations (4, 2) of the base rates.

    Combinations with one ratio are parallel. On coaxial bases elbows and D depend on the distance from base to tip
    alone, and so does a combination that does not change when the whole linkage turns: A + B = 0.
    """
    rows: list[tuple[float, float] | None] = []  # each as a combination; elbows and D are none where bases are apart
    for i in range(PLACES):
        if i < 4 and coupled >> i & 1:
            rows.append((float(combination[i, 0]), float(combination[i, 1])))
        else:
            rows.append({A: (1.0, 0.0), B: (0.0, 1.0)}.get(i, (1.0, -1.0) if coaxial else None))
    found = 0
    for i, row in enumerate(rows):
        for j, other in enumerate(rows):
            if i != j and row and other and row[0] * other[1] == row[1] * other[0]:
                found |= 1 << (PLACES * i + j)
    return found


class Brakes(NamedTuple):
    """The MR brake of each joint, Eqs. (2), (4) and the backlash; arrays in joint order, zero where there is none."""

    present: np.ndarray  # (4,) 1.0 where the joint carries a brake
    current_max: np.ndarray  # (4,) A
    k: np.ndarray  # (4, 5) N m per A^.., Eq. (2)
    knee: np.ndarray  # (4,) A, the 0.2 A of Eq. (2); below 0: the brake has a torque table
    omega_0: np.ndarray  # (4,) rad/s, Eq. (4)
    floor: np.ndarray  # (4,) rad/s: Eq. (4) is extrapolated down to here, then constant
    rise: np.ndarray  # (4, 7) s: a_avg, a_1 .. a_6 of Eq. (4), rising (rates in rpm inside the formula)
    fall: np.ndarray  # (4, 7) s: the same, falling
    play: np.ndarray  # (4,) rad, width of the backlash
    curve: np.ndarray = NO_CURVE  # (4, PIECES, 4), of a torque table in place of Eq. (2); infinite: none

    def stronger(self, strength: float) -> "Brakes":
        """The same brakes with `strength` times the torque at each current."""
        used = np.isfinite(self.curve) & (np.arange(4) != FROM)
        return self._replace(k=strength * self.k, curve=self.curve * np.where(used, strength, 1.0))


def no_brakes() -> Brakes:
    """No joint carries a brake: all numbers zero."""
    wide = {"k": 5, "rise": 7, "fall": 7}
    arrays = [np.zeros((4, wide[name]) if name in wide else 4) for name in Brakes._fields[:-1]]
    return Brakes._make([*arrays, NO_CURVE.copy()])
