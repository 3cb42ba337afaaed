"""PHD_PLAIN_NUMBA=1: without our compiler numba makes the same numbers, so that it can be dropped."""

import os
import subprocess
import sys

import pytest

TICKS = 3000
TRIAL = f"""
import hashlib
import numpy as np
from core import tick_log
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.study.unrecorded import person_of, switched_on, trial_of
from experiments.trial.population import load_population
from experiments.trial.tick import run_ticks

protocol, rows = load_protocol(), np.zeros(({TICKS}, tick_log.WIDTH))
device, person = protocol.devices[0], person_of(load_population(), 11, 1)
for number, preset in protocol.controllers.items():
    planned = PlannedTrial(1, 1, device.name, number, 1, 1)
    trial = trial_of(protocol, person, 1, planned, switched_on(device, protocol), preset)
    print(trial.run(rows), np.count_nonzero(rows[:, tick_log.PHASE] == tick_log.MOVE), hashlib.sha256(rows).hexdigest())
print(type(run_ticks.entry).__module__.split(".")[0])
"""


def trials(plain: str) -> list[str]:
    """Of the first ticks of a trial with each controller: how many, how many in motion, a checksum; whose compiler."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "0", "PHD_PLAIN_NUMBA": plain}
    done = subprocess.run([sys.executable, "-c", TRIAL], env=environment, capture_output=True, text=True, timeout=850)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.timeout(900)
def test_plain_numba_makes_the_same_ticks_to_the_last_bit() -> None:
    ours, plain = trials("0"), trials("1")
    assert (ours.pop(), plain.pop()) == ("core", "numba")
    assert ours == plain and len(ours) == 5
    assert all(int(line.split()[1]) > TICKS // 10 for line in ours)  # controllers decide only while they move
