"""Statistics say what they count: people and pairs that differ, why a p is missing, percent of no tiny mean."""

import pytest

from experiments.analysis.statistics import pairs


@pytest.mark.parametrize(
    ("differences", "differ", "missing"),
    [([0.0] * 5 + [1.0], 1, ""), ([0.0] * 8, 0, ""), ([1.0, 2.0, 0.0], 2, "3 of the 6 people")],
)
def test_a_difference_of_zero_beside_a_correlation_of_one_names_how_many_pairs_differ(differences, differ, missing):
    people = [f"{n}" for n in range(len(differences))]
    table = {1: dict(zip(people, differences, strict=True)), 2: dict.fromkeys(people, 0.0)}
    shift, correlation = pairs("path_error_m", "three-brake", table)
    assert shift.differ == correlation.differ == differ
    assert missing in shift.missing and bool(shift.missing) == (shift.p is None)
    if differ == 1:
        assert (shift.value, correlation.value) == (0.0, 1.0)
