"""Which joint each brake's current resists, how much and how soon, while a hand moves the handle in circles.

A brake of torque y at joint j takes g_j y sign(g_j . v) of hand force (g_j: row of Eqs. (7) and (8)). With the
currents on and off by turns, least squares gives the torque, at least 0, that the current of each brake adds at each
joint:

    F = sum_j s_j g_j (off_j + u_jk added_k) + M a,    s_j = sign(g_j . v),
    u_jk = 1 while brake k has current and if it resists at joint j.
"""

import contextlib
import math
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from core.brake import time_constant, torque_gain
from core.files import InputError
from core.linkage import tip_force_map
from core.mechanism import JOINTS
from core.simulator.state import pack_brakes, pack_mechanism
from experiments.bring_up.step import SHARE, Finding, Observed
from experiments.identify.step_response import COLUMNS, Step
from experiments.identify.two_currents import identify_two_currents, summary_of

HALF_S, TIMES = 1.03, 3  # on, then off, so often for each brake; about half a circle, which turns each joint
LASTS_S = 4 * TIMES * 2.0 * HALF_S
NONE = -1  # no brake has current
LATE_ROWS = 7  # velocity and acceleration of a sample are those of so many ms before (half of the motion filter)
SETTLED_S = 0.1  # after a switch, the torque is taken for steady
SLOWEST = 0.1  # rad/s: below it, near a reversal, play and creep hide the sign
EVERY = 4  # rows are used, of 1 kHz
TRANSIENT_S = 0.3
#: The share of the model's torque that counts as the brake's; the models are assumed, so it is wide. Our choice
LEAST, MOST = 0.4, 2.5
ENOUGH_ROWS = 400


class Motion(NamedTuple):
    """The rows of the step as arrays: force and motion of the same moment."""

    t: np.ndarray  # (n,) s
    g: np.ndarray  # (n, 4, 2) 1/m
    rates: np.ndarray  # (n, 4) rad/s
    force: np.ndarray  # (n, 2) N
    acceleration: np.ndarray  # (n, 2) m/s2
    on: np.ndarray  # (n,) index of the brake that has current, or NONE
    since_s: np.ndarray  # (n,) since the currents changed


def motion_of(observed: Observed) -> Motion:
    """The rows as arrays, velocity and acceleration shifted to the moment of the force."""
    late = LATE_ROWS
    t = 1e-6 * observed.column("board_us").astype(float)[:-late]
    tip, force = observed.column("tip")[:-late], observed.column("hand_force")[:-late]
    velocity, acceleration = observed.column("velocity")[late:], observed.column("acceleration")[late:]
    asked = np.array([row.asked for row in observed.rows])[:-late]
    on = np.where(asked.any(axis=1), asked.argmax(axis=1), NONE)
    changes = np.concatenate([[0], np.flatnonzero(np.diff(on)) + 1])
    since = t - t[changes[np.searchsorted(changes, np.arange(len(t)), side="right") - 1]]
    mechanism, g = pack_mechanism(observed.device.mechanism)[0], np.empty((len(t), 4, 2))
    for row, (x, y) in zip(g, tip.tolist(), strict=True):
        tip_force_map(mechanism, x, y, row)
    rates = np.einsum("njk,nk->nj", g, velocity)
    return Motion(t, g, rates, force, acceleration, on, since)


def inertia_columns(acceleration: np.ndarray) -> np.ndarray:
    """(n, 2, 3): M a for M = ((m0, m1), (m1, m2)), by column."""
    columns = np.zeros((len(acceleration), 2, 3))
    columns[:, 0, 0], columns[:, 0, 1] = acceleration[:, 0], acceleration[:, 1]
    columns[:, 1, 1], columns[:, 1, 2] = acceleration[:, 0], acceleration[:, 1]
    return columns


class Torques(NamedTuple):
    """The fit."""

    joints: list[int]  # of each brake, where its current resists most likely
    added: np.ndarray  # (brakes,) N m, there
    own: np.ndarray  # (brakes,) N m, if it resists at its own joint
    off: np.ndarray  # (brakes,) N m, without current
    mass: np.ndarray  # (3,) kg
    rows: int


def fit_torques(motion: Motion, braked: list[int]) -> Torques:
    """Fit the torques of all brakes; each brake's joint is the one that leaves least of the force unexplained.

    Our choice: one joint for each brake, since the pulls of four joints are nearly those of any two.
    """
    moving = np.all(np.abs(motion.rates[:, braked]) > SLOWEST, axis=1) & (motion.since_s > SETTLED_S)
    used = np.flatnonzero(moving)[::EVERY]
    pulls = np.sign(motion.rates[used])[:, :, None] * motion.g[used]  # (m, 4, 2) N for 1 N m
    pulls = pulls[:, braked].transpose(0, 2, 1)  # (m, 2, brakes)
    n, on = len(braked), motion.on[used]
    torques = Torques([], np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(3), len(used))
    if len(used) < ENOUGH_ROWS:
        return torques
    plain = np.concatenate([pulls, inertia_columns(motion.acceleration[used])], axis=2)
    least = np.append(np.zeros(n), [0.0, -np.inf, 0.0])  # friction never drives; neither mass is negative
    base = lsq_linear(*_flat(plain, motion.force[used], on == NONE), (least, np.inf)).x
    torques = torques._replace(off=base[:n], mass=base[n:])
    for place, k in enumerate(braked):
        observed = (on == k) | (on == NONE)
        fits = []
        for j in range(n):
            design = np.concatenate([plain, (pulls[:, :, j] * (on == k)[:, None])[:, :, None]], axis=2)
            fit = lsq_linear(*_flat(design, motion.force[used], observed), (np.append(least, 0.0), np.inf))
            fits.append((fit.cost, j, fit.x[-1]))
        _, j, torques.added[place] = min(fits)
        torques.joints.append(braked[j])
        torques.own[place] = fits[place][2]
    return torques


def _flat(design: np.ndarray, force: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return design[rows].reshape(-1, design.shape[2]), force[rows].reshape(-1)


def steps_of(motion: Motion, torques: Torques, braked: list[int], k: int, level: float) -> list[Step]:
    """The torque (N m) of brake k after each change of its current, where its joint turned one way all the while."""
    rest = motion.force - np.einsum("nkm,m->nk", inertia_columns(motion.acceleration), torques.mass)
    for place, j in enumerate(braked):
        rest = rest - (np.sign(motion.rates[:, j]) * torques.off[place])[:, None] * motion.g[:, j]
    g = motion.g[:, k]
    torque = np.sign(motion.rates[:, k]) * np.einsum("nk,nk->n", rest, g) / np.einsum("nk,nk->n", g, g)
    steps = []
    for begin in np.flatnonzero((motion.on[1:] == k) ^ (motion.on[:-1] == k)) + 1:
        part = slice(begin, begin + round(1e3 * TRANSIENT_S))
        rates = motion.rates[part, k]
        if len(rates) == round(1e3 * TRANSIENT_S) and np.abs(rates).min() > SLOWEST and np.ptp(np.sign(rates)) == 0.0:
            rpm = 30.0 / math.pi * float(np.abs(rates).mean())
            currents = (0.0, level) if motion.on[begin] == k else (level, 0.0)
            steps.append(Step(*currents, round(rpm, 1), motion.t[part] - motion.t[begin], torque[part]))
    return steps


def steps_text(steps: list[Step]) -> str:
    """The steps as a file for `phd identify`; "": none."""
    rows = [
        (f"{t:.3f}", f"{step.current_from:g}", f"{step.current_to:g}", step.speed_rpm, f"{torque:.5f}", number)
        for number, step in enumerate(steps)
        for t, torque in zip(step.t.tolist(), step.torque.tolist(), strict=True)
    ]
    return "".join(",".join(map(str, row)) + "\n" for row in (COLUMNS, *rows)) if rows else ""


def judge_brakes(observed: Observed) -> Finding:
    """Every brake resists at its own joint, about as much as its model says."""
    motion, braked = motion_of(observed), observed.braked
    torques = fit_torques(motion, braked)
    if torques.rows < ENOUGH_ROWS:
        advice = "Repeat: move the handle in circles of 8 cm all the time, one in two seconds."
        return Finding(False, "the handle hardly moved", advice)
    record = pack_brakes(observed.device.brakes, backlash=False)[0]
    figures: dict[str, Any] = {"off_N_m": torques.off.tolist()}
    words, wrong, tables = [], [], {}
    for place, k in enumerate(braked):
        joint, level = JOINTS[k], SHARE * float(observed.largest[k])
        model = float(torque_gain(record, k, level) - torque_gain(record, k, 0.0))
        added = float(torques.own[place])
        steps = steps_of(motion, torques, braked, k, level)
        tables[joint] = steps_text(steps)
        about = {"added_N_m": added, "model_N_m": model, "steps": len(steps), "resists": JOINTS[torques.joints[place]]}
        words.append(f"{joint} {added:.2f} N m (model {model:.2f})")
        if rises := [step for step in steps if step.rising]:
            rate = math.pi / 30.0 * float(np.mean([step.speed_rpm for step in rises]))
            about["model_rise_s"] = float(time_constant(record, k, level, rate, True))
        with contextlib.suppress(InputError):  # no steps both ways, or no torque: `added_N_m` says so
            about["identified"] = summary_of(identify_two_currents(steps, joint))["numbers"]
        figures[joint] = about
        strongest = JOINTS[torques.joints[place]]
        if strongest != joint and torques.added[place] > LEAST * model:
            wrong.append(f"Current for {joint} brakes {strongest}: exchange the plugs of these brakes.")
        elif not LEAST * model < added < MOST * model:
            wrong.append(f"Look at brake {joint}: its clamp, its coil, and the brake file of the device.")
    figures["steps"] = tables
    return Finding(not wrong, "10 % add " + ", ".join(words), " ".join(wrong), figures)
