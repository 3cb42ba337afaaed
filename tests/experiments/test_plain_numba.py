"""PHD_PLAIN_NUMBA=1: without our compiler numba makes the same numbers, so that it can be dropped.

`python tests/experiments/test_plain_numba.py` compares trials with each controller, which takes minutes to compile.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCENE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "switching.toml"
WHOSE = """
import sys
from app.cli import main
from core.simulator.simulation import run_rows
print(type(run_rows.entry).__module__.split(".")[0])
sys.exit(main(sys.argv[1:]))
"""
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


def printed(plain: str, code: str, *arguments: str) -> list[str]:
    """The lines that a process prints, with our compiler ("0") or plain numba ("1")."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "0", "PHD_PLAIN_NUMBA": plain}
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=850)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.timeout(900)
def test_plain_numba_makes_the_same_motion_to_the_last_bit(tmp_path: Path) -> None:
    files = {"core": tmp_path / "ours.csv", "numba": tmp_path / "plain.csv"}
    for plain, (whose, file) in zip("01", files.items(), strict=True):
        assert printed(plain, WHOSE, "simulate", str(SCENE), "--out", str(file))[0] == whose
    assert files["core"].read_bytes() == files["numba"].read_bytes()


def main() -> None:
    """Compare the first ticks of a trial with each controller: how many, how many in motion, a checksum."""
    ours, plain = printed("0", TRIAL), printed("1", TRIAL)
    assert (ours.pop(), plain.pop()) == ("core", "numba")
    assert ours == plain and len(ours) == 5
    assert all(int(line.split()[1]) > TICKS // 10 for line in ours)  # controllers decide only while they move


if __name__ == "__main__":
    main()
