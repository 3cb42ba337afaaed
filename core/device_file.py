"""The format of device files: their keys, and the rules that one file can break by itself.

Lengths in m, masses in kg, angles in rad (joint order A, E, B, C).
"""

import math
import warnings
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from core.files import (
    NotNegative,
    Pair,
    Positive,
    StrangeInput,
    Table,
    choice,
    is_assumed,
    parse_toml,
    read_text,
    shipped_or_file,
    text_of_form,
)
from core.mechanism import JOINTS
from core.ranges import (
    TIME_CONSTANT,
    TORQUE,
    Angle,
    BodyMass,
    Coordinate,
    Current,
    Inertia,
    LagTime,
    Length,
    Place,
    TableCurrent,
    Torque,
)
from core.torque_table import torque_curve, why_no_table

SHIPPED_FOLDER = Path(__file__).resolve().parent / "brake_files"

#: N m. Our choice: where the two branches of Eq. (2) differ by more at the knee, it is moved to where they meet, or
#: k_5 is what makes them meet (`BrakeFile.equation_2`): with a jump K has no inverse.
KNEE_TOLERANCE = 1e-6
KNEE_MOVED = 0.5  # by at most this share of itself
JUMP_SAID = 0.01  # of the torque at the knee: a larger jump is said


class TimeConstant(Table, frozen=True):
    """Eq. (4): a_avg at omega_0 and above, a_1 .. a_6 below."""

    a_avg_s: LagTime  # time constant at `omega_0_rpm` and above
    a: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # a_1 .. a_6; all 0: a_avg

    def __post_init__(self) -> None:
        if not any(self.a):
            msgspec.structs.force_setattr(self, "a", (0.0, 0.0, 0.0, 0.0, 0.0, self.a_avg_s))

    def slower(self, factor: float) -> "TimeConstant":
        """The same, `factor` times as long."""
        a1, a2, a3, a4, a5, a6 = (factor * number for number in self.a)
        return TimeConstant(a_avg_s=factor * self.a_avg_s, a=(a1, a2, a3, a4, a5, a6))

    def below_omega_0(self, current: float, speed_log2: float) -> float:
        """Time constant (s), Eq. (4) below omega_0; speed_log2 is the paper's omega_L: log2 of rpm."""
        a1, a2, a3, a4, a5, a6 = self.a
        w = speed_log2
        return a6 + a2 * w + a4 * w * w + current * (a1 + a3 * w + a5 * w * w)


class BrakeFile(Table, frozen=True, kw_only=True):
    """A brake file. Where no current commands the brake, `command_unit` names the unit: currents are then in that."""

    name: Annotated[str, msgspec.Meta(min_length=1)]  # in tables and reports
    current_max_A: Current  # largest current
    k: tuple[float, Torque, float, float, float] | None = None  # [k_1, .., k_5] of Eq. (2); this or `torque_table`
    torque_table: tuple[tuple[TableCurrent, Torque], ...] | None = None  # [[A, N m], ..]: 2 to 24 rising points from 0
    knee_A: NotNegative = 0.2  # of Eq. (2)
    omega_0_rpm: Positive = 8.0  # of Eq. (4); assumed
    floor_rpm: Positive = 0.125  # speed below which the time constant no longer changes; assumed
    rise: TimeConstant
    fall: TimeConstant
    backlash_deg: Annotated[float, msgspec.Meta(ge=0, lt=360)] = 0.0  # inside it only the torque without current acts
    provenance: str = ""  # where the numbers come from
    command_unit: Annotated[str, text_of_form("[!-~ ]{1,12}", "1 to 12 characters of plain text")] = "A"  # of currents

    def __post_init__(self) -> None:
        if (self.k is None) == (self.torque_table is None):
            raise ValueError("either k or torque_table is required, and not both")
        if self.torque_table is not None:
            if reason := why_no_table(self.torque_table, self.current_max_A):
                raise ValueError(reason)
            if reason := TORQUE.refusal(self.torque_gain(self.current_max_A)):
                raise ValueError(f"torque_table: the torque at current_max_A {reason}")
        else:
            doubt = self._join_at_knee()
            self._check_torque_gain()
            if doubt:
                warnings.warn(doubt, StrangeInput, stacklevel=2)
        if self.floor_rpm > self.omega_0_rpm:
            raise ValueError(f"floor_rpm ({self.floor_rpm:g}) must not exceed omega_0_rpm ({self.omega_0_rpm:g})")
        for key, constant in (("rise", self.rise), ("fall", self.fall)):
            self._check_time_constant(key, constant)

    @property
    def assumed(self) -> bool:
        """Whether some of its numbers are assumed."""
        return is_assumed(self.provenance)

    def changed(self, lag: float, drag: float, torque: float, backlash_deg: float | None) -> "BrakeFile":
        """The brake with factors on its time constants, on its torque without current (drag), and on what current adds.

        The drag is there beside the field's torque: without it K is less by k_2 at every current. backlash_deg: None:
        as it is.
        """
        k1, k2, k3, k4, k5 = self.equation_2
        more = (drag - torque) * k2
        play = self.backlash_deg if backlash_deg is None else backlash_deg
        rise, fall = self.rise.slower(lag), self.fall.slower(lag)
        if self.torque_table is None:
            k, table = (torque * k1, drag * k2, torque * k3, torque * k4, torque * k5 + more), None
        else:
            k, table = None, tuple((current, torque * held + more) for current, held in self.torque_table)
        return msgspec.structs.replace(self, k=k, torque_table=table, rise=rise, fall=fall, backlash_deg=play)

    def torque_gain(self, current: float) -> float:
        """Torque gain K (N m), Eq. (2), of the file (the kernels have their own, on arrays)."""
        if self.torque_table is not None:
            curve = torque_curve(self.torque_table)
            square, slope, torque, begin = curve[np.searchsorted(curve[:, 0], current, side="right") - 1, ::-1].tolist()
            return (square * (current - begin) + slope) * (current - begin) + torque
        k1, k2, k3, k4, k5 = self.equation_2
        return k1 * current + k2 if current < self.knee_A else (k3 * current + k4) * current + k5

    @property
    def equation_2(self) -> tuple[float, float, float, float, float]:
        """k_1 .. k_5; of a table only k_2, its torque without current."""
        return self.k or (0.0, self.torque_table[0][1] if self.torque_table else 0.0, 0.0, 0.0, 0.0)

    def _join_at_knee(self) -> str:
        """Make the two branches of Eq. (2) meet: published coefficients are rounded, and fitted separately.

        Returns what was changed, as a sentence, where the branches were far apart; else "".
        """
        k1, k2, k3, k4, k5 = self.equation_2
        knee = self.knee_A
        below, above = k1 * knee + k2, (k3 * knee + k4) * knee + k5
        jump = abs(above - below)
        if not KNEE_TOLERANCE < jump < math.inf or knee >= self.current_max_A:
            return ""
        meet = [x.real for x in np.roots([k3, k4 - k1, k5 - k2]) if x.imag == 0.0]
        nearest = min(meet, key=lambda x: abs(x - knee), default=math.inf)
        if abs(nearest - knee) <= KNEE_MOVED * knee:
            repair = f"knee_A is {nearest:.4g}, where they meet"
            msgspec.structs.force_setattr(self, "knee_A", float(nearest))
            knee = self.knee_A  # as far as rounding lets them
        else:
            repair = f"k_5 is {k5 + below - above:.4g}, with which they meet"
        k5 = k1 * knee + k2 - (k3 * knee + k4) * knee
        msgspec.structs.force_setattr(self, "k", (k1, k2, k3, k4, k5))
        sentence = f"{self.name}: k: the torque jumps from {below:g} to {above:g} N m at the knee; {repair}"
        return sentence if jump > JUMP_SAID * abs(below) else ""

    def _check_torque_gain(self) -> None:
        """K must be >= 0 and rise all the way from 0 to current_max_A (else it has no inverse)."""
        k1, k2, k3, k4, k5 = self.equation_2
        knee, largest = self.knee_A, self.current_max_A
        if reason := TORQUE.refusal(self.torque_gain(largest)):
            raise ValueError(f"k: the torque at current_max_A {reason}")
        if k2 < 0:
            raise ValueError(f"k gives a negative torque at zero current (k_2 = {k2:g} N m)")
        if knee > 0 and k1 <= 0:
            raise ValueError(f"k: the torque must rise with the current, but k_1 = {k1:g} below the knee")
        if knee >= largest:
            return  # the quadratic branch is never used
        slopes = 2 * k3 * knee + k4, 2 * k3 * largest + k4
        if not (min(slopes) >= 0 and 0 < max(slopes) < math.inf):
            raise ValueError(
                f"k: the torque must rise with the current up to current_max_A = {largest:g}, but its slope is "
                f"{slopes[0]:g} at the knee and {slopes[1]:g} N m/A at the end"
            )

    def _check_time_constant(self, key: str, constant: TimeConstant) -> None:
        """Eq. (4), linear in I, quadratic in omega_L, must be positive from floor to omega_0 at any current."""
        low, high = math.log2(self.floor_rpm), math.log2(self.omega_0_rpm)
        for current in (0.0, self.current_max_A):
            linear = constant.a[1] + current * constant.a[2]
            square = constant.a[3] + current * constant.a[4]
            places = [low, high]
            if square > 0 and low < -linear / (2 * square) < high:
                places.append(-linear / (2 * square))
            for w in places:
                value = constant.below_omega_0(current, w)
                if TIME_CONSTANT.refusal(value):
                    raise ValueError(
                        f"{key}.a gives a time constant of {value:.3g} s at {2.0**w:.3g} rpm and {current:g} "
                        f"{self.command_unit}; it must be positive from floor_rpm to omega_0_rpm"
                    )


def read_brake_text(reference: str, folder: Path, where: str) -> str:
    """A brake file in full: of a shipped name, or of a path relative to the device file's folder (`where`)."""
    return read_text(shipped_or_file(reference, SHIPPED_FOLDER, folder, f"{where}: unknown brake"))


def parse_brake(text: str, where: str) -> BrakeFile:
    """A brake file from its text; `where` names it in refusals."""
    return parse_toml(text, BrakeFile, where)


#: Elbow sides of arm 1 and arm 2, +1: the elbow lies to the left of base -> tip.
ELBOWS = {"out": (1.0, -1.0), "in": (-1.0, 1.0), "left": (1.0, 1.0), "right": (-1.0, -1.0)}
Counts = Annotated[int, msgspec.Meta(gt=0, le=10**9)]  # of a counter of 32 bits, with a sign


class Geometry(Table, frozen=True):
    """Bases, link lengths, and to which side the elbows bulge."""

    base_A_m: Place  # base joints, [x, y]
    base_B_m: Place
    L_AE_m: Length  # links: base to elbow, elbow to tip
    L_ED_m: Length
    L_BC_m: Length
    L_CD_m: Length
    elbows: Annotated[str, choice(*ELBOWS)]  # side to which the elbows bulge: "out", "in", "left" or "right"


class Link(Table, frozen=True):
    """One link; a uniform rod where com (from the proximal joint) or inertia (about the com) is left out."""

    mass_kg: BodyMass  # of the link
    com_m: Coordinate | None = None  # centre of mass, from the proximal joint; none: half of the length
    inertia_kg_m2: Inertia | None = None  # about the centre of mass; none: of a rod


class Mass(Table, frozen=True):
    """Masses and inertias."""

    AE: Link
    ED: Link
    BC: Link
    CD: Link
    tip_kg: BodyMass  # handle and what is fixed to it
    joint_E_kg: BodyMass = 0.0  # brakes that the elbows carry
    joint_C_kg: BodyMass = 0.0
    rotor_inertia_kg_m2: Inertia = 0.0  # of each brake's rotor


class HardStops(Table, frozen=True):
    """The hard stops of the joints."""

    margin: Annotated[float, msgspec.Meta(gt=0, lt=1)] = 0.3  # least sine of the angle at elbows and tip (hard stop)
    theta_A_rad: Pair | None = None  # hard stops, [low, high]
    theta_E_rad: Pair | None = None
    theta_B_rad: Pair | None = None
    theta_C_rad: Pair | None = None

    def __post_init__(self) -> None:
        for joint in JOINTS:
            stop = getattr(self, f"theta_{joint}_rad")
            if stop is None:
                continue
            turn = 2.0 * math.pi
            if not (-turn <= stop[0] < stop[1] <= turn and stop[1] - stop[0] < turn):
                raise ValueError(
                    f"theta_{joint}_rad must be [low, high] with low < high, within -2 pi .. 2 pi and less than a turn "
                    f"apart, not {list(stop)}"
                )


class BrakeNames(Table, frozen=True):
    """The brake file of each braked joint."""

    #: the brake at the joint: a shipped name, a path from this file's folder, or a `[[brake]]` of the same protocol
    A: str | None = None
    E: str | None = None
    B: str | None = None
    C: str | None = None


#: Coefficient of a base joint's rate in what a coupling's brake acts on; more than these would be gears.
Coefficient = Annotated[float, msgspec.Meta(ge=-12, le=12)]


class Coupling(Table, frozen=True):
    """The combination of the base joints' rates on which a brake acts: A omega_A + B omega_B.

    Whole numbers, so that its angle is known without counting turns.
    """

    A: Coefficient = 0.0  # whole numbers a, b: the brake acts on a omega_A + b omega_B, not on an elbow
    B: Coefficient = 0.0

    def __post_init__(self) -> None:
        if not (self.A.is_integer() and self.B.is_integer() and (self.A or self.B)):
            raise ValueError(f"a coupling needs whole numbers A and B, not both 0, not {self.A:g} and {self.B:g}")

    @property
    def label(self) -> str:
        """How it is shown: "A-B", "A+B", "2A+B"."""
        words = ""
        for factor, joint in ((self.A, "A"), (self.B, "B")):
            if factor:
                sign = "-" if factor < 0 else "+" if words else ""
                words += f"{sign}{'' if abs(factor) == 1 else f'{abs(factor):g}'}{joint}"
        return words


class Couplings(Table, frozen=True):
    """Brakes at the bases that take the place of those at the elbows."""

    E: Coupling | None = None
    C: Coupling | None = None


class Encoders(Table, frozen=True):
    """Encoder counts per revolution, at two or four joints."""

    A: Counts | None = None  # counts per turn, at two joints or four
    E: Counts | None = None
    B: Counts | None = None
    C: Counts | None = None

    def __post_init__(self) -> None:
        if sum(getattr(self, joint) is not None for joint in JOINTS) not in (2, 4):
            raise ValueError("encoders must name two or four of the joints A, E, B, C")

    @property
    def counts(self) -> tuple[int, ...]:
        """Counts per revolution (4,) of the joints A, E, B, C; 0 at a joint without one."""
        return tuple(getattr(self, joint) or 0 for joint in JOINTS)


class ForceSensor(Table, frozen=True):
    """Which body carries the force sensor, how it is turned, and the mass on the hand's side of it."""

    on: Annotated[str, choice("handle", "ED", "CD")]  # what carries the force sensor: "handle", "ED" or "CD"
    rotation_rad: Angle = 0.0  # how the sensor is turned on it
    inertia_beyond_kg: BodyMass = 0.0  # part of `mass.tip_kg` on the hand's side of the sensor
    calibration: str | None = None  # file of a 6 x 6 matrix, from this file's folder


class Sensing(Table, frozen=True):
    """The sensors; a device without this table has ideal ones."""

    encoders: Encoders | None = None
    force: ForceSensor | None = None
    home_m: Place | None = None  # where a jig holds the handle for homing; none: the middle of the first path


class DeviceFile(Table, frozen=True):
    """The keys of a device file."""

    name: Annotated[str, msgspec.Meta(min_length=1)]  # in tables, figures and file names
    geometry: Geometry
    mass: Mass
    brakes: BrakeNames
    couplings: Couplings = Couplings()
    limits: HardStops = HardStops()
    sensing: Sensing | None = None
    provenance: str = ""  # where the numbers come from

    def __post_init__(self) -> None:
        if not self.name.isprintable() or any(letter in ',;"/\\' for letter in self.name):
            raise ValueError(f'name must be plain text without , ; " / or \\, not {self.name!r}')
        force = self.sensing.force if self.sensing else None
        if force and force.inertia_beyond_kg > self.mass.tip_kg:
            raise ValueError(
                f"sensing.force.inertia_beyond_kg ({force.inertia_beyond_kg:g}) is part of mass.tip_kg "
                f"({self.mass.tip_kg:g}) and cannot exceed it"
            )
        if not self.braked:
            raise ValueError("brakes must name at least one of the joints A, E, B, C")
        for joint in self.coupled:
            if joint not in self.braked:
                raise ValueError(f"couplings.{joint}: there is no brake {joint} in brakes that it could carry")

    @property
    def braked(self) -> str:
        """Letters of the braked joints, in order."""
        return "".join(joint for joint in JOINTS if getattr(self.brakes, joint) is not None)

    @property
    def coupled(self) -> dict[str, Coupling]:
        """The couplings, by the letter of their brake."""
        found = {joint: getattr(self.couplings, joint) for joint in "EC"}
        return {joint: coupling for joint, coupling in found.items() if coupling is not None}
