"""Cobots: a free caster is a free body, the hand alone supplies energy, wheels never disagree, walls are not passed."""

import numpy as np
import pytest

from core.cobot import (
    COBOT,
    UNSTEERED,
    CobotFile,
    advance,
    advance_at_wall,
    new_cobot,
    path_goal,
    velocity,
)
from core.control.velocity_field import Field
from core.records import new_record

STEP = 1e-3
HUBS = ((0.30, 0.0), (-0.15, 0.26), (-0.15, -0.26))
SCOOTER = CobotFile(name="scooter", mass_kg=30.0, inertia_kg_m2=2.0, hubs_m=HUBS, steering_rate_max_rad_s=20.0)
ONE_CASTOR = CobotFile(
    name="one castor", mass_kg=4.0, inertia_kg_m2=1.0, hubs_m=((0.0, 0.0),), steering_rate_max_rad_s=30.0
)
BOTH = pytest.mark.parametrize("file", [ONE_CASTOR, SCOOTER], ids=lambda file: file.name)


def moving(file, vx, vy, w=0.0):
    """A cobot whose castors stand as that motion needs them."""
    record = new_cobot(file)
    mass, inertia = file.mass_kg, file.inertia_kg_m2
    speed = np.sqrt(mass * (vx * vx + vy * vy) + inertia * w * w)
    record["twist"][0], record["speed"][0] = np.array((vx, vy, w)) / speed, speed
    for i, hub in enumerate(file.hubs_m):
        rolls = np.array((vx - w * hub[1], vy + w * hub[0]))
        record["axis"][0, i] = rolls / np.hypot(*rolls)
    return record


def towards(beta_x, beta_y):
    """A field whose tangent is +x."""
    return Field(0.0, 1.0, 0.0, 0.0, 1.0, beta_x, beta_y)


def free_body(file, motion, force, steps):
    """Poses (steps + 1, 3) of the free body under a force constant over each step: exact."""
    inverse = 1.0 / np.array((file.mass_kg, file.mass_kg, file.inertia_kg_m2))
    v, pose, poses = np.array(motion), np.zeros(3), [np.zeros(3)]
    for k in range(steps):
        after = v + STEP * inverse * force(k)
        pose = pose + 0.5 * STEP * (v + after)
        v = after
        poses.append(pose)
    return np.array(poses)


def forces(file, seed, size):
    """A smooth force (N, N m) over time that a hand could exert, at step k."""
    rng = np.random.default_rng(seed)
    amplitude, rate, phase = size * rng.normal(size=(3, 3)), rng.uniform(0.5, 6.0, (3, 3)), rng.uniform(0, 6, (3, 3))
    torque = 1.0 if len(file.hubs_m) > 1 else 0.0
    return lambda k: np.sum(amplitude * np.sin(rate * k * STEP + phase), axis=1) * np.array((1.0, 1.0, 0.2 * torque))


def axes_agree(record, file):
    """Largest side slip of any hub, as a share of its unit motion."""
    bx, by, bw = record["twist"][0]
    worst = 0.0
    for axis, hub in zip(record["axis"][0], file.hubs_m, strict=False):
        worst = max(worst, abs(axis[0] * (by + bw * hub[0]) - axis[1] * (bx - bw * hub[1])))
    return worst * np.sqrt(file.mass_kg)


@BOTH
def test_a_free_caster_at_20_cm_s_is_the_free_body(file):
    push = forces(file, 3, 0.1 * file.mass_kg)
    motion = (0.2, 0.0, 0.0)
    record, expected = moving(file, *motion), free_body(file, motion, push, 800)
    for k in range(800):
        advance(record[0], tuple(push(k)), 0, UNSTEERED, STEP)
        assert not record["limited"][0]
        assert record["pose"][0] == pytest.approx(expected[k + 1], abs=1e-12)
    assert np.hypot(*expected[-1][:2] - (0.16, 0.0)) > 0.003, "the push bent the way"


@BOTH
@pytest.mark.parametrize("seed", range(6))
def test_the_hand_alone_supplies_energy_and_the_castors_agree_within_their_rate(file, seed):
    record, push = new_cobot(file), forces(file, seed, 1.5 * file.mass_kg)
    rng = np.random.default_rng(seed)
    most, limited = 0.0, 0
    for k in range(1500):
        axis = record["axis"][0].copy()
        goal = rng.normal(size=3) * (1.0, 1.0, float(len(file.hubs_m) > 1)) if k % 200 < 100 else np.zeros(3)
        advance(record[0], tuple(push(k)), int(goal.any()), tuple(goal), STEP)
        assert 0.5 * record["speed"][0] ** 2 == pytest.approx(record["work"][0], abs=1e-9 + 1e-9 * record["work"][0])
        assert axes_agree(record, file) < 1e-9
        for before, after in zip(axis, record["axis"][0], strict=True):
            most = max(most, np.arctan2(abs(before[0] * after[1] - before[1] * after[0]), abs(before @ after)))
        limited += record["limited"][0] != 0
    assert most <= file.steering_rate_max_rad_s * STEP * (1 + 1e-9) and limited > 0


def test_castors_held_still_roll_round_the_centre_of_their_axles():
    record = moving(SCOOTER, 0.1, 0.05, 0.4)
    axes = record["axis"][0].copy()
    centre = np.array((-0.05, 0.1)) / 0.4
    radius = np.hypot(*centre)
    c, s = np.cos(0.4 * STEP), np.sin(0.4 * STEP)
    for _ in range(2000):
        vx, vy, w = velocity(record[0])
        assert np.hypot(vx, vy) == pytest.approx(0.4 * radius, rel=1e-9)
        advance(record[0], UNSTEERED, 1, (c * vx - s * vy, s * vx + c * vy, w), STEP)  # as it rolls on anyway
        place = record["pose"][0, :2] - centre
        assert np.hypot(*place) == pytest.approx(radius, abs=2e-6)
    assert record["axis"][0] == pytest.approx(axes, abs=1e-9) and record["pose"][0, 2] == pytest.approx(0.8)


@BOTH
def test_no_hand_within_the_stated_push_passes_the_wall_and_all_come_near_it(file):
    wall, most, push = np.array((0.0, 0.0, 0.0, 1.0)), 2000, 8.0 * file.mass_kg
    reached = 0
    for seed in range(16):
        rng = np.random.default_rng(seed)
        record = np.concatenate([new_cobot(file, (0.0, 0.35, 0.0)), new_record(COBOT)]).view(np.recarray)
        turn, least = rng.uniform(-np.pi, np.pi), np.inf
        for _ in range(1500):
            turn += rng.normal() * 0.02
            size = push * (1.0 if seed % 2 else rng.uniform())
            fx, fy = size * np.cos(turn), size * np.sin(turn)
            if record["pose"][0, 1] > 0.4:
                fy = -size * 0.5
            advance_at_wall(record, wall, push, (fx, fy, 0.0), STEP, most)
            least = min(least, record["pose"][0, 1])
        assert least > 0.0
        assert 0.5 * record["speed"][0] ** 2 == pytest.approx(record["work"][0], rel=1e-9, abs=1e-9)
        reached += least < 0.06
    assert reached > 4, "the wall is not kept by standing off from it"


def test_steered_along_a_path_the_heading_is_brought_near_and_the_way_is_the_paths():
    record = new_cobot(SCOOTER, (0.0, 0.0, 0.5))
    for _ in range(4000):
        goal = path_goal(record[0], towards(0.8, 0.6), (10.0, 0.0, 0.0), 0.0, 0.1, STEP)
        advance(record[0], (10.0, 0.0, 0.0), 1, goal, STEP)
    x, y, heading = record["pose"][0]
    assert heading == pytest.approx(0.0, abs=1e-3)
    vx, vy, _ = velocity(record[0])
    assert (vx, vy) / np.hypot(vx, vy) == pytest.approx((0.8, 0.6), abs=1e-3)
    assert record["side_force"][0] > 4.0, "the castors held the hand's force across the path"


def test_a_hand_that_pushes_away_still_comes_to_the_path_and_keeps_half_its_force_along_it():
    record, push = new_cobot(ONE_CASTOR), np.array((5.0, 5.0))
    assert path_goal(record[0], towards(0.0, -1.0), (5.0, -5.0, 0.0), 0.0, 1.0, STEP) == (0.0, -1.0, 0.0)
    x, y, _ = path_goal(record[0], towards(0.0, -1.0), (*push, 0.0), 0.0, 1.0, STEP)
    assert (x, y) == pytest.approx(np.array((0.75, -0.25)) / np.hypot(0.75, 0.25)) and push @ (x, y) > 2.5
    slowing = path_goal(moving(ONE_CASTOR, 0.2, -0.2)[0], towards(0.6, -0.8), (-5.0, 5.0, 0.0), 0.0, 1.0, STEP)
    assert slowing == (0.6, -0.8, 0.0), "a hand that only slows it down is let on along beta"
    assert path_goal(moving(ONE_CASTOR, -0.2, 0.0)[0], towards(0.0, -1.0), (*push, 0.0), 0.0, 1.0, STEP)[:2] == (
        1.0,
        0.0,
    )


@pytest.mark.parametrize(
    ("hubs", "reason"), [(((0.1, 0.0),), "centre of mass"), (((0.1, 0.0), (0.1, 0.0)), "the same hub")]
)
def test_a_cobot_that_cannot_be_is_refused(hubs, reason):
    with pytest.raises(ValueError, match=reason):
        CobotFile(name="x", mass_kg=1.0, inertia_kg_m2=1.0, hubs_m=hubs, steering_rate_max_rad_s=1.0)
