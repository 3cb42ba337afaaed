"""`phd worlds`: thousands of small studies, each under assumptions of its own, judged as the paper judges.

A row of DIR/worlds.csv is one study: its world, its triple of people, its seed, its assumptions, and what was measured
in each of its trials (`experiments.worlds.table`). DIR/report is made from the table alone, so that worlds are judged
by other rules without a new simulation. A study is the one that `phd study` runs with the same assumptions and seed,
without recordings. How the folder is filled, resumed and spread over workers: `experiments.study.jobs`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.files import InputError
from core.tick_log import TICK_S
from experiments.analysis.findings import why_no_findings
from experiments.analysis.metrics import JUDGED
from experiments.plan import make_plan
from experiments.progress import Progress, no_progress
from experiments.recording.atomic_files import replace_file
from experiments.study.jobs import Done, Work, device_texts, run_work, table_lines
from experiments.study.unrecorded import study_trials, with_low_gain_found
from experiments.worlds.ranges import Ranges, Value
from experiments.worlds.report import report_files
from experiments.worlds.table import cells_of, columns

KIND, REPORT = "worlds", "report"
MOST_STUDIES = 1_000_000


@dataclass(frozen=True)
class World:
    """One study under one set of assumptions."""

    number: int  # of the study, its place in the table from 1
    world: int
    triple: int  # the people
    seed: int
    values: Mapping[str, Value]
    ranges: Ranges

    def run(self) -> Done:
        """Run the study; its row, in the order of `columns`."""
        protocol, population = self.ranges.study(self.values, self.seed)
        about = self.world, self.triple, self.seed, *self.values.values()
        try:
            protocol = with_low_gain_found(protocol, population)
        except InputError:  # no low gain is without vibration: there are no trials
            return Done(table_lines([[*about, *cells_of((), self.ranges.protocol)]]), 0)
        rows, ticks = zip(*study_trials(protocol, population, self.ranges.operators, JUDGED), strict=True)
        return Done(table_lines([[*about, *cells_of(rows, protocol)]]), sum(ticks))


def worlds_of(ranges: Ranges, n: int, seed: int, triples: int = 1) -> list[World]:
    """The worlds that are drawn from the ranges, each with so many triples of people.

    A seed for each triple, for its people, their noise and their order of trials; the first ones are those of a run
    with one triple a world.
    """
    shares = ranges.drawn(n, seed)
    seeds = np.random.SeedSequence(seed).generate_state(n * triples).reshape(triples, n)
    return [
        World(i * triples + k + 1, i + 1, k + 1, int(seeds[k, i]), ranges.values(shares[i]), ranges)
        for i in range(n)
        for k in range(triples)
    ]


@dataclass(frozen=True)
class WorldsRun:
    """A run of worlds: what decides its table."""

    ranges: Ranges
    n: int = 10_000
    seed: int = 1
    triples: int = 1

    def work(self) -> Work[World]:
        """InputError: the statements cannot be judged, or there are too many worlds."""
        ranges = self.ranges
        if reason := why_no_findings(ranges.protocol.controllers):
            raise InputError(f"worlds {ranges.name}: {reason}")
        if self.n * self.triples > MOST_STUDIES:
            raise InputError(f"--n: at most {MOST_STUDIES} studies, not {self.n * self.triples}")
        texts = {"ranges": ranges.text, "protocol": ranges.protocol.text, "n": str(self.n), "seed": str(self.seed)}
        texts |= {"triples": str(self.triples)} | device_texts(ranges.protocol.devices)
        texts |= {f"population {name}": text for name, text in ranges.populations.items()}
        return Work(KIND, ranges.name, texts, columns(ranges), worlds_of(ranges, self.n, self.seed, self.triples))


def run_worlds(
    run: WorldsRun, out: Path, resume: bool = False, cluster: str | None = None, progress: Progress = no_progress
) -> dict:
    """Run the studies that are not done yet, write the table and the report; the summary. As `run_work`."""
    work = run.work()
    finished = run_work(work, Path(out), resume, cluster, progress)
    new = len(work.jobs) - finished.already_done
    trials = run.ranges.operators * len(make_plan(run.ranges.protocol, "01"))
    return {
        "out": str(finished.table),
        **write_report(run, Path(out), finished.table.read_bytes()),
        "already_done": finished.already_done,
        "trials": trials * len(work.jobs),
        "trials_per_s": trials * new / finished.wall_s,
        "simulated_s": finished.ticks * TICK_S,
        "wall_s": finished.wall_s,
    }


def write_report(run: WorldsRun, out: Path, table: bytes) -> dict:
    """Judge the table, and write DIR/report in place of an earlier one; what the summary says of it."""
    files, found = report_files(table.decode().splitlines(), run.ranges, run.ranges.drawn(run.n, run.seed), run.seed)
    (out / REPORT).mkdir(exist_ok=True)
    for name, content in files.items():
        replace_file(out / REPORT / name, content)
    return {"report": str(out / REPORT / "report.md"), **found}
