"""The low gain by the paper's rule: the largest without detectable vibration."""

import json

import numpy as np
import pytest
from protocols import PEOPLE, assuming, protocol_of, short
from sessions import new_session

from app.cli import main
from core.files import InputError
from experiments.protocol import Protocol, protocol_from_json, protocol_to_json
from experiments.store.study_plan import read_study
from experiments.study.unrecorded import DETECTED_M_S2, GAINS, study_trials, vibrations, with_low_gain_found


@pytest.fixture(scope="module")
def unsettled() -> Protocol:
    return protocol_of(assuming('low_gain = "no vibration"', short(paths=1).text))


@pytest.fixture(scope="module")
def found(unsettled) -> Protocol:
    return with_low_gain_found(unsettled, PEOPLE)


def test_the_gain_found_does_not_vibrate_and_the_next_one_does(unsettled, found):
    assert found.low_gain in GAINS[1:-1]
    low = found.controllers[5]
    without = vibrations(found, PEOPLE, found.controllers[1])
    steps = GAINS.index(found.low_gain)
    added = [vibrations(found, PEOPLE, low.replaced(gain_N_s_m=GAINS[n])) - without for n in (steps, steps + 1)]
    assert added[0].max() <= DETECTED_M_S2**2 < added[1].max()


def test_the_same_seed_finds_the_same_gain_and_another_world_another(unsettled, found):
    assert with_low_gain_found(unsettled, PEOPLE).low_gain == found.low_gain
    about = protocol_to_json(unsettled)
    slow = {"low_gain": "no vibration", "sensing": "encoders", "lag_factor": 0.2}
    other = with_low_gain_found(protocol_from_json({**about, "overrides": {"assumptions": slow}}, "other"), PEOPLE)
    assert other.low_gain != found.low_gain


def test_a_session_needs_the_number(unsettled, tmp_path, capsys):
    with pytest.raises(InputError, match="find the number on simulated trials; here it must be given in N s/m"):
        new_session(tmp_path, protocol=unsettled)
    assert main(["run", "--low-gain", "no vibration", "--print-plan"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_study_by_the_rule_prints_and_stores_the_number_and_goes_on_with_it_as_do_trials_without_recordings(
    unsettled, tmp_path, capsys, found
):
    path, out = tmp_path / "mine.toml", tmp_path / "out"
    path.write_text(unsettled.text)
    asked = ["study", str(path), "--operators", "1", "--out", str(out)]
    assert main([*asked, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    stored = read_study(out).protocol.overrides
    assert told["low_gain_N_s_m"] == stored["low_gain_found"] in GAINS
    assert "(no vibration; Table I prints 5)" in (out / "report" / "report.md").read_text()
    assert main([*asked, "--resume", "--low-gain", "no vibration"]) == 0
    assert main([*asked, "--resume", "--low-gain", "5"]) == 2
    assert "--low-gain: the study was begun with no vibration" in capsys.readouterr().err
    trials = [row for row, _ in study_trials(found, PEOPLE, 1) if row.controller == 5]
    assert trials and all(np.isfinite(row.value("path_error_m")) for row in trials)
