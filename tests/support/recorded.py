"""Recordings for tests: plausible ticks, and the promised names of their columns."""

from pathlib import Path

import numpy as np

from core import tick_log
from core.control.controllers import DECISIONS
from experiments.recording import Recording, recording_columns
from experiments.store.database import DATABASE, Database, new_database, reading, trials_in
from experiments.store.recording import RecordingWriter, as_json, close_trial, description, digest_of, write_parquet

NAMES = (
    "t_s, phase, tip_x_m, tip_y_m, tip_vx_m_s, tip_vy_m_s, tip_ax_m_s2, tip_ay_m_s2, hand_fx_N, hand_fy_N, "
    "current_A_A, current_E_A, current_B_A, current_C_A, torque_A_N_m, torque_E_N_m, torque_B_N_m, torque_C_N_m, "
    "stuck, decision, lateness_us, energy_hand_J, energy_brakes_J, energy_kinetic_J, energy_stops_J, "
    "target_x_m, target_y_m, sensed_fx_N, sensed_fy_N, target_vx_m_s, target_vy_m_s, arm_held_x_N, arm_held_y_N, "
    "arm_force_max_N, arm_stiffness_xx_N_per_m, arm_stiffness_xy_N_per_m, arm_stiffness_yy_N_per_m, "
    "path_distance_m, travel_sense, forward_x, forward_y, desired_x, desired_y, "
    "slave_x_m, slave_y_m, wanted_fx_N, wanted_fy_N, nearest_fx_N, nearest_fy_N, shown_fx_N, shown_fy_N, "
    "obstacle_distance_m"
).split(", ")


def ticks(n, seed=0):
    """n plausible rows of the tick log."""
    generator = np.random.default_rng(seed)
    rows = generator.normal(size=(n, tick_log.WIDTH))
    rows[:, tick_log.T] = np.arange(n) / 1000.0
    rows[:, tick_log.PHASE] = np.arange(n) * 4 // max(n, 1)
    rows[:, tick_log.STUCK] = generator.integers(0, 16, n)
    rows[:, tick_log.DECISION] = generator.integers(0, len(DECISIONS), n)
    return rows


def new_session_database(folder: Path, sync: bool = False) -> Database:
    """The database of a session of which nothing is known."""
    with new_database(folder / DATABASE, sync):
        pass
    return Database(folder, sync)


def record(
    folder: Path, rows: np.ndarray, braked: str = "AEB", outcome=None, pieces: int = 1, closed: bool = True,
    metadata=None, sensors=None, run: int = 1,
) -> Path:  # fmt: skip
    """A trial of these rows, in the folder of a new session; a row of the database for each piece.

    closed: its ticks are in its file, as after a trial; else it has ended, and they are in the database.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with Database(folder, sync=False) if (folder / DATABASE).exists() else new_session_database(folder) as database:
        writer = RecordingWriter(database, ("trials", run), braked, metadata or {"participant": "01"}, sensors)
        for piece in np.array_split(rows, pieces):
            writer.write(piece)
            writer.flush()
        trial = writer.close(outcome or {"status": "done"})
        database.commit()
        if closed:
            close_trial(database, trial, sync=False)
    return folder / "trials" / f"run-{run:03d}.parquet"


def assert_holds(recording, rows):
    """The recording holds exactly these rows, bit by bit."""
    for name, place in recording_columns(recording.braked):
        assert np.array_equal(recording.column(name), rows[:, place], equal_nan=True), name


def put_recording(path: Path, recording: Recording) -> Path:
    """Another recording in the place of one, whole by its checksums: other values, or another description."""
    with reading(path.parent.parent) as stored:
        (trial,) = (trial for trial, _ in trials_in(stored) if path.parent.parent / trial.name == path)
    about = description(recording.braked, recording.metadata, recording.sensors, recording.words["decision"])
    outcome = as_json(recording.outcome, "outcome")
    write_parquet(path, about, outcome, [np.array([column.astype(float) for column in recording.columns.values()])])
    whole = {"bytes": path.stat().st_size, "sha256": digest_of(path)}
    with Database(path.parent.parent) as database:
        database.put("trial", *trial._replace(about=about, outcome=outcome, ticks=recording.rows, **whole))
    return path
