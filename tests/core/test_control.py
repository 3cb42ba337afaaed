"""The controllers as a whole: presets, decisions, currents; where the two sets of rules differ.

The paper's rules read literally deadlock and chatter, the settled ones do not. Points (2) (sense of a joint), (4) and
(6) are held by kernel tests in test_choice_of_brake and test_velocity_field.
"""

import math
import re

import numpy as np
import pytest
from devices import FOUR, THREE
from hypothesis import assume, example, given
from hypothesis import strategies as st
from protocols import PAPER
from synthetic_device import CURRENT_MAX, brakes_on, gain, random_mass, random_rows

from core.control import algorithm
from core.control.algorithm import LOCKED, Tick, pushes_away
from core.control.controllers import ALGORITHMS, DECISIONS, Preset, decide, make_controller, make_preset
from core.control.rule_sets import LITERAL, RULE_SETS, SETTLED
from core.control.velocity_field import PIECE, WANTED, Field, Seen, new_memory
from core.files import InputError
from core.path import Path, Polyline, build_path, line
from core.simulator.state import pack_brakes

PRESETS = PAPER.controllers
CONTROLLERS = {
    **{preset.name: preset for preset in PRESETS.values()},
    "wall": Preset("wall", "reflect", (0.0, 500.0)),
}
#: Table I, and every other algorithm that ships.
EVERY = dict(enumerate([*PRESETS.values(), *(make_preset(k, k, {}) for k in list(ALGORITHMS)[4:])], start=1))
USE_SDOF = DECISIONS.index("sdof A")
USE_PROPORTIONAL = DECISIONS.index("prop A")
USE_CAPPED = DECISIONS.index("prop A, at normalised force")
USE_BELOW_DRAG = DECISIONS.index("prop A, below off-state drag")

pytestmark = pytest.mark.nojit

SEGMENT_1 = line((-0.10, 0.40), (0.10, 0.40))
FORCE = 17.4  # N, normalised
ALL = brakes_on("AEBC")
MASS = np.array([1.2, 0.3, 2.5])

seed = st.integers(0, 2**32 - 1)
angle = st.floats(-math.pi, math.pi)
numbers, every_number = st.integers(1, 5), st.sampled_from(list(EVERY))
rule_names = st.sampled_from(["settled", "literal"])


def decision(controller, path: Path, x, y, vx, vy, fx, fy, g, mass=MASS, brakes=ALL, memory=None):
    """Decision code and currents (4,) of one tick."""
    current = np.full(4, np.nan)
    memory = new_memory() if memory is None else memory
    seen = Seen(*map(float, (x, y, vx, vy, fx, fy)))
    packed = pack_brakes(brakes, backlash=True)[0]
    return decide(controller, path, Tick(seen, g, mass, packed, memory, current))[0], current


def decided(controller, x, y, v, f, g=None, mass=MASS):
    """The same of the three-brake device."""
    g = THREE.rows(np.array([x, y])) if g is None else g
    return decision(controller, SEGMENT_1, x, y, *v, *f, g, mass, brakes_on("AEB"))


def random_state(rng: np.random.Generator) -> list[float]:
    """Tip near segment 1, velocity up to 0.3 m/s or very slow, hand force up to 30 N or very weak."""
    v = rng.normal(size=2) * rng.choice([0.1, 1e-3])
    f = rng.normal(size=2) * rng.choice([10.0, 0.3])
    return [*rng.uniform([-0.1, 0.33], [0.1, 0.47]), *v, *f]


def test_the_presets_of_the_papers_protocol_are_table_i_but_for_the_low_gain_in_N_per_cm_s():
    assert list(PRESETS) == [1, 2, 3, 4, 5]
    assert [preset.value("gap_m") for preset in PRESETS.values()] == [0, 0, 0.005, 0, 0]
    assert [preset.value("gain_N_s_m") for preset in PRESETS.values()] == [0, 0, 0, 10_000, 500]
    assert [preset.kind for preset in PRESETS.values()] == ["none", "sdof", "sdof", "proportional", "proportional"]


@pytest.mark.parametrize(
    ("change", "force", "options"),
    [
        ({"kind": "adaptive"}, FORCE, {}),
        ({"values": (-0.001, 5.0)}, FORCE, {}),
        ({"values": (math.nan, 5.0)}, FORCE, {}),
        ({"values": (0.0, math.inf)}, FORCE, {}),
        ({"values": (0.0, -5.0)}, FORCE, {}),
        ({}, 0.0, {}),
        ({}, math.nan, {}),
        ({}, FORCE, {"rules": "loose"}),
        ({}, FORCE, {"velocity_noise": -1e-3}),
    ],
)
def test_a_controller_that_cannot_be_is_refused_in_a_sentence(change, force, options):
    preset = Preset("mine", "proportional", (0.0, 5.0))._replace(**change)
    with pytest.raises(InputError, match="controller|rules"):
        make_controller(preset, force, **options)


@given(seed, numbers, rule_names, st.sampled_from(["AEBC", "AEB", "B", ""]))
def test_currents_are_those_that_the_decision_names_and_never_beyond_the_brake(seed, number, rules, joints):
    rng = np.random.default_rng(seed)
    g, brakes = random_rows(rng), brakes_on(joints)
    controller = make_controller(PRESETS[number], FORCE, rules)
    code, current = decision(controller, SEGMENT_1, *random_state(rng), g, random_mass(rng), brakes)
    assert np.all((current >= 0.0) & (current <= CURRENT_MAX))
    if number == 1:
        assert code == algorithm.NONE
    if code in LOCKED:
        assert np.array_equal(current, brakes.current_max)
    elif code < USE_SDOF:
        assert not current.any()
    else:
        i = (code - USE_SDOF) % 4
        assert "AEBC"[i] in joints
        assert not np.delete(current, i).any(), "one brake at a time"
        assert (current[i] == 0.0) == (code >= USE_BELOW_DRAG or gain(0.0) * np.hypot(*g[i]) >= FORCE)
        force = gain(current[i]) * np.hypot(*g[i])
        assert force <= max(FORCE, gain(0.0) * np.hypot(*g[i])) * (1 + 1e-9), "the off-state drag is not commanded"
        if code < USE_PROPORTIONAL or code >= USE_CAPPED and current[i] > 0.0:
            assert force == pytest.approx(min(FORCE, gain(CURRENT_MAX) * np.hypot(*g[i])))


def test_no_brake_gets_more_than_it_may_have_whatever_an_algorithm_writes():
    brakes = brakes_on("AEB")
    current = np.array([1e3, math.nan, -1.0, 0.5])
    algorithm.limit(Tick(Seen(*[0.0] * 6), np.zeros((4, 2)), MASS, brakes, new_memory(), current))
    assert current.tolist() == [CURRENT_MAX, 0.0, 0.0, 0.0]  # C has no brake


@given(seed, st.floats(-0.02, 0.02))
def test_inside_the_gap_nothing_is_controlled_and_outside_the_gap_changes_nothing(seed, distance):
    rng = np.random.default_rng(seed)
    g, (x, _, *state) = random_rows(rng), random_state(rng)
    code, current = decision(make_controller(PRESETS[3], FORCE), SEGMENT_1, x, 0.4 + distance, *state, g)
    if abs(0.4 + distance - 0.4) < 0.005:
        assert (code, current.any()) == (algorithm.IN_GAP, False)
    else:
        without = decision(make_controller(PRESETS[2], FORCE), SEGMENT_1, x, 0.4 + distance, *state, g)
        assert code == without[0] and np.array_equal(current, without[1])


@pytest.mark.parametrize("rules", ["settled", "literal"])
def test_without_a_valid_sdof_path_an_outward_push_is_locked_and_any_other_released(rules):
    g = np.tile([3.0, -3.0], (4, 1))  # left of a path along +x all SDOF paths lead up to the right: none valid
    controller, three = make_controller(PRESETS[2], FORCE, rules), brakes_on("AEB")
    code, current = decision(controller, SEGMENT_1, 0, 0.42, 0, 0, 4, 6, g, brakes=three)
    assert (code, current.tolist()) == (algorithm.LOCK_NO_VALID, [1, 1, 1, 0])
    code, current = decision(controller, SEGMENT_1, 0, 0.42, 0, 0, 4, -6, g, brakes=three)
    assert (code, current.tolist()) == (algorithm.RELEASE_NO_VALID, [0, 0, 0, 0])


@given(seed, every_number, rule_names)
def test_the_mirror_image_of_device_path_and_hand_gets_the_mirrored_decision(seed, number, rules):
    rng = np.random.default_rng(seed)
    g, mass, state = random_rows(rng), random_mass(rng), random_state(rng)
    controller = make_controller(EVERY[number], FORCE, rules)
    code, current = decision(controller, SEGMENT_1, *state, g, mass)
    swap = [2, 3, 0, 1]  # A and B, E and C change places
    x, y, vx, vy, fx, fy = state
    mirrored = decision(
        controller,
        line((0.10, 0.40), (-0.10, 0.40)),
        *(-x, y, -vx, vy, -fx, fy),
        (g * [-1.0, 1.0] * rng.choice([-1.0, 1.0], (4, 1)))[swap],  # the sense in which a joint counts is free
        mass * [1.0, -1.0, 1.0],
    )
    words = re.sub(
        r"\b[AEBC]+\b", lambda found: "".join("AEBC"[i] for i in sorted(map("BCAE".index, found[0]))), DECISIONS[code]
    )
    assert DECISIONS[mirrored[0]] == words
    assert mirrored[1][swap] == pytest.approx(current, abs=1e-12)


@given(every_number, rule_names, *[st.floats(-0.5, 0.5)] * 4, *[st.floats(-60, 60)] * 2, seed)
@example(4, "settled", 0.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0)
@example(4, "literal", 0.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0)
@example(2, "literal", 0.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0)
@example(5, "settled", 0.0, 0.4, 0.0, 5e-324, 0.0, 5e-324, 0)
def test_no_finite_state_gives_a_current_that_is_not_a_number(number, rules, x, y, vx, vy, fx, fy, seed):
    memory = new_memory()
    controller = make_controller(EVERY[number], FORCE, rules)
    g = random_rows(np.random.default_rng(seed))
    g[seed % 4] *= seed % 2  # some joints have no moment arm
    code, current = decision(controller, SEGMENT_1, x, y, vx, vy, fx, fy, g, memory=memory)
    assert 0 <= code < len(DECISIONS)
    assert np.all(np.isfinite(current)) and np.all(np.isfinite(memory[:WANTED])), "it remembers numbers"


@pytest.mark.parametrize("number", [2, 3, 4, 5])
@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_input_that_is_not_finite_releases_all_brakes_and_is_forgotten(number, wrong):
    controller, g = make_controller(PRESETS[number], FORCE), FOUR.rows(np.array([0.0, 0.42]))
    for place in range(6):
        state, memory = [0.0, 0.42, 0.1, 0.0, 5.0, 5.0], np.array([-1.0, 1.0])
        state[place] = wrong
        code, current = decision(controller, SEGMENT_1, *state, g, memory=memory)
        assert (code, current.any(), memory.tolist()) == (algorithm.NOT_FINITE, False, [-1.0, 1.0])


@given(angle, st.floats(1e-6, 60.0), st.floats(0.005, 0.04))
def test_literally_a_tip_at_rest_has_no_candidate_and_the_slightest_outward_push_locks_it(push, force, distance):
    f = (force * math.cos(push), force * math.sin(push))
    assume(f[1] != 0.0)
    code, _ = decided(make_controller(PRESETS[4], FORCE, "literal"), 0.0, 0.4 + distance, (0, 0), f)
    assert code == (algorithm.LOCK_NONE_SELECTED if f[1] > 0.0 else algorithm.RELEASE_NONE_SELECTED)


@given(seed, angle, st.floats(0.6, 60.0), st.floats(0.0, 0.0019), angle)
def test_settled_1_at_rest_the_impending_motion_decides_whatever_the_velocity_noise(seed, push, force, noise, way):
    rng = np.random.default_rng(seed)
    g, mass = random_rows(rng), random_mass(rng)
    f = force * np.array([math.cos(push), math.sin(push)])
    start = np.linalg.solve([[mass[0], mass[1]], [mass[1], mass[2]]], f)
    begun = (0.002 + 1e-12) * start / np.linalg.norm(start)
    for preset in (PRESETS[4], PRESETS[5].replaced(gain_N_s_m=500.0)):
        controller = make_controller(preset, FORCE)
        at_rest = decided(controller, 0.0, 0.42, (0, 0), f, g, mass)
        noisy = decided(controller, 0.0, 0.42, (noise * math.cos(way), noise * math.sin(way)), f, g, mass)
        moving = decided(controller, 0.0, 0.42, begun, f, g, mass)
        assert at_rest[0] == noisy[0] == moving[0]
        assert at_rest[1] == pytest.approx(moving[1], abs=1e-6)
        assert at_rest[1] == pytest.approx(noisy[1], abs=1e-12)


@pytest.mark.parametrize(("force", "felt"), [(0.49, False), (0.51, True)])
def test_settled_1_a_hand_is_felt_above_half_a_newton(force, felt):
    code, _ = decided(make_controller(PRESETS[4], FORCE), 0.0, 0.42, (0.0, 0.0), (force, 0.0))
    assert (code >= USE_PROPORTIONAL) == felt


@given(angle, st.floats(0.51, 40.0), st.floats(0.01, 0.2), st.sampled_from([0, 1, 2]))
def test_settled_2_the_noise_of_a_stuck_joints_rate_does_not_decide(push, force, speed, stuck):
    g = THREE.rows(np.array([0.01, 0.42]))
    along = np.array([-g[stuck, 1], g[stuck, 0]]) / np.hypot(*g[stuck])
    f = force * np.array([math.cos(push), math.sin(push)])
    codes = set()
    for noise in (1e-9, -1e-9):  # m/s across the arc of the stuck joint
        v = speed * along + noise * g[stuck] / np.hypot(*g[stuck])
        codes.add(decided(make_controller(PRESETS[4], FORCE), 0.01, 0.42, v, f, g)[0])
    assert len(codes) == 1


@given(angle, angle, st.sampled_from([1.0, -1.0]), st.floats(0.0, 40.0))
def test_settled_3_a_push_is_outward_above_half_a_newton_and_within_60_degrees(direction, push, side, f):
    t = (math.cos(direction), math.sin(direction))
    n = (side * t[1], -side * t[0])
    field = Field(0.01, *t, *n, *t)
    force = (f * math.cos(push), f * math.sin(push))
    outward = -(force[0] * n[0] + force[1] * n[1])
    assume(abs(outward - 0.5) > 1e-9 and abs(outward - 0.5 * f) > 1e-9 and (abs(outward) > 1e-9 or f == 0.0))
    within_60_degrees = f > 0.0 and math.acos(max(-1.0, min(outward / f, 1.0))) < math.pi / 3
    assert pushes_away(Seen(0.0, 0.0, 0.0, 0.0, *force), field, SETTLED) == (outward > 0.5 and within_60_degrees)
    assert pushes_away(Seen(0.0, 0.0, 0.0, 0.0, *force), field, LITERAL) == (outward > 0.0)


def test_the_proportional_controller_locks_if_no_brake_helps_an_outward_push_or_the_tip_moves_back():
    helps = np.array([[3.0, 3.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])  # brake A only
    out_ahead, out_back, in_ahead, in_back = (0.1, 0.1), (-0.05, 0.1), (0.1, -0.005), (-0.1, -0.04)
    none = np.zeros((4, 2))
    for rules in RULE_SETS:
        for v, f, g, expected in [
            (out_ahead, (1, 5), helps, USE_CAPPED),  # a brake that helps is used, not the lock
            (out_ahead, (1, 5), none, algorithm.LOCK_NONE_SELECTED),
            (out_ahead, (1, -5), none, algorithm.RELEASE_NONE_SELECTED),
            (out_back, (1, 5), helps, algorithm.LOCK_BACK),
            (out_back, (1, 5), none, algorithm.LOCK_NONE_SELECTED),
            (in_back, (1, -5), none, algorithm.LOCK_BACK_NONE_SELECTED),
            (in_ahead, (1, -5), none, algorithm.RELEASE_NONE_SELECTED),
        ]:
            code, _ = decided(make_controller(PRESETS[4], FORCE, rules), 0.0, 0.4001, v, f, g)
            assert DECISIONS[code] == DECISIONS[expected], (rules, v, f)


def test_settled_5_moving_back_locks_only_beyond_5_mm_s_and_four_times_the_velocity_noise():
    def locked(speed, rules="settled", noise=0.0):
        controller = make_controller(PRESETS[4], FORCE, rules, velocity_noise=noise)
        code, current = decided(controller, 0.0, 0.4, (-speed, 0.0), (3.0, 0.0))
        assert (code in {algorithm.LOCK_BACK, algorithm.LOCK_BACK_NONE_SELECTED}) == (current[[0, 1, 2]].min() == 1.0)
        return code in LOCKED

    assert [locked(s) for s in (0.0049, 0.0051)] == [False, True]
    assert [locked(s, noise=2e-3) for s in (0.0079, 0.0081)] == [False, True]
    assert [locked(s, noise=1e-4) for s in (0.0049, 0.0051)] == [False, True]
    assert [locked(s, "literal") for s in (0.0, 1e-9)] == [False, True]


@given(seed, angle, st.floats(0.0, 40.0), st.floats(0.0, 0.00499), angle, st.floats(-0.06, 0.06))
def test_settled_a_hand_that_pushes_inward_is_never_locked_below_5_mm_s(seed, push, force, speed, way, distance):
    assume(abs(distance) > 1e-6)
    f = (force * math.cos(push), -math.copysign(force * abs(math.sin(push)), distance))
    v = (speed * math.cos(way), speed * math.sin(way))
    for number in (2, 3, 4, 5):
        rng = np.random.default_rng(seed)
        controller = make_controller(PRESETS[number], FORCE)
        assert decided(controller, 0.0, 0.4 + distance, v, f, random_rows(rng), random_mass(rng))[0] not in LOCKED


@pytest.mark.parametrize("name", CONTROLLERS)
def test_beyond_a_corner_a_hand_that_pushes_on_is_held_back_towards_it(name):
    angles = 0.5 * math.pi + 0.8 * math.pi * np.arange(6)
    corners = tuple((0.08 * math.cos(a), 0.36 + 0.08 * math.sin(a)) for a in angles)
    star = build_path(Polyline(corners), "star")
    corner, way = star.pieces[1, 2:4], star.pieces[0, 4:6]
    preset, memory, current = CONTROLLERS[name], new_memory(), np.zeros(4)
    controller, brakes = make_controller(preset, FORCE), pack_brakes(ALL, backlash=False)[0]

    def beyond(distance, push):
        tip = corner + distance * way
        seen = Seen(*tip, *(0.05 * way), *(push * way))
        return decide(controller, star, Tick(seen, FOUR.rows(tip), np.array([1.0, 0.0, 1.0]), brakes, memory, current))

    beyond(0.0, 5.0)
    code, field = beyond(0.01, 8.0)
    assert memory[PIECE] == 1 and field.distance == pytest.approx(0.01)
    assert (field.n_x, field.n_y) == pytest.approx(tuple(-way), abs=1e-6), "back to the corner"
    assert current.any() == (preset.kind != "none"), "something brakes"
    if name == "wall":
        assert tuple(memory[WANTED : WANTED + 2]) == pytest.approx(tuple(-0.01 * 500.0 * way), abs=1e-6)
    gap = preset.value("gap_m")
    assert not gap or beyond(0.5 * gap, 8.0)[0] == algorithm.IN_GAP
