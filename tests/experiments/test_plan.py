"""Laws of the session plan: balance, alternation, never the same controller twice running, one seed one plan."""

from collections import Counter
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from protocols import PAPER

from core.files import InputError
from experiments.plan import (
    configuration_order,
    lay_out,
    make_plan,
    plan_from_json,
    plan_hash,
    plan_to_json,
    practice_trial,
)

CONFIGURATIONS = tuple(device.name for device in PAPER.devices)
PATHS, CONTROLLERS = tuple(PAPER.paths), tuple(PAPER.controllers)


PAPER_ARGUMENTS = dict(
    participant=1, seed=1, devices=CONFIGURATIONS, segments=PATHS, controllers=CONTROLLERS, blocks=3
)


def paper_plan(participant, seed):
    """The plan of the paper's protocol."""
    return make_plan(replace(PAPER, seed=seed), participant)


@given(st.integers(0, 2**40), st.integers(0, 500))
@settings(max_examples=60, deadline=None)
def test_every_cell_stands_once_in_each_block_and_no_controller_comes_twice_running(seed, participant):
    plan = paper_plan(participant, seed)
    assert [trial.run for trial in plan] == list(range(1, 61))
    for configuration in CONFIGURATIONS:
        for block in (1, 2, 3):
            cells = [
                (t.controller, t.segment) for t in plan if (t.configuration, t.block) == (configuration, block)
            ]
            assert sorted(cells) == [(c, s) for c in range(1, 6) for s in PATHS]
    assert all(before.controller != after.controller for before, after in zip(plan, plan[1:], strict=False))
    assert [t.block for t in plan] == [1] * 10 + [2] * 10 + [3] * 10 + [1] * 10 + [2] * 10 + [3] * 10


@given(
    st.integers(0, 1000), st.integers(2, 4), st.integers(1, 3), st.integers(1, 4), st.integers(1, 3), st.integers(1, 3)
)
@settings(max_examples=60, deadline=None)
def test_any_protocol_keeps_the_same_laws(seed, controllers, paths, blocks, devices, repetitions):
    names = tuple(f"device {i}" for i in range(devices))
    plan = lay_out(3, seed, names, range(1, paths + 1), range(1, controllers + 1), blocks, repetitions)
    cells = Counter((t.configuration, t.block, t.controller, t.segment) for t in plan)
    assert len(cells) == devices * blocks * controllers * paths and set(cells.values()) == {repetitions}
    assert all(before.controller != after.controller for before, after in zip(plan, plan[1:], strict=False))
    places = {(t.configuration, t.controller, t.segment, t.repetition) for t in plan}
    assert len(places) == len(plan) and {t.repetition for t in plan} == set(range(1, blocks * repetitions + 1))


def test_where_few_orders_are_allowed_one_is_found_all_the_same():
    """Two controllers, 60 trials a block: only two in 10^17 orders alternate."""
    plan = lay_out(1, 1, ("a",), (1, 2, 3), (1, 2), 2, 10)
    assert all(before.controller != after.controller for before, after in zip(plan, plan[1:], strict=False))
    assert {trial.segment for trial in plan[:10]} == {1, 2, 3}


def test_a_single_controller_comes_in_every_trial():
    plan = lay_out(1, 1, ("a", "b"), (1, 2), (4,), 3)
    assert {trial.controller for trial in plan} == {4} and len(plan) == 12
    orders = {tuple(t.segment for t in lay_out(1, seed, ("a",), (1, 2), (4,), 3)) for seed in range(30)}
    assert len(orders) > 4  # the paths are still shuffled


def test_codes_take_the_places_of_the_controllers_in_a_blind_plan():
    """The plan over codes is the same plan: which controller a code is, it does not know."""
    plain, coded = make_plan(PAPER, "01"), make_plan(replace(PAPER, blind=True), "01")
    key = dict(zip(("K1", "K2", "K3", "K4", "K5"), CONTROLLERS, strict=True))
    assert tuple(t._replace(controller=key[t.controller]) for t in coded) == plain
    assert make_plan(PAPER, "01", coded=True) == coded and plan_from_json(plan_to_json(coded)) == coded


def test_practice_goes_through_all_cells_before_it_repeats_one_and_is_not_the_plan():
    drawn = [practice_trial(PAPER, "01", "four-brake", number) for number in range(1, 21)]
    assert {t.block for t in drawn} == {0} and [t.run for t in drawn] == list(range(1, 21))
    for round_of in (drawn[:10], drawn[10:]):
        assert {(t.controller, t.segment) for t in round_of} == {(c, s) for c in CONTROLLERS for s in PATHS}
    assert all(before.controller != after.controller for before, after in zip(drawn, drawn[1:], strict=False))
    cells = [(t.controller, t.segment) for t in drawn[:10]]
    assert cells != [(t.controller, t.segment) for t in make_plan(PAPER, "01") if t.configuration == "four-brake"][:10]


def test_repetition_counts_the_same_cell_in_the_order_it_is_met():
    met = Counter()
    for trial in paper_plan(2, 9):
        cell = (trial.configuration, trial.controller, trial.segment)
        met[cell] += 1
        assert trial.repetition == met[cell]


def test_configuration_is_the_outer_block_and_its_order_alternates_by_participant():
    firsts = []
    for participant in range(1, 9):
        configurations = [trial.configuration for trial in paper_plan(participant, 1)]
        assert len(set(configurations[:30])) == len(set(configurations[30:])) == 1
        assert configurations[0] != configurations[30]
        firsts.append(configurations[0])
    assert firsts == ["three-brake", "four-brake"] * 4
    assert paper_plan("02", 1) == paper_plan(2, 1) == paper_plan("p2", 1)
    with_three = [configuration_order(p, ("a", "b", "c"))[0] for p in (1, 2, 3, 4)]
    assert with_three == ["a", "b", "c", "a"]


def test_one_seed_gives_one_plan_and_participants_and_seeds_differ():
    assert paper_plan("01", 1) == paper_plan("01", 1)
    plans = {paper_plan(participant, seed) for participant in (1, 3, 5) for seed in (1, 2, 3)}
    assert len(plans) == 9
    assert paper_plan("anna", 1) == paper_plan("anna", 1) != paper_plan("berta", 1)


def test_hash_follows_the_content_and_survives_storage():
    plan = paper_plan(1, 1)
    assert plan_from_json(plan_to_json(plan)) == plan
    assert plan_hash(plan_from_json(plan_to_json(plan))) == plan_hash(plan)
    others = [
        (*plan[:7], plan[7]._replace(**{field: value}), *plan[8:])
        for field, value in (
            ("controller", 9),
            ("segment", 9),
            ("block", 9),
            ("repetition", 9),
            ("configuration", "x"),
        )
    ]
    assert len({plan_hash(plan), *map(plan_hash, others), plan_hash(plan[:-1])}) == 7


def test_every_controller_is_about_equally_often_at_every_place_of_a_block():
    """400 seeds, first configuration: 400 draws of 1/5 for each place of each block, sd 8 about 80."""
    at = Counter()
    for seed in range(400):
        for trial in paper_plan(1, seed)[:30]:
            at[trial.run, trial.controller] += 1
    assert len(at) == 150
    assert all(abs(count - 80) < 5 * 8 for count in at.values())


def test_every_cell_follows_every_cell_of_another_controller():
    """No hidden pattern: over many seeds every allowed pair of neighbours occurs."""
    pairs = set()
    for seed in range(60):
        plan = paper_plan(1, seed)
        pairs |= {
            ((a.controller, a.segment), (b.controller, b.segment)) for a, b in zip(plan, plan[1:], strict=False)
        }
    assert len(pairs) == 10 * 8


@pytest.mark.parametrize(
    "arguments, word",
    [
        (dict(participant="a b"), "participant"),
        (dict(participant=-1), "participant"),
        (dict(participant=1.5), "participant"),
        (dict(seed=-1), "seed"),
        (dict(seed="x"), "seed"),
        (dict(blocks=0), "blocks"),
        (dict(devices=()), "devices"),
        (dict(devices=("a", "a")), "devices"),
        (dict(repetitions=0), "repetitions"),
        (dict(controllers=()), "controllers"),
    ],
)
def test_an_impossible_plan_is_refused_in_one_sentence(arguments, word):
    with pytest.raises(InputError, match=word):
        lay_out(**{**PAPER_ARGUMENTS, **arguments})


def test_a_single_trial_is_a_plan():
    assert [t[:3] for t in lay_out(1, 1, ("a",), (1,), (2,), 1)] == [(1, 1, "a")]
