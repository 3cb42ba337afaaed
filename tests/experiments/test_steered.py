"""A castor in place of brakes runs the paper's trial: same path, operator and measures; what cannot be is refused."""

import os
import re

import numpy as np
import pytest

from app.cli import main
from core import tick_log as log
from core.device import COBOT_FOLDER, build_device, load_device
from core.files import InputError
from core.path import Segment
from core.simulator.hand import spring_hand
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis.trials_table import read_table
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.session.files import session_folder
from experiments.study.replay import Replacement, replay
from experiments.study.study import run_study
from experiments.trial.population import load_population
from experiments.trial.trial import Conditions, SimulatedTrial

TEXT = (COBOT_FOLDER / "unicycle.toml").read_text()
PLANNED = PlannedTrial(1, 1, "unicycle", 2, 1, 1)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """One operator with the four-brake device and the unicycle."""
    folder = tmp_path_factory.mktemp("steered")
    text = load_protocol("steered").text.replace('"three-brake", ', "").replace("blocks = 3", "blocks = 1")
    (folder / "own.toml").write_text(text)
    run_study(folder / "study", 1, load_protocol(folder / "own.toml"), load_population())
    return folder / "study"


def test_steered_the_path_is_kept_far_better_than_by_brakes_and_freely_it_is_not(study):
    rows = read_table(study / "trials.csv")
    assert {row.status for row in rows} == {"done"} and len(rows) == 12
    error = {
        (name, number): np.mean(
            [r.value("path_error_m") for r in rows if (r.configuration, r.controller) == (name, number)]
        )
        for name in ("four-brake", "unicycle")
        for number in (1, 2)
    }
    assert error["unicycle", 2] < 0.1 * error["four-brake", 2] < error["four-brake", 1]
    assert error["unicycle", 1] > 1e-3, "a free caster does not guide"
    steered = [row for row in rows if row.configuration == "unicycle"]
    assert all(
        row.value("energy_added_max_J") == 0.0 and abs(row.value("energy_residual_J")) < 1e-12 for row in steered
    )


def test_its_trials_are_replayed_to_the_last_bit_and_its_hand_through_brakes(study):
    trials = session_folder(study, "01") / "trials"
    rows = [row for row in read_table(study / "trials.csv") if row.configuration == "unicycle"]
    for row in rows:
        found = replay(trials / f"run-{row.run:03d}.parquet")
        assert found["equal"] and found["decisions"]["different"] == 0 and found["begins"] == "start"
    other = replay(trials / f"run-{rows[0].run:03d}.parquet", Replacement(device="four-brake"))
    assert other["begins"] == "move" and other["after"]["way_made"] > 0.3
    back = [row for row in read_table(study / "trials.csv") if row.configuration == "four-brake"][0]
    assert replay(trials / f"run-{back.run:03d}.parquet", Replacement(device="unicycle"))["after"]["way_made"] > 0.3


def pulled(text, target, seconds=1.0, controller=2):
    """Rows of a movement of a unicycle, from (0, 0.4), by a stiff spring to a target; and the trial's outcome."""
    device = build_device(text, {}, "own")
    hand = spring_hand((500.0, 0.0, 500.0), (10.0, 0.0, 10.0), 60.0, 1.0, (0.0, 0.4))
    path = Segment(start_m=(0.0, 0.4), end_m=(0.1, 0.4))
    preset = load_protocol("steered").controllers[controller]
    trial = SimulatedTrial(SimulatedDevice(device, (0.0, 0.4), hand), PLANNED, Conditions(path, preset, "settled"))
    trial.arguments().run["phase"][0] = log.MOVE
    trial.aim(*target)
    rows = np.empty((round(1000 * seconds), log.WIDTH))
    trial.run(rows)
    return rows, trial.outcome()


def test_a_wheel_that_would_have_to_hold_more_than_its_grip_is_warned_of():
    _, outcome = pulled(TEXT, (0.02, 0.55))
    assert not any("skid" in warning for warning in outcome["warnings"])
    weak = re.sub(r"grip_N = \S+", "grip_N = 5.0", TEXT)
    _, outcome = pulled(weak, (0.02, 0.55))
    assert any("5 N" in warning and "skid" in warning for warning in outcome["warnings"])


def test_the_handle_stands_where_the_linkage_stops_and_the_ledger_knows():
    rows, _ = pulled(TEXT, (0.0, 0.9), 1.5, controller=1)
    assert 0.45 < rows[-1, log.TIP_Y] < 0.58 and np.isfinite(rows[:, log.TIP_X : log.HAND_FY + 1]).all()
    assert rows[-1, log.ENERGY_STOPS] > 0.1
    left = rows[:, log.ENERGY_KINETIC] + rows[:, log.ENERGY_STOPS] - rows[:, log.ENERGY_HAND]
    assert np.ptp(left) < 1e-9


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("[brakes]", '[brakes]\nA = "mrb-2107-3"', "massless links"),
        ("AE = {mass_kg = 0.0}", "AE = {mass_kg = 0.1}", "massless links"),
        ("[castor]", "[wheel]", "wheel"),
        ("grip_N = 80.0", "grip_N = 0.0", "grip_N"),
    ],
)
def test_a_castor_that_cannot_be_is_refused_in_a_sentence(tmp_path, old, new, reason):
    assert old in TEXT
    (tmp_path / "own.toml").write_text(TEXT.replace(old, new))
    with pytest.raises(InputError, match=reason):
        load_device(tmp_path / "own.toml")


def test_controllers_that_need_brakes_are_refused_and_so_is_a_castor_on_a_bench(capsys, tmp_path):
    with pytest.raises(InputError, match="Proportional, high gain: needs brakes, and device unicycle has a castor"):
        load_protocol("paper", devices=["unicycle"])
    (tmp_path / "scene.toml").write_text(
        'device = "unicycle"\nduration_s = 0.1\nstep_s = 1e-3\ninitial_tip_m = [0.0, 0.4]\n'
    )
    out = ["--out", str(tmp_path / "out")]
    for verb in (["figures", "--device", "unicycle", *out], ["simulate", str(tmp_path / "scene.toml"), *out],
                 ["emulate", "--device", "unicycle"]):  # fmt: skip
        assert main(verb) == 2
        assert "unicycle has a castor" in capsys.readouterr().err
    real = ["--link", f"serial:{os.devnull}", "--data-dir", str(tmp_path)]
    arguments = ["run", "steered", "--device", "unicycle", *real]
    assert main(arguments) == 2
    assert "unicycle has a castor, which can only be simulated" in capsys.readouterr().err
