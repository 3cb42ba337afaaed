"""`phd worlds`: thousands of small studies, each under assumptions of its own, judged as the paper judges.

A row of DIR/worlds.csv is one world: its seed, its assumptions, the verdict and margin of each statement by boxes
(`experiments.analysis.findings`), and the boxes themselves, so that it can be judged again by other rules. A world
is the study that `phd study` runs with the same assumptions and seed, without recordings. DIR/report is made from the
table alone. How the folder is filled, resumed and spread over workers: `experiments.study.jobs`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.files import InputError
from experiments.analysis.findings import IN_BOXES, STATEMENTS, PooledBox, box_findings, pooled_boxes, why_no_findings
from experiments.analysis.metrics import JUDGED
from experiments.analysis.trials_table import to_compare
from experiments.plan import make_plan
from experiments.progress import Progress, unseen
from experiments.protocol import Protocol
from experiments.recording.atomic_files import write_new_files
from experiments.study.jobs import Done, Work, device_texts, run_work, table_lines
from experiments.study.unrecorded import settled, study_trials
from experiments.trial.tick import TICK_S
from experiments.worlds.ranges import Ranges, Value
from experiments.worlds.report import report_files

KIND, REPORT = "worlds", "report"
MOST_WORLDS = 1_000_000
QUARTILES = PooledBox._fields


@dataclass(frozen=True)
class World:
    """One study under one set of assumptions."""

    number: int
    seed: int
    values: Mapping[str, Value]
    ranges: Ranges

    def run(self) -> Done:
        """Its row, in the order of `columns`."""
        protocol, population = self.ranges.study(self.values, self.seed)
        try:
            protocol = settled(protocol, population)
        except InputError:  # no low gain is without vibration: one cannot tell of such a world
            return Done(self._row({}, math.nan), 0)
        rows, ticks = zip(*study_trials(protocol, population, self.ranges.operators, JUDGED), strict=True)
        return Done(self._row(pooled_boxes(rows), len(to_compare(rows)) / len(rows)), sum(ticks))

    def _row(self, boxes: Mapping[tuple[str, str, int], PooledBox], share_done: float) -> bytes:
        protocol = self.ranges.protocol
        found = box_findings(boxes, [device.name for device in protocol.devices])
        return table_lines([[
            self.number, self.seed, *self.values.values(), share_done, *(one.verdict for one in found),
            *(one.margin for one in found),
            *(getattr(boxes.get(cell), q, math.nan) for cell in _cells(protocol) for q in QUARTILES),
        ]])  # fmt: skip


def _cells(protocol: Protocol) -> list[tuple[str, str, int]]:
    return [(m, device.name, k) for m in IN_BOXES for device in protocol.devices for k in protocol.controllers]


def columns(ranges: Ranges) -> tuple[str, ...]:
    """Of worlds.csv."""
    numbers = [statement.number for statement in STATEMENTS]
    quartiles = [":".join(map(str, (*cell, q))) for cell in _cells(ranges.protocol) for q in QUARTILES]
    about = "world", "seed", *ranges.ranges, "share_done"
    return (*about, *(f"statement_{n}" for n in numbers), *(f"margin_{n}" for n in numbers), *quartiles)


def worlds_of(ranges: Ranges, n: int, seed: int) -> list[World]:
    """The worlds that are drawn from the ranges; each has a seed of its own, for its people and its order of trials."""
    shares = ranges.drawn(n, seed)
    seeds = np.random.SeedSequence(seed).generate_state(n)
    return [World(i + 1, int(seeds[i]), ranges.values(shares[i]), ranges) for i in range(n)]


def run_worlds(
    ranges: Ranges,
    out: Path,
    n: int,
    seed: int = 1,
    resume: bool = False,
    cluster: str | None = None,
    progress: Progress = unseen,
) -> dict:
    """Run the worlds that are not done yet, write the table and the report; the summary. As `run_work`."""
    if reason := why_no_findings(ranges.protocol.controllers):
        raise InputError(f"worlds {ranges.name}: {reason}")
    if n > MOST_WORLDS:
        raise InputError(f"--n: at most {MOST_WORLDS} worlds, not {n}")
    texts = {"ranges": ranges.text, "protocol": ranges.protocol.text, "n": str(n), "seed": str(seed)}
    texts |= {f"population {name}": text for name, text in ranges.populations.items()}
    texts |= device_texts(ranges.protocol.devices)
    work = Work(KIND, ranges.name, texts, columns(ranges), worlds_of(ranges, n, seed))
    finished = run_work(work, Path(out), resume, cluster, progress)
    report = Path(out) / REPORT
    files, found = report_files(finished.table, ranges, seed)
    if not report.exists():
        write_new_files({report / name: content for name, content in files.items()})
    trials = n * ranges.operators * len(make_plan(ranges.protocol, "01"))
    new = trials * (n - finished.already_done) // n
    return {
        "out": str(finished.table),
        "report": str(report / "report.md"),
        **found,
        "worlds": n,
        "already_done": finished.already_done,
        "trials": trials,
        "trials_per_s": new / finished.wall_s,
        "simulated_s": finished.ticks * TICK_S,
        "wall_s": finished.wall_s,
    }
