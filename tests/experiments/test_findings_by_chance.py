"""The shares by chance that a report names: how often each statement holds by boxes though all controllers are none."""

import math
from dataclasses import replace

import numpy as np
from msgspec import structs

from experiments.analysis.findings import CHANCE, HOLDS, box_findings_of
from experiments.analysis.metrics import JUDGED
from experiments.analysis.trials_table import TrialRow, as_table
from experiments.protocol import load_protocol
from experiments.study.unrecorded import study_trials
from experiments.trial.population import load_population

POPULATIONS, OPERATORS, TRIPLES = ("average", "from-device"), 5, 30


def shares_of(population: str, generator: np.random.Generator) -> np.ndarray:
    """People without control; a triple is three of them, whose trials on a path change controllers at random."""
    protocol = load_protocol("paper")
    same = structs.replace(protocol, controllers=dict.fromkeys(protocol.controllers, protocol.controllers[1]))
    tasks: dict[str, dict[tuple[str, int], list[TrialRow]]] = {}
    for row, _ in study_trials(same, load_population(population), OPERATORS, JUDGED):
        tasks.setdefault(row.participant, {}).setdefault((row.configuration, row.path), []).append(row)
    held = []
    for _ in range(TRIPLES):
        rows = []
        for person in generator.choice(list(tasks), 3, replace=False):
            for task in tasks[person].values():
                controllers = generator.permutation([int(row.controller) for row in task])
                rows += [replace(row, controller=int(k)) for row, k in zip(task, controllers, strict=True)]
        held.append([finding.verdict == HOLDS for finding in box_findings_of(as_table(rows))])
    return np.mean(held, axis=0)


def test_each_statement_holds_by_chance_as_often_as_the_report_says():
    generator = np.random.default_rng(1)
    shares = np.array([shares_of(population, generator) for population in POPULATIONS])
    for (number, said), least, most in zip(CHANCE.items(), shares.min(axis=0), shares.max(axis=0), strict=True):
        for share, expected in ((least, said[0]), (most, said[1])):
            p = min(max(expected, 0.02), 0.98)
            # triples share their people, so they tell less than as many independent ones
            assert abs(share - expected) < 4.0 * math.sqrt(p * (1.0 - p) / TRIPLES) + 0.02, (number, share, said)
