"""What brakes can do across the motion, against linear programming on random poses."""

import math

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from app.cli import main
from core.device import load_device
from core.workspace import free_tips, held_in_any_direction
from experiments.paper_figures.directions import gaps
from experiments.paper_figures.maps import least_across, mean_across, pushes_of, worst_across

DISPLAYS = ["er-two-brake", "three-brake", "four-brake", "pter"]


def poses(device, count, seed=3):
    tips = free_tips(device.mechanism)
    return tips[np.random.default_rng(seed).choice(len(tips), count)]


def on_the_lesser_side(pushes, direction):
    """The force across a motion at one tip, by linear programming over the torques of the brakes."""
    force = -(np.sign(pushes.rows[:, :, 0] @ direction)[:, None] * pushes.pull[:, :, 0])
    left = np.array([-direction[1], direction[0]])
    bounds = list(zip(pushes.low, pushes.high, strict=True))
    sides = [-linprog(-force @ (sign * left), bounds=bounds).fun for sign in (1.0, -1.0)]
    return max(min(sides), 0.0)


@pytest.mark.parametrize("as_acceleration", [False, True])
@pytest.mark.parametrize("name", DISPLAYS)
def test_what_brakes_can_do_across_a_motion_is_that_of_linear_programming(name, as_acceleration):
    device = load_device(name)
    for x, y in poses(device, 3):
        pushes = pushes_of(device, np.array([x]), np.array([y]), as_acceleration)
        found = []
        for angle in np.linspace(0.0, 2.0 * math.pi, 21):
            direction = np.array([math.cos(angle), math.sin(angle)])
            found.append(on_the_lesser_side(pushes, direction))
            assert least_across(pushes, direction[:, None])[0] == pytest.approx(found[-1], abs=1e-9)
        angles = np.linspace(0.0, math.pi, 20_001)
        many = pushes._replace(rows=np.repeat(pushes.rows, len(angles), 2), pull=np.repeat(pushes.pull, len(angles), 2))
        everywhere = least_across(many, np.array([np.cos(angles), np.sin(angles)]))
        worst, size = worst_across(pushes)[0], np.hypot(*pushes.pull[:, :, 0].T) @ pushes.high
        assert worst <= everywhere.min() + 1e-9 and everywhere.min() - worst <= 2e-4 * size
        assert mean_across(pushes)[0] == pytest.approx(everywhere.mean(), abs=5e-3 * size)


@pytest.mark.parametrize("name", DISPLAYS)
def test_the_force_of_a_full_lock_is_the_largest_circle_in_its_zonotope_and_half_of_it_is_had_across_any_motion(name):
    device = load_device(name)
    for x, y in poses(device, 4):
        pushes = pushes_of(device, np.array([x]), np.array([y]))
        rows, torque = pushes.rows[:, :, 0], pushes.high
        corners = np.array(np.meshgrid(*([[-1.0, 1.0]] * len(rows)))).reshape(len(rows), -1).T * torque @ rows
        sides = ConvexHull(corners).equations  # a . f + b <= 0, |a| = 1
        circle = linprog((0.0, 0.0, -1.0), np.column_stack((sides[:, :2], np.ones(len(sides)))), -sides[:, 2],
                         bounds=[(None, None), (None, None), (0.0, None)])  # fmt: skip
        held = held_in_any_direction(rows, torque)
        assert held == pytest.approx(-circle.fun)
        for angle in np.linspace(0.1, 3.0, 9):  # both sides together are the width of the zonotope
            left = np.array([-math.sin(angle), math.cos(angle)])
            assert np.abs(rows @ left) @ torque >= held * (1.0 - 1e-12)


def test_two_brakes_leave_a_direction_open_everywhere_and_lines_without_a_gap_of_90_degrees_none():
    """The argument of the paper's Fig. 1: the share of the workspace with a direction in which one side has nothing."""
    open_share = {}
    for name in DISPLAYS:
        device = load_device(name)
        pushes = pushes_of(device, *poses(device, 300).T)._replace(low=np.zeros(len(device.braked)))
        lines = np.arctan2(pushes.rows[:, 1], pushes.rows[:, 0]).T
        is_open = worst_across(pushes) < 1e-9
        assert is_open.tolist() == (gaps(lines).max(axis=-1) >= 0.5 * math.pi).tolist()
        open_share[name] = is_open.mean()
    assert open_share["er-two-brake"] == 1.0 and open_share["pter"] == 0.0
    assert open_share["three-brake"] > open_share["four-brake"] > 0.0


def test_a_map_is_drawn_alone_with_its_displays_beside_each_other(tmp_path, capsys):
    asked = "figures", "--map", "force", "--device", "er-two-brake", "pter", "--out", str(tmp_path / "maps")
    assert main(list(asked)) == 0
    assert sorted(path.name for path in (tmp_path / "maps").iterdir()) == ["map_force.pdf", "map_force.png"]
    assert "er-two-brake, pter" in capsys.readouterr().out
