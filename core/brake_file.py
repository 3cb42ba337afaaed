"""Brake files: the numbers of one MR brake, Eqs. (2) and (4), its current limit and its backlash.

The current clamp reads the limit here. Currents in A, torques in N m, speeds in rpm as in the paper.
"""

import math
from pathlib import Path
from typing import Annotated

import msgspec

from core.errors import InputError
from core.files import NotNegative, Positive, Table, parse_toml, read_text

SHIPPED_FOLDER = Path(__file__).resolve().parent / "brake_files"

#: N m. Our choice: the two branches of Eq. (2) may differ by this much at the knee (rounding of printed
#: coefficients); a larger step has no inverse there.
KNEE_TOLERANCE = 1e-6


class TimeConstant(Table, frozen=True):
    """Eq. (4): a_avg at omega_0 and above, a_1 .. a_6 below."""

    a_avg_s: Positive
    a: tuple[float, float, float, float, float, float]

    def below_omega_0(self, current: float, speed_log2: float) -> float:
        """Time constant (s), Eq. (4) below omega_0; speed_log2 is the paper's omega_L: log2 of rpm."""
        a1, a2, a3, a4, a5, a6 = self.a
        w = speed_log2
        return a6 + a2 * w + a4 * w * w + current * (a1 + a3 * w + a5 * w * w)


class BrakeFile(Table, frozen=True):
    """One brake as its file says it."""

    name: Annotated[str, msgspec.Meta(min_length=1)]
    current_max_A: Positive
    k: tuple[float, float, float, float, float]
    knee_A: NotNegative
    omega_0_rpm: Positive
    floor_rpm: Positive
    rise: TimeConstant
    fall: TimeConstant
    backlash_deg: Annotated[float, msgspec.Meta(ge=0, lt=360)]
    provenance: str = ""  # where the numbers come from; "assumed": not measured

    def __post_init__(self) -> None:
        self._check_torque_gain()
        if self.floor_rpm > self.omega_0_rpm:
            raise ValueError(f"floor_rpm ({self.floor_rpm:g}) must not exceed omega_0_rpm ({self.omega_0_rpm:g})")
        for key, constant in (("rise", self.rise), ("fall", self.fall)):
            self._check_time_constant(key, constant)

    def torque_gain(self, current: float) -> float:
        """Torque gain K (N m), Eq. (2), of the file (the kernels have their own, on arrays)."""
        k1, k2, k3, k4, k5 = self.k
        return k1 * current + k2 if current < self.knee_A else (k3 * current + k4) * current + k5

    def _check_torque_gain(self) -> None:
        """K must be >= 0, continuous, and rise all the way from 0 to current_max_A (else it has no inverse)."""
        k1, k2, k3, k4, k5 = self.k
        knee, largest = self.knee_A, self.current_max_A
        if k2 < 0:
            raise ValueError(f"k gives a negative torque at zero current (k_2 = {k2:g} N m)")
        if knee > 0 and k1 <= 0:
            raise ValueError(f"k: the torque must rise with the current, but k_1 = {k1:g} below the knee")
        if knee >= largest:
            return  # the quadratic branch is never used
        below, above = k1 * knee + k2, (k3 * knee + k4) * knee + k5
        if not abs(above - below) <= KNEE_TOLERANCE:
            raise ValueError(f"k: the torque jumps from {below:g} to {above:g} N m at knee_A = {knee:g}")
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
                if not 0 < value < math.inf:
                    raise ValueError(
                        f"{key}.a gives a time constant of {value:.3g} s at {2.0**w:.3g} rpm and {current:g} A; "
                        "it must be positive from floor_rpm to omega_0_rpm"
                    )


def shipped_brakes() -> list[str]:
    """Names of the brake files that come with the product."""
    return sorted(file.stem for file in SHIPPED_FOLDER.glob("*.toml"))


def find_brake_file(reference: str, folder: Path, where: str) -> Path:
    """The file of a brake: a shipped name, or a path relative to the device file (`where`)."""
    if reference in shipped_brakes():
        return SHIPPED_FOLDER / f"{reference}.toml"
    path = folder / reference
    if reference and path.is_file():
        return path
    raise InputError(
        f"{where}: unknown brake {reference!r}: neither a shipped brake ({', '.join(shipped_brakes())}) nor a file"
    )


def read_brake_text(reference: str, folder: Path, where: str) -> str:
    """The brake file in full."""
    return read_text(find_brake_file(reference, folder, where))


def parse_brake(text: str, where: str) -> BrakeFile:
    """A brake file from its text; `where` names it in refusals."""
    return parse_toml(text, BrakeFile, where)
