"""A participant's plan as text, to be read before anyone sits down."""

import math

from core.control.controllers import PROPORTIONAL, SDOF, Preset
from core.path_file import Arc, PathFile, Polyline, build_path
from experiments.plan import PRACTICE_BLOCK, PlannedTrial, break_after, make_plan, plan_hash, practice_trial
from experiments.protocol import Protocol

TRIAL_S = 15.0  # assumed: approach, hold, a move of some seconds, and what lies between two trials
RERIG_S = 300.0  # assumed: taking a brake off or putting one on, and the checks


def print_plan(protocol: Protocol, participant: str) -> str:
    """The protocol's facts, the estimated duration, then every trial in order with practice, breaks and re-rigs."""
    plan = make_plan(protocol, participant)
    parts = [_head(protocol, participant, plan)]
    place = 0
    for configuration in dict.fromkeys(trial.configuration for trial in plan):
        if place:
            parts.append(f"re-rig to {configuration}")
        trials = [trial for trial in plan if trial.configuration == configuration]
        parts.append("\n".join([configuration, *_lines(protocol, participant, trials)]))
        place += len(trials)
    return "\n\n".join(parts) + "\n"


def estimated_s(protocol: Protocol, plan: tuple[PlannedTrial, ...]) -> float:
    """How long a session takes (s): trials, practice and re-rigs at the assumed pace, breaks at their least."""
    configurations = len(protocol.devices)
    each = len(plan) // configurations
    breaks = sum(break_after(protocol, done, each - done) for done in range(1, each)) * configurations
    trials = len(plan) + configurations * protocol.practice_trials
    rest_s = protocol.breaks.least_s if protocol.breaks else 0.0
    return trials * TRIAL_S + breaks * rest_s + (configurations - 1) * RERIG_S


def _head(protocol: Protocol, participant: str, plan: tuple[PlannedTrial, ...]) -> str:
    minutes = math.ceil(estimated_s(protocol, plan) / 60.0)
    assumed = f"assumed: {TRIAL_S:g} s a trial"
    if len(protocol.devices) > 1:
        assumed += f", {RERIG_S / 60:g} min a re-rig"
    practised = protocol.practice_trials * len(protocol.devices)
    practice = f" and {practised} of practice" if practised else ""
    lines = [
        f"{protocol.name} protocol, participant {participant}: {len(plan)} trials{practice}, about {minutes} min "
        f"({assumed})",
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
    told = f'"slower" under {cues.too_fast_s:g} s, "faster" over {cues.too_slow_s:g} s' if cues else "no cues"
    return f"{linkage}, {feedback}, {told}"


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
    about = []
    if preset.algorithm in (SDOF, PROPORTIONAL) and preset.gap_m:
        about.append(f"gap {1e3 * preset.gap_m:g} mm")
    if preset.algorithm == PROPORTIONAL:
        about.append(f"gain {preset.gain:g} N s/m")
    return f"{preset.name} ({', '.join(about)})" if about else preset.name


def _lines(protocol: Protocol, participant: str, trials: list[PlannedTrial]) -> list[str]:
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
        if block != PRACTICE_BLOCK and break_after(protocol, done, len(trials) - done):
            assert protocol.breaks is not None
            lines.append(f"  -- break of at least {protocol.breaks.least_s:g} s --")
    return lines
