"""`phd simulate`: run a scene and stream its motion to a CSV file.

The rows come chunk by chunk, so memory stays flat however long the scene is. The file is created exclusively, and
removed again if the run does not reach its end. Beside the run goes the same scene at half the step: where the two come
apart, or the energy ledger contradicts the motion, the summary warns.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from core.files import InputError
from core.mechanism import JOINTS
from core.simulator.hand import new_hand
from core.simulator.simulation import ROW_WIDTH, Ledger, Simulation
from core.tick_log import STUCK_LETTERS
from experiments.simulate.scene import Scene

#: Most output rows, and most steps, computed at a time: enough that a call costs nothing, few enough that progress
#: shows and an interrupt is heard (a running kernel hears none).
CHUNK_ROWS = 20_000
CHUNK_STEPS = 500_000

#: m; a run whose tip differs by more from that at half the step is warned of (our choice: a first-order error of a
#: millimetre shows as half a millimetre, and leave a margin).
SURE_WITHIN_M = 3e-4

#: Columns of a chunk: t, x, y, vx, vy, torque of A, E, B, C, stuck (bits 1 A, 2 E, 4 B, 8 C).
X, TORQUE, STUCK, WIDTH = 1, 5, 9, ROW_WIDTH


@dataclass(frozen=True)
class Summary:
    """What a run did."""

    rows: int
    steps: int
    wall_s: float
    simulated_s: float
    events: int
    fallbacks: int
    half_step_differs_m: float | None  # how far at most half the step puts the tip elsewhere; None: without bound
    check_s: float  # wall time that finding this out took
    warnings: tuple[str, ...]


class SceneRun:
    """A scene being simulated, chunk by chunk."""

    def __init__(self, scene: Scene) -> None:
        """Compile, or load, every kernel that a step needs, so that no clock runs meanwhile."""
        self.scene, self.row = scene, 0
        self.simulation = new_simulation(scene)
        new_simulation(scene).rows(1, scene.step_s, 1, scene.schedule_t, scene.schedule, 0, 0)

    def run_chunk(self, rows: int) -> np.ndarray:
        """The next output rows (rows, WIDTH); the first call begins at t = 0."""
        scene, first = self.scene, self.row
        self.row += rows
        return self.simulation.rows(
            rows, scene.step_s, scene.output_every, scene.schedule_t, scene.schedule, first, scene.rows - 1
        )

    def ledger(self) -> Ledger:
        """Energies and counts so far."""
        return self.simulation.ledger()


def new_simulation(scene: Scene) -> Simulation:
    """The scene's device and hand before the first step."""
    (x, y), (vx, vy) = scene.initial_tip, scene.initial_velocity
    hand = new_hand(scene.force_t, scene.force)
    return Simulation(scene.device, (x, y), (vx, vy), scene.fidelity, scene.integrator, hand, tolerance=scene.tolerance)


def simulate(scene: Scene, out_path: str | Path, progress: Callable[[float], None] = lambda share: None) -> Summary:
    """Run a scene into a new CSV file. `progress` gets the share done (0 to 1) after each chunk.

    InputError if the file exists or cannot be created; OSError if writing fails; FloatingPointError if the motion
    diverges. In all these cases, and on any other exception, no half-written file is left behind.
    """
    path = Path(out_path)
    file = create_file(path)
    try:
        with file:
            run, check = SceneRun(scene), HalfStep(SceneRun(scene.finer()))
            start, check_s, done = time.perf_counter(), 0.0, 0
            file.write((",".join(column_names(scene.device.braked)) + "\n").encode())
            while done < scene.rows:
                count = min(CHUNK_ROWS, max(CHUNK_STEPS // scene.output_every, 1), scene.rows - done)
                chunk, times = run.run_chunk(count), scene.row_times(done, count)
                if not np.isfinite(chunk).all():  # a force or speed beyond all sense
                    t = times[np.flatnonzero(~np.isfinite(chunk).all(axis=1))[0]]
                    raise FloatingPointError(f"the simulated motion is no longer finite at t = {t:g} s")
                write_rows(file, times, chunk, scene.device.braked)
                began = time.perf_counter()
                check.compare(chunk)
                check_s += time.perf_counter() - began
                done += count
                progress(done / scene.rows)
            wall_s = time.perf_counter() - start - check_s
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    ledger = run.ledger()
    return Summary(
        scene.rows, scene.steps, wall_s, scene.duration_s, ledger.events, ledger.fallbacks,
        check.apart_m if math.isfinite(check.apart_m) else None, check_s, ledger.warnings() + check.warnings(scene),
    )  # fmt: skip


class HalfStep:
    """The same scene at half the step, compared row by row."""

    def __init__(self, run: SceneRun) -> None:
        self.run, self.done, self.apart_m, self.first = run, 0, 0.0, -1

    def compare(self, chunk: np.ndarray) -> None:
        """Take the run's next rows."""
        apart = np.hypot(*(chunk - self.run.run_chunk(len(chunk)))[:, X : X + 2].T)
        apart[~np.isfinite(apart)] = np.inf
        beyond = np.flatnonzero(apart > SURE_WITHIN_M)
        if self.first < 0 and len(beyond):
            self.first = self.done + int(beyond[0])
        self.apart_m = max(self.apart_m, float(apart.max()))
        self.done += len(chunk)

    def warnings(self, scene: Scene) -> tuple[str, ...]:
        """A sentence where the two came apart."""
        if self.first < 0:
            return ()
        t = scene.row_times(self.first, 1)[0]
        far = f"up to {1e3 * self.apart_m:.3g} mm elsewhere" if math.isfinite(self.apart_m) else "beyond all bounds"
        return (
            f"the tip may be wrong by a millimetre or more from t = {t:g} s on: "
            f"half the step puts it {far}; choose a smaller step_s",
        )


def create_file(path: Path) -> BinaryIO:
    """A new file, open for writing; an InputError if it exists or cannot be created."""
    try:
        return open(path, "xb")
    except FileExistsError:
        raise InputError(f"{path}: exists already and is never overwritten") from None
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or "the path is not valid"
        raise InputError(f"{path}: cannot be created ({reason.lower()})") from None


def column_names(braked: str) -> list[str]:
    """The header of the output: no columns for joints without a brake."""
    tip = ["t_s", "tip_x_m", "tip_y_m", "tip_vx_m_s", "tip_vy_m_s"]
    return [*tip, *(f"torque_{joint}_N_m" for joint in braked), "stuck"]


def write_rows(file: BinaryIO, times: np.ndarray, chunk: np.ndarray, braked: str) -> None:
    """Append rows: shortest decimals that read back as the same doubles, LF line ends."""
    columns = [times, *chunk[:, X : X + 4].T, *(chunk[:, TORQUE + JOINTS.index(joint)] for joint in braked)]
    bits = pa.array(chunk[:, STUCK].astype(np.int8))
    stuck = pa.DictionaryArray.from_arrays(bits, list(STUCK_LETTERS)).cast(pa.string())
    arrays = [pa.array(column + 0.0) for column in columns]  # + 0.0: no "-0" where a torque is zero
    table = pa.table([*arrays, stuck], names=column_names(braked))
    pa_csv.write_csv(table, file, pa_csv.WriteOptions(include_header=False, quoting_style="none"))
