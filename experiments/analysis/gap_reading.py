"""Table I's gap read the other way: what that does to SDOF with gap and to the verdicts on the paper's statements.

`experiments.study.gap_reading` runs the trials; here are the table and the sentence that a report makes of them.
"""

from typing import NamedTuple

import pandas as pd

from experiments.analysis.findings import Finding, box_findings_of, findings
from experiments.analysis.metrics import JUDGED, Metric
from experiments.analysis.report_tables import markdown_table
from experiments.analysis.statistics import configurations_of
from experiments.analysis.trials_table import Trials, to_compare
from experiments.numbers import fixed

GAP = 3  # the controller of Table I that has one


class GapReadOtherwise(NamedTuple):
    """The trials with SDOF with gap again, each from the same start in the same hands, with the gap read otherwise."""

    reading: str  # of the study: "half" or "full"
    gap_m: float  # to each side, in the study
    other_gap_m: float
    trials: Trials


def gap_table(trials: Trials, other: GapReadOtherwise, timeouts: bool) -> str:
    """The statements whose verdict the other reading changes, as Markdown."""
    then = pd.concat([trials[trials["controller"] != GAP], other.trials])
    boxes = zip(box_findings_of(trials, timeouts), box_findings_of(then, timeouts), strict=True)
    within = zip(findings(trials, timeouts), findings(then, timeouts), strict=True)
    lines = [
        (box.statement.number, box.statement.text, *(_change(*two) for two in ((box, box_then), (one, one_then))))
        for (box, box_then), (one, one_then) in zip(boxes, within, strict=True)
        if (box.verdict, one.verdict) != (box_then.verdict, one_then.verdict)
    ]
    head = ("", "the paper says", "by boxes", "within each participant")
    return markdown_table(head, lines) or "No verdict changes."


def _change(before: Finding, after: Finding) -> str:
    return before.verdict if before.verdict == after.verdict else f"{before.verdict} -> **{after.verdict}**"


def gap_sentence(trials: Trials, other: GapReadOtherwise, timeouts: bool) -> str:
    """What the two readings are, and the medians of SDOF with gap under both."""
    words = {"half": "half the width of the band without control", "full": "the whole width of the band"}
    then = words["full" if other.reading == "half" else "half"]
    both = [to_compare(one, timeouts).query(f"controller == {GAP}") for one in (trials, other.trials)]
    medians = "; ".join(
        f"{device}: "
        + ", ".join(_medians(metric, *(one[one["configuration"] == device] for one in both)) for metric in JUDGED)
        for device in configurations_of(trials)
    )
    return (
        f"Our choice: the gap that Table I prints is {words[other.reading]}, {1e3 * other.gap_m:g} mm to each side. "
        f"Read as {then}, {1e3 * other.other_gap_m:g} mm to each side, the same trials of the same people change in "
        f"these medians: {medians}."
    )


def _medians(metric: Metric, before: Trials, after: Trials) -> str:
    values = [fixed(metric.scale * float(one[metric.name].median()), metric.decimals) for one in (before, after)]
    return f"{metric.short} {values[0]} -> {values[1]} {metric.shown_unit}".rstrip()
