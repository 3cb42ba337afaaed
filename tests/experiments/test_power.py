"""`phd power`: the number of people it names is the number that finds the difference."""

import csv

import numpy as np
import pytest
from protocols import short

from core.files import InputError
from experiments.analysis.statistics import signed_rank_p
from experiments.study.people_needed import MOST_PEOPLE, Draws, people_needed, share_found, signed_rank_chances
from experiments.study.power import power, question_of
from experiments.trial.population import load_population

FOUND = 0.8


def people(*means: float, count: int = 4000, seed: int = 0) -> np.ndarray:
    """The scores of people whose distribution is known: normal, with means that are apart."""
    covariance = 0.5 * (np.eye(len(means)) + 1.0)
    return np.random.default_rng(seed).multivariate_normal(means, covariance, count)


ROUGH = Draws(50, 5, 50, 10)  # where what is written does not depend on them
FEW = Draws(redrawn=33, studies_redrawn=100)


def test_many_signed_rank_tests_at_once_are_those_of_the_analysis():
    generator = np.random.default_rng(1)
    differences = generator.normal(0.3, 1.0, (200, 11))
    differences[:30, 2] = 0.0
    differences[20:40, 3] = np.nan
    differences[199] = 0.0
    one_by_one = [signed_rank_p(row[np.isfinite(row)]) for row in differences]
    assert signed_rank_chances(differences) == pytest.approx(one_by_one, abs=1e-12)


@pytest.mark.parametrize("means", [(0.0, 0.8), (0.0, 0.8, 0.4, 0.2)])
def test_at_the_number_named_new_studies_find_the_difference_as_often_as_wanted(means: tuple[float, ...]):
    named = people_needed(people(*means), (0, 1), FOUND, 1, FEW)
    assert named.people and named.low and named.high and named.low <= named.people <= named.high
    spread = 3.0 * np.sqrt(FOUND * (1.0 - FOUND) * (1.0 / 500 + 1.0 / 1000))
    others = people(*means, seed=1)
    assert share_found(others, (0, 1), named.people, 500, seed=99) > FOUND - spread
    assert share_found(others, (0, 1), named.people - 2, 500, seed=99) < FOUND + spread


def test_the_interval_holds_the_true_number():
    true = people_needed(people(0.0, 0.8), (0, 1), FOUND, 1, ROUGH._replace(studies=1000)).people
    assert true
    found = [people_needed(people(0.0, 0.8, count=60, seed=seed), (0, 1), FOUND, seed, FEW) for seed in range(1, 9)]
    inside = sum((needed.low or MOST_PEOPLE) <= true <= (needed.high or MOST_PEOPLE) for needed in found)
    assert inside >= 5, "of 8 intervals of 95 %, fewer come true once in 2,500 runs"


def test_simulated_people_of_each_population_get_a_line_a_curve_and_a_warning(tmp_path):
    protocol = short(paths=1)
    asked = question_of(protocol, ("no control", "4"), "path_error_m", FOUND)._replace(draws=ROUGH)
    populations = {name: load_population(name) for name in ("average", "steady")}
    done = []
    summary = power(protocol, asked, populations, 6, tmp_path / "out", done.append)
    assert "simulated" in summary["warnings"][0] and done[-1] == 1.0
    with (tmp_path / "out" / "power.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    wanted = {(name, where) for name in populations for where in ("three-brake", "four-brake", "pooled")}
    assert {(row["from"], row["configuration"]) for row in rows} == wanted
    assert (tmp_path / "out" / "power.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match="not empty"):
        power(protocol, asked, populations, 6, tmp_path / "out")


def test_a_question_that_says_nothing_is_refused_and_nothing_is_half_written(tmp_path):
    protocol = short(paths=1)
    asked = question_of(protocol, ("1", "SDOF"), "mean_tip_force_N", FOUND)
    with pytest.raises(InputError, match="only 4 finished trials with both, at least 6"):
        power(protocol, asked, {"average": load_population()}, 4, tmp_path / "few")
    assert not (tmp_path / "few").exists(), "nothing half-written"
    with pytest.raises(InputError, match="has no controller 'soft'; it has 1 \"No control\""):
        question_of(protocol, ("soft", "1"), "path_error_m", FOUND)
    with pytest.raises(InputError, match="there is no 'speed'"):
        question_of(protocol, ("1", "2"), "speed", FOUND)


def test_more_people_than_can_be_had_are_no_number():
    assert people_needed(people(0.0, 0.0), (0, 1), FOUND, 1, ROUGH).people is None
