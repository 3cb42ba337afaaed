"""Laws of the session plan: balance, alternation, never the same controller twice running, one seed one plan."""

from collections import Counter
from itertools import pairwise
from types import SimpleNamespace

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from protocols import PAPER

from core.files import InputError
from experiments.plan import make_plan, plan_from_json, plan_hash, plan_to_json, practice_trial

CELLS = {(controller, path) for controller in PAPER.controllers for path in PAPER.paths}


def plan_of(devices, controllers, paths, blocks, repetitions=1, seed=1, participant="3"):
    """The plan of a protocol of so many devices ("1", "2", ..), controllers and paths."""
    protocol = replace(
        PAPER, devices=tuple(SimpleNamespace(name=str(i)) for i in range(1, devices + 1)),
        controllers=dict.fromkeys(range(1, controllers + 1)), paths=dict.fromkeys(range(1, paths + 1)),
        blocks=blocks, repetitions=repetitions, seed=seed,
    )  # fmt: skip
    return make_plan(protocol, participant)


def paper_plan(participant, seed):
    """The plan of the paper's protocol."""
    return make_plan(replace(PAPER, seed=seed), str(participant))


def never_twice_running(plan):
    return all(before.controller != after.controller for before, after in pairwise(plan))


@given(
    st.integers(1, 3), st.integers(2, 5), st.integers(1, 3), st.integers(1, 4), st.integers(1, 3),
    st.integers(0, 2**40), st.integers(0, 500),
)  # fmt: skip
@example(2, 5, 2, 3, 1, 1, 1)  # the paper's
@example(1, 2, 3, 2, 10, 1, 1)  # only two in 10^17 orders of a block alternate: one is found all the same
@example(1, 1, 1, 1, 1, 1, 1)  # a single trial is a plan
@settings(max_examples=80)
def test_every_cell_stands_as_often_in_each_block_and_no_controller_comes_twice_running(
    devices, controllers, paths, blocks, repetitions, seed, participant
):
    plan = plan_of(devices, controllers, paths, blocks, repetitions, seed, str(participant))
    cells = Counter((t.configuration, t.block, t.controller, t.path) for t in plan)
    assert len(cells) == devices * blocks * controllers * paths and set(cells.values()) == {repetitions}
    assert never_twice_running(plan) and [trial.run for trial in plan] == list(range(1, len(plan) + 1))
    in_block = controllers * paths * repetitions
    assert [t.block for t in plan] == [1 + i // in_block % blocks for i in range(len(plan))]
    assert len(list(dict.fromkeys(t.configuration for t in plan[:: in_block * blocks]))) == devices
    met = Counter()
    for t in plan:  # repetition counts the same cell of a configuration in the order in which it is met
        met[t.configuration, t.controller, t.path] += 1
        assert t.repetition == met[t.configuration, t.controller, t.path]


def test_codes_take_the_places_of_the_controllers_in_a_blind_plan():
    """The plan over codes is the same plan: which controller a code is, it does not know."""
    plain, coded = make_plan(PAPER, "01"), make_plan(replace(PAPER, blind=True), "01")
    key = dict(zip(("K1", "K2", "K3", "K4", "K5"), PAPER.controllers, strict=True))
    assert tuple(t._replace(controller=key[t.controller]) for t in coded) == plain
    assert make_plan(PAPER, "01", coded=True) == coded and plan_from_json(plan_to_json(coded)) == coded


def test_practice_goes_through_all_cells_before_it_repeats_one_and_is_not_the_plan():
    drawn = [practice_trial(PAPER, "01", "four-brake", number) for number in range(1, 21)]
    assert {t.block for t in drawn} == {0} and [t.run for t in drawn] == list(range(1, 21))
    assert never_twice_running(drawn)
    cells = [(t.controller, t.path) for t in drawn]
    assert set(cells[:10]) == set(cells[10:]) == CELLS
    plan = [(t.controller, t.path) for t in make_plan(PAPER, "01") if t.configuration == "four-brake"]
    assert cells[:10] != plan[:10]


def test_the_order_of_the_configurations_alternates_by_participant():
    assert [paper_plan(n, 1)[0].configuration for n in range(1, 9)] == ["three-brake", "four-brake"] * 4
    assert [plan_of(3, 2, 1, 1, participant=str(n))[0].configuration for n in (1, 2, 3, 4)] == ["1", "2", "3", "1"]
    assert paper_plan("02", 1) == paper_plan(2, 1) == paper_plan("p2", 1)


def test_one_seed_gives_one_plan_and_participants_and_seeds_differ():
    assert paper_plan("anna", 1) == paper_plan("anna", 1)
    assert len({paper_plan(who, seed) for who in (1, 3, 5, "anna", "berta") for seed in (1, 2, 3)}) == 15


def test_the_hash_follows_the_content_and_survives_storage():
    plan = paper_plan(1, 1)
    assert plan_from_json(plan_to_json(plan)) == plan
    others = [
        (*plan[:7], plan[7]._replace(**{field: value}), *plan[8:])
        for field, value in dict(controller=9, path=9, block=9, repetition=9, configuration="x").items()
    ]
    assert len({plan_hash(plan), *map(plan_hash, others), plan_hash(plan[:-1])}) == 7
    with pytest.raises(InputError, match="each trial needs exactly run, block"):
        plan_from_json([{"run": 1}])


def test_every_controller_is_about_equally_often_at_every_place_of_a_block_and_every_cell_follows_every_other():
    """400 seeds, first configuration: 400 draws of 1/5 for each place of each block, sd 8 about 80."""
    at = Counter((trial.run, trial.controller) for seed in range(400) for trial in paper_plan(1, seed)[:30])
    assert len(at) == 150 and all(abs(count - 80) < 5 * 8 for count in at.values())
    pairs = {(a[3:5], b[3:5]) for seed in range(60) for a, b in pairwise(paper_plan(1, seed))}
    assert len(pairs) == 10 * 8
