"""PHD_PLAIN_NUMBA=1: without our compiler numba makes the same numbers, so that it can be dropped."""

import contextlib
import io
import os
import subprocess
import sys

#: Equations of motion and the exact solver of stick and slip, at random states: what every step is made of.
NUMBERS = """
import numpy as np
from core.device import load_device
from core.simulator.state import new_body, pack_mechanism
from core.simulator.stick_slip import Joints, solve_at_rest
from core.simulator.stick_slip_mode import update_kinematics

rng, mechanism = np.random.default_rng(1), pack_mechanism(load_device("four-brake").mechanism)[0]
body, sign = new_body(0.0, 0.4)[0], np.zeros(7)
for _ in range(2000):
    body.tip[:] = *rng.uniform((-0.1, 0.3), (0.1, 0.45)), *rng.normal(size=2)
    update_kinematics(mechanism, body)
    joints = Joints(body.g, np.ones(7, np.int64), *rng.uniform(0.0, 1.0, (2, 7)), 0)
    held, *acceleration = solve_at_rest(joints, tuple(body.mass), tuple(rng.normal(scale=8.0, size=2)), sign)
    print(held, *(float(x).hex() for x in (*body.rate, *body.bias, *body.bias_force, *acceleration)))
print(type(solve_at_rest.entry).__module__.split(".")[0])
"""


def test_plain_numba_makes_the_same_numbers_to_the_last_bit() -> None:
    with contextlib.redirect_stdout(io.StringIO()) as said:
        exec(NUMBERS, {})
    done = subprocess.run(
        [sys.executable, "-c", NUMBERS],
        env={**os.environ, "PHD_PLAIN_NUMBA": "1"}, capture_output=True, text=True, timeout=850,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    ours, plain = said.getvalue().splitlines(), done.stdout.splitlines()
    assert (ours.pop(), plain.pop()) == ("core", "numba")
    assert ours == plain and len({line.split()[0] for line in ours}) > 1, "it sticks and slips"
