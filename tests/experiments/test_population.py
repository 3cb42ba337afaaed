"""Populations: every number has a unit and a source, and a file that cannot be meant is refused."""

import re

import numpy as np
import pytest
from people import AVERAGE
from scipy import stats

from core.files import InputError, shipped_names
from experiments.trial.population import LIMITS, SHIPPED_FOLDER, load_population


@pytest.fixture
def refused(tmp_path):
    """The refusal of the average file with one line changed."""

    def refusal(key: str, line: str | None) -> str:
        text, count = re.subn(rf"^{key} = .*$", line or "", AVERAGE.text, flags=re.MULTILINE)
        path = tmp_path / "people.toml"
        path.write_text(text if count else f"{text}\n{line}\n")
        with pytest.raises(InputError) as error:
            load_population(path)
        assert str(error.value).startswith(str(path)) and "\n" not in str(error.value)
        return str(error.value)

    return refusal


def test_people_whose_error_comes_from_the_device_have_no_error_of_their_own_and_tune_nothing_to_findings():
    population = load_population("from-device")
    for key in ("bias_m", "curvature_m", "trial_bias_m", "felt_gain"):
        assert population.spreads[key].value == 0.0
    assert population.changed_after_findings == ()


@pytest.mark.parametrize("name", shipped_names(SHIPPED_FOLDER))
def test_the_same_seed_is_the_same_person_and_everybody_lies_within_the_file(name):
    population = load_population(name)
    people = [population.draw(np.random.default_rng(seed)) for seed in range(40)]
    assert people[5] == population.draw(np.random.default_rng(5)) != people[6]
    for person in people:
        for key, number in person._asdict().items():
            spread, (least, most) = population.spreads[key], LIMITS[key]
            low = next(v for v in (spread.value, spread.low, least) if v is not None)
            high = next(v for v in (spread.value, spread.high, most) if v is not None)
            assert low <= number <= high, key


def test_a_normal_number_is_normal_and_cut_at_its_limits(tmp_path):
    path = tmp_path / "people.toml"
    lines = {"bias_m": "{mean = 0.0, sd = 0.006", "tremor_Hz": "{mean = 4.0, sd = 1.0"}
    text = AVERAGE.text
    for key, line in lines.items():
        text = re.sub(rf"^{key} = .*$", f'{key} = {line}, source = "test"}}', text, flags=re.MULTILINE)
    path.write_text(text)
    population, generator = load_population(path), np.random.default_rng(1)
    people = [population.draw(generator) for _ in range(500)]
    assert stats.kstest([person.bias_m for person in people], "norm", (0.0, 0.006)).pvalue > 0.01
    least = LIMITS["tremor_Hz"][0]
    cut = stats.truncnorm(least - 4.0, LIMITS["tremor_Hz"][1] - 4.0, loc=4.0)
    assert stats.kstest([person.tremor_Hz for person in people], cut.cdf).pvalue > 0.01


def test_a_seed_is_the_same_place_in_every_population():
    """So that populations can be compared person by person."""
    for seed in range(5):
        steady, average = (load_population(name).draw(np.random.default_rng(seed)) for name in ("steady", "average"))
        assert steady.mass_kg == average.mass_kg and steady.bias_m == average.bias_m
        assert steady.tremor_N < average.tremor_N


@pytest.mark.parametrize(
    ("key", "line", "said"),
    [
        ("mass_kg", None, "required key mass_kg is missing"),
        ("mass_kg", "mass_kg = {value = 1.0}", "required key mass_kg.source is missing"),
        ("mass_kg", 'mass_kg = {source = "x"}', "mass_kg: must hold value, or low and high, or mean and sd, not none"),
        ("mass_kg", 'mass_kg = {low = 1.0, source = "x"}', "not low"),
        ("mass_kg", 'mass_kg = {value = 1.0, sd = 0.1, source = "x"}', "not value, sd"),
        ("mass_kg", 'mass_kg = {low = 2.0, high = 1.0, source = "x"}', "mass_kg: low (2) must not exceed high (1)"),
        ("mass_kg", 'mass_kg = {mean = 1.0, sd = -1.0, source = "x"}', "mass_kg: sd must be between 0 and 10, not -1"),
    ],
)
def test_a_file_that_cannot_be_meant_is_refused_by_file_key_and_reason(refused, key, line, said):
    assert said in refused(key, line)
