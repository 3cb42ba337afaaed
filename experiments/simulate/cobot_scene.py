"""Scenes of a cobot (`core/cobot.py`): castors steered freely, along a path or along a wall, under a given hand force.

The fields of `CobotSceneFile` are its keys; two such scenes are shipped, scooter and scooter-wall.
"""

import math
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow import csv as pa_csv

from core.cobot import COBOT, UNSTEERED, CobotFile, advance, advance_at_wall, new_cobot, path_goal, velocity
from core.control.rule_sets import SETTLED, Rules
from core.control.velocity_field import PIECE, Seen, field_at, new_memory
from core.device import COBOT_FOLDER
from core.files import InputError, Positive, Table, from_plain, is_assumed, parse_toml, read_text, shipped_or_file
from core.kernels import kernel
from core.path import Path as PathAhead
from core.path import build_path, line, nearest_piece, path_from
from core.ranges import Angle, Coordinate, Force, Place, Push, Torque
from core.records import new_record
from experiments.progress import Progress, no_progress
from experiments.simulate.scene import StepLength, hand_force, refuse_too_long, whole_number
from experiments.simulate.simulate import new_csv, run_beside

FREE, ALONG_PATH, AT_WALL = range(3)
#: t, pose (3), velocity (3), angles of the castors (3), limited castors (bits), hand's work, kinetic energy
WIDTH = 13
Pose = tuple[Coordinate, Coordinate, Angle]


class HandTable(Table, frozen=True):
    """What the hand does at the centre of mass: a file, or a constant."""

    file: str | None = None  # CSV of t_s, fx_N, fy_N, torque_N_m, linear between rows
    constant: tuple[Force, Force, Torque] | None = None  # in its place: [N, N, N m]

    def __post_init__(self) -> None:
        if self.file is not None and self.constant is not None:
            raise ValueError("give either file or constant, not both")


class WallTable(Table, frozen=True):
    """A straight wall that a free cobot never passes, as long as the hand pushes no harder than `push_max_N`."""

    at_m: Place  # a point of a wall
    normal: tuple[float, float]  # direction to its free side
    push_max_N: Push  # largest push into the wall

    def __post_init__(self) -> None:
        if not math.hypot(*self.normal) > 0.0:
            raise ValueError("normal must have a direction")


class CobotSceneFile(Table, frozen=True):
    """A scene as it stands in its file."""

    cobot: str  # a shipped cobot, or a path from this file's folder
    duration_s: Positive  # of the scene, and of a step
    step_s: StepLength
    output_interval_s: Positive | None = None  # none: `step_s`
    initial_pose: Pose = (0.0, 0.0, 0.0)  # m, m, rad: at rest, castors along the body's x axis
    force: HandTable = HandTable()
    #: to steer along, as a path of a protocol, with `heading_rad` (0.0), reached within about `within_m` (0.3)
    path: dict[str, Any] | None = None
    wall: WallTable | None = None

    def __post_init__(self) -> None:
        if self.path is not None and self.wall is not None:
            raise ValueError("give either path or wall, not both")


class CobotScene(NamedTuple):
    """A scene that has passed every check."""

    cobot: CobotFile
    pose: Pose
    step_s: float
    output_every: int  # steps from one output row to the next
    rows: int  # the first at t = 0
    mode: int
    path: PathAhead
    heading_rad: float
    within_m: float
    wall: np.ndarray  # (4,) a place, and the unit normal
    push_max_N: float
    force_t: np.ndarray  # (m,) s
    force: np.ndarray  # (m, 3)

    def finer(self) -> "CobotScene":
        """The same at half the step."""
        return self._replace(step_s=0.5 * self.step_s, output_every=2 * self.output_every)

    @property
    def check_words(self) -> tuple[str, str]:
        """For the warning where the check differs from the run: what the check was, and what to do."""
        return "half the step", "choose a smaller step_s"

    def row_times(self, first: int, count: int) -> np.ndarray:
        """Times (s) of output rows first .. first + count - 1."""
        return np.arange(first, first + count) * self.output_every * self.step_s


def is_cobot_scene(path: Path) -> bool:
    """Whether a scene file is one of a cobot: it names one."""
    return any(line.split("=")[0].strip() == "cobot" for line in read_text(path).splitlines())


def load_cobot(reference: str, folder: Path, where: str) -> CobotFile:
    """A shipped cobot by its name, or a cobot file by its path."""
    path = shipped_or_file(reference, COBOT_FOLDER, folder, f"{where}: unknown cobot")
    return parse_toml(read_text(path), CobotFile, str(path))


def read_cobot_scene(path: Path) -> CobotScene:
    """The scene of a file; every path inside is relative to it. An InputError names file, key and reason."""
    file = parse_toml(read_text(path), CobotSceneFile, str(path))
    cobot = load_cobot(file.cobot, path.parent, f"{path}: cobot")
    interval = file.step_s if file.output_interval_s is None else file.output_interval_s
    every = whole_number(interval, file.step_s, f"{path}: output_interval_s", "step_s")
    rows = whole_number(file.duration_s, interval, f"{path}: duration_s", "output intervals") + 1
    refuse_too_long((rows - 1) * every, rows, path)
    mode, ahead, heading, within = FREE, line((0.0, 0.0), (1.0, 0.0)), 0.0, 1.0
    if file.path is not None:
        about = dict(file.path)
        mode = ALONG_PATH
        heading = from_plain(about.pop("heading_rad", 0.0), float, f"{path}: path.heading_rad")
        within = from_plain(about.pop("within_m", 0.3), Positive, f"{path}: path.within_m")
        ahead = build_path(path_from(about, f"{path}: path"), f"{path}: path")
    wall, push = np.zeros(4), 0.0
    if file.wall is not None:
        (nx, ny), mode, push = file.wall.normal, AT_WALL, file.wall.push_max_N
        wall = np.array((*file.wall.at_m, nx / math.hypot(nx, ny), ny / math.hypot(nx, ny)))
        if (file.initial_pose[0] - wall[0]) * wall[2] + (file.initial_pose[1] - wall[1]) * wall[3] < 0.0:
            raise InputError(f"{path}: initial_pose: stands behind the wall")
    constant, columns = file.force.constant or (0.0, 0.0, 0.0), FORCES
    times, force = hand_force(file.force.file, constant, columns, file.duration_s, path)
    if len(cobot.hubs_m) == 1 and np.any(force[:, 2]):
        raise InputError(f"{path}: force: {cobot.name} has one castor and no heading, its torque must be 0")
    return CobotScene(
        cobot, file.initial_pose, file.step_s, every, rows, mode, ahead, heading, within, wall, push,
        times, force,
    )  # fmt: skip


class Task(NamedTuple):
    """What the castors of a scene do, as the kernel reads it."""

    mode: int
    path: PathAhead
    rules: Rules
    heading: float  # rad
    within: float  # m
    wall: np.ndarray  # (4,)
    push: float  # N
    most: int  # steps of a rehearsal
    step: float  # s


@kernel
def run_cobot(cobots, memory, task, forces, first, rows):
    """Fill rows (n, WIDTH) from row `first` on, and advance after each by as many steps as it has forces (n, steps, 3).

    cobots: the cobot, and a record for its rehearsals.
    """
    step = task.step
    cobot = cobots[0]
    for r in range(rows.shape[0]):
        row, limited = rows[r], 0
        row[0] = (first + r) * forces.shape[1] * step
        vx, vy, w = velocity(cobot)
        row[4], row[5], row[6] = vx, vy, w
        for k in range(3):
            row[1 + k] = cobot.pose[k]
            row[7 + k] = math.atan2(cobot.axis[k, 1], cobot.axis[k, 0])
        row[11], row[12] = cobot.work, 0.5 * cobot.speed * cobot.speed
        for n in range(forces.shape[1]):
            force = forces[r, n, 0], forces[r, n, 1], forces[r, n, 2]
            if task.mode == AT_WALL:
                advance_at_wall(cobots, task.wall, task.push, force, step, task.most)
            elif task.mode == ALONG_PATH:
                vx, vy, _ = velocity(cobot)
                seen = Seen(cobot.pose[0], cobot.pose[1], vx, vy, force[0], force[1])
                field = field_at(task.path, memory, seen, task.rules)
                advance(cobot, force, 1, path_goal(cobot, field, force, task.heading, task.within, step), step)
            else:
                advance(cobot, force, 0, UNSTEERED, step)
            limited |= cobot.limited
        row[10] = limited


class CobotRun:
    """A scene being simulated, chunk by chunk."""

    def __init__(self, scene: CobotScene) -> None:
        self.scene, self.done = scene, 0
        self.cobots = np.concatenate([new_cobot(scene.cobot, scene.pose), new_record(COBOT)])
        self.memory = new_memory()
        self.memory[PIECE] = nearest_piece(scene.path, *scene.pose[:2])

    def run_chunk(self, count: int) -> np.ndarray:
        """The next output rows (count, WIDTH); the first call begins at t = 0."""
        s, every = self.scene, self.scene.output_every
        rows = np.zeros((count, WIDTH))
        middle = (self.done * every + np.arange(count * every) + 0.5) * s.step_s  # a step holds the force of its middle
        forces = np.column_stack([np.interp(middle, s.force_t, s.force[:, k]) for k in range(3)])
        quarter_turns = round(2.0 * math.pi / (s.cobot.steering_rate_max_rad_s * s.step_s)) + 500
        task = Task(s.mode, s.path, SETTLED, s.heading_rad, s.within_m, s.wall, s.push_max_N, quarter_turns, s.step_s)
        run_cobot(self.cobots, self.memory, task, forces.reshape(count, every, 3), self.done, rows)
        self.done += count
        return rows


def simulate_cobot(scene: CobotScene, out_path: str | Path, progress: Progress = no_progress) -> dict[str, Any]:
    """Run a scene into a new CSV file, as `simulate` does; the summary."""
    wheels = len(scene.cobot.hubs_m)
    limited_rows, nearest = 0, math.inf

    def write(times: np.ndarray, rows: np.ndarray) -> None:
        nonlocal limited_rows, nearest
        force = [np.interp(times, scene.force_t, scene.force[:, k]) for k in range(3)]
        write_rows(file, np.column_stack([rows, *force]), wheels)
        limited_rows += int(np.count_nonzero(rows[:, 10]))
        distance = (rows[:, 1] - scene.wall[0]) * scene.wall[2] + (rows[:, 2] - scene.wall[1]) * scene.wall[3]
        nearest = min(nearest, float(distance.min()))

    with new_csv(out_path, column_names(wheels)) as file:
        run = CobotRun(scene)
        done = run_beside(run, CobotRun(scene.finer()), write, progress)
    record = run.cobots[0]
    return {
        "cobot": scene.cobot.name,
        "assumed": is_assumed(scene.cobot.provenance),
        "rows": scene.rows,
        "wall_s": done.wall_s,
        "half_step_differs_m": done.differs_m,
        "rows_with_a_servo_at_its_limit": limited_rows,
        "side_force_max_N": float(record["side_force"]),
        "energy_residual_J": 0.5 * float(record["speed"]) ** 2 - float(record["work"]),
        "least_distance_from_wall_m": nearest if scene.mode == AT_WALL else None,
        "warnings": list(done.warnings),
    }


FORCES = ("fx_N", "fy_N", "torque_N_m")  # of the hand


def column_names(wheels: int) -> list[str]:
    """The header of the output."""
    castors = [f"castor_{i}_rad" for i in range(1, wheels + 1)]
    pose = ["t_s", "x_m", "y_m", "heading_rad", "vx_m_s", "vy_m_s", "rate_rad_s"]
    return [*pose, *castors, "limited", "work_J", "kinetic_J", *FORCES]


def write_rows(file: BinaryIO, rows: np.ndarray, wheels: int) -> None:
    """Append rows; `limited`: the numbers of the castors whose servo sets the pace until the next one."""
    arrays = [pa.array(column + 0.0) for column in rows[:, : 7 + wheels].T]
    words = ["".join(str(i + 1) for i in range(wheels) if int(bits) >> i & 1) for bits in rows[:, 10]]
    table = pa.table([*arrays, pa.array(words), *map(pa.array, rows[:, 11:].T)], names=column_names(wheels))
    pa_csv.write_csv(table, file, pa_csv.WriteOptions(include_header=False, quoting_style="none"))
