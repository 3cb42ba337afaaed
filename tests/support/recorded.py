"""Recordings for tests: plausible ticks, and the promised names of their columns."""

import numpy as np
import pyarrow as pa

from core import tick_log
from core.control.controllers import DECISIONS
from experiments.recording.schema import recording_columns
from experiments.recording.writer import RecordingWriter

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


def record(path, rows, braked="AEB", outcome=None, pieces=1, flush=False):
    """A closed stream of these rows; flush: a batch a piece."""
    with RecordingWriter(path, braked, {"participant": "01"}, sync=False) as writer:
        for piece in np.array_split(rows, pieces):
            writer.write(piece)
            if flush:
                writer.flush()
        writer.close(outcome or {"status": "done"})
    return path


def assert_holds(recording, rows):
    """The recording holds exactly these rows, bit by bit."""
    for name, place in recording_columns(recording.braked):
        assert np.array_equal(recording.column(name), rows[:, place], equal_nan=True), name


def batch_ends(path):
    """The byte after each message of a stream, the first entry after the header, and the rows up to there."""
    source = pa.BufferReader(path.read_bytes())
    stream = pa.ipc.open_stream(source)
    schema_and_dictionaries = pa.BufferReader(path.read_bytes())
    while pa.ipc.read_message(schema_and_dictionaries).type != "record batch":
        ends = [(schema_and_dictionaries.tell(), 0)]
    for batch in stream:
        ends.append((source.tell(), ends[-1][1] + batch.num_rows))
    return ends
