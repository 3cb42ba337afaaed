"""`python -m tests.benchmarks.board_bench [TRIALS]`: a session on the simulated device and over the board, and why the
two differ.

Every trial is run with the same person and the same noise: on the simulated device, and over the board with each of
`board_trials.CASES`. A difference is that of a pair; shown is the median of a configuration's and controller's pairs.
"""

import sys
from collections import defaultdict
from collections.abc import Callable, Sequence

import numpy as np

from experiments.analysis.metrics import Metrics
from experiments.plan import make_plan
from experiments.protocol import Protocol, load_protocol
from experiments.study.helpers import cores, process_pool
from experiments.trial.population import load_population
from tests.benchmarks.board_trials import ALL, CASES, Setting, on_the_board, on_the_simulated_device

PARTICIPANT = 1
AGAIN = "another trial"  # on the simulated device: how much two trials of one person differ by themselves
SHOWN = {
    "path_error_m": "path error", "mean_tip_force_N": "tip force", "acceleration_dft_sum": "DFT",
    "acceleration_weighted_rms_m_s2": "weighted rms", "sparc": "SPARC", "duration_s": "duration",
}  # fmt: skip


def run_board(trials: int | None, progress: Callable[[float], None]) -> list[dict]:
    """The first `trials` of a participant's plan (None: all); one entry for each."""
    all_settings = settings(load_protocol(low_gain=5.0, sensing="ideal"))[:trials]
    done = []
    with process_pool(min(cores(), len(all_settings))) as pool:
        for one in pool.map(compared, all_settings):
            done.append(one)
            progress(len(done) / len(all_settings))
    return done


def settings(protocol: Protocol) -> list[Setting]:
    """The trials of one participant, in order."""
    person = load_population("average").draw(np.random.default_rng([protocol.seed, PARTICIPANT]))
    return [
        Setting(protocol, protocol.device(planned.configuration), planned, person, (protocol.seed, planned.run))
        for planned in make_plan(protocol, str(PARTICIPANT))
    ]


def compared(setting: Setting) -> dict:
    """One trial in every way: the measures on the simulated device, and relative differences by case."""
    status, here = on_the_simulated_device(setting)
    ways = {case.title(): on_the_board(setting, case) for case in CASES}
    ways[AGAIN] = on_the_simulated_device(setting._replace(seed=(*setting.seed, 1)))
    planned = setting.planned
    return {
        "run": planned.run, "configuration": planned.configuration, "controller": planned.controller,
        "path": planned.segment, "status": {"simulated": status, **{way: found[0] for way, found in ways.items()}},
        "simulated": {name: here[name] for name in SHOWN},
        "difference": {way: differences(here, found[1]) for way, found in ways.items()},
    }  # fmt: skip


def differences(here: Metrics, there: Metrics) -> dict[str, float | None]:
    """Relative differences of the measures shown; None where there is nothing to compare."""
    pairs = {name: (here[name], there[name]) for name in SHOWN}
    return {name: b / a - 1.0 if a and b is not None else None for name, (a, b) in pairs.items()}


def medians(trials: Sequence[dict], way: str, absolute: bool = False) -> dict[tuple[str, int], dict[str, float]]:
    """(configuration, controller) -> measure -> median difference of the pairs, of their magnitudes if absolute."""
    pairs: dict[tuple[str, int], dict[str, list[float]]] = defaultdict(lambda: {name: [] for name in SHOWN})
    for trial in trials:
        for name, value in trial["difference"][way].items():
            if value is not None:
                pairs[trial["configuration"], trial["controller"]][name].append(abs(value) if absolute else value)
    return {
        key: {name: float(np.median(values)) for name, values in by_name.items() if values}
        for key, by_name in sorted(pairs.items())
    }


def table(trials: Sequence[dict]) -> str:
    """Everything at once for each measure, then one measure after the other by cause; %, medians of pairs."""
    whole = medians(trials, ALL.title())
    lines = [f"{len(trials)} trials; board less simulated device, same person and noise: median of pairs, %", ""]
    lines += [f"{'all effects':22}" + "".join(f"{title:>14}" for title in SHOWN.values())]
    lines += [name_of(key) + "".join(shown(found.get(name)) for name in SHOWN) for key, found in whole.items()]
    ways = [case.title() for case in CASES]
    for measure in ("path_error_m", "mean_tip_force_N", "acceleration_dft_sum"):
        lines += ["", f"{SHOWN[measure]}, by cause"]
        by_way = {way: medians(trials, way) for way in ways} | {AGAIN: medians(trials, AGAIN, absolute=True)}
        lines += [f"  {number}: {way}" for number, way in enumerate(by_way, 1)]
        lines += [f"{'':22}" + "".join(f"{number:>14}" for number in range(1, len(by_way) + 1))]
        lines += [name_of(key) + "".join(shown(found[key].get(measure)) for found in by_way.values()) for key in whole]
    unlike = [t["run"] for t in trials if len({status for way, status in t["status"].items() if way != AGAIN}) > 1]
    lines += ["", f"trials that end otherwise on the board: {', '.join(map(str, unlike)) or 'none'}"]
    return "\n".join(lines)


def name_of(key: tuple[str, int]) -> str:
    """Configuration and controller."""
    return f"{f'{key[0]}, {key[1]}':22}"


def shown(value: float | None) -> str:
    """A share in %."""
    return f"{'-':>14}" if value is None else f"{100.0 * value:>+14.1f}"


if __name__ == "__main__":
    print(table(run_board(int(sys.argv[1]) if len(sys.argv) > 1 else 60)))
