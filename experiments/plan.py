"""The plan of a participant's session: all its trials, drawn from a seed before the first one, and printed as text.

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
from collections.abc import Sequence
from itertools import groupby, pairwise
from typing import NamedTuple

import msgspec
import numpy as np

from core.control.controllers import Preset
from core.files import InputError
from core.path import BLEND_WIDTH_M, Arc, PathFile, Polyline, build_path
from experiments.protocol import Protocol

PRACTICE_BLOCK = 0
MAX_LABEL = 20  # letters and digits of a participant, as a folder's name has room for
MOST_SHOWN = 8  # points of a polyline in the printed plan
#: A random order is drawn until one fits (3 in 10 of the paper's do); after this many draws it is built.
_MOST_DRAWS = 2000
_PRACTICE = 0x9AC71CE  # sets the draws of practice apart from those of the plan

TRIAL_S = 15.0  # assumed: approach, hold, a move of some seconds, and what lies between two trials
RERIG_S = 300.0  # assumed: taking a brake off or putting one on, and the checks

#: A controller, by its number or code, and the number of a path.
Cell = tuple[int | str, int]


class PlannedTrial(NamedTuple):
    """One trial of the plan. `block` counts within a configuration, `repetition` one cell within it."""

    run: int  # 1.. in the order of the session
    block: int  # 1..blocks; 0: practice, which counts nowhere
    configuration: str  # name of the device
    controller: int | str  # its number in the protocol, as in Table I; in a blind session a code, "K3"
    path: int  # number of the path
    repetition: int  # 1.., of the cell within the configuration


def participant_label(text: str) -> str:
    """The label that was typed, without blanks around it. InputError: as `refuse_no_label`."""
    refuse_no_label(label := text.strip())
    return label


def refuse_no_label(label: str) -> None:
    """InputError unless it is a participant's label, which a folder is named after."""
    if not (label.isascii() and label.isalnum()):
        raise InputError(f"participant {label!r}: must be letters a to z and digits only")
    if len(label) > MAX_LABEL:
        raise InputError(f"participant {label}: must have at most {MAX_LABEL} characters, not {len(label)}")


def participant_index(participant: str) -> int:
    """The participant's number, which decides the order of the configurations: "07" and "p7" give 7.

    Our choice: a label without digits gets a number from its letters, so the order does not depend on chance.
    InputError: as `refuse_no_label`.
    """
    refuse_no_label(participant)
    digits = re.search(r"\d+$", participant) or re.search(r"\d+", participant)
    return int(digits.group()) if digits else zlib.crc32(participant.encode())


def codes(count: int) -> tuple[str, ...]:
    return tuple(f"K{number}" for number in range(1, count + 1))


def _cells(protocol: Protocol, coded: bool | None) -> list[Cell]:
    """Every controller on every path; coded: with codes in place of the controllers (None: as in the protocol)."""
    is_coded = protocol.blind if coded is None else coded
    controllers = codes(len(protocol.controllers)) if is_coded else protocol.controllers
    return [(controller, path) for controller in controllers for path in protocol.paths]


def make_plan(protocol: Protocol, participant: str, coded: bool | None = None) -> tuple[PlannedTrial, ...]:
    """All trials of a participant, in order; the same arguments give the same plan.

    The first participant begins with the first device, the second with the second, .. coded: as in `_cells`.
    """
    index = participant_index(participant)
    generator = np.random.default_rng(np.random.SeedSequence([protocol.seed, index]))
    cells = _cells(protocol, coded) * protocol.repetitions
    names = [device.name for device in protocol.devices]
    first = (index - 1) % len(names)
    trials: list[PlannedTrial] = []
    for configuration in (*names[first:], *names[:first]):
        met: Counter[Cell] = Counter()
        for block in range(1, protocol.blocks + 1):
            last = trials[-1].controller if trials else None
            for cell in _shuffled_block(cells, last, generator):
                met[cell] += 1
                trials.append(PlannedTrial(len(trials) + 1, block, configuration, *cell, met[cell]))
    return tuple(trials)


def practice_trial(
    protocol: Protocol, participant: str, configuration: str, number: int, coded: bool | None = None
) -> PlannedTrial:
    """The practice trial of this number (1..) in a configuration; its run is its number until it is run.

    Our choice: practice goes through all cells, shuffled as a block is, then through all of them again.
    """
    position = [device.name for device in protocol.devices].index(configuration)
    key = [_PRACTICE, protocol.seed, participant_index(participant), position]
    generator = np.random.default_rng(np.random.SeedSequence(key))
    drawn: list[Cell] = []
    while len(drawn) < number:
        drawn += _shuffled_block(_cells(protocol, coded), drawn[-1][0] if drawn else None, generator)
    return PlannedTrial(number, PRACTICE_BLOCK, configuration, *drawn[number - 1], number)


def _shuffled_block(cells: Sequence[Cell], last: int | str | None, generator: np.random.Generator) -> list[Cell]:
    """The cells in one of the allowed orders, all equally likely (nearly so, where few orders fit).

    Allowed: no controller twice running, nor `last`, the one of the trial before the block, at its start.
    """
    for _ in range(_MOST_DRAWS):
        drawn = [cells[i] for i in generator.permutation(len(cells))]
        controllers = [last, *(controller for controller, _ in drawn)]
        if len({*controllers[1:]}) == 1 or all(before != after for before, after in pairwise(controllers)):
            return drawn
    return _built_block(cells, last, generator)


def _built_block(cells: Sequence[Cell], last: int | str | None, generator: np.random.Generator) -> list[Cell]:
    """An allowed order, place by place: a cell at random, among those after which the rest can still be placed."""
    rest, built = [cells[i] for i in generator.permutation(len(cells))], []
    while rest:
        left = len(rest) - 1
        counts = Counter(controller for controller, _ in rest)
        fits = [
            i
            for i, (controller, _) in enumerate(rest)
            if controller != last
            and counts[controller] - 1 <= left // 2
            and all(count <= (left + 1) // 2 for other, count in counts.items() if other != controller)
        ]
        built.append(rest.pop(fits[int(generator.integers(len(fits)))]))
        last = built[-1][0]
    return built


def break_after(protocol: Protocol, done: int, left: int) -> bool:
    """Whether a break comes after `done` trials of a configuration, `left` of which are still to come.

    Our choice: none after the last, where the re-rig is one.
    """
    return protocol.breaks is not None and done > 0 and left > 0 and done % protocol.breaks.after_trials == 0


def plan_to_json(plan: Sequence[PlannedTrial]) -> list[dict]:
    """The plan as plain lists and dictionaries, to be stored in session.json."""
    return [trial._asdict() for trial in plan]


def plan_from_json(trials: Sequence[dict]) -> tuple[PlannedTrial, ...]:
    """The plan that was stored. InputError if a trial lacks a field, has one too many, or one of another type."""
    try:
        return tuple(msgspec.convert(tuple(PlannedTrial(**trial)), PlannedTrial) for trial in trials)
    except (TypeError, msgspec.ValidationError):
        raise InputError(f"plan: each trial needs exactly {', '.join(PlannedTrial._fields)}") from None


def plan_hash(plan: Sequence[PlannedTrial]) -> str:
    """SHA-256 (hex) of the plan's canonical JSON: keys sorted, no spaces, ASCII."""
    canonical = json.dumps(plan_to_json(plan), sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(canonical.encode()).hexdigest()


# ------------------------------------------------------------------------------------------------------ as printed text


def steps_between(protocol: Protocol, before: PlannedTrial, after: PlannedTrial, done: int, left: int) -> list[str]:
    """The lines between a trial and the next one: a re-rig, a break.

    done, left: trials of the first one's configuration.
    """
    if after.configuration != before.configuration:
        return [f"re-rig to {after.configuration}"]
    if protocol.breaks is not None and break_after(protocol, done, left):
        return [f"-- break of at least {protocol.breaks.least_s:g} s --"]
    return []


def print_plan(protocol: Protocol, participant: str) -> str:
    """The protocol's facts, the estimated duration, then every trial."""
    return f"{_head(protocol, participant, make_plan(protocol, participant))}\n\n{print_trials(protocol, participant)}"


def print_trials(protocol: Protocol, participant: str, coded: bool | None = None) -> str:
    """Every trial in order, a line each, with practice and the steps between. coded: as in `_cells`."""
    plan = make_plan(protocol, participant, coded)
    parts, before = list[str](), plan[0]
    for configuration, group in groupby(plan, key=lambda trial: trial.configuration):
        trials = list(group)
        if before.configuration != configuration:
            parts += steps_between(protocol, before, trials[0], len(trials), 0)
        parts.append("\n".join([configuration, *_lines(protocol, participant, trials, coded)]))
        before = trials[-1]
    return "\n\n".join(parts) + "\n"


def _lines(protocol: Protocol, participant: str, trials: list[PlannedTrial], coded: bool | None) -> list[str]:
    """The trials of one configuration, its practice first."""
    width = max(len(protocol.controller_name(trial.controller)) for trial in trials)
    practice = [
        practice_trial(protocol, participant, trials[0].configuration, number, coded)
        for number in range(1, protocol.practice_trials + 1)
    ]
    lines, block = [], None
    for done, trial in enumerate([*practice, *trials], start=1 - len(practice)):
        is_practice = trial.block == PRACTICE_BLOCK
        if trial.block != block:
            block = trial.block
            lines.append("  practice" if is_practice else f"  block {block}")
        run = "" if is_practice else trial.run
        lines.append(f"  {run:>5}  {protocol.controller_name(trial.controller):{width}}  path {trial.path}")
        if 0 < done < len(trials):
            lines += [f"  {line}" for line in steps_between(protocol, trial, trials[done], done, len(trials) - done)]
    return lines


def plan_summary(protocol: Protocol) -> str:
    """The factors of a participant's session, its trials, and about how long it takes."""
    plan = make_plan(protocol, "1")
    parts = {"device": protocol.devices, "controller": protocol.controllers, "path": protocol.paths}
    factors = [counted(len(of), name) for name, of in parts.items()]
    if (times := protocol.blocks * protocol.repetitions) > 1:
        factors.append(str(times))
    return f"{' × '.join(factors)} = {_length(protocol, plan)}"


def counted(number: int, name: str) -> str:
    """ "1 trial", "2 trials"."""
    return f"{grouped(number)} {name}" if number == 1 else f"{grouped(number)} {name}s"


def grouped(number: float) -> str:
    """A number for people: whole from a thousand on, with thin gaps between the thousands."""
    return f"{number:,.0f}".replace(",", "\u202f") if abs(number) >= 1e3 else f"{number:g}"


def time_left_s(
    protocol: Protocol, plan: Sequence[PlannedTrial], waiting: Sequence[PlannedTrial], trial_s: float = TRIAL_S
) -> float:
    """How long the trials that still wait take, at this pace, with practice, shortest breaks and re-rigs."""
    whole, left = (Counter(trial.configuration for trial in trials) for trials in (plan, waiting))
    breaks = sum(
        break_after(protocol, done, whole[device] - done)
        for device in left
        for done in range(whole[device] - left[device] + 1, whole[device])
    )
    practised = protocol.practice_trials * sum(left[device] == whole[device] for device in left)  # those not begun
    rest_s = protocol.breaks.least_s if protocol.breaks else 0.0
    return (len(waiting) + practised) * trial_s + breaks * rest_s + max(len(left) - 1, 0) * RERIG_S


def _length(protocol: Protocol, plan: Sequence[PlannedTrial]) -> str:
    """Trials and duration of a session: everything at the assumed pace."""
    practised = len(protocol.devices) * protocol.practice_trials
    practice = f" and {practised} of practice" if practised else ""
    whole_min = math.ceil(time_left_s(protocol, plan, plan) / 60.0)
    return f"{counted(len(plan), 'trial')}{practice}, about {whole_min} min"


def _head(protocol: Protocol, participant: str, plan: Sequence[PlannedTrial]) -> str:
    rerig = f", {RERIG_S / 60:g} min a re-rig" if len(protocol.devices) > 1 else ""
    times = "once" if protocol.repetitions == 1 else f"{protocol.repetitions} times"
    coded = f"sees codes, K1 to K{len(protocol.controllers)}; the session draws which is which when it begins"
    breaks, pages = protocol.breaks, counted(len(protocol.instruction), "page")
    every = counted(breaks.after_trials, "trial").removeprefix("1 ") if breaks else ""
    facts = {
        "participants": [", ".join(protocol.participants) or "any"],
        "devices": [f"{device.name}{' (assumed)' if device.assumed else ''}" for device in protocol.devices],
        "paths": [f"{n}  {_path_text(path, protocol.drawn.get(n, ''))}" for n, path in protocol.paths.items()],
        "controllers": [f"{number}  {_controller_text(preset)}" for number, preset in protocol.controllers.items()],
        "blocks": [f"{protocol.blocks} for each device, each controller on each path {times} in each"],
        "breaks": [f"after every {every} of a device, at least {breaks.least_s:g} s" if breaks else "none"],
        "rules": [protocol.rules],
        "seed": [f"{protocol.seed}, plan {plan_hash(plan)[:16]}"],
        "participant sees": [_seen(protocol)],
        "experimenter": [coded] if protocol.blind else [],
        "measures": [_file_text(name, protocol.code[name].text) for name in [protocol.measure] if name],
        "instructions": [f"{pages} before the first trial, for a person"] if protocol.instruction else [],
        "questionnaire": [f"after each {protocol.questionnaire.each}, for a person"]
        if protocol.questionnaire.on
        else [],
    }
    lines = [
        f"{protocol.name} protocol, participant {participant}: {_length(protocol, plan)} "
        f"(assumed: {TRIAL_S:g} s a trial{rerig})",
        "",
        *(f"{'' if i else name:18}{value}" for name, values in facts.items() for i, value in enumerate(values)),
    ]
    if protocol.paths_assumed:
        lines.append("\nThe paths are assumed.")
    if len(protocol.controllers) == 1 and len(plan) > 1:
        lines.append("\nThere is only one controller, so it comes again in every trial.")
    return "\n".join(lines)


def _seen(protocol: Protocol) -> str:
    linkage = "the linkage" if protocol.show_linkage else "no linkage"
    trace = "the trace" if protocol.show_trace else "no trace"
    feedback = "no feedback" if protocol.feedback == "none" else f"the {protocol.feedback} after each trial"
    cues = protocol.cues
    paced = f'"slower" under {cues.too_fast_s:g} s, "faster" over {cues.too_slow_s:g} s' if cues else "no cues"
    return f"{linkage}, {trace}, {feedback}, {paced}"


def _path_text(path: PathFile, drawn: str) -> str:
    """A path in a line; drawn: how its drawing was read, "" where it is none."""

    def place(point: tuple[float, float]) -> str:
        return f"({point[0]:g}, {point[1]:g})"

    if drawn:
        where = drawn
    elif isinstance(path, Arc):
        turn = f"{path.from_deg:g} to {path.to_deg:g} deg"
        where = f"arc about {place(path.centre_m)}, radius {path.radius_m:g} m, {turn}"
    elif isinstance(path, Polyline):
        few = len(path.points_m) <= MOST_SHOWN
        points = " - ".join(map(place, path.points_m)) + " m" if few else f"of {len(path.points_m)} points"
        where = f"polyline {points}"
    else:
        where = f"segment {place(path.start_m)} - {place(path.end_m)} m"
    built = build_path(path, "path")
    blended = "" if built.blend_width == BLEND_WIDTH_M else f", blend width {1e3 * built.blend_width:.3g} mm"
    return f"{where}, {built.length:.3f} m long{blended}"


def _controller_text(preset: Preset) -> str:
    about = [
        f"{parameter.word} {grouped(parameter.scale * value)} {parameter.unit}".rstrip()
        for parameter, value in zip(preset.algorithm.parameters, preset.values, strict=True)
        if preset.own or value != parameter.default
    ]
    about += [_file_text(preset.kind, preset.own.text)] if preset.own else []
    return f"{preset.name} ({', '.join(about)})" if about else preset.name


def _file_text(name: str, text: str) -> str:
    return f"{name}, sha256 {hashlib.sha256(text.encode()).hexdigest()[:12]}"
