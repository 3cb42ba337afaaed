"""The tables of report.md, in Markdown: each function makes one of them, "" where it would have no line."""

from collections.abc import Iterable, Mapping, Sequence

from experiments.analysis.findings import CHANCE, Finding
from experiments.analysis.metrics import JUDGED, Metric
from experiments.analysis.report_sentences import name_of, p_value, signed
from experiments.analysis.statistics import POOLED, Result
from experiments.analysis.trials_table import COUNTED, Trials
from experiments.numbers import fixed, percent


def markdown_table(head: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    """A table in Markdown; "" without lines."""
    rows = ["|" + "".join(f" {cell} |" if cell != "" else " |" for cell in line) for line in (head, *lines)]
    return "\n".join([rows[0], "|---" * len(head) + "|", *rows[1:]]) if len(rows) > 1 else ""


def with_unit(metric: Metric) -> str:
    return f"{metric.short} ({metric.shown_unit})" if metric.shown_unit else metric.short


def findings_table(found: Sequence[Finding], by_boxes: Sequence[Finding]) -> str:
    """The paper's statements with their verdicts by boxes and within each participant."""
    lines = []
    for finding, box in zip(found, by_boxes, strict=True):
        number, text, _ = finding.statement
        judged = f"**{box.verdict}**", chance(number), box.sentence, f"**{finding.verdict}**", finding.sentence
        lines.append((number, text, *judged))
    head = ("", "the paper says", "by boxes", "by chance", "why", "within each participant", "why")
    return markdown_table(head, lines)


def chance(number: int) -> str:
    """How often a statement holds by boxes where nothing differs between the controllers."""
    low, high = CHANCE[number]
    return percent(low) if low == high else f"{fixed(100.0 * low, 0)} to {percent(high)}"


def contrasts_of(results: Sequence[Result], own: Sequence[Metric]) -> list[Result]:
    """The differences of all pairs of controllers, by measure."""
    measures = [metric.name for metric in (*JUDGED, *own)]
    return [r for name in measures for r in results if (r.measure, r.statistic) == (name, "hodges_lehmann")]


def contrasts_table(contrasts: Sequence[Result], names: Mapping[int, str], own: Sequence[Metric]) -> str:
    """Each pair of controllers by measure and configuration."""
    metrics = {metric.name: metric for metric in (*JUDGED, *own)}
    lines = []
    for r in contrasts:
        metric = metrics[r.measure]
        pair = f"{name_of(r.first, names)} - {name_of(r.second, names)}"
        p = "none" if r.p_holm is None else p_value(r.p_holm).removeprefix("= ")
        differ, difference = f"{r.differ} of {r.people}", signed(r, metric.scale, metric.decimals)
        lines.append((with_unit(metric), r.configuration, pair, difference, differ, p))
    return markdown_table(("measure", "device", "controllers", "difference", "people that differ", "p"), lines)


def changes_against(none: int, results: Sequence[Result]) -> list[Result]:
    """The differences on each device between a controller and the uncontrolled one, whose number is `none`."""
    return [
        r for r in results
        if r.statistic == "hodges_lehmann" and r.configuration != POOLED and f"{none}" in (r.first, r.second)
    ]  # fmt: skip


def against_none_table(changes: Sequence[Result], none: int, names: Mapping[int, str], own: Sequence[Metric]) -> str:
    """Each controller's change against no control, by device: a column for each measure."""
    metrics = (*JUDGED, *own)
    found = {(r.configuration, r.second if r.first == f"{none}" else r.first, r.measure): r for r in changes}
    lines = []
    for device, controller in dict.fromkeys(key[:2] for key in found):
        cells = [_change_cell(found.get((device, controller, metric.name)), metric, none) for metric in metrics]
        lines.append((device, name_of(controller, names), *cells))
    return markdown_table(("device", "controller", *map(with_unit, metrics)), lines)


def _change_cell(change: Result | None, metric: Metric, none: int) -> str:
    """A controller minus no control; "*": after Holm's correction p is less than 0.05."""
    if change is None:
        return ""
    scale = -metric.scale if change.first == f"{none}" else metric.scale
    star = "*" if change.p_holm is not None and change.p_holm < 0.05 else ""
    return signed(change, scale, metric.decimals) + star


def roughness_table(results: Sequence[Result], names: Mapping[int, str]) -> str:
    """How rough each controller is beside no control, by each definition of smoothness."""
    found = {(r.configuration, r.measure, r.first): f"{r.value:.2f}" for r in results if r.test == "roughness"}
    controllers = list(dict.fromkeys(key[2] for key in found))
    lines = [
        (*place, *(found.get((*place, k), "") for k in controllers)) for place in dict.fromkeys(k[:2] for k in found)
    ]
    return markdown_table(("device", "by", *(name_of(k, names) for k in controllers)), lines)


def locks_table(trials: Trials, names: Mapping[int, str]) -> str:
    """How often the rules lock or release because no brake is right, by device and controller."""
    counted = trials[trials["status"].isin(COUNTED)].dropna(subset=["locked_share", "released_share"])
    lines = []
    for (device, controller), cell in counted.groupby(["configuration", "controller"]):
        locked, released = (
            f"{100.0 * sum(cell[share]) / len(cell):.2f}" for share in ("locked_share", "released_share")
        )
        with_lock = f"{(cell['locked_share'] > 0.0).sum()} of {len(cell)}"
        lines.append((device, name_of(controller, names), locked, released, with_lock))
    return markdown_table(("device", "controller", "locked (% of ticks)", "released (%)", "trials with a lock"), lines)
