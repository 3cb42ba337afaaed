"""Brake files: Eqs. (2) and (4) as the file gives them, and that a brake which cannot exist is refused."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.device_file import SHIPPED_FOLDER, parse_brake
from core.files import InputError

BRAKE = (SHIPPED_FOLDER / "mrb-2107-3.toml").read_text()


def changed(pattern: str, replacement: str, text: str = BRAKE) -> str:
    """The text with a pattern, which must occur, replaced."""
    assert re.search(pattern, text), pattern
    return re.sub(pattern, replacement, text)


def test_shipped_brake_follows_its_gain_and_time_constants_as_printed_beside_them():
    brake = parse_brake(BRAKE, "brake")
    gains = [brake.torque_gain(current) for current in (0.0, 0.2, 0.6, 1.0)]
    assert gains == pytest.approx([0.35, 1.0, 3.4, 5.3])
    for w in (-3.0, 0.0, 2.9):
        for current in (0.0, 0.5, 1.0):
            square = (w - 3.0) ** 2 * (1.0 + current)
            assert brake.rise.below_omega_0(current, w) == pytest.approx(0.030 + 0.004 * square)
            assert brake.fall.below_omega_0(current, w) == pytest.approx(0.020 + 0.002 * square)


def test_the_er_brake_rises_with_the_square_of_the_field_and_follows_in_4_ms_at_any_speed():
    brake = parse_brake((SHIPPED_FOLDER / "er-disc.toml").read_text(), "brake")
    assert [brake.torque_gain(field) for field in (0.0, 1.0, 2.0, 4.0)] == pytest.approx([0.2, 0.5, 1.4, 5.0])
    assert (brake.command_unit, brake.knee_A) == ("kV/mm", 0.0)
    for constant in (brake.rise, brake.fall):
        assert {constant.a_avg_s, constant.below_omega_0(0.0, -3.0), constant.below_omega_0(4.0, 2.9)} == {0.004}


BAD_BRAKES = {
    "negative off torque": ("0.35,", "-0.35,", "k gives a negative torque at zero current"),
    "falls below the knee": ("k = .3.25", "k = [-1", "must rise with the current"),
    "falls above the knee": (
        r"-1\.5625, 7\.25, -0\.3875",
        "-8.75, 7.25, -0.1",
        "must rise with the current up to",
    ),
    "jumps at the knee": (r"-0\.3875", "-0.3", "jumps from 1 to 1.0875 N m at knee_A"),
    "negative time": (r"0\.066\]", "-0.066]", r"rise\.a gives a time constant of -"),
    "dips below zero inside": (r"0\.002, 0\.002, 0\.038", "0.002, 0.002, 0.017", r"fall\.a gives a time constant"),
    "no time above": ("a_avg_s = 0.030", "a_avg_s = 0", r"rise\.a_avg_s must be greater than 0"),
    "floor above omega_0": (r"floor_rpm = 0\.125", "floor_rpm = 9", "must not exceed omega_0_rpm"),
    "no current": ("current_max_A = 1.0", "current_max_A = 0.0", "current_max_A must be greater than 0"),
    "five coefficients": (r"0\.066\]", "0.066, 1]", r"rise\.a must hold 6 values, not 7"),
    "no unit": ("knee_A", 'command_unit = ""\nknee_A', "command_unit must be 1 to 12 characters of plain text"),
    "unknown key": ("knee_A", "knee_mA = 1\nknee_A", "unknown key knee_mA"),
    "backlash": ("backlash_deg = 0.75", "backlash_deg = -1", "backlash_deg must be at least 0"),
}


@pytest.mark.parametrize("pattern, replacement, says", BAD_BRAKES.values(), ids=BAD_BRAKES)
def test_a_brake_that_cannot_be_is_refused(pattern, replacement, says):
    with pytest.raises(InputError, match=says):
        parse_brake(changed(pattern, replacement), "my-brake.toml")


@given(st.floats(0.01, 20), st.floats(0, 5), st.floats(-30, 30), st.floats(-30, 30), st.floats(0.05, 0.9))
def test_an_accepted_brake_has_a_torque_that_rises_all_the_way(k1, k2, k3, k4, knee):
    k5 = k1 * knee + k2 - (k3 * knee + k4) * knee
    text = changed(r"(?m)^k = .*$", f"k = [{k1}, {k2}, {k3}, {k4}, {k5}]")
    text = changed("knee_A = 0.2", f"knee_A = {knee}", text)
    currents = np.linspace(0.0, 1.0, 201)
    torque = np.where(currents < knee, k1 * currents + k2, (k3 * currents + k4) * currents + k5)
    rises = bool(np.all(np.diff(torque) > -1e-9))
    try:
        parse_brake(text, "brake")
        assert rises
    except InputError:
        slopes = 2 * k3 * np.array([knee, 1.0]) + k4
        assert slopes.min() <= 1e-9
