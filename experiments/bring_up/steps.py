"""The steps of bringing a board up, in their order: what is asked, what currents flow, what must have passed."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from core.device import Device
from core.files import InputError
from core.workspace import tip_is_free
from experiments.bring_up.brakes_in_motion import HALF_S, LASTS_S, TIMES, judge_brakes
from experiments.bring_up.checks import (
    LINKS,
    ON_S,
    SILENT_S,
    all_on,
    are_gone,
    are_there,
    has_pushed,
    has_turned,
    in_turn,
    judge_board,
    judge_currents,
    judge_encoder,
    judge_hole,
    judge_latency,
    judge_push,
    judge_quiet,
    judge_stop,
    judge_supply,
    judge_watchdog,
    judge_zero,
    moves,
)
from experiments.bring_up.step import Point, Step

PATIENCE_S = 60.0  # until the person has done it
SECOND_HOLE_M = 0.08  # from the first hole of the jig: away from the bases, where joints A and B both turn


def second_hole(device: Device, home: Point) -> Point:
    """Where the jig has its second hole, m: the encoders are checked there."""
    ways = ((0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0))
    places = [(home[0] + x * SECOND_HOLE_M, home[1] + y * SECOND_HOLE_M) for x, y in ways]
    return next(place for place in places if bool(tip_is_free(device.mechanism, *place)))


def millimetres(place: Point) -> str:
    """A place (m) in words, in mm."""
    return f"x = {1e3 * place[0]:.0f} mm, y = {1e3 * place[1]:.0f} mm"


def steps_for(device: Device, encoders: str, force: bool, home: Point, latency_s: float = 60.0) -> list[Step]:
    """All steps, in their order. encoders: letters of the joints that have one; home: of the jig, m."""
    hole = second_hole(device, home)
    found = [
        Step("board", "Version, limits, clock", judge_board, 2.0),
        Step("quiet", "Encoders and amplifiers at rest", judge_quiet, 1.0, "Do not touch the handle.",
             {"do": "let go"}, True),
    ]  # fmt: skip
    before: tuple[str, ...] = ("quiet",)
    for joint in encoders:
        turns, held, _ = LINKS[joint]
        ask = f"Hold link {held} still, and turn link {turns} counter-clockwise by 10 degrees or more."
        name = f"encoder {joint}"
        found.append(
            Step(name, f"Encoder of joint {joint}", judge_encoder(joint), PATIENCE_S, ask, {"do": f"turn {joint}"},
                 needs=before, ends=has_turned)
        )  # fmt: skip
        before = (*before, name)
    found += [
        Step("first hole", "Homing in the jig", judge_hole(home), 0.5,
             f"Put the handle into the jig's first hole, {millimetres(home)}.", {"hold": list(home)}, True, before,
             homes=home),
        Step("second hole", "Encoders in the jig's second hole", judge_hole(hole), 0.5,
             f"Put the handle into the jig's second hole, {millimetres(hole)}.", {"hold": list(hole)}, True,
             (*before, "first hole")),
    ]  # fmt: skip
    hands_safe: tuple[str, ...] = (*before, "second hole")
    if force:
        found += [
            Step("zero", "Zero and noise of the force sensor", judge_zero, 1.0,
                 "Take the handle out of the jig, let go of it, and do not touch it.", {"do": "let go"}, True,
                 ("first hole",), zeroes=True),
            Step("push right", "Force sensor along x", judge_push((1.0, 0.0), "to the right"), PATIENCE_S,
                 "Push the handle to the right (+x) with a finger.", {"do": "push right"}, needs=("zero",),
                 ends=has_pushed),
            Step("push away", "Force sensor along y", judge_push((0.0, 1.0), "away from the bases"), PATIENCE_S,
                 "Push the handle away from the bases (+y) with a finger.", {"do": "push away"}, needs=("push right",),
                 ends=has_pushed),
        ]  # fmt: skip
        hands_safe += ("push away",)
    count = int(np.count_nonzero(device.brakes.present))
    found += [
        Step("currents", "Current steps of 10 %", judge_currents, 2.0 * ON_S * count,
             "Do not touch the handle: brakes get 10 % of their current, one after another.", {"do": "let go"}, True,
             ("quiet",), drive=in_turn),
        Step("watchdog", "Watchdog: this computer falls silent", judge_watchdog, 0.3, "Do not touch the handle.",
             {"do": "let go"}, needs=("currents",), drive=all_on, may_fault=True,
             silent_s=SILENT_S),
        Step("stop", "Emergency stop", judge_stop, PATIENCE_S, "Press the emergency stop.", {"do": "press stop"},
             needs=("currents",), drive=all_on, may_fault=True, ends=are_gone),
        Step("supply back", "Supply after the emergency stop", judge_supply, PATIENCE_S,
             "Release the emergency stop and press the supply's start button.", {"do": "release stop"}, True,
             needs=("stop",), drive=all_on, ends=are_there),
    ]  # fmt: skip
    if force:
        ask = "Move the handle in circles of 8 cm about the jig's first hole, one in two seconds, until told: brakes "
        needs = (*hands_safe, "currents", "watchdog", "stop", "supply back")
        found.append(
            Step("brakes", "Brakes at their joints", judge_brakes, LASTS_S, f"{ask}get 10 %.", {"circle": list(home)},
                 needs=needs, begins=moves, drive=partial(in_turn, on_s=HALF_S, times=TIMES))
        )  # fmt: skip
    found.append(
        Step("latency", "Latency and jitter", judge_latency, latency_s,
             f"Let go of the handle, and leave it for {latency_s:g} s.", {"do": "let go"}, needs=("board",))
    )  # fmt: skip
    return found


def with_needs(steps: Sequence[Step], name: str) -> list[Step]:
    """The named step and all steps that it needs, in their order. InputError: there is no step of that name."""
    if name not in (names := [step.name for step in steps]):
        raise InputError(f"--step: this device has no step {name!r}; its steps are {', '.join(names)}")
    wanted = {name}
    for step in reversed(steps):
        wanted |= set(step.needs) if step.name in wanted else set()
    return [step for step in steps if step.name in wanted]


def missing_needs(step: Step, passed: Sequence[str]) -> str:
    """Why a step is not done, one sentence; "": it can be."""
    missing = [name for name in step.needs if name not in passed]
    return f"not done: it needs {', '.join(missing)}" if missing else ""
