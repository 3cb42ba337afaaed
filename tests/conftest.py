"""What tests of the mechanics share."""

import os

import pytest
from devices import BENCH, FIXED, FiveBar, random_five_bar

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")  # windows without a screen, as CI has them

MANY = (*FIXED, *(random_five_bar(seed) for seed in range(6)))


def _name(bar: FiveBar) -> str:
    return bar.name.replace(" ", "-")


@pytest.fixture(params=FIXED, ids=_name)
def five_bar(request: pytest.FixtureRequest) -> FiveBar:
    """The two shipped devices and the two bench devices."""
    return request.param


@pytest.fixture(params=BENCH, ids=_name)
def bench(request: pytest.FixtureRequest) -> FiveBar:
    """The two bench devices."""
    return request.param


@pytest.fixture(params=MANY, ids=_name)
def any_five_bar(request: pytest.FixtureRequest) -> FiveBar:
    """Shipped, bench and random devices."""
    return request.param
