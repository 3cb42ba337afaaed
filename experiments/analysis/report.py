"""What a study leaves to read: findings.csv, statistics.csv, participant_means.csv, by_path.csv and report.md.

The page is `report_template.md` filled in with `report_tables` and `report_sentences`; the same rows and note give the
same bytes.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from string import Template

from core.files import InputError
from experiments.analysis import by_path, report_sentences, report_tables
from experiments.analysis.findings import CONTROLLER, HOLDS, Finding, box_findings_of, findings, why_no_findings
from experiments.analysis.gap_reading import GapReadOtherwise, gap_sentence, gap_table
from experiments.analysis.sensitivity import Read, sensitivity
from experiments.analysis.simulation_errors import HAND, STEP, Moved, error_sentence, error_table
from experiments.analysis.statistics import (
    CELL,
    MEASURES,
    NAMED,
    Result,
    configurations_of,
    people_of,
    scores,
    statistics,
    too_few,
    with_names,
)
from experiments.analysis.trials_table import (
    COUNTED,
    Controller,
    StudyData,
    Trials,
    controllers_of,
    csv_bytes,
    frame_bytes,
    is_coded,
    names_in,
    own_columns,
    to_compare,
    without_value,
)
from experiments.atomic_files import write_new_files

TEMPLATE = Path(__file__).with_name("report_template.md")
SIMULATED = "The participants are simulated: all of this is about the model, not about people."


def write_report(
    data: StudyData,
    out_folder: str | Path,
    timeouts: bool = False,
    moved: Sequence[Moved] = (),
    read: Read | None = None,
    gap: GapReadOtherwise | None = None,
) -> list[str]:
    """Write the files into `out_folder`; the warnings.

    The paper's statements are tested on Table I's controllers alone. Of coded trials only the means are written: each
    blind session has a key of its own, so codes cannot be compared.
    timeouts: trials whose time was up count in the statistics.
    read: gives the recording that a row names, for further definitions of smoothness.
    moved: how far the measures move when the trials of a sample are simulated otherwise.
    gap: the trials again, with Table I's gap read the other way.
    InputError before anything is written if one exists already or no trial counts.
    """
    folder, trials = Path(out_folder), data.trials
    if not trials["status"].isin(COUNTED).any():
        raise InputError(f"{folder}: no trial was done or timed out, there is nothing to report")
    coded = is_coded(trials)
    refusal = why_no_findings(data.controllers, coded)
    names = {k: preset.name for k, preset in data.controllers.items()}
    titles = names_in(trials) | names
    names = names if refusal else CONTROLLER
    found = [] if refusal else findings(trials, timeouts)
    by_boxes = [] if refusal else box_findings_of(trials, timeouts)
    warned = [*warnings(trials, found, data.simulated), *without_value(trials, data.own, data.failed)]
    parts = {
        "note": f"{data.note[:1].upper()}{data.note[1:].rstrip('.')}",
        "trials": report_sentences.about_trials(trials, names, timeouts),
        "warnings": "\n\n".join(f"**{warning}**" for warning in warned),
        "coded": refusal if coded else "",
        "findings": report_tables.findings_table(found, by_boxes),
    }
    of_paths = by_path.by_path(trials, data.labels, timeouts)
    means = _means_csv(to_compare(trials, timeouts), titles)
    files = {"participant_means.csv": means, by_path.NAME: frame_bytes(of_paths)}
    parts["by_path"] = by_path.by_path_table(of_paths, data.own)
    if not coded:
        none = _uncontrolled(data)
        results = [*statistics(trials, timeouts), *sensitivity(trials, read, timeouts, none or 0)]
        files["statistics.csv"] = _csv(NAMED, with_names(results, titles))
        parts |= _comparisons(data, results, names) if refusal else {}
        parts |= {} if none is None else _against_none(data, results, names, none)
        parts["roughness"] = report_tables.roughness_table(results, names)
        parts["locks"] = report_tables.locks_table(trials, names)
        more = report_sentences.sentences(results, names, data.own)
        parts["sentences"] = "\n".join(f"- {sentence}" for sentence in more)
    if found:
        files["findings.csv"] = _findings_csv(found, by_boxes)
        if gap:
            parts["gap_otherwise"] = gap_table(trials, gap, timeouts)
            parts["gap_medians"] = gap_sentence(trials, gap, timeouts)
    if moved and not coded:
        parts |= {"errors": error_table(moved, names), "error_bar": error_sentence(moved), "step": STEP, "hand": HAND}
        files["simulation_errors.csv"] = _csv(
            (*Moved._fields, "controller_name"), [(*move, titles.get(move.controller)) for move in moved]
        )
    files["report.md"] = page(parts).encode()
    write_new_files({folder / name: content for name, content in files.items()})
    return warned


def _uncontrolled(data: StudyData) -> int | None:
    """The number of the controller that never acts, if there is one."""
    return next((number for number, preset in data.controllers.items() if preset.kind == "none"), None)


def _comparisons(data: StudyData, results: Sequence[Result], names: Mapping[int, str]) -> dict[str, str]:
    """The parts of the page about each pair of controllers."""
    contrasts = report_tables.contrasts_of(results, data.own)
    return {
        "contrasts": report_tables.contrasts_table(contrasts, names, data.own),
        "contrasts_how": report_sentences.reading_contrasts(contrasts),
    }


def _against_none(data: StudyData, results: Sequence[Result], names: Mapping[int, str], none: int) -> dict[str, str]:
    """The parts of the page about the changes against no control."""
    changes = report_tables.changes_against(none, results)
    if not changes:
        return {"against_none": "No participant tried a controller and no control on the same device."}
    return {
        "against_none": report_tables.against_none_table(changes, none, names, data.own),
        "against_none_how": report_sentences.reading_against_none(changes, results),
    }


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


def _means_csv(trials: Trials, titles: Mapping[Controller, str]) -> bytes:
    """One line a participant, configuration and controller: the means that the tests are made of."""
    measures = (*MEASURES, *own_columns(trials))
    tables = [scores(trials, measure) for measure in measures]
    cells = [
        (person, configuration, controller)
        for person in people_of(trials)
        for configuration in configurations_of(trials)
        for controller in controllers_of(trials)
    ]
    lines = [
        (*cell, titles.get(cell[2]), *(t.get(cell) for t in tables))
        for cell in cells if any(cell in t for t in tables)
    ]  # fmt: skip
    return _csv((*CELL, "controller_name", *measures), lines)


def warnings(trials: Trials, found: Sequence[Finding], simulated: bool) -> list[str]:
    """Warnings that stand before the findings: too few people, or simulated ones."""
    few = too_few(fewest_people(trials, found))
    return ([few] if few else []) + ([SIMULATED] if simulated else [])


def fewest_people(trials: Trials, found: Sequence[Finding]) -> int:
    """On how many people the findings rest, at least."""
    compared = [comparison.found.people for finding in found for comparison in finding.evidence if comparison.found]
    return min(compared, default=len(people_of(trials)))


def side_by_side(choices: Mapping[str, Trials]) -> str:
    """Markdown: the verdicts of several studies (at least one) in columns, within each participant and by boxes, then
    why those that do not hold within each participant do not.
    """
    found = {label: findings(trials) for label, trials in choices.items()}
    by_boxes = {label: box_findings_of(trials) for label, trials in choices.items()}
    lines = [
        (row[0].statement.number, row[0].statement.text, *(finding.verdict for finding in row))
        for row in zip(*found.values(), *by_boxes.values(), strict=True)
    ]
    parts = [
        report_tables.markdown_table(("", "the paper says", *found, *(f"{label}, by boxes" for label in found)), lines)
    ]
    for label, findings_of_study in found.items():
        why = [f"- {refusal}" for refusal in [too_few(fewest_people(choices[label], findings_of_study))] if refusal]
        why += [f"- {f.statement.number}, {f.verdict}: {f.sentence}" for f in findings_of_study if f.verdict != HOLDS]
        if why:
            parts += [f"**{label}**", "\n".join(why)]
    return "\n\n".join(parts) + "\n"
