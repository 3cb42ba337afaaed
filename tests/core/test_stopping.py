"""The bound behind the guard of obstacles: what it says of brakes, rows and ways, against simulator and sampling."""

import math

import numpy as np
import pytest

from core.control.guard import Around, Guard, make_around, stopping_distance, tick_at
from core.control.levers import MARGIN, SLOWEST, set_direction, take_places
from core.control.stopping import (
    furthest,
    make_stopping,
    safe_radius,
    set_largest_lags,
)
from core.device import load_device
from core.simulator.state import new_body, pack_mechanism
from core.simulator.stick_slip_mode import update_kinematics
from core.workspace import brake_rows, free_tips, tip_is_free
from tests.support.reaches import PUSHES_N, pushed_device

NAMES = list(PUSHES_N)


@pytest.mark.parametrize("name", NAMES)
def test_no_place_between_those_that_are_looked_at_is_weaker_or_turns_its_joints_faster(name: str) -> None:
    device, push = load_device(name), PUSHES_N[name]
    mechanism, present = pack_mechanism(device.mechanism)[0], device.brakes.present > 0.0
    stopping, tips = make_stopping(device.mechanism, device.brakes, push)[0], free_tips(device.mechanism)
    rng = np.random.default_rng(3)
    for _ in range(30):
        x, y = tips[rng.integers(len(tips))]
        radius, heading = rng.choice([0.005, 0.03, 0.06, 0.1, 0.2]), rng.uniform(0.0, 2.0 * math.pi)
        slopes = np.where(present, stopping.full * rng.choice([0.5, 1.0], 4), 0.0)
        take_places(stopping.levers, x, y, radius)
        n = np.array([math.cos(heading), math.sin(heading)])
        set_direction(stopping.levers, *n)
        left = slopes @ stopping.levers.lever[:, : stopping.levers.rows] - push
        found = {"held": left.min(), "for progress": (left * stopping.levers.per_way[: stopping.levers.rows]).min()}
        r, angles = radius * np.sqrt(rng.random(1500)), rng.uniform(0.0, 2.0 * math.pi, 1500)
        near = np.column_stack((x + r * np.cos(angles), y + r * np.sin(angles)))
        near = near[tip_is_free(device.mechanism, *near.T)]
        if not len(near):
            continue
        rows = brake_rows(device.mechanism, *near.T)[present]
        across = np.stack((-rows[:, 1], rows[:, 0]), axis=1) / np.hypot(rows[:, 0], rows[:, 1])[:, None]
        levers = np.abs(np.einsum("kan,ian->kin", across, rows))
        left = np.einsum("kin,i->kn", levers, slopes[present]) - push
        along = np.maximum(np.abs(np.einsum("kan,a->kn", across, n)), SLOWEST)
        where = f"({x:.3f}, {y:.3f}) radius {radius}"
        assert found["held"] <= left.min() + 1e-9, where
        if found["held"] > 0.0:
            assert found["for progress"] <= (left / along).min() + 1e-9, where
        for place in near[:60]:
            body = new_body(*place)
            update_kinematics(mechanism, body[0])
            (xx, xy, yy), g = body["mass"][0], body["g"][0, :4]
            swift = np.einsum("ia,ab,ib->i", g, np.linalg.inv([[xx, xy], [xy, yy]]), g)
            assert (swift[present] <= stopping.levers.swift[present]).all(), where


def test_a_rougher_look_is_never_taken_for_a_proof() -> None:
    """A push of more than a full lock holds, with the margin for what lies between, and a device at rest."""
    device = load_device("er-two-brake")  # holds 16.4 N everywhere
    for push, sure in ((0.7 * (1.0 - MARGIN) * 16.4, True), (16.41, False)):
        stopping = make_stopping(device.mechanism, device.brakes, push)[0]
        assert math.isfinite(safe_radius(stopping, 0.0, 0.4, 1e-6)) == sure
    take_places(stopping.levers, 0.0, 0.4, 0.02)
    set_direction(stopping.levers, 0.0, 0.0)
    set_largest_lags(stopping, 0.0, 0.02)
    assert furthest(stopping, 0.0, 0.02) == math.inf


@pytest.mark.parametrize("name", NAMES)
def test_no_hand_brings_the_tip_beyond_the_stopping_distance_which_is_not_far_beyond_its_way(name: str) -> None:
    """A hand that pushes on as the tip moves, brakes locked after a tick; lag and play make the bound a wide one."""
    device, push = load_device(name), PUSHES_N[name]
    around = make_around(Around(guard=Guard(push_N=push)), device)[0]
    for speed in (0.1, 0.3):
        simulated = pushed_device(device, (0.0, 0.4))
        simulated.body["tip"][0, 2:], simulated.hand.grips["held"][0] = (speed, 0.0), (push, 0.0)
        simulated.settle(np.zeros(4), 0.0)
        furthest_x = 0.0
        for n in range(300):
            simulated.move(simulated.brakes["current_max"][0] * (n > 0), 1e-3 * n, 1e-3)
            furthest_x = max(furthest_x, simulated.tip[0])
        distance = stopping_distance(around, tick_at(device, (0.0, 0.4), (speed, 0.0)))
        assert furthest_x <= distance <= (2.5 if name == "er-two-brake" else 8.0) * furthest_x
