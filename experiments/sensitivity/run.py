"""`phd sensitivity`: thousands of small studies, each with values of its own for what the paper does not print.

A row of DIR/sensitivity.csv is a trial: its sample, person, device, controller and path, and the measures that judge
the paper's statements. DIR/report is made from that table alone. A study is the one that `phd study` runs with the same
values and seed, without recordings. How the folder is filled, resumed and spread: `experiments.study.jobs`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.files import InputError
from core.tick_log import TICK_S
from experiments.analysis.findings import why_no_findings
from experiments.analysis.metrics import JUDGED
from experiments.atomic_files import replace_file
from experiments.plan import make_plan
from experiments.progress import Progress, no_progress
from experiments.sensitivity.ranges import Ranges, Value
from experiments.sensitivity.report import report_files
from experiments.study.jobs import Done, Work, device_texts, run_work, table_lines
from experiments.study.unrecorded import operator_trials, with_low_gain_found

KIND, REPORT = "sensitivity", "report"
PLACE = ("sample", "participant", "configuration", "controller", "path", "repetition")
COLUMNS = (*PLACE, *(metric.name for metric in JUDGED))
MOST_SAMPLES = 100_000
DIGITS = 6  # of a measure


@dataclass(frozen=True)
class Sample:
    """One study with the values that were drawn for it."""

    number: int  # from 1
    seed: int
    values: Mapping[str, Value]
    ranges: Ranges

    def run(self) -> Done:
        """Run the study; a row a trial, in the order of `COLUMNS`, without measures where it did not reach the end."""
        protocol, populations = self.ranges.study(self.values, self.seed)
        people = [populations[k % len(populations)] for k in range(self.ranges.operators)]
        lines, ticks = list[list[object]](), 0
        try:
            protocol = with_low_gain_found(protocol, people[0])
        except InputError:  # even the least gain vibrates: the study has no low gain, and no trials
            people = []
        for operator, population in enumerate(people, start=1):
            seen: dict[tuple, int] = {}
            for row, more in operator_trials(protocol, population, operator, JUDGED):
                cell = row.configuration, row.controller, row.path
                seen[cell] = seen.get(cell, 0) + 1
                values = [row.value(metric.name) if row.status == "done" else None for metric in JUDGED]
                texts = ["" if value is None else f"{value:.{DIGITS}g}" for value in values]
                lines.append([self.number, operator, *cell, seen[cell], *texts])
                ticks += more
        return Done(table_lines(lines or [[self.number, *[math.nan] * (len(COLUMNS) - 1)]]), ticks)


@dataclass(frozen=True)
class SensitivityRun:
    """What decides a run's table."""

    ranges: Ranges
    n: int = 3000
    seed: int = 1

    def samples(self) -> list[Sample]:
        """The samples in order; a seed for each, of its people, their noise and the order of their trials."""
        shares = self.ranges.shares(self.n, self.seed)
        seeds = np.random.SeedSequence(self.seed).generate_state(self.n)
        return [Sample(i + 1, int(seeds[i]), self.ranges.values(shares[i]), self.ranges) for i in range(self.n)]

    def work(self) -> Work[Sample]:
        """InputError: the statements cannot be judged, or there are too many samples."""
        ranges = self.ranges
        if reason := why_no_findings(ranges.protocol.controllers):
            raise InputError(f"ranges {ranges.name}: {reason}")
        if self.n > MOST_SAMPLES:
            raise InputError(f"--n: at most {MOST_SAMPLES} samples, not {self.n}")
        texts = {"ranges": ranges.text, "protocol": ranges.protocol.text, "n": str(self.n), "seed": str(self.seed)}
        texts |= device_texts(ranges.protocol.devices)
        texts |= {f"population {name}": text for name, text in ranges.populations.items()}
        return Work(KIND, ranges.name, texts, COLUMNS, self.samples())


def run_sensitivity(
    run: SensitivityRun, out: Path, resume: bool = False, cluster: str | None = None, progress: Progress = no_progress
) -> dict:
    """Run the samples that are not done yet, write the table and the report; the summary. As `run_work`."""
    work = run.work()
    finished = run_work(work, Path(out), resume, cluster, progress)
    files, found = report_files(finished.table, run.ranges, run.ranges.shares(run.n, run.seed), run.seed)
    (out / REPORT).mkdir(exist_ok=True)
    for name, content in files.items():
        replace_file(out / REPORT / name, content)
    new = len(work.jobs) - finished.already_done
    return {
        "out": str(finished.table),
        "report": str(out / REPORT / "report.md"),
        **found,
        "already_done": finished.already_done,
        "trials": run.ranges.operators * len(make_plan(run.ranges.protocol, "01")) * len(work.jobs),
        "samples_per_min": 60.0 * new / finished.wall_s,
        "simulated_s": finished.ticks * TICK_S,
        "wall_s": finished.wall_s,
    }
