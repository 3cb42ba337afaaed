"""The decisions of a recorded trial once more, from its rows alone: SENSE and DECIDE of the tick, nothing simulated."""

from typing import NamedTuple

import numpy as np

from core.control.algorithm import Tick
from core.control.controllers import decide
from core.control.velocity_field import WANTED, seen_in
from core.kernels import kernel
from core.simulator.stick_slip_mode import update_kinematics
from experiments.trial.encoder_sensing import see


class Decisions(NamedTuple):
    """The inputs of a controller in the ticks of a trial, and its decisions."""

    given: np.ndarray  # (n, 8): tip (m), its velocity (m/s), the hand force and the force to be shown (N)
    taken: np.ndarray  # (n,): the ticks whose decision was taken
    memory: np.ndarray  # of the controller
    codes: np.ndarray  # (n,), filled where the decision was taken
    currents: np.ndarray  # (n, 4) A, likewise


@kernel
def decide_again(controller, path, model, bodies, sensing, decisions):
    """Fill in the decisions of a trial from its rows alone, from the first tick on; bodies: one BODY, work space."""
    mechanism, body, sensors, memory = model.mechanism[0], bodies[0], sensing.sensors[0], decisions.memory
    for n in range(decisions.given.shape[0]):
        given, seen = decisions.given[n], body
        for i in range(4):
            body.tip[i] = given[i]
        update_kinematics(mechanism, body)
        if sensors.on != 0:
            seen = sensing.seen[0]
            see(mechanism, body, sensors, seen)
        if decisions.taken[n]:
            memory[WANTED], memory[WANTED + 1] = given[6], given[7]
            sensed = seen_in(seen.tip, given[4:6])
            tick = Tick(sensed, seen.g, seen.mass, model.brakes[0], memory, decisions.currents[n])
            decisions.codes[n] = decide(controller, path, tick)[0]
