"""Controllers, joints and lines are told apart by people with any colour vision, on screen and on paper alike."""

import pytest
from colour_sight import SIGHTS, nearest

from app.window.widgets.palette import DARK, LIGHT
from experiments.analysis.colours import colour_places
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


def test_distances_are_those_of_the_space_and_the_colour_blind_see_less():
    assert nearest(("#000000", "#ffffff"), "normal").distance == pytest.approx(100.0, abs=0.5)
    red, green = "#c00000", "#007000"
    assert nearest((red, green), "deuteranopia").distance < 0.5 * nearest((red, green), "normal").distance
