"""Trials without recordings are those of a study: the same seed gives the same numbers."""

import numpy as np
from protocols import short

from experiments.analysis.metrics import DRAWN, METRICS
from experiments.analysis.trials_table import read_table
from experiments.study.study import run_study
from experiments.study.unrecorded import study_trials
from experiments.trial.normals import Normals, normals
from experiments.trial.population import load_population
from experiments.trial.trial import NOISE_DRAWS


def test_trials_without_recordings_have_the_measures_of_the_studys_table_bit_by_bit(tmp_path):
    protocol, population = short(seed="7", rules='"literal"'), load_population("tremulous")
    run_study(tmp_path / "study", 1, protocol, population)
    (table,) = (tmp_path / "study").glob("sub-*/ses-*/trials.csv")
    rows = {row.run: row for row in read_table(table)}
    trials = list(study_trials(protocol, population, 1))
    assert len(trials) == len(rows) == 20
    for one in trials:
        row = rows[one.planned.run]
        place = row.configuration, row.controller, row.segment, row.repetition, row.status
        assert place == (*one.planned[2:], one.outcome["status"])
        assert {name: getattr(row, name) for name in one.measures} == one.measures
    assert list(trials[0].measures) == [metric.name for metric in METRICS]
    few = next(study_trials(protocol, population, 1, DRAWN))
    assert few.measures == {metric.name: trials[0].measures[metric.name] for metric in DRAWN}


def test_no_trial_changes_the_draws_that_the_others_take():
    first = next(study_trials(short(seed="8"), load_population("average"), 1)).planned
    key = 8, 1, first.segment, first.repetition
    generator = np.random.default_rng(np.random.SeedSequence(key))
    kept = normals(*key)
    assert kept._drawn, "the trial took others"
    for size in (6, (NOISE_DRAWS, 2)):
        assert np.array_equal(kept.standard_normal(size), generator.standard_normal(size))


def test_kept_draws_are_those_of_the_generator_however_often_they_are_taken():
    drawn = Normals([3, 1])
    generator = np.random.default_rng(np.random.SeedSequence([3, 1]))
    expected = generator.standard_normal(6), generator.standard_normal((100, 2))
    for _ in range(2):
        again = drawn.from_the_first()
        assert np.array_equal(again.standard_normal(6), expected[0])
        assert np.array_equal(again.standard_normal((100, 2)), expected[1])
