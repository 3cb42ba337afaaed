"""How far single trials move when they are simulated at a tenth of the step; docs/speed-and-error.md has the figures.

python -m tests.benchmarks.step_error [OPERATORS]     the worst trial of each controller, of the first block of each

The controller decides once a millisecond as before.
"""

import sys

from experiments.analysis.metrics import BY_NAME, DRAWN
from experiments.analysis.simulation_errors import STEP
from experiments.protocol import load_protocol
from experiments.study.unrecorded import person_of, simulation_errors
from experiments.trial.population import load_population


def main(operators: str = "10") -> None:
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


if __name__ == "__main__":
    main(*sys.argv[1:])
