"""The report says what the other reading of Table I's gap changes: the same trials from the same starts."""

import conclusions
import numpy as np
import pytest
from protocols import PEOPLE, assuming, protocol_of, short

from experiments.analysis.gap_reading import GAP, gap_sentence, gap_table
from experiments.analysis.metrics import JUDGED
from experiments.analysis.trials_table import as_table
from experiments.protocol import load_protocol
from experiments.study.gap_reading import OTHER, gap_read_otherwise, with_gap_read_as
from experiments.study.unrecorded import person_of, study_trials

PROTOCOL = short(paths=1)


@pytest.fixture(autouse=True)
def as_people_get_it():
    with conclusions.whole():
        yield


@pytest.fixture(scope="module")
def people():
    return {f"{number:02d}": person_of(PEOPLE, PROTOCOL.seed, number) for number in (1, 2)}


@pytest.fixture(scope="module")
def trials():
    return as_table(row for row, _ in study_trials(PROTOCOL, PEOPLE, 2, JUDGED))


def test_with_the_studys_own_reading_its_trials_with_the_gap_come_out_again_to_the_last_digit(
    people, trials, monkeypatch
):
    monkeypatch.setitem(OTHER, "half", "half")
    found = gap_read_otherwise(PROTOCOL, people)
    own = trials[trials["controller"] == GAP]
    for name in ("run", "configuration", *(metric.name for metric in JUDGED)):
        assert found.trials[name].tolist() == own[name].tolist()
    assert gap_table(trials, found, False) == "No verdict changes."


def test_the_other_reading_is_half_the_gap_and_changes_nothing_but_the_trials_that_have_one(people, trials):
    found = gap_read_otherwise(PROTOCOL, people)
    assert (found.reading, found.gap_m, found.other_gap_m) == ("half", 0.005, 0.0025)
    assert set(found.trials["controller"]) == {GAP} and len(found.trials) == 4
    before, after = (one["mean_tip_force_N"].median() for one in (trials[trials["controller"] == GAP], found.trials))
    assert not np.isclose(before, after)
    sentence = gap_sentence(trials, found, False)
    assert "half the width of the band without control, 5 mm to each side" in sentence and "2.5 mm" in sentence


def test_a_study_of_the_whole_width_is_compared_with_the_half_and_other_controllers_with_nothing(people):
    whole = protocol_of(assuming('gap_reading = "full"', PROTOCOL.text))
    assert with_gap_read_as("half", whole).controllers[GAP].value("gap_m") == 0.005
    found = gap_read_otherwise(whole, people)
    assert (found.reading, found.gap_m, found.other_gap_m) == ("full", 0.0025, 0.005)
    assert gap_read_otherwise(load_protocol("obstacles"), people) is None
