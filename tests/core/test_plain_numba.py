"""PHD_PLAIN_NUMBA=1: without our compiler numba makes the same numbers, so that it can be dropped."""

import os
import subprocess
import sys

import pytest

#: The implicit steps of the simulator, with everything that they call: a fifth of what a scene compiles.
MOTION = """
import hashlib
import numpy as np
from core.device import load_device
from core.simulator.hand import wave_hand
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.state import Data, Model
from core.simulator.stepping import advance_stepping

hand = wave_hand(np.array([[15.0, 6.0, 0.0], [-10.0, 4.0, 1.5]]))
device = SimulatedDevice(load_device("four-brake"), (0.0, 0.4), hand)
m, d, tips = device.model, device.data, []
model, data = Model(m.mechanism[0], m.brakes[0], m.fidelity, m.integrator), Data(hand, *(one[0] for one in d[1:]))
for k in range(3000):
    currents = np.where(np.arange(4) == k // 50 % 5, 0.8, 0.0)
    advance_stepping(model, data, currents, 1e-3 * k, 1e-3)
    tips.append(device.body["tip"][0, :2].tolist())
left = b"".join(one.tobytes() for one in d[1:4])
print(np.ptp(tips, axis=0).min(), hashlib.sha256(left).hexdigest(), hashlib.sha256(np.array(tips)).hexdigest())
print(type(advance_stepping.entry).__module__.split(".")[0])
"""


def printed(plain: str, code: str) -> list[str]:
    """The lines that a process prints, with our compiler ("0") or plain numba ("1")."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "0", "PHD_PLAIN_NUMBA": plain}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=850)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.timeout(900)
def test_plain_numba_makes_the_same_motion_to_the_last_bit() -> None:
    ours, plain = printed("0", MOTION), printed("1", MOTION)
    assert (ours.pop(), plain.pop()) == ("core", "numba")
    assert ours == plain and float(ours[0].split()[0]) > 0.02, "m that the tip goes"
