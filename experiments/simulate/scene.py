"""Scene files: one run of the simulator without an operator (device, brake schedule, hand force, steps).

`read_scene` checks everything that can be checked before the first step; what it returns can be simulated.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from core.control.guard import NOTHING, Around, Guard, why_no_guard
from core.device import Device, load_device
from core.files import InputError, NotNegative, Positive, Table, choice, parse_toml, read_text, shipped_or_file
from core.mechanism import JOINTS
from core.number_table import read_number_file
from core.obstacles import ObstacleFile, build_obstacles, nearest_obstacle
from core.ranges import FORCE, STEP, TORQUE, YIELD, Force, Held, Place, Speed
from core.tick_log import TICK_S
from core.workspace import tip_is_free

SHIPPED_FOLDER = Path(__file__).resolve().parents[1] / "scenes"

#: Relative. duration and output interval may miss a whole number of output intervals and steps by this much.
WHOLE_WITHIN = 1e-9
#: s. Times closer than this are one time (schedule row and step edge, end of a force file and of the scene).
TIME_WITHIN = 1e-9

#: A force file that goes on for so many times the scene's duration is hardly in seconds. Our choice.
MUCH_LONGER = 20.0

#: A run of more would take an hour and more, and its table more than a GiB.
MOST_STEPS, MOST_ROWS = 1_000_000_000, 10_000_000

StepLength = Annotated[float, msgspec.Meta(gt=TIME_WITHIN, le=STEP.most, extra={"range": STEP})]


class JointCurrents(Table, frozen=True):
    """One current a joint; joints that are not named are 0."""

    A: NotNegative = 0.0  # constant currents, with "static" and "mr"
    E: NotNegative = 0.0
    B: NotNegative = 0.0
    C: NotNegative = 0.0


class JointTorques(Table, frozen=True):
    """One yield torque a joint; joints that are not named are 0."""

    A: Held = 0.0  # constant yield torques, with "ideal"
    E: Held = 0.0
    B: Held = 0.0
    C: Held = 0.0


class BrakeTable(Table, frozen=True):
    """The commands to the brakes: constants, or a schedule file that overrides them."""

    torque_N_m: JointTorques | None = None
    current_amperes: JointCurrents | None = None
    schedule: str | None = None  # CSV in their place: t_s, A, E, B, C; a row holds until the next


class ForceTable(Table, frozen=True):
    """What the hand does: a file, or a constant."""

    file: str | None = None  # CSV: t_s, fx_N, fy_N, linear between rows
    constant_N: tuple[Force, Force] | None = None  # in its place

    def __post_init__(self) -> None:
        if self.file is not None and self.constant_N is not None:
            raise ValueError("give either file or constant_N, not both")


class SceneFile(Table, frozen=True):
    """A scene as it stands in its file."""

    device: str  # a shipped device, or a path from this file's folder
    duration_s: Positive  # of the scene, and of a step
    step_s: StepLength
    initial_tip_m: Place  # [x, y]
    output_interval_s: Positive | None = None  # from row to row; none: `step_s`
    #: fourth order; "stepping": first order, robust; "karnopp": Eq. (6), for comparison (it can create energy)
    integrator: Annotated[str, choice("event", "stepping", "karnopp")] = "event"
    initial_tip_velocity_m_s: tuple[Speed, Speed] = (0.0, 0.0)  # of the tip
    #: torques as given; "static": K(I) at once; "mr": with lag and backlash
    fidelity: Annotated[str, choice("ideal", "static", "mr")] = "ideal"
    brakes: BrakeTable = BrakeTable()
    force: ForceTable = ForceTable()
    obstacle: tuple[ObstacleFile, ...] = ()  # as in a protocol; adds the column `obstacle_m`, negative inside
    guard: Guard | None = None  # as in a protocol; steps are then at most a millisecond

    def __post_init__(self) -> None:
        if self.guard is not None and self.fidelity == "ideal":
            raise ValueError("guard needs fidelity 'static' or 'mr': it locks the brakes by their currents")
        right, wrong = "torque_N_m", "current_amperes"
        if self.fidelity != "ideal":
            right, wrong = wrong, right
        if getattr(self.brakes, wrong) is not None:
            raise ValueError(f"brakes.{wrong} does not go with fidelity {self.fidelity!r}; give brakes.{right}")


@dataclass(frozen=True)
class Scene:
    """A scene that has passed every check. SI units; joints in the order A, E, B, C."""

    device: Device
    duration_s: float
    step_s: float
    steps: int  # in the whole scene
    output_interval_s: float
    output_every: int  # steps from one output row to the next
    integrator: str
    fidelity: str
    initial_tip: np.ndarray  # (2,) m
    initial_velocity: np.ndarray  # (2,) m/s
    schedule_t: np.ndarray  # (n,) s, rising, the first <= 0; each row holds from its time on
    schedule: np.ndarray  # (n, 4) yield torque in N m (ideal) or current in A (static, mr)
    force_t: np.ndarray  # (m,) s, rising; linear in between, held beyond the ends (a constant has one knot)
    force: np.ndarray  # (m, 2) N
    tolerance: float = 1.0  # share of the integrator's own error bounds
    around: Around = NOTHING  # obstacles; with a guard no step is longer than its tick

    @property
    def rows(self) -> int:
        """Rows of the output: the first at t = 0."""
        return self.steps // self.output_every + 1

    def finer(self) -> "Scene":
        """The same scene for a check of its accuracy: `event` at half the step, with a hundredth of its error bounds.

        No integrator is checked by itself but `event`, which cuts its steps by its own error estimate and locates what
        happens within them: where that estimate and not step_s sets the error, a tenth of the bounds leaves half of it,
        and where it falls back to `stepping`, the check does so in pieces a hundredth as long.
        `stepping` cuts a fast step alike at any step_s, and like `karnopp` sees brakes stop the tip within one step and
        within half of it alike: either would agree with its own error.
        """
        return replace(
            self, step_s=0.5 * self.step_s, steps=2 * self.steps, output_every=2 * self.output_every,
            integrator="event", tolerance=0.01 * self.tolerance,
        )  # fmt: skip

    @property
    def check_words(self) -> tuple[str, str]:
        """For the warning where the check differs from the run: what the check was, and what to do."""
        if self.integrator == "event":
            return "half the step", "choose a smaller step_s"
        return "event at half the step", "choose integrator event or a smaller step_s"

    def row_times(self, first: int, count: int) -> np.ndarray:
        """Times (s) of output rows first .. first + count - 1: exact multiples of the interval.

        Where the interval is one over a whole number (1e-3 s), the multiple is taken by division: 9 ms is then
        0.009, not 0.009000000000000001.
        """
        k = np.arange(first, first + count, dtype=float)
        interval, per_second = self.output_interval_s, round(1.0 / self.output_interval_s)
        return k / per_second if per_second and 1.0 / per_second == interval else k * interval


def scene_file(name_or_path: str | Path) -> Path:
    """The file of a scene, shipped or not. InputError: there is none."""
    return shipped_or_file(name_or_path, SHIPPED_FOLDER, Path(), "unknown scene")


def read_scene(path: str | Path, text: str | None = None) -> Scene:
    """The scene of a file, or of a text that is taken for its; every path inside is relative to it.

    An InputError names file, key and reason.
    """
    path = Path(path)
    file = parse_toml(read_text(path) if text is None else text, SceneFile, str(path))
    try:
        device = load_device(file.device, path.parent)
    except InputError as error:
        raise InputError(f"{path}: device: {error}") from None
    interval = file.step_s if file.output_interval_s is None else file.output_interval_s
    parts = 1 if file.guard is None else _parts_of_step(file.step_s, path)
    output_every = parts * whole_number(interval, file.step_s, f"{path}: output_interval_s", "step_s")
    intervals = whole_number(file.duration_s, interval, f"{path}: duration_s", "output intervals")
    refuse_too_long(intervals * output_every, intervals + 1, path)
    if not tip_is_free(device.mechanism, *file.initial_tip_m):
        x, y = file.initial_tip_m
        raise InputError(
            f"{path}: initial_tip_m: the tip of {device.name} cannot be at ({x:g}, {y:g}) m: "
            "out of reach, beyond a hard stop, or not in y > 0"
        )
    return Scene(
        device, file.duration_s, file.step_s / parts, intervals * output_every, interval, output_every, file.integrator,
        file.fidelity, np.array(file.initial_tip_m), np.array(file.initial_tip_velocity_m_s),
        *_schedule(file, device, path),
        *hand_force(file.force.file, file.force.constant_N or (0.0, 0.0), ("fx_N", "fy_N"), file.duration_s, path),
        around=_around(file, device, path),
    )  # fmt: skip


def whole_number(total: float, part: float, where: str, of: str) -> int:
    """How many parts make the total; an InputError unless that is a whole number."""
    ratio = total / part
    if ratio > 2.0**53:
        raise InputError(f"{where} ({total:g} s) is too many {of} ({part:g} s)")
    count = round(ratio)
    if count < 1 or abs(ratio - count) > WHOLE_WITHIN * count:
        raise InputError(f"{where} ({total:g} s) is not a whole number of {of} ({part:g} s)")
    return count


def refuse_too_long(steps: int, rows: int, path: Path) -> None:
    """Refuse a scene that would take hours, or whose output would fill a disk."""
    if steps > MOST_STEPS:
        raise InputError(f"{path}: step_s: {steps:g} steps are too many, at most {MOST_STEPS:,}: choose longer ones")
    if rows > MOST_ROWS:
        raise InputError(
            f"{path}: output_interval_s: {rows:g} rows are too many, at most {MOST_ROWS:,}: choose a longer one"
        )


def _parts_of_step(step_s: float, path: Path) -> int:
    """Into how many parts a guarded step is divided, so that each look of the guard is at the edge of a step.

    Half the step, beside which the scene is run, then has half the parts' length: it checks them.
    """
    ticks = step_s / TICK_S
    parts = max(round(ticks), 1)
    whole = ticks / parts if ticks >= 1.0 else 1.0 / ticks
    if abs(whole - round(whole)) > WHOLE_WITHIN * whole:
        raise InputError(
            f"{path}: step_s ({step_s:g} s) must be a whole number of milliseconds, or one over a whole number: the "
            "guard looks every millisecond"
        )
    return parts


def _around(file: SceneFile, device: Device, path: Path) -> Around:
    """The obstacles. InputError if they are too many, or there is a guard that cannot keep the tip out of them."""
    try:
        edges = build_obstacles(file.obstacle)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    around = Around(obstacles=file.obstacle, guide=False, guard=file.guard)
    x, y = file.initial_tip_m
    if reason := why_no_guard(around, device.name, device, np.array([[x, y]]), "at initial_tip_m"):
        raise InputError(f"{path}: guard: {reason}")
    if file.guard is not None and nearest_obstacle(edges, len(edges), x, y).distance <= 0.0:
        raise InputError(f"{path}: initial_tip_m: ({x:g}, {y:g}) m is in an obstacle, there is nothing to guard")
    return around


def _schedule(file: SceneFile, device: Device, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) and values (n, 4) of the commands to the brakes."""
    key = "torque_N_m" if file.fidelity == "ideal" else "current_amperes"
    given = getattr(file.brakes, key) or JointCurrents()
    constants = np.array([[getattr(given, joint) for joint in JOINTS]])
    _check_commands(constants, device, file.fidelity, lambda row, joint: f"{path}: brakes.{key}.{joint}")
    if file.brakes.schedule is None:
        return np.zeros(1), constants
    name = path.parent / file.brakes.schedule
    table = read_number_file(name, f"{path}: brakes.schedule", ("t_s",), tuple(JOINTS))
    joints = table.columns[1:]
    table.check_times(file.duration_s, longer=1.0)
    values = np.zeros((len(table.values), 4))
    values[:, [JOINTS.index(joint) for joint in joints]] = table.values[:, 1:]
    if file.fidelity == "ideal":
        for joint in joints:
            table.check_range(joint, YIELD)
    _check_commands(values, device, file.fidelity, lambda row, joint: f"{name}: line {table.line(row)}: {joint}")
    return table.values[:, 0].copy(), values


def _check_commands(values: np.ndarray, device: Device, fidelity: str, where: Callable[[int, str], str]) -> None:
    """Refuse values (n, 4) below zero, at a joint without a brake, or above the brake's current limit."""
    for i, joint in enumerate(JOINTS):
        braked = joint in device.braked
        limit = (np.inf if fidelity == "ideal" else device.brakes.current_max[i]) if braked else 0.0
        for row in np.flatnonzero((values[:, i] < 0.0) | (values[:, i] > limit)):
            value, place = values[row, i], where(int(row), joint)
            if not braked:
                reason = f": {device.name} has no brake at this joint, so it must be 0 or absent"
            elif value < 0.0:
                reason = " must not be negative"
            else:
                reason = f" must be at most {limit:g} {device.command_unit} (current_max_A of the brake)"
            raise InputError(f"{place}{reason}, not {value:g}")


def hand_force(
    file: str | None, constant: Sequence[float], columns: Sequence[str], duration_s: float, path: Path
) -> tuple[np.ndarray, np.ndarray]:
    """Knots (m,), s, and forces (m, columns) of what the hand does: those of the scene's force file, or a constant."""
    if file is None:
        return np.zeros(1), np.array([constant])
    name = path.parent / file
    table = read_number_file(name, f"{path}: force.file", ("t_s", *columns))
    table.check_times(duration_s, MUCH_LONGER)
    for column in columns:
        table.check_range(column, TORQUE if column.endswith("_N_m") else FORCE)
    last = table.values[-1, 0]
    if last < duration_s - TIME_WITHIN:
        raise InputError(f"{name}: ends at {last:g} s, before the scene does (duration_s = {duration_s:g} s)")
    return table.values[:, 0].copy(), np.ascontiguousarray(table.values[:, 1:])
