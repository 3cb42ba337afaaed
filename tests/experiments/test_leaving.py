"""A simulated tip that goes where no scene may begin is warned of, with the time."""

import re

import numpy as np
import pytest

from core.device import load_device
from core.workspace import free_tips
from experiments.simulate.leaving import Leaving
from experiments.simulate.scene import read_scene
from experiments.simulate.simulate import simulate

SCENE = """device = "four-brake"
duration_s = {}
step_s = 1e-3
initial_tip_m = [0.2, 0.36]
output_interval_s = {}
[force]
constant_N = {}
"""
AT_T = re.compile(r"the tip leaves the workspace at t = (\S+) s: it passes behind the bases, at \((\S+), (\S+)\) m")


def warnings_of(tmp_path, duration, interval, force):
    (tmp_path / "scene.toml").write_text(SCENE.format(duration, interval, force))
    return simulate(read_scene(tmp_path / "scene.toml"), tmp_path / f"{duration}-{interval}.csv")["warnings"]


@pytest.mark.parametrize("interval", [0.5, 0.001])
def test_a_tip_that_passes_behind_its_bases_is_warned_of_once_however_far_apart_the_rows(tmp_path, interval):
    (warning,) = warnings_of(tmp_path, 2.0, interval, [4.0, -6.0])
    found = AT_T.fullmatch(warning)
    assert found and float(found[1]) == pytest.approx(0.59, abs=0.006) and -0.01 < float(found[3]) <= 0.0


def test_a_tip_that_is_pushed_against_a_hard_stop_has_not_left(tmp_path):
    assert warnings_of(tmp_path, 0.5, 0.01, [20.0, 60.0]) == []


def test_whatever_is_beyond_a_stop_or_out_of_reach_has_left_and_what_is_free_has_not():
    mechanism = load_device("four-brake").mechanism
    tips = free_tips(mechanism)
    leaving = Leaving(mechanism)
    leaving.look(np.arange(len(tips)) * 1e-3, *tips.T)
    assert leaving.warning == ""
    leaving.look(np.array([7.0, 8.0]), np.array([0.0, 0.0]), np.array([0.4, 5.0]))
    assert leaving.warning.startswith(
        "the tip leaves the workspace at t = 8 s: it is beyond a hard stop, at (0.000, 5.0"
    )
