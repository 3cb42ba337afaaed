"""`phd simulate`: run a scene and stream its motion to a new CSV file, chunk by chunk, so memory stays flat.

Beside the run goes the same scene at half the step: where the two come apart, or the energy ledger contradicts the
motion, the summary warns.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from core.mechanism import JOINTS
from core.simulator.hand import new_hand
from core.simulator.simulation import ROW_WIDTH, Ledger, Simulation
from core.tick_log import STUCK_LETTERS
from experiments.progress import Progress, unseen
from experiments.recording.atomic_files import refuse_existing_files, refusing
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


def simulate(scene: Scene, out_path: str | Path, progress: Progress = unseen) -> dict[str, Any]:
    """Run a scene into a new CSV file; what the run did. `progress` gets the share done (0 to 1) after each chunk.

    InputError if the file exists or cannot be created; OSError if writing fails; FloatingPointError if the motion
    diverges. In all these cases, and on any other exception, no half-written file is left behind.
    """
    braked = scene.device.braked
    with new_csv(Path(out_path), column_names(braked)) as file:
        run, half_step = SceneRun(scene), SceneRun(scene.finer())
        done = run_beside(scene, run, half_step, lambda times, rows: write_rows(file, times, rows, braked), progress)
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
        "warnings": [*ledger.warnings(), *done.warnings],
    }


@contextmanager
def new_csv(path: Path, header: Sequence[str]) -> Iterator[BinaryIO]:
    """A new file with its header, open for writing; it is removed if an exception ends the writing.

    InputError if it exists or cannot be created.
    """
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


class Comparison(NamedTuple):
    """A run beside the same scene at half the step."""

    wall_s: float  # of the run alone
    check_s: float  # of the one at half the step
    differs_m: float | None  # how far apart their places came; None: without bound
    warnings: tuple[str, ...]


def run_beside(
    scene: Any, run: Any, half_step: Any, write: Callable[[np.ndarray, np.ndarray], None],
    progress: Callable[[float], None],
) -> Comparison:  # fmt: skip
    """Run a scene (of a device or a cobot) and the same one at half the step, chunk by chunk, and compare the places.

    write: takes the times (n,) and rows (n, columns; the place in columns X and X + 1) of each chunk of the run.
    FloatingPointError if the motion diverges.
    """
    start, check_s, done, differs_m, wrong_from_s = time.perf_counter(), 0.0, 0, 0.0, math.inf
    while done < scene.rows:
        count = min(CHUNK_ROWS, max(CHUNK_STEPS // scene.output_every, 1), scene.rows - done)
        rows, times = run.run_chunk(count), scene.row_times(done, count)
        if not np.isfinite(rows).all():  # a force or speed beyond all sense
            t = times[np.flatnonzero(~np.isfinite(rows).all(axis=1))[0]]
            raise FloatingPointError(f"the simulated motion is no longer finite at t = {t:g} s")
        write(times, rows)
        began = time.perf_counter()
        apart = np.hypot(*(rows - half_step.run_chunk(count))[:, X : X + 2].T)
        apart[~np.isfinite(apart)] = np.inf
        differs_m = max(differs_m, float(apart.max()))
        wrong_from_s = min([wrong_from_s, *times[apart > SURE_WITHIN_M][:1]])
        check_s += time.perf_counter() - began
        done += count
        progress(done / scene.rows)
    far = f"up to {1e3 * differs_m:.3g} mm elsewhere" if math.isfinite(differs_m) else "beyond all bounds"
    warning = (
        f"the motion may be wrong by a millimetre or more from t = {wrong_from_s:g} s on: half the step puts it {far}; "
        "choose a smaller step_s"
    )
    return Comparison(
        time.perf_counter() - start - check_s, check_s, differs_m if math.isfinite(differs_m) else None,
        (warning,) if math.isfinite(wrong_from_s) else (),
    )  # fmt: skip


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
