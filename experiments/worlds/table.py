"""The table of worlds: a row a study, with what was measured in each of its trials, so that it can be judged again.

    world,triple,seed,rules,..,path_error_m:three-brake:1,..
    17,2,4036,settled,..,0.00213 0.00187 nan 0.00204 ..,..

The cell of a measure, device and controller holds its trials, person by person, path by path, in the order in which
each came; "nan": the trial did not reach the end, or there was nothing to measure. A study without a low gain free of
vibration has no trials, and empty cells.
"""

import csv
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from experiments.analysis.charts import QUARTILE_METHOD
from experiments.analysis.findings import DEPENDS, HOLDS, LEAST_FINISHED, Boxes, PooledBox, box_findings
from experiments.analysis.metrics import JUDGED
from experiments.analysis.trials_table import TrialRow
from experiments.protocol import Protocol
from experiments.worlds.ranges import Ranges

DIGITS = 6  # of a measure
ABOUT = ("world", "triple", "seed")
NO_CONTROL = 1
Cell = tuple[str, str, int]  # measure, device, controller


def cells(protocol: Protocol) -> list[Cell]:
    """The cells of a row (measure, device, controller), in order."""
    return [
        (metric.name, device.name, k) for metric in JUDGED for device in protocol.devices for k in protocol.controllers
    ]


def columns(ranges: Ranges) -> tuple[str, ...]:
    """The columns of worlds.csv."""
    return (*ABOUT, *ranges.ranges, *(":".join(map(str, cell)) for cell in cells(ranges.protocol)))


def cells_of(rows: Iterable[TrialRow], protocol: Protocol) -> list[str]:
    """A study's trials as the cells of its row."""
    found: dict[Cell, list[str]] = {cell: [] for cell in cells(protocol)}
    for row in sorted(rows, key=lambda row: (row.participant, row.segment, row.repetition)):
        for metric in JUDGED:
            value = row.value(metric.name) if row.status == "done" else None
            number = math.nan if value is None else value
            found[metric.name, row.configuration, int(row.controller)].append(f"{number:.{DIGITS}g}")
    return [" ".join(texts) for texts in found.values()]


class Worlds(NamedTuple):
    """A table of worlds, read: a row a study, the triples of a world one after the other."""

    triples: int  # of each world
    seeds: np.ndarray  # (rows,)
    cells: list[Cell]
    values: np.ndarray  # (rows, cells, trials), in the order of the table; nan: missing

    def boxes(self) -> list[Boxes]:
        """The boxes of each row; none where under 90 % of the trials reached the end."""
        measured = np.isfinite(self.values)
        enough, whole = measured.mean(axis=2) >= LEAST_FINISHED, measured.all(axis=2)
        quartiles, at = np.full((3, *enough.shape), np.nan), (0.25, 0.5, 0.75)
        for some, quantile in ((whole, np.quantile), (enough & ~whole, np.nanquantile)):
            quartiles[:, some] = quantile(self.values[some], at, axis=1, method=QUARTILE_METHOD)
        return [
            {cell: PooledBox(*box) for cell, box, kept in zip(self.cells, of_row, enough_of_row, strict=True) if kept}
            for of_row, enough_of_row in zip(np.moveaxis(quartiles, 0, 2).tolist(), enough, strict=True)
        ]

    def part(self, rows: slice) -> "Worlds":
        """A table of these rows alone."""
        return self._replace(seeds=self.seeds[rows], values=self.values[rows])

    def pooled(self, triples: slice = slice(None)) -> "Worlds":
        """A row a world: all people of these triples in the same boxes."""
        n = len(self.values) // self.triples
        of_triples = self.values.reshape(n, self.triples, *self.values.shape[1:])[:, triples]
        values = np.moveaxis(of_triples, 1, 2).reshape(n, len(self.cells), -1)
        return Worlds(1, self.seeds[:: self.triples], self.cells, values)

    def without_controllers(self, groups: int, seed: int) -> "Worlds":
        """The same studies if all controllers were none: trials drawn anew from the uncontrolled ones.

        groups: people times paths, in each of which trials are drawn, the same ones for every measure. What the few
        trials of a group lack in variance about their geometric mean, n / (n - 1), is made up for.
        """
        generator, n = np.random.default_rng(seed), len(self.values)
        each = self.values.shape[2] // groups
        made = np.empty_like(self.values)
        drawn: dict[tuple[str, int], np.ndarray] = {}
        for place, (measure, device, controller) in enumerate(self.cells):
            chosen = drawn.setdefault((device, controller), generator.integers(each, size=(n, groups, each)))
            values = self.values[:, self.cells.index((measure, device, NO_CONTROL))].reshape(n, groups, each)
            middle = np.exp(np.log(values).mean(axis=2, keepdims=True))
            wider = middle * (values / middle) ** math.sqrt(each / max(each - 1, 1))
            made[:, place] = np.take_along_axis(wider, chosen, axis=2).reshape(n, -1)
        return self._replace(values=made)


def read_worlds(table: Sequence[str]) -> Worlds:
    """The lines of worlds.csv."""
    lines = csv.reader(table)
    header = next(lines)
    rows = list(lines)
    triples = max(int(row[1]) for row in rows)
    places = [i for i, name in enumerate(header) if name.count(":") == 2]
    trials = max(len(row[places[0]].split()) for row in rows)
    values = np.full((len(rows), len(places), trials), np.nan)
    for of_row, row in zip(values, rows, strict=True):
        if texts := " ".join(row[i] for i in places).split():
            of_row[:] = np.array(texts, dtype=float).reshape(of_row.shape)
    names = (header[i].split(":") for i in places)
    seeds = np.array([int(row[2]) for row in rows])
    return Worlds(triples, seeds, [(measure, device, int(k)) for measure, device, k in names], values)


class Verdicts(NamedTuple):
    """Each statement's verdict and margin by boxes; a row is a study."""

    words: np.ndarray  # (rows, statements)
    margins: np.ndarray  # (rows, statements), in units of U; nan: one cannot tell

    @property
    def holds(self) -> np.ndarray:
        return self.words == HOLDS

    @property
    def depends(self) -> np.ndarray:
        return self.words == DEPENDS

    @property
    def short(self) -> np.ndarray:
        """(rows,) How far a study is from all statements: what each lacks, summed, in units of U.

        A statement of which one cannot tell lacks 1.
        """
        return -np.minimum(np.nan_to_num(self.margins, nan=-1.0), 0.0).sum(axis=1)


def judge(worlds: Worlds, devices: Sequence[str], bands: float = 1.0) -> Verdicts:
    """Judge each row by boxes; bands: how many times as wide as the paper's judgement has them."""
    found = [box_findings(boxes, devices, bands) for boxes in worlds.boxes()]
    words, margins = ([[getattr(finding, of) for finding in row] for row in found] for of in ("verdict", "margin"))
    return Verdicts(np.array(words), np.array(margins, dtype=float))
