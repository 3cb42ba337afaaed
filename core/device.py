"""Devices: any planar five-bar with its brakes and sensors, from its file to what the kernels read.

Lengths in m, masses in kg, angles in rad (joint order A, E, B, C). A device that cannot exist is refused here:
no tip position at which both arms close, or a mass matrix that has no inverse.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from core.device_file import ELBOWS, BrakeFile, DeviceFile, Link, Sensing, parse_brake, read_brake_text
from core.files import (
    InputError,
    Pair,
    from_plain,
    is_assumed,
    parse_toml,
    read_text,
    shipped_names,
    shipped_or_file,
    toml_text,
)
from core.mechanism import JOINTS, Arm, Brakes, Mechanism, no_brakes, parallel_rows
from core.number_table import number
from core.torque_table import NO_KNEE, torque_curve
from core.workspace import brake_rows, free_tips, why_impossible

SHIPPED_FOLDER = Path(__file__).resolve().parent / "devices"
COBOT_FOLDER = Path(__file__).resolve().parent / "cobots"
RAD_S_PER_RPM = 2.0 * math.pi / 60.0

#: m. Our choice: bases closer than this count as one axis (g_E and g_C are then parallel to rounding).
COAXIAL_WITHIN = 1e-9


@dataclass(frozen=True, eq=False)  # arrays do not compare to one truth: a device is itself
class Device:
    """A device, ready for the kernels, with the files it came from."""

    name: str
    mechanism: Mechanism
    brakes: Brakes
    braked: str  # letters of the braked joints in the order A, E, B, C, e.g. "AEB"
    force_normalised_N: float
    labels: dict[str, str]  # of each brake on screen: its joint, or its coupling, e.g. "A-B"
    command_unit: str  # of the commands to its brakes, "A" unless their files name another
    assumed: bool  # some of its numbers are assumed: marked wherever they are shown
    text: str  # the device file in full
    brake_texts: dict[str, str]  # name (as in [brakes]) -> the brake file in full
    sensing: Sensing | None
    calibration: np.ndarray | None  # (6, 6) of the force sensor
    calibration_text: str | None  # its file in full
    file: DeviceFile
    brake_files: dict[str, BrakeFile]  # letter of the joint -> its brake's file, as changed by `with_brakes`


def shipped_devices() -> list[str]:
    """Names of the devices that come with the product."""
    return shipped_names(SHIPPED_FOLDER)


def load_device(name_or_path: str | Path, folder: Path | None = None, unknown: str = "unknown device") -> Device:
    """A shipped device by its name, or a device file by its path from `folder` (default: the current one).

    InputError, which `unknown` begins if there is neither.
    """
    path = shipped_or_file(name_or_path, SHIPPED_FOLDER, folder or Path(), unknown)
    return device_of(read_text(path), path.parent, str(path), {})


def device_of(text: str, folder: Path, where: str, brakes: Mapping[str, str]) -> Device:
    """A device from the text of its file; `where` names it. brakes: texts of brake files by name, before those shipped.

    folder: where other brakes, and the calibration of its force sensor, are looked for.
    """
    file = parse_toml(text, DeviceFile, where)
    references = dict.fromkeys(getattr(file.brakes, joint) for joint in file.braked)
    texts = {r: brakes[r] if r in brakes else read_brake_text(r, folder, f"{where}: brakes") for r in references}
    matrix = read_text(folder / name) if (name := calibration_name(file)) else None
    return build_device(text, texts, where, matrix)


def inline_devices(
    devices: Sequence[dict[str, Any]], brakes: Sequence[dict[str, Any]], folder: Path, where: str
) -> dict[str, Device]:
    """The devices whose files stand in another file as `[[device]]`, by name; its `[[brake]]`s are brakes for them."""
    texts: dict[str, str] = {}
    for place, content in enumerate(brakes, start=1):
        name = from_plain(content, BrakeFile, f"{where}: brake {place}").name
        if name in texts:
            raise InputError(f"{where}: brake: two have the same name ({name})")
        texts[name] = toml_text(content)
    found: dict[str, Device] = {}
    for place, content in enumerate(devices, start=1):
        named = f"{where}: device {place}"
        name = from_plain(content, DeviceFile, named).name
        if name in found:
            raise InputError(f"{where}: device: two have the same name ({name})")
        found[name] = device_of(toml_text(content), folder, named, texts)
    return found


def build_device(text: str, brake_texts: dict[str, str], where: str, calibration_text: str | None = None) -> Device:
    """A device from its files' texts, as a session stores them; `where` names the device file in refusals."""
    file = parse_toml(text, DeviceFile, where)
    references = {joint: getattr(file.brakes, joint) for joint in file.braked}
    for joint, reference in references.items():
        if reference not in brake_texts:
            raise InputError(f"{where}: brakes.{joint}: the brake file {reference!r} is missing")
    read = {name: parse_brake(brake_texts[name], f"brake file {name}") for name in dict.fromkeys(references.values())}
    brakes = {joint: read[reference] for joint, reference in references.items()}
    units = {brake.command_unit for brake in brakes.values()}
    if len(units) > 1:
        raise InputError(f"{where}: brakes: all must be commanded in one unit, not in {' and '.join(sorted(units))}")
    if reason := _why_impossible(file):
        raise InputError(f"{where}: {reason}")
    mechanism = build_mechanism(file)
    return Device(
        name=file.name,
        mechanism=mechanism,
        brakes=build_brakes(brakes),
        braked=file.braked,
        force_normalised_N=force_normalised(file, mechanism, brakes),
        labels={joint: joint for joint in file.braked} | {j: coupling.label for j, coupling in file.coupled.items()},
        command_unit=units.pop(),
        assumed=is_assumed(file.provenance) or any(brake.assumed for brake in brakes.values()),
        text=text,
        brake_texts=dict(brake_texts),
        sensing=file.sensing,
        calibration=_calibration(file, calibration_text, where),
        calibration_text=calibration_text,
        file=file,
        brake_files=brakes,
    )


@functools.lru_cache(maxsize=100)
def _why_impossible(file: DeviceFile) -> str:
    """As `why_impossible`, which takes longer than all else; a session's device is read again and again."""
    return why_impossible(build_mechanism(file))


def with_brakes(device: Device, change: Callable[[BrakeFile], BrakeFile]) -> Device:
    """The device with each of its brake files changed. Its numbers then count as assumed."""
    files = {joint: change(brake) for joint, brake in device.brake_files.items()}
    return replace(
        device,
        brakes=build_brakes(files),
        force_normalised_N=force_normalised(device.file, device.mechanism, files),
        assumed=True,
        brake_files=files,
    )


def without_backlash(device: Device) -> Device:
    """The device with brakes that have no play."""
    return replace(device, brakes=device.brakes._replace(play=np.zeros(4)))


def build_mechanism(file: DeviceFile) -> Mechanism:
    """The linkage as the kernels read it."""
    g, m = file.geometry, file.mass
    side_1, side_2 = ELBOWS[g.elbows]

    def arm(base: Pair, lengths: Pair, links: tuple[Link, Link], elbow_mass: float, joints: str, side: float) -> Arm:
        (length_1, length_2), (link_1, link_2) = lengths, links
        carried = set(file.braked) - set(file.coupled)
        base_rotor, elbow_rotor = (m.rotor_inertia_kg_m2 if j in carried else 0.0 for j in joints)
        base_rotor += m.rotor_inertia_kg_m2 * sum(
            getattr(coupling, joints[0]) ** 2 for coupling in file.coupled.values()
        )
        com_1, inertia_1 = centre_and_inertia(link_1, length_1)
        com_2, inertia_2 = centre_and_inertia(link_2, length_2)
        moved = inertia_1 + link_1.mass_kg * com_1**2 + (elbow_mass + link_2.mass_kg) * length_1**2
        return Arm(
            *base, length_1, length_2, side,
            proximal=moved + base_rotor + elbow_rotor,
            distal=inertia_2 + link_2.mass_kg * com_2**2 + elbow_rotor,
            coupling=link_2.mass_kg * com_2 / length_2,
            rotor=elbow_rotor,
        )  # fmt: skip

    coaxial = math.dist(g.base_A_m, g.base_B_m) <= COAXIAL_WITHIN
    coupled, combination = 0, np.zeros((4, 2))
    for joint, coupling in file.coupled.items():
        i = JOINTS.index(joint)
        coupled |= 1 << i
        combination[i] = coupling.A, coupling.B
    stops = [getattr(file.limits, f"theta_{joint}_rad") for joint in JOINTS]
    return Mechanism(
        arm_1=arm(g.base_A_m, (g.L_AE_m, g.L_ED_m), (m.AE, m.ED), m.joint_E_kg, "AE", side_1),
        arm_2=arm(g.base_B_m, (g.L_BC_m, g.L_CD_m), (m.BC, m.CD), m.joint_C_kg, "BC", side_2),
        tip_mass=m.tip_kg,
        coaxial=coaxial,
        margin=file.limits.margin,
        theta_low=np.array([stop[0] if stop else -math.inf for stop in stops]),
        theta_high=np.array([stop[1] if stop else math.inf for stop in stops]),
        has_theta_stops=any(stop is not None for stop in stops),
        coupled=coupled,
        combination=combination,
        coupling=m.rotor_inertia_kg_m2 * float(combination.prod(axis=1).sum()),
        lines=parallel_rows(combination, coupled, coaxial),
    )


def centre_and_inertia(link: Link, length: float) -> tuple[float, float]:
    """Centre of mass (m, from the proximal joint) and inertia about it (kg m2); L/2, m L^2 / 12 if left out."""
    com = 0.5 * length if link.com_m is None else link.com_m
    inertia = link.mass_kg * length**2 / 12.0 if link.inertia_kg_m2 is None else link.inertia_kg_m2
    return com, inertia


def build_brakes(files: dict[str, BrakeFile]) -> Brakes:
    """The brakes of a device as the kernels read them; zeros at joints without one."""
    arrays = no_brakes()
    for joint, brake in files.items():
        i = JOINTS.index(joint)
        arrays.present[i] = 1.0
        arrays.current_max[i] = brake.current_max_A
        arrays.k[i] = brake.equation_2
        arrays.knee[i] = brake.knee_A
        if brake.torque_table is not None:
            arrays.knee[i] = NO_KNEE
            arrays.curve[i] = torque_curve(brake.torque_table)
        arrays.omega_0[i] = brake.omega_0_rpm * RAD_S_PER_RPM
        arrays.floor[i] = brake.floor_rpm * RAD_S_PER_RPM
        arrays.rise[i] = (brake.rise.a_avg_s, *brake.rise.a)
        arrays.fall[i] = (brake.fall.a_avg_s, *brake.fall.a)
        arrays.play[i] = math.radians(brake.backlash_deg)
    return arrays


def force_normalised(file: DeviceFile, mechanism: Mechanism, brakes: dict[str, BrakeFile]) -> float:
    """The smallest force (N) that every brake can exert at its largest current anywhere in the workspace.

    Section IV of the paper. A torque reaches the tip over a moment arm no longer than the proximal link (A, B) or
    the shorter link of the arm (E, C), so this is the least of K(current_max) over that arm. Our choice: that of a
    coupling is the longest found at places spread over the workspace.
    """
    geometry = file.geometry
    longest_arm = {
        "A": geometry.L_AE_m,
        "E": min(geometry.L_AE_m, geometry.L_ED_m),
        "B": geometry.L_BC_m,
        "C": min(geometry.L_BC_m, geometry.L_CD_m),
    }
    if file.coupled:
        rows = brake_rows(mechanism, *free_tips(mechanism).T)
        least = np.hypot(rows[:, 0], rows[:, 1]).min(axis=-1)
        longest_arm |= {joint: 1.0 / float(least[JOINTS.index(joint)]) for joint in file.coupled}
    return min(brake.torque_gain(brake.current_max_A) / longest_arm[joint] for joint, brake in brakes.items())


def calibration_name(file: DeviceFile) -> str | None:
    """The file of the force sensor's 6 x 6 matrix, relative to the device file; None: it has none."""
    return file.sensing.force.calibration if file.sensing and file.sensing.force else None


def _calibration(file: DeviceFile, text: str | None, where: str) -> np.ndarray | None:
    """The 6 x 6 matrix in the text of the file that the device file names; None where it names none."""
    name = calibration_name(file)
    if name is None:
        return None
    if text is None:
        raise InputError(f"{where}: sensing.force.calibration: the file {name} is missing")
    rows = [line.replace(",", " ").split() for line in text.splitlines() if line.strip()]
    try:
        matrix = np.array([[number(cell) for cell in row] for row in rows])
    except ValueError:
        matrix = np.empty(0)
    if matrix.shape != (6, 6) or not np.all(np.isfinite(matrix)):
        raise InputError(f"{where}: sensing.force.calibration: {name} does not hold 6 x 6 finite numbers")
    return matrix
