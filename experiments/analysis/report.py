"""What a study leaves to read: findings.csv, statistics.csv, participant_means.csv and report.md.

Plain sentences and tables; the same rows and note give the same bytes.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from core.control.controllers import Preset
from core.files import InputError
from experiments.analysis.findings import (
    CONTROLLER,
    HOLDS,
    BoxFinding,
    Finding,
    box_findings_of,
    description_only,
    findings,
    why_no_findings,
)
from experiments.analysis.metrics import BY_NAME, DRAWN, FIGURES
from experiments.analysis.sensitivity import sensitivity, swapped
from experiments.analysis.statistics import (
    MEASURES,
    POOLED,
    Result,
    configurations_of,
    finished_share,
    least_p_holm,
    people_of,
    scores,
    statistics,
    too_few,
)
from experiments.analysis.trials_table import COUNTED, TrialRow, by_controller, csv_bytes, to_compare
from experiments.numbers import fixed, percent, significant
from experiments.recording.atomic_files import write_new_files

#: The measures that the report leads with, those of the figures.
SHOWN = tuple(metric.name for metric in DRAWN)
AGAINST_NONE = "## Against no control"
SIMULATED = "The operators are simulated: read it as what this model says, not as people."
READ = (
    "By boxes, as the paper judges: all trials of everyone in one box for each controller and device; medians (and "
    "quartiles), lower by at least 15 % of the uncontrolled median, little changed within 15 %, similar within 30 %, "
    "on every device (docs/judging.md). Within each participant: a difference is taken within each, then stands the "
    "mean participant's, in brackets its 95 % interval (Student's t, which takes the differences as normal; fewer "
    "participants only widen it, one alone has none and decides nothing). Similar or negligible: within a band of 15 % "
    "of the uncontrolled median. It holds only if every device and every measure of one thing says so; where they "
    "disagree, the interval is too wide, or under 90 % of the trials reached the end, one cannot tell."
)
SUBSTEPS, ASIDE_M = 10, 1e-6
STEP, HAND = "step of a tenth", "hand 1 um aside"
READ_ERRORS = (
    "Trials of one simulated operator's first block again, from the same start, with the same operator and noise, and "
    "one thing changed; the controller decides once a millisecond as before. Absolute change of a measure: median / "
    f"largest (the largest share of the measure itself). *{STEP}*: the error of the integration. *{HAND}*: how sure a "
    "single trial can be at all, an encoder's step being 20 um; where it moves a trial about as far as the step does, "
    "brakes that switch at 1 kHz carry any difference on, and no finer step settles it. The brakes' row: what lag and "
    "backlash are worth. Every measure: simulation_errors.csv."
)


class Moved(NamedTuple):
    """How far one measure of one controller's trials moves by one change, in the measure's unit."""

    controller: int
    change: str
    measure: str
    trials: int
    median: float
    worst: float
    worst_share: float | None  # of the measure itself; None where that is zero


def write_report(
    rows: Sequence[TrialRow],
    out_folder: str | Path,
    note: str,
    controllers: Mapping[int, Preset],
    simulated: bool,
    timeouts: bool = False,
    moved: Sequence[Moved] = (),
    recordings: Path | None = None,
) -> list[str]:
    """Write the files into `out_folder`; the warnings. note: what was used, as on the figures.

    recordings: where the recordings of the rows are named from, for further definitions of smoothness.
    controllers: those of the protocol; the paper's statements are tested on Table I's alone. Of coded rows only the
    means are written: each blind session has a key of its own, so codes cannot be compared.
    simulated: operators, not people, moved the handle. timeouts: trials whose time was up count in the statistics.
    moved: how far the measures move when the trials of a sample are simulated otherwise.
    InputError before anything is written if one exists already or no trial counts.
    """
    folder = Path(out_folder)
    if not any(row.status in COUNTED for row in rows):
        raise InputError(f"{folder}: no trial was done or timed out, there is nothing to report")
    coded = any(isinstance(row.controller, str) for row in rows)
    refusal = why_no_findings(controllers, coded)
    names = {k: one.name for k, one in controllers.items()} if refusal else CONTROLLER
    none = next((k for k, one in controllers.items() if one.kind == "none"), 0)
    found = [] if refusal else findings(rows, timeouts)
    by_boxes = [] if refusal else box_findings_of(rows, timeouts)
    parts = ["# Report", f"{note[:1].upper()}{note[1:].rstrip('.')}. {_trials(rows, names, timeouts)}"]
    warned = warnings(rows, found, simulated)
    parts += [f"**{warning}**" for warning in warned]
    parts.append("## The paper's findings")
    parts += [refusal] if refusal else [_findings_table(found, by_boxes), READ]
    files = {"participant_means.csv": _means_csv(to_compare(rows, timeouts))}
    if not coded:
        results = [*statistics(rows, timeouts), *sensitivity(rows, recordings, timeouts, none)]
        files |= {"findings.csv": _findings_csv(found, by_boxes)} if found else {}
        files["statistics.csv"] = _csv(Result._fields, results)
        bar = [error_sentence(moved)] if moved else []
        for table in (
            _against_none(results, names, none),
            _roughness(results, names),
            _locks_and_releases(rows, names),
        ):
            parts += [*table, *bar] if table else []
        if moved:
            parts += ["## How sure these numbers are", error_table(moved, names), READ_ERRORS]
            files["simulation_errors.csv"] = _csv(Moved._fields, moved)
        parts.append("## What else to know")
        parts.append("\n".join(f"- {sentence}" for sentence in sentences(results, names)))
    files["report.md"] = ("\n\n".join(parts) + "\n").encode()
    write_new_files({folder / name: content for name, content in files.items()})
    return warned


def _csv(header: Sequence[str], lines: Iterable[Sequence[object]]) -> bytes:
    """Lines of cells; a number to nine digits, an empty cell for None."""
    return csv_bytes(
        [header, *([f"{cell:.9g}" if isinstance(cell, float) else cell for cell in line] for line in lines)]
    )


def _findings_csv(found: Sequence[Finding], by_boxes: Sequence[BoxFinding]) -> bytes:
    """One line a statement: its number, words, verdict, every number behind it, and the deciding ones in a sentence;
    then the verdict by boxes, its margin (in uncontrolled medians) and its sentence.
    """
    words = {True: "yes", False: "no", None: "unclear"}
    lines = []
    for one, box in zip(found, by_boxes, strict=True):
        numbers = "; ".join(
            f"{c.what}: {c.numbers}{f', n = {c.found.people}' if c.found else ''}: {words[c.answer]}"
            for c in one.comparisons
        )
        of_box = box.verdict, None if math.isnan(box.margin) else box.margin, box.sentence
        lines.append((one.statement.number, one.statement.text, one.verdict, numbers, one.sentence, *of_box))
    header = ("number", "statement", "verdict", "numbers", "sentence", "by_boxes", "margin_by_boxes", "why_by_boxes")
    return _csv(header, lines)


def _means_csv(rows: Sequence[TrialRow]) -> bytes:
    """One line a participant, configuration and controller: the means that the tests are made of."""
    tables = [scores(rows, measure) for measure in MEASURES]
    cells = [
        (person, configuration, controller)
        for person in people_of(rows)
        for configuration in configurations_of(rows)
        for controller in sorted({row.controller for row in rows}, key=by_controller)
    ]
    lines = [(*cell, *(t.get(cell) for t in tables)) for cell in cells if any(cell in t for t in tables)]
    return _csv(("participant", "configuration", "controller", *MEASURES), lines)


def warnings(rows: Sequence[TrialRow], found: Sequence[Finding], simulated: bool) -> list[str]:
    """What a reader must know before the findings: that the people are too few, or that they are simulated."""
    few = (description_only(found) if found else "") or too_few(len(people_of(rows)))
    return ([few] if few else []) + ([SIMULATED] if simulated else [])


def _trials(rows: Sequence[TrialRow], names: Mapping[int, str], timeouts: bool) -> str:
    people, counted = len(people_of(rows)), sum(row.status in COUNTED for row in rows)
    late = sum(row.status == "timeout" for row in rows)
    text = f"{people} participant{'s' if people != 1 else ''}, {counted} trials that count"
    if len(rows) > counted:
        text += f", {len(rows) - counted} that do not (aborted, stopped, redone, recovered, skipped or excluded)"
    aborted = any(row.status == "aborted" for row in rows)
    if not late and not aborted:
        return text + "; all reached the end."
    text += f"; {late} of them ran out of time and {'count in' if timeouts else 'are left out of'} the statistics."
    if any(isinstance(row.controller, str) for row in rows):
        return text
    worst = sorted((share, cell) for cell, share in finished_share(rows).items() if share < 1.0)
    listed = ", ".join(f"{_name(k, names)} on {device} {percent(share)}" for share, (device, k) in worst)
    return f"{text} Reached the end{' (aborted: not)' if aborted else ''}: {listed}; all others 100 %."


def _name(controller: int | str, names: Mapping[int, str]) -> str:
    return names.get(int(controller), f"controller {controller}")


def _number(result: Result, scale: float, digits: int) -> str:
    """A number with its sign and, if it has one, its interval."""
    text = fixed(scale * (result.value or 0.0), digits, "+")
    if result.low is None or result.high is None:
        return text
    low, high = sorted((scale * result.low, scale * result.high))
    return f"{text} ({fixed(low, digits, '+')} to {fixed(high, digits, '+')})"


def _findings_table(found: Sequence[Finding], by_boxes: Sequence[BoxFinding]) -> str:
    table = ["| | the paper says | by boxes | why | within each participant | why |", "|---" * 6 + "|"]
    for one, box in zip(found, by_boxes, strict=True):
        judged = f"**{box.verdict}** | {box.sentence} | **{one.verdict}** | {one.sentence}"
        table.append(f"| {one.statement.number} | {one.statement.text} | {judged} |")
    return "\n".join(table)


def _against_none(results: Sequence[Result], names: Mapping[int, str], none: int) -> list[str]:
    """Table of each controller's change against the uncontrolled one, by device, and how to read it."""
    chosen: dict[tuple[str, str, str], Result] = {}
    for r in results:
        if r.statistic == "hodges_lehmann" and r.configuration != POOLED and f"{none}" in (r.first, r.second):
            chosen[r.configuration, r.second if r.first == f"{none}" else r.first, r.measure] = r
    if not chosen:
        return [AGAINST_NONE, "No participant tried a controller and no control on the same device."]
    heads = [f"{metric.title.lower()} ({metric.shown_unit})" for metric in DRAWN]
    lines = [f"| device | controller | {' | '.join(heads)} |", "|---" * (2 + len(heads)) + "|"]
    for configuration, controller in dict.fromkeys(key[:2] for key in chosen):
        cells = []
        for metric in DRAWN:
            pair = chosen.get((configuration, controller, metric.name))
            star = "*" if pair and pair.p_holm is not None and pair.p_holm < 0.05 else ""
            scale = -metric.scale if pair and pair.first == f"{none}" else metric.scale  # controller minus none
            cells.append(_number(pair, scale, metric.decimals) + star if pair else "")
        lines.append(f"| {configuration} | {_name(controller, names)} | {' | '.join(cells)} |")
    few = any(r.p_holm is None for r in chosen.values())
    how = "Change of the participants' means (Hodges-Lehmann"
    how += ")." if few else ", 95 % interval). *: Wilcoxon p < 0.05 after Holm's correction for all pairs."
    return [AGAINST_NONE, "\n".join(lines), how, *_out_of_reach(results, {key[0] for key in chosen})]


def _roughness(results: Sequence[Result], names: Mapping[int, str]) -> list[str]:
    """Table of how rough each controller is beside no control, by each definition of smoothness."""
    found = {(r.configuration, r.measure, r.first): r.value or 0.0 for r in results if r.test == "roughness"}
    if not found:
        return []
    controllers = list(dict.fromkeys(key[2] for key in found))
    lines = [f"| device | by | {' | '.join(_name(k, names) for k in controllers)} |"]
    lines.append("|---" * (2 + len(controllers)) + "|")
    for device, measure in dict.fromkeys(key[:2] for key in found):
        cells = [f"{found[cell]:.2f}" if (cell := (device, measure, k)) in found else "" for k in controllers]
        lines.append(f"| {device} | {measure} | {' | '.join(cells)} |")
    how = (
        "Median of the trials over that of no control. `acceleration_dft_sum`, the paper's as we read it, takes the "
        "acceleration from positions under a low-pass of 20 Hz; `acceleration_exact_dft_sum` from the simulator: it "
        "sees vibration up to 100 Hz. `phd analyze` adds other weights, filters and ranges from the recordings."
    )
    return ["## How rough, by what is looked at", "\n".join(lines), how]


def _locks_and_releases(rows: Sequence[TrialRow], names: Mapping[int, str]) -> list[str]:
    """Table of how often the rules lock or release because no brake is right, by device and controller."""
    shares: dict[tuple[str, int | str], list[tuple[float, float]]] = {}
    for row in rows:
        if row.status in COUNTED and row.locked_share is not None and row.released_share is not None:
            shares.setdefault((row.configuration, row.controller), []).append((row.locked_share, row.released_share))
    if not shares:
        return []
    lines = ["| device | controller | locked (% of ticks) | released (%) | trials with a lock |", "|---" * 5 + "|"]
    for (device, controller), found in sorted(shares.items()):
        locked, released = (100.0 * sum(values) / len(found) for values in zip(*found, strict=True))
        with_lock = sum(one > 0.0 for one, _ in found)
        lines.append(
            f"| {device} | {_name(controller, names)} | {locked:.2f} | {released:.2f} | {with_lock} of {len(found)} |"
        )
    how = (
        "Mean share of the ticks. Locked: full current on all brakes, because no brake was valid or selected and the "
        "hand pushed away, or because it moved back. Released: no current, because no brake was valid or selected."
    )
    return ["## Locks and releases", "\n".join(lines), how]


def _out_of_reach(results: Sequence[Result], configurations: set[str]) -> list[str]:
    """Where too few people for it can get a star in the table, a sentence for each number of people and pairs."""
    families: dict[tuple[str, str], list[Result]] = {}
    for r in results:
        if r.p_holm is not None and r.measure in SHOWN and r.configuration in configurations:
            families.setdefault((r.configuration, r.measure), []).append(r)
    where: dict[str, list[str]] = {}
    for (configuration, _), pairs in families.items():
        if (least := least_p_holm(pairs)) >= 0.05:
            people = max(pair.people for pair in pairs)
            why = (
                f"no *, however they differ: the smallest p of Wilcoxon's test with {people} participants is "
                f"{significant(2.0 * 0.5**people)}, after Holm's correction for {len(pairs)} pairs "
                f"{significant(least, 2)}"
            )
            where.setdefault(why, []).append(configuration)
    return [f"On {' and '.join(dict.fromkeys(devices))} {why}." for why, devices in where.items()]


def sentences(results: Sequence[Result], names: Mapping[int, str] = CONTROLLER) -> list[str]:
    """Differences, trend, speed and the order of controllers, each in a sentence or two."""
    written = [
        *_differ(results),
        *_trend(results),
        *_speed(results, names),
        *_order(results, names),
        *_reaction(results),
    ]
    return written or ["There is nothing to compare."]


def _differ(results: Sequence[Result]) -> Iterable[str]:
    for metric in DRAWN:
        chances = {
            r.configuration: r.p
            for r in results
            if r.measure == metric.name and r.statistic == "chi_square" and r.p is not None
        }
        if chances:
            listed = ", ".join(
                f"{where} {'p < 0.001' if p < 0.001 else f'p = {p:.3f}'}" for where, p in chances.items()
            )
            differs = "differs" if all(p < 0.05 for p in chances.values()) else "does not everywhere differ"
            yield f"{metric.title} {differs} between controllers (Friedman: {listed})."


def _trend(results: Sequence[Result]) -> Iterable[str]:
    found = {r.measure: r for r in results if r.test == "trend"}
    shown = [found[measure] for measure in (*SHOWN, "duration_s") if measure in found]
    if shown:
        changes = [_number(r, 1.0, 1).partition(" ") for r in shown]
        listed = "; ".join(
            f"{BY_NAME[r.measure].title.lower()} {value} %{space}{interval}"
            for r, (value, space, interval) in zip(shown, changes, strict=True)
        )
        yield f"Over ten trials, in the same task, the median participant changed (learning or fatigue): {listed}."


def _speed(results: Sequence[Result], names: Mapping[int, str]) -> Iterable[str]:
    speed = [r for r in results if r.test == "speed" and r.value is not None]
    for r in speed:
        if r.statistic == "m_per_doubling":
            value, space, interval = _number(r, 1e3, 2).partition(" ")
            if r.low is None or r.high is None:
                judged = "too few people to judge"
            elif r.low <= 0.0 <= r.high:
                judged = "no clear effect of speed"
            else:
                judged = "slow trials do look accurate" if r.low > 0.0 else "fast trials are the more accurate ones"
            yield f"Twice the speed, same person and task: path error {value} mm{space}{interval}; {judged}."
    for configuration in dict.fromkeys(r.configuration for r in speed if r.configuration != "all"):
        raw, adjusted = (
            {
                r.first: r.value
                for r in speed
                if (r.configuration, r.statistic) == (configuration, statistic) and r.value is not None
            }
            for statistic in ("mean_error", "error_at_common_speed")
        )
        listed = ", ".join(f"{_name(k, names)} {1e3 * raw[k]:.2f} -> {1e3 * adjusted[k]:.2f}" for k in raw)
        same = sorted(raw, key=raw.__getitem__) == sorted(adjusted, key=adjusted.__getitem__)
        kept = "the order of controllers stays" if same else "the order of controllers changes"
        yield f"Path error at equal speed, {configuration} (mm, measured -> adjusted): {listed}; {kept}."


def _order(results: Sequence[Result], names: Mapping[int, str]) -> Iterable[str]:
    orders = [r for r in results if r.test == "order"]
    for base in [r for r in orders if r.measure == r.second]:
        others = [r for r in orders if (r.second, r.configuration) == (base.measure, base.configuration)][1:]
        changed = []
        for other in others:
            pairs = swapped(base.first, other.first)
            if pairs:
                named = (f"{_name(a, names)} and {_name(b, names)}" for a, b in pairs)
                changed.append(f"{other.measure} swaps {', '.join(named)}")
        order = " < ".join(_name(k, names) for k in base.first.split(" < "))
        text = f"Order of controllers by {base.measure}, {base.configuration}, least first: {order}"
        if others:
            text += f"; {'; '.join(changed)}" if changed else f"; the same by {', '.join(r.measure for r in others)}"
        yield text + "."


def _reaction(results: Sequence[Result]) -> Iterable[str]:
    found = {(r.configuration, r.measure): r.value for r in results if r.test == "reaction" and r.value is not None}
    for configuration in dict.fromkeys(device for device, _ in found):
        changed = {measure: value - 1.0 for (device, measure), value in found.items() if device == configuration}
        share = -changed.pop("duration_s")
        listed = ", ".join(f"{BY_NAME[measure].short} {100.0 * by:+.0f} %" for measure, by in changed.items())
        yield (
            f"On {configuration} {100.0 * share:.0f} % of the movement pass before the tip has moved 1 mm (median "
            f"trial); every measure holds this reaction time. Without it: {listed}."
        )


def side_by_side(choices: Mapping[str, Sequence[TrialRow]]) -> str:
    """Markdown: the verdicts of several studies (at least one) in columns, within each participant and by boxes, then
    why those that do not hold within each participant do not.
    """
    found = {label: findings(rows) for label, rows in choices.items()}
    by_boxes = {label: box_findings_of(rows) for label, rows in choices.items()}
    columns = [*found, *(f"{label}, by boxes" for label in found)]
    lines = [f"| | the paper says | {' | '.join(columns)} |", "|---" * (2 + len(columns)) + "|"]
    for of_all in zip(*found.values(), *by_boxes.values(), strict=True):
        statement = of_all[0].statement
        lines.append(f"| {statement.number} | {statement.text} | {' | '.join(one.verdict for one in of_all)} |")
    parts = ["\n".join(lines)]
    for label, of_it in found.items():
        why = [f"- {refusal}" for refusal in [description_only(of_it)] if refusal]
        why += [f"- {f.statement.number}, {f.verdict}: {f.sentence}" for f in of_it if f.verdict != HOLDS]
        if why:
            parts += [f"**{label}**", "\n".join(why)]
    return "\n\n".join(parts) + "\n"


def error_table(moved: Sequence[Moved], names: Mapping[int, str]) -> str:
    """A line for each controller and change, with the measures of the figures, as Markdown."""
    of = {(one.controller, one.change, one.measure): one for one in moved}
    heads = [f"{metric.short} ({metric.shown_unit})" for metric in FIGURES]
    lines = [f"| controller | changed | {' | '.join(heads)} |", "|---" * (2 + len(heads)) + "|"]
    for controller, change in dict.fromkeys(cell[:2] for cell in of):
        cells = []
        for metric in FIGURES:
            one = of.get((controller, change, metric.name))
            share = f" ({significant(100.0 * one.worst_share, 2)} %)" if one and one.worst_share is not None else ""
            median, worst = (
                (significant(metric.scale * of_it, 1) for of_it in (one.median, one.worst)) if one else ("", "")
            )
            cells.append(f"{median} / {worst}{share}" if one else "")
        name = names.get(controller, f"controller {controller}")
        lines.append(f"| {name} | {change} | {' | '.join(cells)} |")
    return "\n".join(lines)


def error_sentence(moved: Sequence[Moved]) -> str:
    """The error bar of a table: what a tenth of the step does at most, to a median and to a single trial."""
    parts = []
    for metric in DRAWN:
        of_step = [one for one in moved if one.change == STEP and one.measure == metric.name]
        if of_step:
            median, worst = (
                metric.scale * max(of_it) for of_it in zip(*((m.median, m.worst) for m in of_step), strict=True)
            )
            parts.append(f"{metric.short} {significant(median, 1)} ({significant(worst, 1)}) {metric.shown_unit}")
    if not parts:
        return ""
    trials = sum(one.trials for one in moved if one.change == STEP and one.measure == DRAWN[0].name)
    return (
        f"Error bar of the simulation, in a sample of {trials} trials, worst controller, median (single) trial: "
        f"{', '.join(parts)}."
    )
