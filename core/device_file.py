"""The format of device files: what a file may say, and the rules that one file can break by itself.

Lengths in m, masses in kg, angles in rad (joint order A, E, B, C).
"""

import math
from typing import Annotated

import msgspec

from core.files import NotNegative, Pair, Positive, Table, one_of
from core.mechanism import JOINTS

#: Elbow sides of arm 1 and arm 2, +1: the elbow lies to the left of base -> tip.
ELBOWS = {"out": (1.0, -1.0), "in": (-1.0, 1.0), "left": (1.0, 1.0), "right": (-1.0, -1.0)}
SENSOR_BODIES = ("handle", "ED", "CD")
Counts = Annotated[int, msgspec.Meta(gt=0)]


class Geometry(Table, frozen=True):
    """Bases, link lengths, and to which side the elbows bulge."""

    base_A_m: Pair
    base_B_m: Pair
    L_AE_m: Positive
    L_ED_m: Positive
    L_BC_m: Positive
    L_CD_m: Positive
    elbows: str

    def __post_init__(self) -> None:
        one_of(self.elbows, tuple(ELBOWS), "elbows")


class Link(Table, frozen=True):
    """One link; a uniform rod where com (from the proximal joint) or inertia (about the com) is left out."""

    mass_kg: NotNegative
    com_m: float | None = None
    inertia_kg_m2: NotNegative | None = None


class Mass(Table, frozen=True):
    """Masses and inertias."""

    AE: Link
    ED: Link
    BC: Link
    CD: Link
    tip_kg: NotNegative
    joint_E_kg: NotNegative = 0.0
    joint_C_kg: NotNegative = 0.0
    rotor_inertia_kg_m2: NotNegative = 0.0


class Limits(Table, frozen=True):
    """Hard stops."""

    margin: Annotated[float, msgspec.Meta(gt=0, lt=1)] = 0.3
    theta_A_rad: Pair | None = None
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

    A: str | None = None
    E: str | None = None
    B: str | None = None
    C: str | None = None


class Encoders(Table, frozen=True):
    """Encoder counts per revolution, at two or four joints."""

    A: Counts | None = None
    E: Counts | None = None
    B: Counts | None = None
    C: Counts | None = None

    def __post_init__(self) -> None:
        if sum(getattr(self, joint) is not None for joint in JOINTS) not in (2, 4):
            raise ValueError("encoders must name two or four of the joints A, E, B, C")


class ForceSensor(Table, frozen=True):
    """Which body carries the force sensor, how it is turned, and the mass on the hand's side of it."""

    on: str
    rotation_rad: float = 0.0
    inertia_beyond_kg: NotNegative = 0.0
    calibration: str | None = None  # file of a 6 x 6 matrix, relative to the device file

    def __post_init__(self) -> None:
        one_of(self.on, SENSOR_BODIES, "on")


class Sensing(Table, frozen=True):
    """The sensors; a device without this table has ideal ones."""

    encoders: Encoders | None = None
    force: ForceSensor | None = None
    home_m: Pair | None = None  # where a jig holds the handle while the encoders are homed


class DeviceFile(Table, frozen=True):
    """One device as its file says it."""

    name: Annotated[str, msgspec.Meta(min_length=1)]
    geometry: Geometry
    mass: Mass
    brakes: BrakeNames
    limits: Limits = Limits()
    sensing: Sensing | None = None
    provenance: str = ""  # "assumed": nobody measured these numbers, and everything that shows them says so

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

    @property
    def braked(self) -> str:
        """Letters of the braked joints, in order."""
        return "".join(joint for joint in JOINTS if getattr(self.brakes, joint) is not None)
