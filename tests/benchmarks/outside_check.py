"""The figures of an outside check of docs/findings.md, from files, by one command each.

python -m tests.benchmarks.outside_check idle                     uncontrolled error; how long SDOF with gap is idle
python -m tests.benchmarks.outside_check triples RANGES.toml [N]  `phd worlds RANGES.toml`, judged as the check did
python -m tests.benchmarks.outside_check medians SWEEP.toml       `phd study --sweep SWEEP.toml`, beside no control
python -m tests.benchmarks.outside_check gap FOLDER               of `phd worlds paper`: where the error exceeds the gap
python -m tests.benchmarks.outside_check step [OPERATORS]         how far single trials move at a tenth of the step

The files: docs/examples/ranges and docs/examples/sweeps. The rule of the check, on every device: SDOF with gap has the
smallest box (q3 - q1) of path error of all five; the medians of the four controllers lie within 30 % of the
uncontrolled median.
"""

import csv
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from core.control.algorithm import GAP, GAP_M
from core.control.controllers import PARAMETERS
from experiments.analysis.charts import QUARTILE_METHOD
from experiments.analysis.findings import SIMILAR_OF_U
from experiments.analysis.metrics import BY_NAME, DRAWN
from experiments.analysis.report import STEP
from experiments.protocol import load_protocol
from experiments.study.sweep import load_sweep, run_sweep
from experiments.study.unrecorded import person_of, simulation_errors, study_trials
from experiments.trial.population import load_population
from experiments.worlds.ranges import load_ranges
from experiments.worlds.report import Worlds, read_worlds
from experiments.worlds.worlds import run_worlds

OPERATORS, TRIPLES = 30, 100
CONTROLLED = (2, 3, 4, 5)
GAP_CONTROLLER = 3
ERROR = "path_error_m"
IDLE = BY_NAME["released_share"]._replace(of=lambda m: m.share_of_ticks(GAP))  # share of the ticks in the gap


def idle() -> None:
    """Of the paper's study with thirty people, by device."""
    found: dict[str, tuple[list[float], list[float]]] = {}
    for row, _ in study_trials(load_protocol(), load_population(), OPERATORS, (BY_NAME[ERROR], IDLE)):
        errors, shares = found.setdefault(row.configuration, ([], []))
        if row.controller == 1:
            errors.append(row.path_error_m)
        if row.controller == GAP_CONTROLLER:
            shares.append(row.released_share)
    for device, (errors, shares) in found.items():
        print(
            f"{device}: uncontrolled error, median {1e3 * np.median(errors):.2f} mm, mean {1e3 * np.mean(errors):.2f} "
            f"mm; SDOF with gap is idle in {np.mean(shares):.1%} of the ticks"
        )


def triples(file: str, n: str = f"{TRIPLES}") -> None:
    """By the values of the file's range, if it has one."""
    ranges = load_ranges(file)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "worlds"
        run_worlds(ranges, out, int(n))
        worlds = read_worlds(out / "worlds.csv")
        with (out / "worlds.csv").open(newline="") as stream:
            lines = list(csv.DictReader(stream))
    groups: dict[str, list[int]] = {}
    for i, line in enumerate(lines):
        groups.setdefault(", ".join(f"{name} {line[name]}" for name in ranges.ranges), []).append(i)
    devices = [device.name for device in ranges.protocol.devices]
    for name, rows in sorted(groups.items()):
        smallest, somewhere, similar = np.mean([_as_the_check(worlds, i, devices) for i in rows], axis=0)
        held = ", ".join(f"{k} {share:.0%}" for k, share in enumerate(worlds.holds[rows].mean(axis=0), start=1))
        print(f"{name or 'all'}: {len(rows)} triples; statements by our rules: {held}")
        print(
            f"  by the check's: SDOF with gap smallest spread {smallest:.0%} (on one device at least {somewhere:.0%}), "
            f"all four within 30 % {similar:.0%}"
        )
        for device in devices:
            medians = [_medians(worlds, rows, device, k) for k in range(1, 6)]
            print(f"  {device}, median path error by controller: {', '.join(f'{m:.2f}' for m in medians)} mm")


def _as_the_check(worlds: Worlds, row: int, devices: list[str]) -> tuple[bool, bool, bool]:
    """SDOF with gap spreads least on every device, and on one at least; all four are similar on every one."""
    boxes = worlds.boxes(row)
    if len(boxes) < len(worlds.cells):  # under 90 % of the trials of one reached the end
        return False, False, False
    smallest, similar = [], []
    for device in devices:
        of_it = {k: boxes[ERROR, device, k] for k in (1, *CONTROLLED)}
        smallest.append(min(of_it, key=lambda k: of_it[k].q3 - of_it[k].q1) == GAP_CONTROLLER)
        medians = [of_it[k].median for k in CONTROLLED]
        similar.append(max(medians) - min(medians) <= SIMILAR_OF_U * of_it[1].median)
    return all(smallest), any(smallest), all(similar)


def _medians(worlds: Worlds, rows: list[int], device: str, controller: int) -> float:
    cell = worlds.cells.index((ERROR, device, controller))
    return 1e3 * float(np.nanmedian(worlds.quartiles[rows, cell, 1]))


def gap(folder: str) -> None:
    """How often each statement holds where the uncontrolled error is above the gap on every device, and where not."""
    ranges, table = load_ranges("paper"), Path(folder) / "worlds.csv"
    worlds = read_worlds(table)
    with table.open(newline="") as stream:
        readings = np.array([line["assumptions.gap_reading"] for line in csv.DictReader(stream)])
    half_width = np.where(readings == "full", 0.5, 1.0) * ranges.protocol.controllers[GAP_CONTROLLER].value(GAP_M.name)
    cells = [worlds.cells.index((ERROR, device.name, 1)) for device in ranges.protocol.devices]
    above = np.all(worlds.quartiles[:, cells, 1] > half_width[:, np.newaxis], axis=1)
    print(f"{len(above)} worlds; above the gap on every device: {above.mean():.1%}")
    for k, holds in enumerate(worlds.holds.T, start=1):
        print(f"  {k}: holds in {holds[above].mean():.1%} of these, in {holds[~above].mean():.1%} of the others")


def medians(file: str) -> None:
    """Of every cell of a sweep, and how much more that is than without control."""
    sweep = load_sweep(Path(file))
    with tempfile.TemporaryDirectory() as folder:
        run_sweep(sweep, Path(folder) / "sweep")
        with (Path(folder) / "sweep" / "sweep.csv").open(newline="") as stream:
            rows = [row for row in csv.DictReader(stream) if row["status"] == "done"]
    cells: dict[tuple[str, ...], dict[str, list[list[float]]]] = {}
    for row in rows:
        where = tuple(row[name] for name in ("population", "configuration", *sweep.varied))
        controller = " ".join((row["kind"], *(row[name] for name in PARAMETERS if float(row[name]))))
        cells.setdefault(where, {}).setdefault(controller, []).append([float(row[m.name]) for m in DRAWN])
    for where, of_it in cells.items():
        none = np.median(of_it["none"], axis=0)
        for controller, values in of_it.items():
            numbers = np.median(values, axis=0)
            shown = (
                f"{m.short} {m.scale * x:.2f} {m.shown_unit} ({x / was - 1.0:+.1%})"
                for m, x, was in zip(DRAWN, numbers, none, strict=True)
            )
            q1, q3 = 1e3 * np.quantile([errors[0] for errors in values], (0.25, 0.75), method=QUARTILE_METHOD)
            print(f"{', '.join(where)}, {controller}: {', '.join(shown)}; box of path error {q3 - q1:.2f} mm long")


def step(operators: str = "10") -> None:
    """The worst trial of each controller; the controller decides once a millisecond as before."""
    protocol, population = load_protocol(), load_population()
    worst: dict[tuple[int, str], tuple[float, float]] = {}
    for number in range(1, int(operators) + 1):
        for one in simulation_errors(protocol, person_of(population, protocol.seed, number), f"{number:02d}"):
            if one.change == STEP and one.measure in [m.name for m in DRAWN]:
                cell = one.controller, one.measure
                before = worst.get(cell, (0.0, 0.0))
                worst[cell] = max(before[0], one.worst), max(before[1], one.worst_share or 0.0)
    for (controller, measure), (largest, share) in sorted(worst.items()):
        metric = BY_NAME[measure]
        print(f"controller {controller}, {metric.short}: {metric.scale * largest:.2g} {metric.shown_unit}, {share:.2g}")


WHAT: dict[str, Callable[..., None]] = {one.__name__: one for one in (idle, triples, gap, medians, step)}

if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] not in WHAT:
        sys.exit(__doc__)
    WHAT[sys.argv[1]](*sys.argv[2:])
