"""Numbers as people read them: no power of ten where digits do, no minus before nothing, one form of percent."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.numbers import fixed, percent, significant

NUMBERS = st.floats(-1e5, 1e5)


@pytest.mark.parametrize(
    ("value", "digits", "text"), [(14.2, 1, "10"), (-0.0, 3, "0"), (1234.6, 2, "1200"), (2.5e-7, 2, "2.5e-07")]
)
def test_a_number_of_few_digits_is_no_power_of_ten(value, digits, text):
    assert significant(value, digits) == text


@given(NUMBERS, st.integers(1, 4))
def test_significant_digits_are_the_number_to_half_of_the_last_one(value, digits):
    text = significant(value, digits)
    assert float(text) == float(f"{value:.{digits}g}")
    assert ("e" in text) == (0.0 < abs(float(text)) < 1e-4)


@given(NUMBERS, st.integers(0, 4), st.sampled_from(("", "+")))
def test_zero_has_no_minus(value, decimals, sign):
    texts = fixed(value, decimals, sign), percent(value, decimals, sign)
    for text in texts:
        assert not re.fullmatch(r"-0(\.0*)?( %)?", text)
    assert texts[1].endswith(" %")
