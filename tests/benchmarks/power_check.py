"""At the number of people that `phd power` names, how many of 500 simulated studies find the difference?

    python -m tests.benchmarks.power_check

New people, measured and tested as `phd analyze` does it. About five minutes on two quiet cores.
"""

import argparse

from experiments.analysis.statistics import by_configuration, pairs
from experiments.analysis.trials_table import to_compare
from experiments.protocol import load_protocol
from experiments.study.power import answers, question_of, simulated_trials
from experiments.trial.population import load_population
from experiments.worlds.pictures import wilson

POWER = 0.8


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--protocol", default="paper")
    parser.add_argument("--between", nargs=2, default=("1", "2"))
    parser.add_argument("--measure", default="path_error_m")
    parser.add_argument("--population", default="average")
    parser.add_argument("--people", type=int, default=100)
    parser.add_argument("--studies", type=int, default=500)
    args = parser.parse_args()
    protocol, population = load_protocol(args.protocol, seed=1), load_population(args.population)
    asked = question_of(protocol, args.between, args.measure, POWER)
    rows = simulated_trials(protocol, population, args.people, asked.measure)
    (answer, *_) = answers(rows, population.name, protocol, asked)
    print(answer.words)
    n = answer.needed.people
    assert n is not None, "no number to check"
    others = load_protocol(args.protocol, seed=2)
    new = to_compare(simulated_trials(others, population, n * args.studies, asked.measure))
    wanted = {str(number) for number, preset in protocol.controllers.items() if preset in (asked.first, asked.second)}
    found = 0
    for study in range(args.studies):
        labels = {f"{one:02d}" for one in range(study * n + 1, (study + 1) * n + 1)}
        table = dict(by_configuration([row for row in new if row.participant in labels], asked.measure.name))
        results = pairs(asked.measure.name, answer.configuration, table[answer.configuration])
        found += any(
            {one.first, one.second} == wanted and one.p_holm is not None and one.p_holm < 0.05 for one in results
        )
    low, high = wilson(found, args.studies)
    print(f"{args.studies} new studies of {n} people: {found / args.studies:.3f} find it ({low:.3f} to {high:.3f})")


if __name__ == "__main__":
    main()
