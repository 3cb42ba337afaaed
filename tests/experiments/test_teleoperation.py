"""The passive master: a delayed slave, its force shown by brakes, its columns, its measures, and what is refused."""

import numpy as np
import pytest

from core import tick_log as log
from core.device import load_device
from core.files import InputError
from core.records import new_record
from experiments.analysis.metrics import trial_metrics
from experiments.paper_figures.passive_master import DELAYS_S, contact
from experiments.paper_figures.workspace import workspace_of
from experiments.protocol import load_protocol
from experiments.slave import SLAVE, Slave, follow_master, set_slave
from experiments.store.files import session_folder
from experiments.study.replay import replay
from experiments.study.study import run_study
from experiments.trial.population import load_population
from tests.experiments.test_metrics import MOVE_FROM, PATH, hand_made

FOUR = load_device("four-brake")
TEXT = load_protocol("teleoperation").text


@pytest.fixture(scope="module")
def contacts():
    """The hand goes into the wall, by brakes and by a motor, at every delay."""
    workspace = workspace_of(FOUR.mechanism)
    return {(delay, motor): contact(FOUR, workspace, delay, motor) for delay in DELAYS_S for motor in (False, True)}


def test_the_master_is_passive_at_any_delay_where_a_motor_puts_energy_in(contacts):
    for delay in DELAYS_S:
        brakes = contacts[delay, False]
        assert brakes.put_in_J < 1e-9
        rows = brakes.rows
        left = rows[:, log.ENERGY_KINETIC] + rows[:, log.ENERGY_BRAKES] - rows[:, log.ENERGY_HAND]
        assert np.ptp(left) < 1e-8, "all energy is the hand's"
        assert brakes.wanted.max() > 8.0 and brakes.share > 0.05
    assert contacts[0.0, True].put_in_J < 0.01
    assert contacts[0.05, True].put_in_J > 1.0 and contacts[0.1, True].put_in_J > 1.0


def test_the_force_arrives_two_delays_after_the_handle_has_gone(contacts):
    early, late = contacts[0.0, False], contacts[0.1, False]
    first = [int(np.argmax(course.wanted > 0.0)) for course in (early, late)]
    assert first[1] - first[0] == pytest.approx(200, abs=3), "ticks; the brakes have not acted before"


def test_a_slave_stands_where_the_springs_of_drive_and_wall_balance():
    slave = Slave(wall_at_m=(0.0, 0.4), wall_normal=(0.0, -2.0), delay_s=0.02, force_scale=0.5)
    record, tip, memory = new_record(SLAVE), np.array((0.05, 0.415, 0.0, 0.0)), np.full(7, np.nan)
    set_slave(record[0], slave)
    for tick in range(4000):
        follow_master(record.view(np.ndarray)[0], tip, tick, memory)
    depth = 0.015 * slave.stiffness_N_m / (slave.stiffness_N_m + slave.wall_stiffness_N_m)
    assert record["place"][0] == pytest.approx((0.05, 0.4 + depth, 0.0, 0.0), abs=1e-9)
    assert memory[3:5] == pytest.approx((0.0, -0.5 * slave.wall_stiffness_N_m * depth))


def test_the_measures_are_those_of_the_columns():
    none = trial_metrics(hand_made(), PATH)
    wanted, shown, near = np.zeros((3, 5200))
    wanted[MOVE_FROM:4000] = -10.0
    shown[MOVE_FROM:4000], near[MOVE_FROM:4000] = -6.0, -7.5
    columns = dict(WANTED_FX=0.0, WANTED_FY=wanted, SHOWN_FX=3.0, SHOWN_FY=shown, NEAREST_FX=0.0, NEAREST_FY=near)
    found = trial_metrics(hand_made(SLAVE_X=hand_made().column("tip_x_m"), SLAVE_Y=0.408, **columns), PATH)
    assert found["slave_error_m"] == pytest.approx(0.008)
    assert found["force_shown_share"] == pytest.approx(0.6)
    assert found["force_unavailable_share"] == pytest.approx(0.25)
    assert none["force_shown_share"] is None, "nothing was wanted"


def test_a_study_runs_it_and_a_replay_is_equal_to_the_last_bit(tmp_path):
    text = TEXT.replace('"three-brake", ', "").replace("blocks = 3", "blocks = 1")
    file = tmp_path / "own.toml"
    file.write_text(text)
    run_study(tmp_path / "study", 1, load_protocol(file), load_population())
    trials = sorted((session_folder(tmp_path / "study", "01") / "trials").glob("*.parquet"))
    assert len(trials) == 6
    for trial in trials[:3]:
        found = replay(trial)
        assert found["equal"] and found["decisions"]["different"] == 0
        assert found["before"]["energy_added_max_J"] < 1e-12
        shown = found["metrics"]["force_shown_share"]["after"]
        assert "Virtual wall" in found["after"]["controller"] or 0.0 < shown < 1.0, "wanted whatever the controller"


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("wall_normal = [0.0, -1.0]", "wall_normal = [0.0, 0.0]", "direction"),
        ("delay_s = 0.05", "delay_s = 0.6", "delay_s"),
        ("mass_kg = 1.0", "mass_kg = 0.005", "too small"),
        (TEXT[TEXT.index("[slave]") :], "", "Force of the slave: needs a .slave. or wall_N_m"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(tmp_path, old, new, reason):
    assert old in TEXT
    (tmp_path / "own.toml").write_text(TEXT.replace(old, new))
    with pytest.raises(InputError, match=reason):
        load_protocol(tmp_path / "own.toml")
