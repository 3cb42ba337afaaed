"""`python -m tests.benchmarks.plain_numba`: what our compiler of kernels (`core/kernels`) gains over plain numba, and
that both make the same ticks to the last bit.

Once both ratios are near 1, numba has caught up and `core/kernels/compiler.py` can go. Each side compiles in a new
process with an empty cache, all that the set-up compiles; then both run the same trials in turn.
"""

import os
import subprocess
import sys
import tempfile

COMPILE = """
import time
from app import compile_kernels as set_up
start = time.process_time()
set_up.compile_trials()
set_up.compile_scene()
set_up.compile_loop()
print(time.process_time() - start)
"""
TRIALS = """
import hashlib, sys, time
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.study.unrecorded import person_of, run_trial, switched_on, trial_of
from experiments.trial.population import load_population
protocol, person, least = load_protocol(), person_of(load_population(), 1, 1), float("inf")
ticks = hashlib.sha256()
for _ in range(20):
    spent = 0.0
    for device in protocol.devices:
        for number, preset in protocol.controllers.items():
            planned = PlannedTrial(1, 1, device.name, number, 1, 1)
            trial = trial_of(protocol, person, 1, planned, switched_on(device, protocol), preset)
            start = time.process_time()
            rows = run_trial(trial)
            spent += time.process_time() - start
            ticks.update(rows.tobytes())
    least = min(least, spent)
print(least, ticks.hexdigest())
"""
ROUNDS = 3
SIDES = {"ours": "0", "plain numba": "1"}


def printed(code: str, plain: str, cache: str) -> list[str]:
    """What a new process prints: seconds of a processor, and of trials a checksum of their ticks."""
    environment = {**os.environ, "PHD_PLAIN_NUMBA": plain, "XDG_CACHE_HOME": cache}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, check=True, text=True)
    return done.stdout.split()


def main() -> None:
    """Print both times of both sides, and their ratios."""
    with tempfile.TemporaryDirectory() as folder:
        caches = {side: os.path.join(folder, plain) for side, plain in SIDES.items()}
        compiled = {side: float(printed(COMPILE, plain, caches[side])[0]) for side, plain in SIDES.items()}
        runs = [{side: printed(TRIALS, plain, caches[side]) for side, plain in SIDES.items()} for _ in range(ROUNDS)]
    assert len({digest for run in runs for _, digest in run.values()}) == 1, "other ticks"
    trials = {side: min(float(run[side][0]) for run in runs) for side in SIDES}
    for what, found in (("compile all that the set-up does", compiled), ("ten trials", trials)):
        ours, plain = (found[side] for side in SIDES)
        print(f"{what}: ours {ours:.3g} s, plain numba {plain:.3g} s of a processor, {plain / ours:.2f} times as much")


if __name__ == "__main__":
    main()
