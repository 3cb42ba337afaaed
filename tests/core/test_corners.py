"""What each controller does at a sharp corner: a place to arrive at and to leave (docs/your-own-experiment.md)."""

import math

import numpy as np
import pytest
from protocols import PAPER

from core.control.algorithm import IN_GAP, NONE, Tick
from core.control.controllers import Preset, decide, make_controller
from core.control.velocity_field import PIECE, WANTED, Seen, new_memory
from core.device import load_device
from core.path import Polyline, build_path
from core.simulator.state import pack_brakes
from core.workspace import brake_rows

pytestmark = pytest.mark.nojit

DEVICE = load_device("four-brake")
BRAKES = pack_brakes(DEVICE.brakes, backlash=False)[0]
STAR = build_path(
    Polyline(
        tuple((0.08 * math.cos(a), 0.36 + 0.08 * math.sin(a)) for a in 0.5 * math.pi + 0.8 * math.pi * np.arange(6))
    ),
    "star",
)
CORNER, IN, OUT = STAR.pieces[1, 2:4], STAR.pieces[0, 4:6], STAR.pieces[1, 4:6]
CONTROLLERS = {
    **{preset.name: preset for preset in PAPER.controllers.values()},
    "wall": Preset("wall", "reflect", (0.0, 500.0)),
}


def decided(name, tip, velocity, force, memory):
    """Decision, brake forces (N) that those currents allow against the motion, and field."""
    controller, current = make_controller(CONTROLLERS[name], DEVICE.force_normalised_N), np.zeros(4)
    g = brake_rows(DEVICE.mechanism, *tip)
    tick = Tick(Seen(*tip, *velocity, *force), g, np.array([1.0, 0.0, 1.0]), BRAKES, memory, current)
    code, field = decide(controller, STAR, tick)
    return code, current, field


@pytest.mark.parametrize("name", CONTROLLERS)
def test_beyond_the_corner_a_hand_that_pushes_on_is_held_back_towards_it(name):
    memory, current = new_memory(), np.zeros(4)
    tip = CORNER + 0.01 * IN
    decided(name, CORNER, 0.05 * IN, 5.0 * IN, memory)
    code, current, field = decided(name, tip, 0.05 * IN, 8.0 * IN, memory)
    assert memory[PIECE] == 1 and field.distance == pytest.approx(0.01)
    assert (field.n_x, field.n_y) == pytest.approx(tuple(-IN), abs=1e-6), "back to the corner"
    if CONTROLLERS[name].kind == "none":
        assert code == NONE and not current.any()
        return
    assert current.any(), "something brakes"
    if name == "wall":
        assert tuple(memory[WANTED : WANTED + 2]) == pytest.approx(tuple(-0.01 * 500.0 * IN), abs=1e-6)
    gap = CONTROLLERS[name].value("gap_m")
    if gap:
        assert decided(name, CORNER + 0.5 * gap * IN, 0.05 * IN, 8.0 * IN, memory)[0] == IN_GAP
