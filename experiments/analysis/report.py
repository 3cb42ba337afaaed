"""What a study leaves to read: findings.csv, statistics.csv, participant_means.csv and report.md.

The page is `report_template.md` with tables and sentences filled in; the same rows and note give the same bytes.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from string import Template
from typing import NamedTuple

from core.files import InputError
from experiments.analysis.findings import CHANCE, CONTROLLER, HOLDS, Finding, box_findings_of, findings, why_no_findings
from experiments.analysis.metrics import BY_NAME, DRAWN, FIGURES, JUDGED, Metric
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
from experiments.analysis.trials_table import (
    COUNTED,
    StudyData,
    TrialRow,
    by_controller,
    csv_bytes,
    own_columns,
    to_compare,
    without_value,
)
from experiments.numbers import fixed, percent, significant
from experiments.recording.atomic_files import write_new_files

TEMPLATE = Path(__file__).with_name("report_template.md")
#: The measures that the report leads with: those of the figures, and what judges the statements.
SHOWN = tuple(metric.name for metric in JUDGED)
SIMULATED = "The operators are simulated: read it as what this model says, not as people."
STEP, HAND = "step of a tenth", "hand 1 um aside"


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
    data: StudyData,
    out_folder: str | Path,
    timeouts: bool = False,
    moved: Sequence[Moved] = (),
    recordings: Path | None = None,
) -> list[str]:
    """Write the files into `out_folder`; the warnings.

    The paper's statements are tested on Table I's controllers alone. Of coded rows only the means are written: each
    blind session has a key of its own, so codes cannot be compared.
    timeouts: trials whose time was up count in the statistics.
    recordings: where the recordings of the rows are named from, for further definitions of smoothness.
    moved: how far the measures move when the trials of a sample are simulated otherwise.
    InputError before anything is written if one exists already or no trial counts.
    """
    folder, rows, controllers = Path(out_folder), data.rows, data.controllers
    if not any(row.status in COUNTED for row in rows):
        raise InputError(f"{folder}: no trial was done or timed out, there is nothing to report")
    coded = any(isinstance(row.controller, str) for row in rows)
    refusal = why_no_findings(controllers, coded)
    names = {k: preset.name for k, preset in controllers.items()} if refusal else CONTROLLER
    none = next((k for k, preset in controllers.items() if preset.kind == "none"), None)
    found = [] if refusal else findings(rows, timeouts)
    by_boxes = [] if refusal else box_findings_of(rows, timeouts)
    warned = [*warnings(rows, found, data.simulated), *without_value(rows, data.own)]
    parts = {
        "note": f"{data.note[:1].upper()}{data.note[1:].rstrip('.')}",
        "trials": _trials(rows, names, timeouts),
        "warnings": "\n\n".join(f"**{warning}**" for warning in warned),
        "coded": refusal if coded else "",
        "findings": _findings_table(found, by_boxes),
    }
    files = {"participant_means.csv": _means_csv(to_compare(rows, timeouts))}
    if not coded:
        results = [*statistics(rows, timeouts), *sensitivity(rows, recordings, timeouts, none or 0)]
        files["statistics.csv"] = _csv(Result._fields, results)
        if refusal:
            parts["contrasts"], parts["contrasts_how"] = _contrasts(results, names, data.own)
        if none is not None:
            changes = _against_none(results, names, none, data.own)
            parts["against_none"], parts["against_none_how"] = changes
        parts["roughness"], parts["locks"] = _roughness(results, names), _locks_and_releases(rows, names)
        parts["sentences"] = "\n".join(f"- {sentence}" for sentence in sentences(results, names, data.own))
    if found:
        files["findings.csv"] = _findings_csv(found, by_boxes)
    if moved and not coded:
        parts |= {"errors": error_table(moved, names), "error_bar": error_sentence(moved), "step": STEP, "hand": HAND}
        files["simulation_errors.csv"] = _csv(Moved._fields, moved)
    files["report.md"] = page(parts).encode()
    write_new_files({folder / name: content for name, content in files.items()})
    return warned


def page(parts: Mapping[str, str], template: Path = TEMPLATE) -> str:
    """A template filled in, without the sections whose first part is missing or empty; lines are not broken."""
    sections = []
    for section in re.split(r"\n(?=## )", template.read_text(encoding="utf-8")):
        wanted = Template(section).get_identifiers()
        if parts.get(wanted[0]):
            unbroken = re.sub(r"(?<=[^\n])\n(?=[^\n#])", " ", section)
            sections.append(Template(unbroken).substitute({name: parts.get(name, "") for name in wanted}).strip())
    return re.sub(r"\n{3,}", "\n\n", "\n\n".join(sections)) + "\n"


def _csv(header: Sequence[str], lines: Iterable[Sequence[object]]) -> bytes:
    """Lines of cells; a number to nine digits, an empty cell for None."""
    return csv_bytes(
        [header, *([f"{cell:.9g}" if isinstance(cell, float) else cell for cell in line] for line in lines)]
    )


def _table(head: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    """A table in Markdown; nothing without lines."""
    rows = ["|" + "".join(f" {cell} |" if cell != "" else " |" for cell in line) for line in (head, *lines)]
    return "\n".join([rows[0], "|---" * len(head) + "|", *rows[1:]]) if len(rows) > 1 else ""


def _findings_csv(found: Sequence[Finding], by_boxes: Sequence[Finding]) -> bytes:
    """One line a statement: its number, words, verdict, every number behind it, and the deciding ones in a sentence;
    then the verdict by boxes, its margin (in uncontrolled sizes) and its sentence.
    """
    words = {True: "yes", False: "no", None: "unclear"}
    lines = []
    for finding, box in zip(found, by_boxes, strict=True):
        numbers = "; ".join(
            f"{e.text}{f', n = {e.found.people}' if e.found else ''}: {words[e.answer]}" for e in finding.evidence
        )
        of_box = box.verdict, None if math.isnan(box.margin) else box.margin, box.sentence
        lines.append(
            (finding.statement.number, finding.statement.text, finding.verdict, numbers, finding.sentence, *of_box)
        )
    header = ("number", "statement", "verdict", "numbers", "sentence", "by_boxes", "margin_by_boxes", "why_by_boxes")
    return _csv(header, lines)


def _means_csv(rows: Sequence[TrialRow]) -> bytes:
    """One line a participant, configuration and controller: the means that the tests are made of."""
    measures = (*MEASURES, *own_columns(rows))
    tables = [scores(rows, measure) for measure in measures]
    cells = [
        (person, configuration, controller)
        for person in people_of(rows)
        for configuration in configurations_of(rows)
        for controller in sorted({row.controller for row in rows}, key=by_controller)
    ]
    lines = [(*cell, *(t.get(cell) for t in tables)) for cell in cells if any(cell in t for t in tables)]
    return _csv(("participant", "configuration", "controller", *measures), lines)


def warnings(rows: Sequence[TrialRow], found: Sequence[Finding], simulated: bool) -> list[str]:
    """Warnings that stand before the findings: too few people, or simulated ones."""
    few = too_few(fewest_people(rows, found))
    return ([few] if few else []) + ([SIMULATED] if simulated else [])


def fewest_people(rows: Sequence[TrialRow], found: Sequence[Finding]) -> int:
    """On how many people the findings rest, at least."""
    compared = [comparison.found.people for finding in found for comparison in finding.evidence if comparison.found]
    return min(compared, default=len(people_of(rows)))


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
    shares = finished_share(rows)
    worst = sorted((share, cell) for cell, share in shares.items() if share < 1.0)
    listed = ", ".join(f"{_name(k, names)} on {device} {percent(share)}" for share, (device, k) in worst)
    others = "; all others 100 %" if len(worst) < len(shares) else ""
    return f"{text} Reached the end{' (aborted: not)' if aborted else ''}: {listed}{others}."


def _name(controller: int | str, names: Mapping[int, str]) -> str:
    return names.get(int(controller), f"controller {controller}")


def _number(result: Result, scale: float, digits: int) -> str:
    """A number with its sign and, if it has one, its interval."""
    text = fixed(scale * (result.value or 0.0), digits, "+")
    if result.low is None or result.high is None:
        return text
    low, high = sorted((scale * result.low, scale * result.high))
    return f"{text} ({fixed(low, digits, '+')} to {fixed(high, digits, '+')})"


def _findings_table(found: Sequence[Finding], by_boxes: Sequence[Finding]) -> str:
    lines = []
    for finding, box in zip(found, by_boxes, strict=True):
        number, text, _ = finding.statement
        judged = f"**{box.verdict}**", chance(number), box.sentence, f"**{finding.verdict}**", finding.sentence
        lines.append((number, text, *judged))
    return _table(("", "the paper says", "by boxes", "by chance", "why", "within each participant", "why"), lines)


def chance(number: int) -> str:
    """How often a statement holds by boxes where nothing differs between the controllers."""
    low, high = CHANCE[number]
    return percent(low) if low == high else f"{fixed(100.0 * low, 0)} to {percent(high)}"


def _contrasts(results: Sequence[Result], names: Mapping[int, str], own: Sequence[Metric]) -> tuple[str, str]:
    """Table of each pair of controllers by measure and configuration, and how to read its intervals."""
    lines, tested = [], False
    for metric in (*JUDGED, *own):
        for r in results:
            if (r.measure, r.statistic) == (metric.name, "hodges_lehmann"):
                pair = f"{_name(r.first, names)} - {_name(r.second, names)}"
                p = "" if r.p_holm is None else _p(r.p_holm).removeprefix("= ")
                difference = _number(r, metric.scale, metric.decimals)
                lines.append((_with_unit(metric), r.configuration, pair, difference, p))
                tested |= r.p_holm is not None
    how = " with the 95 % interval of Wilcoxon's test; p after Holm's correction for all pairs of the same rows."
    return _table(("measure", "device", "controllers", "difference", "p"), lines), how if tested else "."


def _p(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"= {p:.3f}"


def _with_unit(metric: Metric) -> str:
    return f"{metric.short} ({metric.shown_unit})" if metric.shown_unit else metric.short


def _against_none(
    results: Sequence[Result], names: Mapping[int, str], none: int, own: Sequence[Metric]
) -> tuple[str, str]:
    """Table of each controller's change against the uncontrolled one, by device, and how to read it."""
    chosen: dict[tuple[str, str, str], Result] = {}
    for r in results:
        if r.statistic == "hodges_lehmann" and r.configuration != POOLED and f"{none}" in (r.first, r.second):
            chosen[r.configuration, r.second if r.first == f"{none}" else r.first, r.measure] = r
    if not chosen:
        return "No participant tried a controller and no control on the same device.", ""
    lines = []
    for configuration, controller in dict.fromkeys(key[:2] for key in chosen):
        cells = []
        for metric in (*JUDGED, *own):
            pair = chosen.get((configuration, controller, metric.name))
            star = "*" if pair and pair.p_holm is not None and pair.p_holm < 0.05 else ""
            scale = -metric.scale if pair and pair.first == f"{none}" else metric.scale  # controller minus none
            cells.append(_number(pair, scale, metric.decimals) + star if pair else "")
        lines.append((configuration, _name(controller, names), *cells))
    heads = [_with_unit(metric) for metric in (*JUDGED, *own)]
    few = any(r.p_holm is None for r in chosen.values())
    interval = "" if few else " with the 95 % interval of that test; *: p < 0.05 after Holm's correction for all pairs"
    how = (
        "Change between the means of each participant's trials, as above, but its middle by Hodges and Lehmann, which "
        f"goes with Wilcoxon's test and takes no distribution{interval}."
    )
    return _table(("device", "controller", *heads), lines), " ".join([how, *_out_of_reach(results, chosen)])


def _roughness(results: Sequence[Result], names: Mapping[int, str]) -> str:
    """Table of how rough each controller is beside no control, by each definition of smoothness."""
    found = {(r.configuration, r.measure, r.first): f"{r.value:.2f}" for r in results if r.test == "roughness"}
    controllers = list(dict.fromkeys(key[2] for key in found))
    lines = [
        (*place, *(found.get((*place, k), "") for k in controllers)) for place in dict.fromkeys(k[:2] for k in found)
    ]
    return _table(("device", "by", *(_name(k, names) for k in controllers)), lines)


def _locks_and_releases(rows: Sequence[TrialRow], names: Mapping[int, str]) -> str:
    """Table of how often the rules lock or release because no brake is right, by device and controller."""
    shares: dict[tuple[str, int | str], list[tuple[float, float]]] = {}
    for row in rows:
        if row.status in COUNTED and row.locked_share is not None and row.released_share is not None:
            shares.setdefault((row.configuration, row.controller), []).append((row.locked_share, row.released_share))
    lines = []
    for (device, controller), found in sorted(shares.items()):
        locked, released = (f"{100.0 * sum(values) / len(found):.2f}" for values in zip(*found, strict=True))
        with_lock = f"{sum(share > 0.0 for share, _ in found)} of {len(found)}"
        lines.append((device, _name(controller, names), locked, released, with_lock))
    return _table(("device", "controller", "locked (% of ticks)", "released (%)", "trials with a lock"), lines)


def _out_of_reach(results: Sequence[Result], shown: Iterable[tuple[str, str, str]]) -> list[str]:
    """Where too few people for it can get a star in the table, a sentence for each number of people and pairs."""
    where: dict[str, list[str]] = {}
    for configuration, measure in dict.fromkeys((key[0], key[2]) for key in shown):
        pairs = [
            r for r in results if (r.configuration, r.measure) == (configuration, measure) and r.p_holm is not None
        ]
        if measure in SHOWN and pairs and (least := least_p_holm(pairs)) >= 0.05:
            people = max(pair.people for pair in pairs)
            why = (
                f"no *, however they differ: the smallest p of Wilcoxon's test with {people} participants is "
                f"{significant(2.0 * 0.5**people)}, after Holm's correction for {len(pairs)} pairs "
                f"{significant(least, 2)}"
            )
            where.setdefault(why, []).append(configuration)
    return [f"On {' and '.join(dict.fromkeys(devices))} {why}." for why, devices in where.items()]


def sentences(
    results: Sequence[Result], names: Mapping[int, str] = CONTROLLER, own: Sequence[Metric] = ()
) -> list[str]:
    """Differences, trend, speed, reaction time and the order of controllers, each in a sentence or two."""
    written = [
        *_differ(results, own), *_trend(results, own), *_speed(results, names), *_reaction(results),
        *_order(results, names),
    ]  # fmt: skip
    return written or ["There is nothing to compare."]


def _differ(results: Sequence[Result], own: Sequence[Metric]) -> Iterable[str]:
    for metric in (*JUDGED, *own):
        tests = [r for r in results if (r.measure, r.statistic) == (metric.name, "chi_square")]
        chances = {r.configuration: r.p for r in tests if r.p is not None}
        if chances:
            listed = ", ".join(f"{where} p {_p(p)}" for where, p in chances.items())
            differs = "differs" if all(p < 0.05 for p in chances.values()) else "does not everywhere differ"
            yield f"{metric.title} {differs} between controllers (Friedman: {listed})."


def _trend(results: Sequence[Result], own: Sequence[Metric]) -> Iterable[str]:
    found = {r.measure: r for r in results if r.test == "trend"}
    listed = [
        f"{metric.short} {_number(found[metric.name], 1.0, 1)} %"
        for metric in (*JUDGED, BY_NAME["duration_s"], *own)
        if metric.name in found
    ]
    if listed:
        changed = "; ".join(listed)
        yield f"Over ten trials, in the same task, the median participant changed (learning or fatigue): {changed}."


def _speed(results: Sequence[Result], names: Mapping[int, str]) -> Iterable[str]:
    speed = [r for r in results if r.test == "speed" and r.value is not None]
    for r in speed:
        if r.statistic == "m_per_doubling":
            if r.low is None or r.high is None:
                judged = "too few people to judge"
            elif r.low <= 0.0 <= r.high:
                judged = "no clear effect of speed"
            else:
                judged = "slow trials do look accurate" if r.low > 0.0 else "fast trials are the more accurate ones"
            yield f"Twice the speed, same person and task: path error {_number(r, 1e3, 2)} mm; {judged}."
    for configuration in dict.fromkeys(r.configuration for r in speed if r.configuration != "all"):
        measured, adjusted = (
            {r.first: 1e3 * (r.value or 0.0) for r in speed if (r.configuration, r.statistic) == (configuration, name)}
            for name in ("mean_error", "error_at_common_speed")
        )
        listed = ", ".join(f"{_name(k, names)} {measured[k]:.2f} -> {adjusted[k]:.2f}" for k in measured)
        same = sorted(measured, key=measured.__getitem__) == sorted(adjusted, key=adjusted.__getitem__)
        kept = "stays" if same else "changes"
        yield f"Path error at equal speed, {configuration} (mm, measured -> adjusted): {listed}; the order {kept}."


def _reaction(results: Sequence[Result]) -> Iterable[str]:
    found = {(r.configuration, r.measure): r.value for r in results if r.test == "reaction" and r.value is not None}
    for configuration in dict.fromkeys(device for device, _ in found):
        changed = {measure: value - 1.0 for (device, measure), value in found.items() if device == configuration}
        share = -changed.pop("duration_s")
        listed = ", ".join(f"{BY_NAME[measure].short} {percent(by, sign='+')}" for measure, by in changed.items())
        yield (
            f"On {configuration} {percent(share)} of the movement pass before the tip has moved 1 mm (median "
            f"trial); every measure holds this reaction time. Without it: {listed}."
        )


def _order(results: Sequence[Result], names: Mapping[int, str]) -> Iterable[str]:
    orders = [r for r in results if r.test == "order"]
    for base in [r for r in orders if r.measure == r.second]:
        others = [r for r in orders if (r.second, r.configuration) == (base.measure, base.configuration)][1:]
        same: list[str] = []  # the definitions that give the same order
        swap: dict[str, list[str]] = {}  # those that swap some controllers, by which
        for other in others:
            pairs = [f"{_name(a, names)} and {_name(b, names)}" for a, b in swapped(base.first, other.first)]
            (swap.setdefault(", ".join(pairs), []) if pairs else same).append(other.measure)
        order = " < ".join(_name(k, names) for k in base.first.split(" < "))
        told = [f"Order of controllers by {base.measure}, {base.configuration}, least first: {order}"]
        told += [f"The same by {'; '.join(same)}"] if same else []
        told += [
            f"{pairs[:1].upper()}{pairs[1:]} change places by {'; '.join(measures)}" for pairs, measures in swap.items()
        ]
        yield ". ".join(told) + "."


def side_by_side(choices: Mapping[str, Sequence[TrialRow]]) -> str:
    """Markdown: the verdicts of several studies (at least one) in columns, within each participant and by boxes, then
    why those that do not hold within each participant do not.
    """
    found = {label: findings(rows) for label, rows in choices.items()}
    by_boxes = {label: box_findings_of(rows) for label, rows in choices.items()}
    lines = [
        (of_all[0].statement.number, of_all[0].statement.text, *(finding.verdict for finding in of_all))
        for of_all in zip(*found.values(), *by_boxes.values(), strict=True)
    ]
    parts = [_table(("", "the paper says", *found, *(f"{label}, by boxes" for label in found)), lines)]
    for label, findings_of_study in found.items():
        why = [f"- {refusal}" for refusal in [too_few(fewest_people(choices[label], findings_of_study))] if refusal]
        why += [f"- {f.statement.number}, {f.verdict}: {f.sentence}" for f in findings_of_study if f.verdict != HOLDS]
        if why:
            parts += [f"**{label}**", "\n".join(why)]
    return "\n\n".join(parts) + "\n"


def error_table(moved: Sequence[Moved], names: Mapping[int, str]) -> str:
    """A line for each controller and change, with the measures of the figures, as Markdown."""
    of = {(move.controller, move.change, move.measure): move for move in moved}
    lines = []
    for controller, change in dict.fromkeys(cell[:2] for cell in of):
        cells = []
        for metric in FIGURES:
            move = of.get((controller, change, metric.name))
            share = f" ({significant(100.0 * move.worst_share, 2)} %)" if move and move.worst_share is not None else ""
            moves = [significant(metric.scale * size, 1) for size in (move.median, move.worst)] if move else []
            cells.append(" / ".join(moves) + share)
        lines.append((_name(controller, names), change, *cells))
    return _table(("controller", "changed", *(f"{metric.short} ({metric.shown_unit})" for metric in FIGURES)), lines)


def error_sentence(moved: Sequence[Moved]) -> str:
    """The error bar of a table: what a tenth of the step does at most, to a median and to a single trial."""
    parts = []
    for metric in DRAWN:
        of_step = [move for move in moved if move.change == STEP and move.measure == metric.name]
        if of_step:
            median, worst = (
                metric.scale * max(values) for values in zip(*((m.median, m.worst) for m in of_step), strict=True)
            )
            parts.append(f"{metric.short} {significant(median, 1)} ({significant(worst, 1)}) {metric.shown_unit}")
    if not parts:
        return ""
    trials = sum(move.trials for move in moved if move.change == STEP and move.measure == DRAWN[0].name)
    return (
        f"Error bar of the simulation, in a sample of {trials} trials, worst controller, median (single) trial: "
        f"{', '.join(parts)}."
    )
