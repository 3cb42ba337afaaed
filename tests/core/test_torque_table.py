"""Brakes by a measured torque table, and by published coefficients whose branches do not quite meet."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.brake import current_for_torque, torque_gain
from core.device import build_brakes
from core.device_file import parse_brake
from core.files import InputError, StrangeInput
from core.simulator.state import pack_brakes
from core.torque_table import FROM, SLOPE, SQUARE, torque_curve

pytestmark = pytest.mark.nojit
BRAKE = Path("core/brake_files/mrb-2107-3.toml").read_text(encoding="utf-8")

steps = st.lists(st.tuples(st.floats(0.01, 1.0), st.floats(0.01, 5.0)), min_size=1, max_size=23)
tables = st.builds(
    lambda off, rows: [(0.0, off), *((x, off + y) for x, y in np.cumsum(rows, axis=0).tolist())],
    st.floats(0.0, 1.0),
    steps,
)


def brake_of(gain, current_max=1.0, knee=0.2):
    """A brake file with this line in place of k, and the record of a device that has it at joint A."""
    text = re.sub(r"(?m)^k = .*$", gain, BRAKE).replace("current_max_A = 1.0", f"current_max_A = {current_max}")
    brake = parse_brake(text.replace("knee_A = 0.2", f"knee_A = {knee}"), "brake")
    return brake, pack_brakes(build_brakes({"A": brake}), backlash=False)[0]


@settings(max_examples=25)
@given(tables)
def test_a_table_is_a_torque_that_rises_through_its_points_without_corners_and_has_an_inverse(table):
    brake, record = brake_of(f"torque_table = {[list(row) for row in table]}", table[-1][0])
    for current, torque in table:
        assert torque_gain(record, 0, current) == pytest.approx(torque, rel=1e-9)
        assert brake.torque_gain(current) == pytest.approx(torque, rel=1e-9)
    currents = np.linspace(0.0, table[-1][0], 161)
    torques = np.array([torque_gain(record, 0, current) for current in currents])
    assert torques == pytest.approx([brake.torque_gain(current) for current in currents.tolist()], rel=1e-12)
    assert np.all(np.diff(torques) > -1e-12)
    back = [torque_gain(record, 0, current_for_torque(record, 0, torque)) for torque in torques.tolist()]
    assert back == pytest.approx(torques, abs=1e-9 * torques[-1])
    curve = torque_curve(table)[: 2 * (len(table) - 1)]
    arriving = curve[:-1, SLOPE] + 2.0 * curve[:-1, SQUARE] * np.diff(curve[:, FROM])
    assert arriving == pytest.approx(curve[1:, SLOPE], rel=1e-9, abs=1e-9), "no corner"


@pytest.mark.parametrize(
    "gain", ["k = [3.25, 0.35, -1.5625, 7.25, -0.3875]", "torque_table = [[0.0, 0.35], [1.0, 5.0]]"]
)
def test_drag_and_the_torque_that_current_adds_change_by_factors_of_their_own(gain):
    brake, _ = brake_of(gain)
    for current in (0.0, 0.1, 0.5, 1.0):
        added = brake.torque_gain(current) - 0.35
        changed = brake.changed(1.0, 2.0, 0.5, None).torque_gain(current)
        assert changed == pytest.approx(2.0 * 0.35 + 0.5 * added), current


@pytest.mark.parametrize(
    ("gain", "says"),
    [
        ("torque_table = [[0.0, 0.3]]", "has 1 points"),
        ("torque_table = [[0.1, 0.3], [1.0, 5.0]]", "must begin at 0 A"),
        ("torque_table = [[0.0, 0.3], [0.9, 5.0]]", "ends at 0.9 A"),
        ("torque_table = [[0.0, -0.3], [1.0, 5.0]]", "negative torque"),
        ("torque_table = [[0.0, 0.3], [0.5, 0.3], [1.0, 5.0]]", "torques must rise"),
        ("torque_table = [[0.0, 0.3], [0.0, 0.4], [1.0, 5.0]]", "currents must rise"),
        ("torque_table = [[0.0, 0.3], [1.0, 5.0]]\nk = [1, 1, 1, 1, 1]", "either k or torque_table"),
        ("", "either k or torque_table"),
    ],
)
def test_a_table_that_is_no_torque_curve_is_refused(gain, says):
    with pytest.raises(InputError, match=says):
        brake_of(gain)


@pytest.mark.parametrize(
    ("k", "knee", "k5"),
    [
        ([3.25, 0.35, -1.5625, 7.25, -0.38], 0.19778, -0.38),  # rounded: the branches meet 2 mA from the knee
        ([3.25, 0.35, -1.5625, 7.25, -0.3], 0.17438, -0.3),  # fitted apart: 26 mA
        ([3.25, 0.35, 1.0, 3.25, 0.5], 0.2, 0.31),  # they meet nowhere near: k_5 is computed
    ],
)
def test_published_coefficients_are_joined_at_the_knee_and_a_jump_that_matters_is_said(k, knee, k5):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", StrangeInput)
        brake, record = brake_of(f"k = {k}")
    assert bool(said) == (k[4] != -0.38)
    assert brake.knee_A == pytest.approx(knee, abs=1e-4) and brake.equation_2[4] == pytest.approx(k5, abs=1e-9)
    assert brake.equation_2[:4] == tuple(k[:4])
    below, above = (brake.torque_gain(brake.knee_A + d) for d in (-1e-12, 0.0))
    assert above == pytest.approx(below, abs=1e-9)
    torques = [torque_gain(record, 0, current) for current in np.linspace(0.0, 1.0, 501).tolist()]
    assert np.all(np.diff(torques) > 0.0)


def test_stronger_brakes_have_so_many_times_the_torque():
    brake, _ = brake_of("torque_table = [[0.0, 0.3], [0.4, 2.0], [1.0, 5.0]]")
    half = pack_brakes(build_brakes({"A": brake}).stronger(0.5), backlash=False)[0]
    for current in (0.0, 0.2, 0.7, 1.0):
        assert torque_gain(half, 0, current) == pytest.approx(0.5 * brake.torque_gain(current))
