"""The controllers as a whole: presets, decisions, currents."""

import math
import re

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from protocols import PAPER
from synthetic_device import CURRENT_MAX, K, brakes_on, gain, random_mass, random_rows, rows

from core.control import algorithm
from core.control import controllers as control
from core.control.algorithm import LOCKED, Tick
from core.control.controllers import ALGORITHMS, DECISIONS, Preset, decide, make_controller, make_preset
from core.control.velocity_field import WANTED, Seen, new_memory
from core.files import InputError
from core.path import Path, line
from core.simulator.state import pack_brakes

PRESETS = PAPER.controllers
#: Table I, and every other algorithm that ships.
EVERY = dict(enumerate([*PRESETS.values(), *(make_preset(k, k, {}) for k in list(ALGORITHMS)[4:])], start=1))
USE_SDOF = control.DECISIONS.index("sdof A")
USE_PROPORTIONAL = control.DECISIONS.index("prop A")
USE_CAPPED = control.DECISIONS.index("prop A, at normalised force")
USE_BELOW_DRAG = control.DECISIONS.index("prop A, below off-state drag")

nojit = pytest.mark.nojit

SEGMENT_1 = line((-0.10, 0.40), (0.10, 0.40))
FORCE = 17.4  # N, normalised
ALL = brakes_on("AEBC")
MASS = np.array([1.2, 0.3, 2.5])

seed = st.integers(0, 2**32 - 1)
numbers, every_number = st.integers(1, 5), st.sampled_from(list(EVERY))
rule_names = st.sampled_from(["settled", "literal"])


def decision(controller, path: Path, x, y, vx, vy, fx, fy, g, mass=MASS, brakes=ALL, memory=None):
    """Decision code and currents (4,) of one tick."""
    current = np.full(4, np.nan)
    memory = new_memory() if memory is None else memory
    seen = Seen(*map(float, (x, y, vx, vy, fx, fy)))
    packed = pack_brakes(brakes, backlash=True)[0]
    return decide(controller, path, Tick(seen, g, mass, packed, memory, current))[0], current


def random_state(rng: np.random.Generator) -> list[float]:
    """Tip near segment 1, velocity up to 0.3 m/s or very slow, hand force up to 30 N or very weak."""
    v = rng.normal(size=2) * rng.choice([0.1, 1e-3])
    f = rng.normal(size=2) * rng.choice([10.0, 0.3])
    return [*rng.uniform([-0.1, 0.33], [0.1, 0.47]), *v, *f]


@nojit
def test_the_presets_of_the_papers_protocol_are_table_i_but_for_the_low_gain_in_N_per_cm_s():
    assert list(PRESETS) == [1, 2, 3, 4, 5]
    assert [preset.value("gap_m") for preset in PRESETS.values()] == [0, 0, 0.005, 0, 0]
    assert [preset.value("gain_N_s_m") for preset in PRESETS.values()] == [0, 0, 0, 10_000, 500]
    assert [preset.kind for preset in PRESETS.values()] == ["none", "sdof", "sdof", "proportional", "proportional"]


@nojit
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


@nojit
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


@nojit
def test_no_brake_gets_more_than_it_may_have_whatever_an_algorithm_writes():
    brakes = brakes_on("AEB")
    current = np.array([1e3, math.nan, -1.0, 0.5])
    algorithm.limit(Tick(Seen(*[0.0] * 6), np.zeros((4, 2)), MASS, brakes, new_memory(), current))
    assert current.tolist() == [CURRENT_MAX, 0.0, 0.0, 0.0]  # C has no brake


@nojit
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


@nojit
@pytest.mark.parametrize("rules", ["settled", "literal"])
def test_without_a_valid_sdof_path_an_outward_push_is_locked_and_any_other_released(rules):
    g = np.tile([3.0, -3.0], (4, 1))  # left of a path along +x all SDOF paths lead up to the right: none valid
    controller, three = make_controller(PRESETS[2], FORCE, rules), brakes_on("AEB")
    code, current = decision(controller, SEGMENT_1, 0, 0.42, 0, 0, 4, 6, g, brakes=three)
    assert (code, current.tolist()) == (algorithm.LOCK_NO_VALID, [1, 1, 1, 0])
    code, current = decision(controller, SEGMENT_1, 0, 0.42, 0, 0, 4, -6, g, brakes=three)
    assert (code, current.tolist()) == (algorithm.RELEASE_NO_VALID, [0, 0, 0, 0])


def test_5_newton_seconds_per_metre_ask_for_less_than_the_drag_and_so_for_no_current():
    selected = {5.0: [], 500.0: []}
    for low_gain, currents in selected.items():
        controller = make_controller(PRESETS[5].replaced(gain_N_s_m=low_gain), FORCE)
        for turn in np.linspace(-1.2, 1.2, 25):
            for speed in (0.05, 0.1, 0.2):
                v = speed * math.cos(turn), speed * math.sin(turn)
                g = rows("three-brake", 0.02, 0.41)
                code, current = decision(controller, SEGMENT_1, 0.02, 0.41, *v, 5, 0, g, brakes=brakes_on("AEB"))
                if code >= USE_PROPORTIONAL:
                    currents.append(current.max())
                    assert (code >= USE_BELOW_DRAG) == (current.max() == 0.0)
    assert len(selected[5.0]) > 20 and max(selected[5.0]) == 0.0
    assert max(selected[500.0]) > 0.1
    assert 5.0 * 0.2 / math.hypot(*g[0]) < K[1], "the reason: the torque asked for is below k_2"


@nojit
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


@nojit
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


@nojit
@pytest.mark.parametrize("number", [2, 3, 4, 5])
@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_input_that_is_not_finite_releases_all_brakes_and_is_forgotten(number, wrong):
    controller, g = make_controller(PRESETS[number], FORCE), rows("four-brake", 0.0, 0.42)
    for place in range(6):
        state, memory = [0.0, 0.42, 0.1, 0.0, 5.0, 5.0], np.array([-1.0, 1.0])
        state[place] = wrong
        code, current = decision(controller, SEGMENT_1, *state, g, memory=memory)
        assert (code, current.any(), memory.tolist()) == (algorithm.NOT_FINITE, False, [-1.0, 1.0])
