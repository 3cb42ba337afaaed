"""`phd simulate`: run a scene and stream its motion to a new CSV file, chunk by chunk, so memory stays flat.

Beside the run goes the same scene at half the step, whatever the integrator by `event`: where the two come apart, or
the energy ledger contradicts the motion, the summary warns.
"""

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from core.control.algorithm import LOCK_TOO_LATE, NONE
from core.mechanism import JOINTS
from core.obstacles import build_obstacles, nearest_obstacle
from core.simulator.guarding import Guarded
from core.simulator.hand import new_hand
from core.simulator.simulation import (
    COMMANDS,
    ENERGIES,
    HAND,
    ROW_WIDTH,
    STUCK,
    Grid,
    Ledger,
    Schedule,
    Simulation,
)
from core.tick_log import STUCK_LETTERS
from experiments.atomic_files import refuse_existing_files, refusing
from experiments.numbers import significant
from experiments.progress import Progress, no_progress
from experiments.simulate.leaving import Leaving, looks_per_row
from experiments.simulate.scene import Scene

#: Most output rows, and most steps, computed at a time: enough that a call costs nothing, few enough that progress
#: shows.
CHUNK_ROWS = 20_000
STDOUT = "-"  # in place of the file's name
CHUNK_STEPS = 500_000

#: s; how late an interrupt is heard while a kernel runs.
HEARD_EVERY_S = 0.1

#: m; a run whose tip differs by more from the check is warned of. Our choice: half of the millimetre promised, so a
#: check may be off by as much. Larger: where the check is off, too, a millimetre passes. Smaller: right results are
#: warned of.
SURE_WITHIN_M = 5e-4

ROUNDING = 1e-9  # relative, of a force file's two components: a push of push_N in any direction is no more than that

#: Columns of a chunk, beside those of `core.simulator.simulation`.
X, TORQUE = 1, 5
ENERGY_COLUMNS = ("work_hand_J", "heat_brakes_J", "kinetic_J", "lost_at_stops_J")  # of the output
GUARD = ROW_WIDTH  # where there is a guard: its decision
LOCKED, TOO_LATE = "lock", "lock: too late"  # words of the guard; where the brakes are free it has none


class SceneRun:
    """A scene being simulated, chunk by chunk."""

    def __init__(self, scene: Scene) -> None:
        """Compile, or load, every kernel that a step needs, so that no clock runs meanwhile."""
        self.scene, self.row = scene, 0
        self.looks, self.leaving = looks_per_row(scene.output_every, scene.step_s), Leaving(scene.device.mechanism)
        self.simulation = new_simulation(scene)
        self.guarded = None if scene.around.guard is None else Guarded(self.simulation, scene.around)
        self.schedule = Schedule(scene.schedule_t, scene.schedule)
        spare = new_simulation(scene)
        first = spare if self.guarded is None else Guarded(spare, scene.around)
        first.rows(1, self.schedule, Grid(0, 0, 1, scene.step_s))

    def run_chunk(self, count: int) -> np.ndarray:
        """The next output rows (count, ROW_WIDTH, or one more with a guard); the first call begins at t = 0."""
        scene, looks = self.scene, self.looks
        grid = Grid(self.row * looks, (scene.rows - 1) * looks, scene.output_every // looks, scene.step_s)
        self.row += count
        simulation = self.simulation if self.guarded is None else self.guarded
        rows = simulation.rows(min(count * looks, grid.last_row + 1 - grid.first_row), self.schedule, grid)
        self.leaving.look(rows[:, 0], rows[:, X], rows[:, X + 1])
        return rows[::looks]

    def ledger(self) -> Ledger:
        """Energies and counts so far."""
        return self.simulation.ledger()

    def guard_ticks(self) -> dict[str, int]:
        """How often the guard has looked so far, and what it did."""
        assert self.guarded is not None
        counts = {"guard_ticks": "ticks", "guard_locked_ticks": "locked", "guard_too_late_ticks": "too_late"}
        return {name: int(self.guarded.looks[field][0]) for name, field in counts.items()}

    def other_decisions(self, half_step: "SceneRun") -> tuple[str, ...]:
        """A sentence where the guard of the same scene at half the step has decided otherwise in any tick."""
        guards = [run.guarded.looks for run in (self, half_step) if run.guarded is not None]
        if len({int(looks["course"][0]) for looks in guards}) < 2:
            return ()
        return ("at half the step the guard locks or lets go in other ticks: from there on the motions differ by that",)


def new_simulation(scene: Scene) -> Simulation:
    """The scene's device and hand before the first step."""
    (x, y), (vx, vy) = scene.initial_tip, scene.initial_velocity
    hand = new_hand(scene.force_t, scene.force)
    simulation = Simulation(scene.device, (x, y), (vx, vy), scene.fidelity, scene.integrator, hand)
    simulation.body["tolerance"][0] = scene.tolerance
    return simulation


def simulate(scene: Scene, out_path: str | Path, progress: Progress = no_progress) -> dict[str, Any]:
    """Run a scene into a new CSV file; returns a summary. `progress` gets the share done (0 to 1) after each chunk.

    InputError if the file exists or cannot be created; OSError if writing fails; FloatingPointError if the motion
    diverges. In all these cases, and on any other exception, no half-written file is left behind.
    """
    edges, nearest = build_obstacles(scene.around.obstacles), math.inf

    def write(times: np.ndarray, rows: np.ndarray) -> None:
        nonlocal nearest
        more: dict[str, pa.Array] = {}
        if len(edges):
            distances = [nearest_obstacle(edges, len(edges), x, y).distance for x, y in rows[:, X : X + 2].tolist()]
            nearest = min(nearest, *distances)
            more["obstacle_m"] = pa.array(distances)
        if scene.around.guard is not None:
            which = np.where(rows[:, GUARD] == NONE, 0, np.where(rows[:, GUARD] == LOCK_TOO_LATE, 2, 1))
            more["guard"] = _words(which, ("", LOCKED, TOO_LATE))
        write_rows(file, times, rows, scene, more)

    with new_csv(out_path, [*column_names(scene), *extra_columns(scene)]) as file:
        run, half_step = SceneRun(scene), SceneRun(scene.finer())
        done = run_beside(run, half_step, write, progress)
    ledger = run.ledger()
    return {
        "rows": scene.rows,
        "steps": scene.steps,
        "wall_s": done.wall_s,
        "simulated_s": scene.duration_s,
        "events": ledger.events,
        "fallbacks": ledger.fallbacks,
        "half_step_differs_m": done.differs_m,
        "check_s": done.check_s,
        **({"least_obstacle_m": nearest} if len(edges) else {}),
        **({} if scene.around.guard is None else run.guard_ticks()),
        "warnings": [
            *ledger.warnings(),
            *done.warnings,
            *([run.leaving.warning] if run.leaving.warning else ()),
            *(run.other_decisions(half_step) if done.warnings and scene.around.guard else ()),
            *(pushed_beyond(scene, scene.around.guard.push_N) if scene.around.guard else ()),
        ],  # fmt: skip
    }


def extra_columns(scene: Scene) -> list[str]:
    """The columns at the end of a scene's file that only scenes with obstacles have."""
    return ["obstacle_m"] * bool(scene.around.obstacles) + ["guard"] * (scene.around.guard is not None)


def pushed_beyond(scene: Scene, allowed: float) -> tuple[str, ...]:
    """A warning where the hand pushes harder than its guard allows for (N)."""
    inside = scene.force_t[(scene.force_t > 0.0) & (scene.force_t < scene.duration_s)]
    times = np.concatenate([[0.0], inside, [scene.duration_s]])
    push = np.hypot(*(np.interp(times, scene.force_t, scene.force[:, axis]) for axis in (0, 1))).max()
    if push <= allowed * (1.0 + ROUNDING):
        return ()
    return (
        f"the hand pushes with up to {significant(push, 4)} N, more than the {allowed:g} N (push_N) that the guard "
        "allows for: the tip can get into an obstacle",
    )


@contextmanager
def new_csv(path: str | Path, header: Sequence[str]) -> Iterator[BinaryIO]:
    """A new file with its header, open for writing; it is removed if an exception ends the writing.

    `STDOUT` is standard output. InputError if the file exists or cannot be created.
    """
    if str(path) == STDOUT:
        sys.stdout.buffer.write((",".join(header) + "\n").encode())
        yield sys.stdout.buffer
        sys.stdout.buffer.flush()
        return
    path = Path(path)
    refuse_existing_files([path])
    with refusing(path, "cannot be created"):
        file = open(path, "xb")
    try:
        with file:
            file.write((",".join(header) + "\n").encode())
            yield file
    except BaseException:
        path.unlink(missing_ok=True)
        raise


class AnyRun(Protocol):
    """A scene of a device or of a cobot, being simulated."""

    scene: Any

    def run_chunk(self, count: int) -> np.ndarray:
        """The next output rows (count, columns)."""


class Comparison(NamedTuple):
    """A run beside its check."""

    wall_s: float  # of the run alone
    check_s: float  # of the check
    differs_m: float | None  # how far apart their places came; None: without bound
    warnings: tuple[str, ...]


def run_beside(
    run: AnyRun, half_step: AnyRun, write: Callable[[np.ndarray, np.ndarray], None], progress: Progress
) -> Comparison:
    """Run a scene and its check (`finer`), chunk by chunk, and compare the places.

    write: takes the times (n,) and rows (n, columns; the place in columns X and X + 1) of each chunk of the run.
    FloatingPointError if the motion diverges.
    """
    scene = run.scene
    start, check_s, done, differs_m, wrong_from_s = time.perf_counter(), 0.0, 0, 0.0, math.inf
    while done < scene.rows:
        count = min(CHUNK_ROWS, max(CHUNK_STEPS // scene.output_every, 1), scene.rows - done)
        rows, times = interruptible(run.run_chunk, count), scene.row_times(done, count)
        if not np.isfinite(rows).all():  # a force or speed beyond all sense
            t = times[np.flatnonzero(~np.isfinite(rows).all(axis=1))[0]]
            raise FloatingPointError(f"the simulated motion is no longer finite at t = {t:g} s")
        write(times, rows)
        began = time.perf_counter()
        apart = np.hypot(*(rows - interruptible(half_step.run_chunk, count))[:, X : X + 2].T)
        apart[~np.isfinite(apart)] = np.inf
        differs_m = max(differs_m, float(apart.max()))
        wrong_from_s = min([wrong_from_s, *times[apart > SURE_WITHIN_M][:1]])
        check_s += time.perf_counter() - began
        done += count
        progress(done / scene.rows)
    far = f"up to {significant(1e3 * differs_m)} mm elsewhere" if math.isfinite(differs_m) else "beyond all bounds"
    check, advice = scene.check_words
    warning = (
        f"the motion may be wrong by a millimetre or more from t = {wrong_from_s:g} s on: {check} puts it {far}; "
        f"{advice}"
    )
    return Comparison(
        time.perf_counter() - start - check_s, check_s, differs_m if math.isfinite(differs_m) else None,
        (warning,) if math.isfinite(wrong_from_s) else (),
    )  # fmt: skip


def interruptible(compute: Callable[[int], np.ndarray], count: int) -> np.ndarray:
    """Call `compute` on a thread of its own and return its result, so that Ctrl-C is heard while a kernel runs.

    An interrupted thread ends with the process. What `compute` raises is raised here.
    """
    found: list[np.ndarray | BaseException] = []

    def run() -> None:
        try:
            found.append(compute(count))
        except BaseException as error:  # handed over below
            found.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(HEARD_EVERY_S)  # on Windows a wait without an end hears nothing
    if isinstance(found[0], BaseException):
        raise found[0]
    return found[0]


def row_places(scene: Scene) -> dict[str, int]:
    """Column of the output -> its place in a row: motion, brakes, hand force, currents, energies.

    No columns for joints without a brake; no currents where the brakes are told torques (fidelity ideal).
    """
    tip = ("tip_x_m", "tip_y_m", "tip_vx_m_s", "tip_vy_m_s")
    joints = {joint: JOINTS.index(joint) for joint in scene.device.braked}
    currents = {} if scene.fidelity == "ideal" else joints
    return (
        {name: X + place for place, name in enumerate(tip)}
        | {f"torque_{joint}_N_m": TORQUE + i for joint, i in joints.items()}
        | {"stuck": STUCK, "hand_fx_N": HAND, "hand_fy_N": HAND + 1}
        | {f"current_{joint}_A": COMMANDS + i for joint, i in currents.items()}
        | {name: ENERGIES + place for place, name in enumerate(ENERGY_COLUMNS)}
    )


def column_names(scene: Scene) -> list[str]:
    """The header of the output."""
    return ["t_s", *row_places(scene)]


def write_rows(
    file: BinaryIO, times: np.ndarray, chunk: np.ndarray, scene: Scene, more: Mapping[str, pa.Array]
) -> None:
    """Append rows: shortest decimals that read back as the same doubles, LF line ends. more: further columns."""
    columns = {"t_s": pa.array(times + 0.0)}  # + 0.0: no "-0" where a number is zero
    for name, place in row_places(scene).items():
        values = chunk[:, place]
        columns[name] = _words(values, STUCK_LETTERS) if place == STUCK else pa.array(values + 0.0)
    table = pa.table(columns | dict(more))
    pa_csv.write_csv(table, file, pa_csv.WriteOptions(include_header=False, quoting_style="none"))


def _words(numbers: np.ndarray, words: Sequence[str]) -> pa.Array:
    """A column of words by their numbers (n,)."""
    return pa.DictionaryArray.from_arrays(pa.array(numbers.astype(np.int8)), list(words)).cast(pa.string())
