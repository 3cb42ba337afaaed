"""A trial on a device with a castor in place of brakes (core/cobot.py: unicycle): stages of the tick, and its start.

The handle is a point mass, with the arm's mass on it; the linkage carries the sensors alone. Outside the movement, in a
gap and without control the castor turns freely; else it is steered along the desired direction of the velocity field.
"""

import math

import numpy as np

from core import tick_log as log
from core.cobot import UNSTEERED, advance, path_goal, place, velocity
from core.control.algorithm import STEER
from core.control.velocity_field import Field
from core.device import Device
from core.device_file import Castor
from core.kernels import kernel
from core.simulator.hand import hand_force
from core.simulator.stick_slip_mode import update_kinematics
from core.stops import stop_gap
from core.tick_log import TICK_S
from experiments.numbers import significant


def set_castor(cobot: np.record, device: Device, tip: np.ndarray, arm_kg: float) -> None:
    """The castor of a trial that begins with this tip (4,), m, m/s: along the motion, at rest along x (our choice)."""
    assert device.castor is not None
    mass = device.mechanism.tip_mass + arm_kg
    place(cobot, ((0.0, 0.0),), mass, 1.0, device.castor.steering_rate_max_rad_s, (tip[0], tip[1], 0.0))
    speed = math.hypot(tip[2], tip[3])
    if speed > 0.0:
        along = tip[2:] / speed
        cobot["twist"][:2], cobot["axis"][0], cobot["speed"] = along / math.sqrt(mass), along, speed * math.sqrt(mass)


def skid_warnings(cobot: np.record, castor: Castor) -> list[str]:
    """Why the motion of a trial may be wrong: its wheel held more than its grip. None where it did not."""
    held = float(cobot["side_force"])
    if held <= castor.grip_N:
        return []
    return [f"the castor held {significant(held)} N sideways, more than its grip of {castor.grip_N:g} N: it would skid"]


@kernel
def turn_castor(hand, state, run, t, row):
    """Stage, in place of SETTLE: the castor's step from t on is taken; acceleration and sensed force follow from it.

    Returns the hand's work, J.
    """
    cobot, tip, arm_kg = run.cobot, state.tip, hand.grips[0].mass
    fx, fy = hand_force(hand, t, tip[0], tip[1], tip[2], tip[3])
    before, force, steered, goal = cobot.work, (fx, fy, 0.0), 0, UNSTEERED
    if run.decision == STEER:
        t_x, t_y, beta_x, beta_y = row[log.FORWARD_X], row[log.FORWARD_Y], row[log.DESIRED_X], row[log.DESIRED_Y]
        field = Field(0.0, t_x, t_y, 0.0, 0.0, beta_x, beta_y)
        steered, goal = 1, path_goal(cobot, field, force, 0.0, 1.0, TICK_S)
    advance(cobot, force, steered, goal, TICK_S)
    vx, vy, _ = velocity(cobot)
    state.acceleration[0], state.acceleration[1] = (vx - tip[2]) / TICK_S, (vy - tip[3]) / TICK_S
    state.hand_force[0] = fx - arm_kg * state.acceleration[0]
    state.hand_force[1] = fy - arm_kg * state.acceleration[1]
    return cobot.work - before


@kernel
def move_with_castor(mechanism, data, cobot, work):
    """Stage, in place of STEP: the tip is where the castor has rolled to.

    A step that would leave the workspace is not made: the handle stands, and its energy is lost at the stop.
    work: of the hand in the step, J.
    """
    state, scratch, tip, arm_kg = data.state, data.scratch, data.state.tip, data.hand.grips[0].mass
    square = tip[2] * tip[2] + tip[3] * tip[3]
    gap = scratch.gap
    stop_gap(mechanism, state.distal_side, cobot.pose[0], cobot.pose[1], scratch.theta, gap, scratch.gap_side)
    if min(gap[0], gap[1], gap[2], gap[3], gap[4]) < 0.0:
        cobot.pose[0], cobot.pose[1], cobot.speed = tip[0], tip[1], 0.0
        cobot.work -= work
        state.lost_at_stops += 0.5 * (cobot.mass - arm_kg) * square
        tip[2] = tip[3] = 0.0
    else:
        vx, vy, _ = velocity(cobot)
        state.work_hand += work - 0.5 * arm_kg * (vx * vx + vy * vy - square)
        tip[0], tip[1], tip[2], tip[3] = cobot.pose[0], cobot.pose[1], vx, vy
    update_kinematics(mechanism, state)
    state.steps += 1
