"""The plan of a participant's session: every trial laid out before the first one, seeded, with a hash.

Every controller x segment cell stands once in each block; the configuration (a re-rig on hardware) is outermost
and its order alternates by participant; the same controller never comes twice running.
"""

import hashlib
import json
import re
import zlib
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from core.errors import InputError


class Segment(NamedTuple):
    """A line segment to follow, from start to end (m)."""

    start: tuple[float, float]
    end: tuple[float, float]


#: Assumed: the paper prints neither of its two line segments.
SEGMENTS: dict[int, Segment] = {
    1: Segment((-0.10, 0.40), (0.10, 0.40)),
    2: Segment((-0.08, 0.26), (0.08, 0.42)),
}

#: The paper's two configurations, by device name.
CONFIGURATIONS = ("three-brake", "four-brake")
CONTROLLERS = (1, 2, 3, 4, 5)
BLOCKS = 3

#: A random order is drawn anew until it fits; with the paper's cells 3 in 10 do.
_MOST_DRAWS = 200_000


class PlannedTrial(NamedTuple):
    """One trial of the plan. `block` counts within a configuration, `repetition` one cell within it."""

    run: int  # 1.. in the order of the session
    block: int  # 1..blocks
    configuration: str  # name of the device
    controller: int  # 1..5 as in Table I
    segment: int
    repetition: int  # 1..blocks


def participant_index(participant: int | str) -> int:
    """The participant's number, which decides the order of the configurations: "07", "p7" and 7 give 7.

    Our choice: a label without digits gets a number from its letters, so the order does not depend on chance.
    """
    if isinstance(participant, bool) or not isinstance(participant, int | str | np.integer):
        raise InputError(f"participant: {participant!r} is neither a number nor a label")
    if not isinstance(participant, str):
        if participant < 0:
            raise InputError(f"participant: {participant!r} must not be negative")
        return int(participant)
    if not participant.isascii() or not participant.isalnum():
        raise InputError(f"participant: label {participant!r} must be letters and digits only")
    digits = re.search(r"\d+$", participant) or re.search(r"\d+", participant)
    return int(digits.group()) if digits else zlib.crc32(participant.encode())


def configuration_order(participant: int | str, devices: Sequence[str]) -> tuple[str, ...]:
    """The devices as this participant meets them: as given for participant 1, from the second on for 2, ..."""
    first = (participant_index(participant) - 1) % len(devices)
    return (*devices[first:], *devices[:first])


def _distinct(key: str, values: Iterable) -> tuple:
    values = tuple(values)
    if not values:
        raise InputError(f"plan: {key} is empty, there is nothing to plan")
    if len(set(values)) != len(values):
        raise InputError(f"plan: {key} names one of {', '.join(map(str, values))} twice")
    return values


def _shuffled_block(
    cells: np.ndarray, last_controller: int | None, generator: np.random.Generator
) -> list[tuple[int, int]]:
    """The (controller, segment) cells in one of the allowed orders, all equally likely.

    Allowed: no controller twice running, nor the controller of the trial before the block at its start.
    """
    for _ in range(_MOST_DRAWS):
        order = cells[generator.permutation(len(cells))]
        controllers = order[:, 0]
        if controllers[0] != last_controller and not np.any(controllers[1:] == controllers[:-1]):
            return [(int(controller), int(segment)) for controller, segment in order]
    raise InputError("plan: no order was found in which no controller comes twice running; plan fewer segments")


def make_plan(
    participant: int | str,
    seed: int,
    devices: Sequence[str] = CONFIGURATIONS,
    segments: Iterable[int] = tuple(SEGMENTS),
    controllers: Iterable[int] = CONTROLLERS,
    blocks: int = BLOCKS,
) -> tuple[PlannedTrial, ...]:
    """All trials of a participant, in order: 60 with the defaults. The same arguments give the same plan."""
    index = participant_index(participant)
    devices = _distinct("devices", devices)
    segments = _distinct("segments", segments)
    controllers = _distinct("controllers", controllers)
    if isinstance(blocks, bool) or not isinstance(blocks, int) or blocks < 1:
        raise InputError(f"plan: blocks = {blocks!r} must be a whole number of at least 1")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"plan: seed = {seed!r} must be a whole number that is not negative")
    if len(controllers) == 1 and len(segments) * blocks * len(devices) > 1:
        raise InputError("plan: a single controller would come twice running; plan at least two controllers")

    generator = np.random.default_rng(np.random.SeedSequence([int(seed), index]))
    cells = np.array([(controller, segment) for controller in controllers for segment in segments])
    trials: list[PlannedTrial] = []
    for configuration in configuration_order(participant, devices):
        for block in range(1, blocks + 1):
            last = trials[-1].controller if trials else None
            for controller, segment in _shuffled_block(cells, last, generator):
                trials.append(PlannedTrial(len(trials) + 1, block, configuration, controller, segment, block))
    return tuple(trials)


def plan_to_json(plan: Sequence[PlannedTrial]) -> list[dict]:
    """The plan as plain lists and dictionaries, to be stored in session.json."""
    return [trial._asdict() for trial in plan]


def plan_from_json(trials: Sequence[dict]) -> tuple[PlannedTrial, ...]:
    """The plan that was stored. InputError if a trial lacks a field or has one too many."""
    try:
        return tuple(PlannedTrial(**trial) for trial in trials)
    except TypeError:
        raise InputError(f"plan: each trial needs exactly {', '.join(PlannedTrial._fields)}") from None


def plan_hash(plan: Sequence[PlannedTrial]) -> str:
    """SHA-256 (hex) of the plan's canonical JSON: keys sorted, no spaces, ASCII."""
    canonical = json.dumps(plan_to_json(plan), sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(canonical.encode()).hexdigest()
