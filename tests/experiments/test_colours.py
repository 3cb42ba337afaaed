"""Controllers, joints and lines are told apart by people with any colour vision, on screen and on paper alike."""

import pytest
from colour_sight import SIGHTS, nearest

from app.window.widgets.palette import DARK, LIGHT
from core.control.controllers import Preset
from experiments.analysis.colours import ON_LIGHT, colour_places
from experiments.analysis.sheet import colour_of
from experiments.paper_figures.workspace import JOINT_COLOURS
from experiments.protocol import load_protocol

PLACES = colour_places(load_protocol().controllers)
LEAST_APART = 15.0  # of CAM02-UCS
DRAWN = {
    "controllers on paper": [colour_of(controller, PLACES) for controller in range(1, 6)],
    "controllers, light": LIGHT.controllers,
    "controllers, dark": DARK.controllers,
    "joints on paper": list(JOINT_COLOURS.values()),
    "joints, light": LIGHT.joints,
    "joints, dark": DARK.joints,
}


@pytest.mark.parametrize("sight", SIGHTS)
@pytest.mark.parametrize("colours", DRAWN.values(), ids=DRAWN)
def test_any_two_colours_are_told_apart_with_any_sight(colours, sight):
    assert nearest(colours, sight).distance >= LEAST_APART


def test_a_controller_has_its_own_colour_in_every_protocol():
    """By its algorithm and its place: a protocol without SDOF leaves its colours to those of no shipped algorithm."""
    kinds = "none sdof sdof proportional proportional reflect damper.py".split()

    def colours(*numbers):
        return [colour_places({n: Preset(f"{n}", kinds[n]) for n in numbers})[n] for n in numbers]

    assert colours(0, 1, 2, 3, 4) == [0, 1, 2, 3, 4] and colours(0, 3) == [0, 3] and colours(3, 0, 1) == [3, 0, 1]
    assert colours(0, 1, 3, 5) == [0, 1, 3, 2] and colours(0, 5, 3) == [0, 1, 3], "what the others leave"
    assert colours(0, 1, 2, 3, 4, 5, 6) == [0, 1, 2, 3, 4, 1, 2], "then they begin again, never with that of none"
    assert colour_of("K1", PLACES) not in ON_LIGHT
