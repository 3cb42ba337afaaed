"""The plan of a participant's session: every trial laid out before the first one, seeded, with a hash; and as text.

Every controller x path cell stands once (or `repetitions` times) in each block; the configuration (a re-rig on
hardware) is outermost and its order alternates by participant; the same controller never comes twice running, unless
there is only one. In a blind session the plan is drawn over codes, K1, K2, .., and does not know which controller each
is.
"""

import hashlib
import json
import math
import re
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from core.control.controllers import ALGORITHMS, Preset
from core.files import InputError
from core.path import Arc, PathFile, Polyline, build_path
from experiments.protocol import Protocol

#: A random order is drawn anew until it fits: with the paper's cells 3 in 10 do. After so many draws it is built.
_MOST_DRAWS = 2000
#: Sets the draws of practice apart from those of the plan.
_PRACTICE = 0x9AC71CE
PRACTICE_BLOCK = 0


class PlannedTrial(NamedTuple):
    """One trial of the plan. `block` counts within a configuration, `repetition` one cell within it."""

    run: int  # 1.. in the order of the session
    block: int  # 1..blocks; 0: practice, which counts nowhere
    configuration: str  # name of the device
    controller: int | str  # its number in the protocol, as in Table I; in a blind session a code, "K3"
    segment: int  # number of the path
    repetition: int  # 1.., of the cell within the configuration


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
    cells: Sequence[tuple], last_controller: int | str | None, generator: np.random.Generator
) -> list[tuple]:
    """The (controller, path) cells in one of the allowed orders, all equally likely (nearly so, where few orders fit).

    Allowed: no controller twice running, nor the controller of the trial before the block at its start.
    """
    controllers = [cell[0] for cell in cells]
    if len(set(controllers)) == 1:
        return [cells[i] for i in generator.permutation(len(cells))]
    for _ in range(_MOST_DRAWS):
        order = generator.permutation(len(cells))
        drawn = [last_controller, *(controllers[i] for i in order)]
        if all(before != after for before, after in zip(drawn, drawn[1:], strict=False)):
            return [cells[i] for i in order]
    return _built_block(cells, last_controller, generator)


def _built_block(cells: Sequence[tuple], last: int | str | None, generator: np.random.Generator) -> list[tuple]:
    """An allowed order, place by place: a cell at random, among those after which the rest can still be placed."""
    rest, built = [cells[i] for i in generator.permutation(len(cells))], []
    while rest:
        left = len(rest) - 1
        counts = Counter(controller for controller, *_ in rest)
        fits = [
            i
            for i, (controller, *_) in enumerate(rest)
            if controller != last
            and counts[controller] - 1 <= left // 2
            and all(count <= (left + 1) // 2 for other, count in counts.items() if other != controller)
        ]
        built.append(rest.pop(fits[int(generator.integers(len(fits)))]))
        last = built[-1][0]
    return built


def lay_out(
    participant: int | str,
    seed: int,
    devices: Sequence[str],
    segments: Iterable[int],
    controllers: Iterable[int | str],
    blocks: int,
    repetitions: int = 1,
) -> tuple[PlannedTrial, ...]:
    """All trials of a participant, in order. The same arguments give the same plan."""
    index = participant_index(participant)
    devices, segments, controllers = (
        _distinct(key, values)
        for key, values in (("devices", devices), ("segments", segments), ("controllers", controllers))
    )
    for key, value, least in (("blocks", blocks, 1), ("repetitions", repetitions, 1), ("seed", seed, 0)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
            raise InputError(f"plan: {key} = {value!r} must be a whole number of at least {least}")

    generator = np.random.default_rng(np.random.SeedSequence([int(seed), index]))
    cells = [(controller, segment) for controller in controllers for segment in segments] * repetitions
    trials: list[PlannedTrial] = []
    for configuration in configuration_order(participant, devices):
        met: dict[tuple, int] = {}
        for block in range(1, blocks + 1):
            last = trials[-1].controller if trials else None
            for cell in _shuffled_block(cells, last, generator):
                met[cell] = met.get(cell, 0) + 1
                trials.append(PlannedTrial(len(trials) + 1, block, configuration, *cell, met[cell]))
    return tuple(trials)


def make_plan(protocol: Protocol, participant: int | str, coded: bool | None = None) -> tuple[PlannedTrial, ...]:
    """All trials of a participant by a protocol. coded: over codes (default: as in the protocol)."""
    names = [device.name for device in protocol.devices]
    controllers = plan_controllers(protocol, coded)
    return lay_out(
        participant, protocol.seed, names, protocol.paths, controllers, protocol.blocks, protocol.repetitions
    )


def plan_controllers(protocol: Protocol, coded: bool | None = None) -> tuple[int | str, ...]:
    """What stands for the controllers in a plan: their numbers, or as many codes."""
    if protocol.blind if coded is None else coded:
        return codes(len(protocol.controllers))
    return tuple(protocol.controllers)


def codes(count: int) -> tuple[str, ...]:
    """The codes of a blind session: K1, K2, .."""
    return tuple(f"K{number}" for number in range(1, count + 1))


def practice_trial(
    protocol: Protocol, participant: int | str, configuration: str, number: int, coded: bool | None = None
) -> PlannedTrial:
    """The practice trial of this number (1..) in a configuration; its run is its number until it is run.

    Our choice: practice goes through all cells, shuffled as a block is, then through all of them again.
    """
    position = [device.name for device in protocol.devices].index(configuration)
    key = [_PRACTICE, protocol.seed, participant_index(participant), position]
    generator = np.random.default_rng(np.random.SeedSequence(key))
    cells = [(controller, path) for controller in plan_controllers(protocol, coded) for path in protocol.paths]
    drawn: list[tuple] = []
    while len(drawn) < number:
        drawn += _shuffled_block(cells, drawn[-1][0] if drawn else None, generator)
    return PlannedTrial(number, PRACTICE_BLOCK, configuration, *drawn[number - 1], number)


def break_after(protocol: Protocol, done: int, left: int) -> bool:
    """Whether a break comes after `done` trials of a configuration, `left` of which are still to come.

    Our choice: none after the last, where the re-rig is one.
    """
    return protocol.breaks is not None and done > 0 and left > 0 and done % protocol.breaks.after_trials == 0


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


TRIAL_S = 15.0  # assumed: approach, hold, a move of some seconds, and what lies between two trials
RERIG_S = 300.0  # assumed: taking a brake off or putting one on, and the checks


#: lines of the printed plan between a trial and the next one; of the first one's configuration so many are then done
#: and left
Steps = Callable[[Protocol, PlannedTrial, PlannedTrial, int, int], list[str]]


def steps_between(protocol: Protocol, before: PlannedTrial, after: PlannedTrial, done: int, left: int) -> list[str]:
    """What the printed plan says between two trials: a re-rig, a break."""
    if after.configuration != before.configuration:
        return [f"re-rig to {after.configuration}"]
    if protocol.breaks is not None and break_after(protocol, done, left):
        return [f"-- break of at least {protocol.breaks.least_s:g} s --"]
    return []


def print_plan(protocol: Protocol, participant: str, steps: Steps = steps_between) -> str:
    """The protocol's facts, the estimated duration, then every trial in order with practice and the steps between."""
    plan = make_plan(protocol, participant)
    parts, before = [_head(protocol, participant, plan)], plan[0]
    for configuration in dict.fromkeys(trial.configuration for trial in plan):
        trials = [trial for trial in plan if trial.configuration == configuration]
        if before.configuration != configuration:
            parts += steps(protocol, before, trials[0], sum(t.configuration == before.configuration for t in plan), 0)
        parts.append("\n".join([configuration, *_lines(protocol, participant, trials, steps)]))
        before = trials[-1]
    return "\n\n".join(parts) + "\n"


def plan_summary(protocol: Protocol) -> str:
    """What a participant's session is made of, how many trials that gives, and about how long it takes."""
    plan = make_plan(protocol, 1)
    counts = [
        counted(len(of), name)
        for of, name in ((protocol.devices, "device"), (protocol.controllers, "controller"), (protocol.paths, "path"))
    ]
    times = protocol.blocks * protocol.repetitions
    practised = protocol.practice_trials * len(protocol.devices)
    practice = f" and {practised} of practice" if practised else ""
    factors = " × ".join(counts + ([str(times)] if times > 1 else []))
    return f"{factors} = {counted(len(plan), 'trial')}{practice}, about {_minutes(protocol, plan)} min"


def counted(number: int, name: str) -> str:
    """ "1 trial", "2 trials"."""
    return f"{number} {name}" if number == 1 else f"{number} {name}s"


def _minutes(protocol: Protocol, plan: tuple[PlannedTrial, ...]) -> int:
    return math.ceil(estimated_s(protocol, plan) / 60.0)


def estimated_s(protocol: Protocol, plan: tuple[PlannedTrial, ...]) -> float:
    """How long a session takes (s): trials, practice and re-rigs at the assumed pace, breaks at their least."""
    configurations = len(protocol.devices)
    each = len(plan) // configurations
    breaks = sum(break_after(protocol, done, each - done) for done in range(1, each)) * configurations
    trials = len(plan) + configurations * protocol.practice_trials
    rest_s = protocol.breaks.least_s if protocol.breaks else 0.0
    return trials * TRIAL_S + breaks * rest_s + (configurations - 1) * RERIG_S


def _head(protocol: Protocol, participant: str, plan: tuple[PlannedTrial, ...]) -> str:
    assumed = f"assumed: {TRIAL_S:g} s a trial"
    if len(protocol.devices) > 1:
        assumed += f", {RERIG_S / 60:g} min a re-rig"
    practised = protocol.practice_trials * len(protocol.devices)
    practice = f" and {practised} of practice" if practised else ""
    lines = [
        f"{protocol.name} protocol, participant {participant}: {len(plan)} trials{practice}, "
        f"about {_minutes(protocol, plan)} min ({assumed})",
        "",
        *_named("participants", [", ".join(protocol.participants) or "anybody"]),
        *_named("devices", [f"{d.name}{' (assumed)' if d.assumed else ''}" for d in protocol.devices]),
        *_named("paths", [f"{number}  {path_text(path)}" for number, path in protocol.paths.items()]),
        *_named("controllers", [f"{number}  {controller_text(one)}" for number, one in protocol.controllers.items()]),
        *_named("blocks", [_blocks(protocol)]),
        *_named("breaks", [_breaks(protocol)]),
        *_named("rules", [protocol.rules]),
        *_named("seed", [f"{protocol.seed}, plan {plan_hash(plan)[:16]}"]),
        *_named("participant sees", [_seen(protocol)]),
        *_named("experimenter", ["sees codes, K1 to K" + f"{len(protocol.controllers)}"] if protocol.blind else []),
        *_named("questionnaire", ["after each block"] if protocol.questionnaire else []),
    ]
    if protocol.paths_assumed:
        lines.append("\nThe paths are assumed.")
    if len(protocol.controllers) == 1 and len(plan) > 1:
        lines.append("\nThere is only one controller, so it comes again in every trial.")
    return "\n".join(lines)


def _named(name: str, values: list[str]) -> list[str]:
    return [f"{name if i == 0 else '':18}{value}" for i, value in enumerate(values)]


def _blocks(protocol: Protocol) -> str:
    times = "once" if protocol.repetitions == 1 else f"{protocol.repetitions} times"
    return f"{protocol.blocks} for each device, each controller on each path {times} in each"


def _breaks(protocol: Protocol) -> str:
    if protocol.breaks is None:
        return "none"
    return f"after each {protocol.breaks.after_trials} trials of a device, at least {protocol.breaks.least_s:g} s"


def _seen(protocol: Protocol) -> str:
    linkage = "the linkage" if protocol.show_linkage else "no linkage"
    feedback = "no feedback" if protocol.feedback == "none" else f"the {protocol.feedback} after each trial"
    cues = protocol.cues
    paced = f'"slower" under {cues.too_fast_s:g} s, "faster" over {cues.too_slow_s:g} s' if cues else "no cues"
    return f"{linkage}, {feedback}, {paced}"


def path_text(path: PathFile) -> str:
    """A path in a few words."""
    length = build_path(path, "path").length
    if isinstance(path, Arc):
        turn = f"{path.from_deg:g} to {path.to_deg:g} deg"
        where = f"arc about {_place(path.centre_m)}, radius {path.radius_m:g} m, {turn}"
    elif isinstance(path, Polyline):
        where = "polyline " + " - ".join(map(_place, path.points_m)) + " m"
    else:
        where = f"segment {_place(path.start_m)} - {_place(path.end_m)} m"
    return f"{where}, {length:.3f} m long"


def _place(point: tuple[float, float]) -> str:
    return f"({point[0]:g}, {point[1]:g})"


def controller_text(preset: Preset) -> str:
    """A controller in a few words."""
    about = [
        f"{one.word} {one.scale * value:g} {one.unit}".rstrip()
        for one, value in zip(ALGORITHMS[preset.kind].parameters, preset.values, strict=True)
        if value != one.default
    ]
    return f"{preset.name} ({', '.join(about)})" if about else preset.name


def _lines(protocol: Protocol, participant: str, trials: list[PlannedTrial], steps: Steps) -> list[str]:
    """The trials of one configuration."""
    width = max(len(protocol.controller_name(trial.controller)) for trial in trials)
    practice = [
        practice_trial(protocol, participant, trials[0].configuration, number)
        for number in range(1, protocol.practice_trials + 1)
    ]
    lines, block = [], None
    for done, trial in enumerate([*practice, *trials], start=1 - len(practice)):
        if trial.block != block:
            block = trial.block
            lines.append(f"  {'practice' if block == PRACTICE_BLOCK else f'block {block}'}")
        run = "" if block == PRACTICE_BLOCK else str(trial.run)
        lines.append(f"  {run:>5}  {protocol.controller_name(trial.controller):{width}}  path {trial.segment}")
        if 0 < done < len(trials):
            lines += [f"  {line}" for line in steps(protocol, trial, trials[done], done, len(trials) - done)]
    return lines
