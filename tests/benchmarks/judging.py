"""What the verdicts and intervals of a report are worth, by simulation; the tables stand in docs/judging.md.

`python -m tests.benchmarks.judging errors`: how often each verdict comes of a true effect, by the number of people.
`python -m tests.benchmarks.judging coverage`: how often the interval of a rank-biserial correlation holds the true one.
`python -m tests.benchmarks.judging chance`: how often each statement holds by boxes though nothing differs.
"""

import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from msgspec import structs

from experiments.analysis.findings import BELOW, ERROR, HOLDS, SIMILAR, STATEMENTS, Claim, Evidence, box_findings_of
from experiments.analysis.metrics import JUDGED
from experiments.analysis.statistics import mean_interval, rank_biserial, rank_biserial_interval
from experiments.analysis.trials_table import TrialRow
from experiments.protocol import load_protocol
from experiments.study.unrecorded import study_trials
from experiments.trial.population import load_population

PEOPLE, EFFECTS = (3, 6, 12, 30), (0.0, 0.05, 0.10, 0.20, 0.40)
DRAWS = 2000
SEED = 1
#: Standard deviations: of the true effect over people (of U); of a person's own level (of its logarithm), of a trial.
EFFECT_SPREAD, LEVEL_SPREAD, TRIAL_SPREAD = 0.10, 0.30, 0.30
TRIALS, DEVICES = 6, ("three-brake", "four-brake")
POPULATIONS, OPERATORS, TRIPLES = ("average", "from-device"), 30, 1000


def errors() -> None:
    """Each rule on one device, and on two, as a statement needs it."""
    generator = np.random.default_rng(SEED)
    for kind, rule, meaning in ((BELOW, "below", "true reduction"), (SIMILAR, "little change", "true difference")):
        print(f"\n{rule}: share that holds / does not hold / cannot tell, on one device (in brackets on two)")
        _print_row(("people", *(f"{meaning} {100 * effect:.0f} %" for effect in EFFECTS)))
        for people in PEOPLE:
            cells = []
            for effect in EFFECTS:
                answers = np.array([[_answer(kind, people, effect, generator) for _ in DEVICES] for _ in range(DRAWS)])
                both = np.where((answers < 0).any(axis=1), -1, np.where((answers > 0).all(axis=1), 1, 0))
                of_one, of_two = ([100.0 * np.mean(v == k) for k in (1, -1, 0)] for v in (answers[:, 0], both))
                cells.append(f"{_slashed(of_one)} ({_slashed(of_two)})")
            _print_row((people, *cells))


def _answer(kind: str, people: int, effect: float, generator: np.random.Generator) -> int:
    """1: the claim is met, -1: it is not, 0: one cannot tell; of so many people with six trials on either side."""
    level = np.exp(LEVEL_SPREAD * generator.normal(size=(people, 1)))
    own = 1.0 - effect - EFFECT_SPREAD * generator.normal(size=(people, 1))
    noise = np.exp(TRIAL_SPREAD * generator.normal(size=(2, people, TRIALS)) - 0.5 * TRIAL_SPREAD**2)
    first, second = (level * own * noise[0]).mean(axis=1), (level * noise[1]).mean(axis=1)
    found = mean_interval((first - second) / second.mean())
    claim = Claim(kind, ERROR, (5,), (1,), little=True)
    answer = Evidence(claim, ERROR, DEVICES, claim.matters, found=found).answer
    return {True: 1, False: -1, None: 0}[answer]


def coverage() -> None:
    """Of normal, heavy-tailed (Student's t of 3) and skewed (exponential) differences, by their shift."""
    generator = np.random.default_rng(SEED)
    draws = {
        "normal": generator.standard_normal,
        "heavy-tailed": lambda size: generator.standard_t(3, size),
        "skewed": lambda size: generator.exponential(size=size) - np.log(2.0),
    }
    _print_row(("differences", "shift", "true correlation", *(f"{people} people" for people in PEOPLE[1:])))
    for name, draw in draws.items():
        for shift in (0.0, 0.5, 1.0, 2.0):
            if name == "skewed" and shift > np.log(2.0):
                continue  # all differences are over 0
            pairs = draw((1_000_000, 2)) + shift
            both, one = (2.0 * np.mean(values > 0.0) - 1.0 for values in (pairs.sum(axis=1), pairs[:, 0]))
            cells = []
            for people in PEOPLE[1:]:
                true = ((people - 1) * both + 2.0 * one) / (people + 1)  # what the correlation is on average
                found = [rank_biserial_interval(rank_biserial(row), people) for row in draw((DRAWS, people)) + shift]
                cells.append(f"{100.0 * np.mean([low <= true <= high for low, high in found]):.1f} %")
            _print_row((name, f"{shift:g}", f"{both:.2f}", *cells))


def chance() -> None:
    """Of triples of simulated people by the paper's protocol, whose five controllers are all none.

    Thirty people are simulated; a triple is three of them, whose trials on a path change controllers at random.
    """
    generator = np.random.default_rng(SEED)
    protocol = load_protocol()
    same = structs.replace(protocol, controllers=dict.fromkeys(protocol.controllers, protocol.controllers[1]))
    shares = []
    for population in POPULATIONS:
        tasks: dict[str, dict[tuple[str, int], list[TrialRow]]] = {}
        for row, _ in study_trials(same, load_population(population), OPERATORS, JUDGED):
            tasks.setdefault(row.participant, {}).setdefault((row.configuration, row.segment), []).append(row)
        held = np.zeros(len(STATEMENTS))
        for _ in range(TRIPLES):
            triple = generator.choice(list(tasks), 3, replace=False)
            rows = [row for person in triple for task in tasks[person].values() for row in _shuffled(task, generator)]
            held += [one.verdict == HOLDS for one in box_findings_of(rows)]
        shares.append(held / TRIPLES)
        print(
            population, ", ".join(f"{s.number}: {share:.2f}" for s, share in zip(STATEMENTS, shares[-1], strict=True))
        )
    ends = zip(STATEMENTS, np.min(shares, axis=0), np.max(shares, axis=0), strict=True)
    print("CHANCE = {" + ", ".join(f"{s.number}: ({low:.2f}, {high:.2f})" for s, low, high in ends) + "}")


def _shuffled(rows: Sequence[TrialRow], generator: np.random.Generator) -> Iterable[TrialRow]:
    controllers = generator.permutation([int(row.controller) for row in rows])
    return (replace(row, controller=int(k)) for row, k in zip(rows, controllers, strict=True))


def _slashed(shares: Iterable[float]) -> str:
    return " / ".join(f"{share:.0f}" for share in shares)


def _print_row(cells: Sequence[object]) -> None:
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    {"errors": errors, "coverage": coverage, "chance": chance}[sys.argv[1]]()
