"""The plane and the workspace: what is painted follows what they are told, and the other way round."""

import math

import numpy as np
import pytest
from fake_ticks import ACROSS, ALONG, TIP, quiet

from app.window.canvas.layers import (
    OFF,
    SLIPPING,
    STUCK,
    Doing,
    Instant,
    directions,
    field_at_rest,
    field_of,
    joints_at,
    needles,
    wedge,
)
from app.window.canvas.linkage_view import Workspace
from core import tick_log
from core.control.rule_sets import SETTLED
from core.control.sdof import nearest_valid_brake, valid_sense
from core.control.velocity_field import PIECE, TRAVEL, Seen, field_at, new_memory
from core.device import Device, load_device
from core.mechanism import JOINTS
from core.path import Polyline, build_path, nearest_piece
from core.workspace import brake_rows
from experiments.trial.tick import log_field

THREE, FOUR = load_device("three-brake"), load_device("four-brake")
BOTH = pytest.mark.parametrize("device", (THREE, FOUR), ids=lambda device: device.name)
LINE = build_path(ALONG, "path")


@pytest.fixture
def workspace(qtbot) -> Workspace:
    """Of a trial with four brakes."""
    workspace = Workspace()
    qtbot.addWidget(workspace)
    workspace.view.show_places((THREE, FOUR), {1: ALONG, 2: ACROSS})
    workspace.resize(760, 620)
    workspace.show()
    workspace.view.show_trial(FOUR, ALONG, TIP)
    return workspace


@BOTH
def test_whatever_the_brakes_do_against_a_motion_lies_in_the_wedge(device: Device) -> None:
    """Fig. 1: forces of yields of any size, each against its own joint's rate, never leave the wedge."""
    generator = np.random.default_rng(3)
    for _ in range(200):
        x, y = generator.uniform(-0.1, 0.1), generator.uniform(0.3, 0.42)
        velocity = generator.normal(size=2) * 0.1
        g = brake_rows(device.mechanism, x, y)
        found = wedge(device, g, *velocity, 0)
        yields = generator.uniform(0.0, 5.0, 4) * device.brakes.present
        force = -(g * (yields * np.sign(g @ velocity))[:, None]).sum(axis=0)
        assert force @ velocity <= 1e-9
        for i, angle in zip(map(JOINTS.index, device.braked), found.spokes, strict=True):
            alone = np.array([math.cos(angle), math.sin(angle)])  # each brake by itself: along its g, against v
            assert alone @ velocity <= 1e-9 and abs(alone[0] * g[i, 1] - alone[1] * g[i, 0]) < 1e-9 * np.hypot(*g[i])
        middle = 0.5 * (found.first + found.last)
        turn = math.remainder(math.atan2(force[1], force[0]) - middle, 2.0 * math.pi)
        assert abs(turn) <= 0.5 * (found.last - found.first) + 1e-9
        assert found.last - found.first <= math.pi + 1e-9


def test_a_stuck_brake_widens_the_wedge_and_rest_has_none() -> None:
    g = brake_rows(FOUR.mechanism, 0.0, 0.4)
    held = wedge(FOUR, g, *(np.array([-g[1, 1], g[1, 0]]) * 0.05 / np.hypot(*g[1])), 2)  # E does not turn
    assert len(held.spokes) == len(FOUR.braked) + 1 and held.last - held.first == pytest.approx(math.pi)
    assert wedge(FOUR, g, 0.0, 0.0, 0) is None


@BOTH
def test_a_locked_brake_leaves_the_direction_in_which_it_does_not_turn_and_the_controllers_choice_is_shown(device):
    generator = np.random.default_rng(4)
    for _ in range(200):
        x, y = generator.uniform(-0.1, 0.1), generator.uniform(0.3, 0.5)
        g, field = brake_rows(device.mechanism, x, y), field_at_rest(LINE, (x, y), generator.choice((-1.0, 1.0)))
        found = directions(device, g, field)
        assert "".join(JOINTS[direction.joint] for direction in found) == device.braked
        for one in found:
            assert g[one.joint] @ (one.p_x, one.p_y) == pytest.approx(0.0, abs=1e-12)
            assert one.sense == valid_sense(one.p_x, one.p_y, field, SETTLED.span_rounding)
        chosen = [one.joint for one in found if one.chosen]
        assert chosen == [i for i in [nearest_valid_brake(device.brakes, g, field, SETTLED)] if i >= 0]


def test_the_field_leads_to_the_path_and_along_it_and_turns_with_the_travel_sense() -> None:
    corners = ((-0.2, 0.3), (0.2, 0.48), 0.02)
    found, back = needles(LINE, 1.0, FOUR, *corners), needles(LINE, -1.0, FOUR, *corners)
    assert len(found) > 50
    for _, y, *beta in found.tolist():
        off = y - 0.4
        if abs(off) >= 0.05:
            assert beta == pytest.approx((0.0, -math.copysign(1.0, off)))
        elif abs(off) < 1e-9:
            assert beta == pytest.approx((1.0, 0.0))
    assert back[:, :3] == pytest.approx(found[:, :3] * (1.0, 1.0, -1.0))


def test_the_forces_of_a_tick_are_those_of_the_hand_and_of_each_brake() -> None:
    instant = Instant.of_tick(FOUR, quiet(TIP_X=TIP[0], TIP_Y=TIP[1], HAND_FX=3.0, HAND_FY=4.0, TORQUE_B=2.0)[-1])
    assert instant.hand == (3.0, 4.0)
    assert instant.brakes == pytest.approx(tuple(2.0 * brake_rows(FOUR.mechanism, *TIP)[2]))


def test_brakes_say_what_they_did_most_of_the_time(workspace: Workspace) -> None:
    rows = quiet(100, CURRENT_E=0.8, TORQUE_E=-3.9, CURRENT_B=0.3, TORQUE_B=1.1, STUCK=2)
    rows[:30, tick_log.CURRENT + 2] = 0.0  # B is without current for less than half of it
    rows[:10, tick_log.CURRENT + 3] = 0.5  # C has some for less than half of it
    workspace.view.add(rows)
    workspace.view.refresh_text()
    states = {joint: doing.state for joint, doing in workspace.view.doing.items()}
    assert states == {"A": OFF, "E": STUCK, "B": SLIPPING, "C": OFF}
    torques = [round(doing.torque, 1) for doing in workspace.view.doing.values()]
    assert torques == [0.0, 3.9, 1.1, 0.0]
    workspace.view.rest(TIP)
    assert set(workspace.view.doing.values()) == {Doing()}


def test_the_field_of_a_tick_is_read_from_its_row_and_found_again_from_its_place() -> None:
    """Path of three pieces; also where the hand turned back, and on the path itself."""
    path = Polyline(((-0.1, 0.4), (0.0, 0.44), (0.1, 0.4)))
    ready, memory, generator = build_path(path, "path"), new_memory(), np.random.default_rng(5)
    senses = set()
    for _ in range(300):
        tip = (generator.uniform(-0.1, 0.1), generator.uniform(0.3, 0.5))
        seen = Seen(*tip, *generator.normal(scale=0.05, size=2), *generator.normal(scale=5.0, size=2))
        field = field_at(ready, memory, seen, SETTLED)
        row = np.zeros(tick_log.WIDTH)
        row[tick_log.TRAVEL_SENSE] = memory[TRAVEL]
        log_field(field, memory, row)
        assert field_of(row) == field
        senses.add(memory[TRAVEL])
        if memory[PIECE] == nearest_piece(ready, *tip):
            assert field_at_rest(ready, tip, memory[TRAVEL]) == pytest.approx(field, abs=1e-9)
    assert senses == {-1.0, 1.0}


def test_arms_keep_their_lengths_and_end_at_the_tip_or_are_not_there() -> None:
    for device in (THREE, FOUR):
        mechanism, reached = device.mechanism, 0
        for x, y in np.random.default_rng(1).uniform((-0.9, -0.9), (0.9, 0.9), (300, 2)).tolist():
            at = joints_at(mechanism, (x, y))
            reached += bool(at)
            ways = [(arm, math.dist((arm.base_x, arm.base_y), (x, y))) for arm in (mechanism.arm_1, mechanism.arm_2)]
            close = (abs(arm.length_1 - arm.length_2) <= way <= arm.length_1 + arm.length_2 for arm, way in ways)
            assert bool(at) is all(close)
            for arm, base, elbow in ((mechanism.arm_1, "A", "E"), (mechanism.arm_2, "B", "C")) if at else ():
                assert math.dist(at[base], at[elbow]) == pytest.approx(arm.length_1)
                assert math.dist(at[elbow], at["D"]) == pytest.approx(arm.length_2)
        assert 0 < reached < 300
