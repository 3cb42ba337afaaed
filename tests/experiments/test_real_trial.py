"""A trial on the bench, over a board in simulated time: the simulated device's trial but for sensors and wire."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from protocols import PAPER
from real_bench import PATH, RealBench, drawn
from recorded import record
from simulated_bench import TIP

from core import tick_log
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis.metrics import trial_metrics
from experiments.plan import PlannedTrial
from experiments.recording import Sensors
from experiments.store.recording import read_recording
from experiments.study.replay import check_decisions
from experiments.trial.trial import Conditions, SimulatedTrial

#: Share by which a measure may differ from the simulated device's, with the same person and noise. Velocity is 7 ms
#: old (filter) and currents come a tick later (wire); encoder steps make the smoothness measures a little larger.
TOLERANCE = {
    "path_error_m": 0.05, "path_error_time_m": 0.05, "mean_tip_force_N": 0.02, "acceleration_dft_sum": 0.10,
    "acceleration_weighted_rms_m_s2": 0.10, "force_over_progress_N": 0.02, "duration_s": 0.02, "peak_error_m": 0.05,
    "path_length_ratio": 0.03, "sparc": 0.03,
}  # fmt: skip
CURRENTS = slice(tick_log.CURRENT, tick_log.CURRENT + 4)


@pytest.fixture
def bench() -> Iterator[RealBench]:
    bench = RealBench()
    yield bench
    bench.link.close()


def simulated(device, controller: int, seed: int) -> np.ndarray:
    """The same trial on the simulated device, (n, WIDTH)."""
    person, generator = drawn(seed)
    trial = SimulatedTrial(
        SimulatedDevice(device, TIP),
        PlannedTrial(1, 1, device.name, controller, 1, 1),
        Conditions(PATH, PAPER.controllers[controller], PAPER.rules, PAPER.trial),
        person,
        generator,
    )
    rows = np.empty((60_000, tick_log.WIDTH))
    rows = rows[: trial.run(rows)]
    assert trial.outcome()["status"] == "done"
    return rows


def recorded(rows: np.ndarray, device, outcome: dict, path: Path, sensors: Sensors | None):
    """Written, closed, turned into Parquet and read back."""
    return read_recording(record(path.parent / path.stem, rows, device.braked, outcome, sensors=sensors))


def test_a_trial_on_the_board_has_the_simulated_devices_measures_and_energies_and_a_row_a_sample(
    bench: RealBench, tmp_path: Path
) -> None:
    trial = bench.trial(2)
    rows = bench.run(trial)
    outcome = trial.outcome()
    assert (outcome["status"], outcome["reason"], outcome["filled"]) == ("done", "", 0)
    assert np.array_equal(
        np.unique(rows[:, tick_log.PHASE]), [tick_log.APPROACH, tick_log.HOLD, tick_log.MOVE, tick_log.END]
    )
    moving = rows[:, tick_log.PHASE] == tick_log.MOVE
    assert rows[moving][:, CURRENTS].any() and not rows[~moving][:, CURRENTS].any()
    assert not any(trial.currents) and not any(bench.board.board.currents), "none after the last tick"
    same = simulated(bench.device, 2, 3)
    here = recorded(rows, bench.device, outcome, tmp_path / "here.arrows", Sensors("AB", 6))
    there = recorded(same, bench.device, {}, tmp_path / "there.arrows", None)
    ours, theirs = (trial_metrics(recording, trial.path) for recording in (here, there))
    off = {name: abs(ours[name] / theirs[name] - 1.0) for name in TOLERANCE}
    assert all(off[name] <= share for name, share in TOLERANCE.items()), off
    assert 0.0 < max(off.values()), "the sensors of a board leave no mark"
    assert rows[-1, tick_log.ENERGY_HAND] == pytest.approx(same[-1, tick_log.ENERGY_HAND], rel=0.05)
    assert rows[-1, tick_log.ENERGY_BRAKES] == pytest.approx(same[-1, tick_log.ENERGY_BRAKES], rel=0.25)
    assert "estimated" in outcome["ledger"]

    assert np.array_equal(np.diff(rows[:, tick_log.BOARD_US]), np.full(len(rows) - 1, 1000.0))
    assert {"board_us", "host_s", "filled", "encoder_A_counts", "encoder_B_counts", "force_6_counts",
            "measured_C_A"} <= set(here.columns)  # fmt: skip
    assert "encoder_E_counts" not in here.columns and here.sensors == Sensors("AB", 6)
    counts = here.column("encoder_A_counts")
    assert np.array_equal(counts, np.round(counts)) and np.ptp(counts) > 100
    assert np.ptp(here.column("host_s") - 1e-6 * here.column("board_us")) < 1e-3


def test_samples_that_came_late_are_all_recorded_the_newest_decides_and_a_stopped_trial_ends_at_once(
    bench: RealBench,
) -> None:
    trial = bench.trial(2)
    bench.run(trial, lambda trial: trial.phase == "move" and any(trial.currents))
    before = trial.currents
    bench.pass_time(10)  # the host sleeps; what the board says waits in the wire
    rows = np.array(trial.exchange())
    assert len(rows) == 11 and not rows[:, tick_log.FILLED].any()
    assert np.allclose(np.diff(rows[:, tick_log.T]), 1e-3, rtol=0.0, atol=1e-9)
    assert (rows[:-1, CURRENTS] == before).all(), "what is past is not decided anew"
    assert (np.diff(rows[:, tick_log.LATENESS_US]) < 0.0).all() and rows[0, tick_log.LATENESS_US] > 9e3
    assert rows[:, tick_log.DECIDED].tolist() == [0.0] * 10 + [1.0]

    trial.abort("the participant sneezed")
    trial.abort("and again")
    assert not any(trial.currents)
    rows = bench.run(trial)
    outcome = trial.outcome()
    assert (outcome["status"], outcome["reason"]) == ("aborted", "the participant sneezed")
    assert len(rows) == round(PAPER.trial.end_s * 1000) and not rows[:, CURRENTS].any()


def test_on_a_bad_wire_decisions_follow_from_the_recording_alone_and_a_fault_after_the_end_leaves_the_trial_done(
    bench: RealBench, tmp_path: Path
) -> None:
    trial = bench.trial(4)
    bench.board.fault("drop=0.05")
    rows = [bench.run(trial, lambda trial: trial.phase == "move")]
    bench.pass_time(10)
    rows.append(bench.run(trial, lambda trial: trial.phase == "end"))
    filled, lost_on_the_way = trial.outcome()["filled"], bench.link.health.lost
    bench.link.stop()
    bench.run(trial)
    rows, outcome = np.concatenate(rows), trial.outcome()
    assert outcome["status"] == "done", outcome
    assert outcome["reason"] == "after its end: stopped by the host or the emergency stop"
    lost = rows[:, tick_log.FILLED] == 1.0
    assert lost.sum() == filled > 50
    assert lost_on_the_way == pytest.approx(filled, abs=5)
    assert np.isnan(rows[lost][:, tick_log.BOARD_US]).all()
    assert np.isfinite(rows[:, tick_log.TIP_X : tick_log.HAND_FY + 1]).all()
    found = recorded(rows, bench.device, outcome, tmp_path / "run.arrows", Sensors("AB", 6))
    assert 0.0 < trial_metrics(found, trial.path)["path_error_m"] < 0.005
    decided = np.count_nonzero(rows[:, tick_log.DECIDED])
    assert 100 < decided < np.count_nonzero(found.in_phase("move"))
    preset, rules = PAPER.controllers[4], PAPER.rules
    assert check_decisions(found, bench.device, Conditions(PATH, preset, rules)) == (decided, 0)
    other = preset.replaced(gain_N_s_m=0.9 * preset.value("gain_N_s_m"))
    assert check_decisions(found, bench.device, Conditions(PATH, other, rules)).different > 10
