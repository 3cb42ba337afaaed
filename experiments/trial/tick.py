"""One tick of a trial (1 kHz), for every kind of hand: simulated operator, mouse, later the force sensor of a bench.

    phase    approach -> hold -> move -> end
    hand     the operator moves its virtual hand (the mouse's target is set from outside)
    decide   the controller, during `move` only: brakes are off in every other phase
    device   currents to the brakes, the pattern of stick and slip, one row of the log, one step of the simulator
"""

import math

import numpy as np

from core.control.algorithm import OFF, release
from core.control.controllers import decide
from core.kernel import kernel
from core.path import nearest
from core.simulator.event import advance_event
from core.simulator.simulation import MR, apply, kinetic, stuck_bits
from core.simulator.state import new_record
from core.simulator.stick_slip_mode import look, resolve
from core.tick_log import (
    APPROACH,
    ARM_FORCE_MAX,
    ARM_HELD_X,
    ARM_HELD_Y,
    ARM_STIFFNESS,
    CURRENT,
    DECISION,
    END,
    ENERGY_BRAKES,
    ENERGY_HAND,
    ENERGY_KINETIC,
    ENERGY_STOPS,
    HAND_FX,
    HAND_FY,
    HOLD,
    LATENESS_US,
    MOVE,
    PHASE,
    SENSED_FX,
    SENSED_FY,
    STUCK,
    TARGET_VX,
    TARGET_VY,
    TARGET_X,
    TARGET_Y,
    TIP_AX,
    TIP_AY,
    TIP_VX,
    TIP_VY,
    TIP_X,
    TIP_Y,
    TORQUE,
    T,
)
from experiments.trial.operator import TICK_S, begin_approach, operate

RUNNING, DONE, TIMEOUT, ABORTED = range(4)
STATUSES = ("running", "done", "timeout", "aborted")

#: why a trial was aborted
NO_REASON, APPROACH_TOO_LONG, FORCE_NOT_FINITE, BY_EXPERIMENTER = range(4)
REASONS = ("", "the start was not reached in time", "the hand force was not finite", "stopped by the experimenter")

ROUNDING_M = 1e-9  # of progress at the end

RUN = np.dtype(
    [
        ("start_radius", "f8"),  # m, within which the start is held
        ("end_radius", "f8"),  # m, within which the end is reached
        ("hold_ticks", "i8"),
        ("approach_ticks", "i8"),  # longest approach
        ("move_ticks", "i8"),  # time-out
        ("end_ticks", "i8"),  # recorded after the end, brakes off
        ("simulated_hand", "i8"),  # 1: the operator drives; 0: the target is set from outside
        ("fidelity", "i8"),
        # what changes
        ("tick", "i8"),
        ("phase", "i8"),
        ("phase_tick", "i8"),
        ("status", "i8"),
        ("reason", "i8"),
        ("stop", "i8"),  # set to 1 from outside: abort
        ("held", "i8"),  # set to 0 from outside: nobody has the handle, and no start is held without a hand
        ("finished", "i8"),
        ("decision", "i8"),
        ("current", "f8", (4,)),  # A
        ("energy_zero", "f8", (3,)),  # J, ledger at the start of the trial: hand, brakes, stops
    ]
)


def new_run(fidelity: int, simulated_hand: bool) -> np.recarray:
    """A trial before its first tick. Radii and times as in DESIGN's trial; the end radius is assumed."""
    run = new_record(RUN)
    fields = dict(
        start_radius=0.003,
        end_radius=0.01,
        hold_ticks=500,
        approach_ticks=30_000 if simulated_hand else np.iinfo(np.int64).max,
        move_ticks=30_000,
        end_ticks=300,
        simulated_hand=int(simulated_hand),
        fidelity=fidelity,
        phase=APPROACH,
        held=1,
        decision=OFF,
    )
    for name, value in fields.items():
        run[name][0] = value
    return run


@kernel
def run_ticks(path, controller, mechanisms, brake_records, hand, states, trials, runs, operators, noise, memory, rows):
    """Run ticks until rows (n, row.WIDTH) are full or the trial is finished; returns how many were run."""
    mechanism, brakes, state, trial = mechanisms[0], brake_records[0], states[0], trials[0]
    run, operator, grip = runs[0], operators[0], hand.grips[0]
    for n in range(rows.shape[0]):
        if run.finished != 0:
            return n
        tip = state.tip
        if run.tick == 0:
            begin(run, state, operator, path)
        next_phase(run, path, state, grip)
        if run.simulated_hand != 0:
            operate(operator, grip, path, run.phase, run.tick, run.phase_tick, tip[0], tip[1], noise)
        if run.phase == MOVE:
            run.decision = decide(
                controller, brakes, path, memory, tip[0], tip[1], tip[2], tip[3],
                state.hand_force[0], state.hand_force[1], state.g, state.mass, run.current,
            )  # fmt: skip
        else:
            release(run.current)
            run.decision = OFF
        rows[n, SENSED_FX], rows[n, SENSED_FY] = state.hand_force[0], state.hand_force[1]
        t = run.tick * TICK_S
        apply(brakes, state, run.current, run.fidelity)
        resolve(mechanism, brakes, hand, state, t)
        log_row(mechanism, brakes, state, grip, run, t, rows[n])
        advance_event(mechanism, brakes, hand, state, trial, run.current, t, TICK_S, 1 if run.fidelity == MR else 0)
        run.tick += 1
        run.phase_tick += 1
        if run.phase == END and run.phase_tick >= run.end_ticks:
            run.finished = 1
    return rows.shape[0]


@kernel
def begin(run, state, operator, path):
    """First tick: the ledger's zero, and the operator sets out for the start."""
    run.energy_zero[0] = state.work_hand
    run.energy_zero[1] = state.heat[0] + state.heat[1] + state.heat[2] + state.heat[3]
    run.energy_zero[2] = state.lost_at_stops
    if run.simulated_hand != 0:
        begin_approach(operator, state.tip[0], state.tip[1], path)


@kernel
def next_phase(run, path, state, grip):
    """Stage: the trial's phases; a force that is not finite or a stop from outside ends it at once, brakes off."""
    x, y = state.tip[0], state.tip[1]
    if run.phase == END:
        return
    wanted = grip.target[0] + grip.target[1] + grip.target[2] + grip.target[3] + grip.held[0] + grip.held[1]
    if not math.isfinite(wanted):
        for i in range(4):
            grip.target[i] = state.tip[i] if i < 2 else 0.0
        grip.held[0] = grip.held[1] = 0.0
        enter(run, END, ABORTED, FORCE_NOT_FINITE)
        return
    if run.stop != 0:
        enter(run, END, ABORTED, BY_EXPERIMENTER)
        return
    at_start = run.held != 0 and math.hypot(x - path.x0, y - path.y0) <= run.start_radius
    if run.phase == APPROACH:
        if at_start:
            enter(run, HOLD, RUNNING, NO_REASON)
        elif run.tick >= run.approach_ticks:
            enter(run, END, ABORTED, APPROACH_TOO_LONG)
    elif run.phase == HOLD:
        if not at_start:
            enter(run, APPROACH, RUNNING, NO_REASON)
        elif run.phase_tick >= run.hold_ticks:
            enter(run, MOVE, RUNNING, NO_REASON)
    elif arrived(path, run.end_radius, x, y):
        enter(run, END, DONE, NO_REASON)
    elif run.phase_tick >= run.move_ticks:
        enter(run, END, TIMEOUT, NO_REASON)


@kernel
def arrived(path, end_radius, x, y):
    """Whether the end of the path is reached, and along the path: not near the end on another part of it."""
    if math.hypot(x - path.x1, y - path.y1) > end_radius:
        return False
    progress, _, _, _ = nearest(path, x, y)
    return progress >= path.length - end_radius - ROUNDING_M


@kernel
def enter(run, phase, status, reason):
    """Enter a phase; `end` settles the trial's status."""
    run.phase, run.phase_tick = phase, 0
    run.status, run.reason = status, reason


@kernel
def log_row(mechanism, brakes, state, grip, run, t, row):
    """Stage: one row of the log, after what happens at t; what was sensed stands in it already."""
    row[T], row[PHASE], row[DECISION] = t, run.phase, run.decision
    row[TIP_X], row[TIP_Y], row[TIP_VX], row[TIP_VY] = state.tip[0], state.tip[1], state.tip[2], state.tip[3]
    row[TIP_AX], row[TIP_AY] = state.acceleration[0], state.acceleration[1]
    row[HAND_FX], row[HAND_FY] = state.hand_force[0], state.hand_force[1]
    for i in range(4):
        row[CURRENT + i], row[TORQUE + i] = run.current[i], state.torque[i]
    row[STUCK] = stuck_bits(mechanism, brakes, state)
    row[LATENESS_US] = 0.0
    row[ENERGY_HAND] = state.work_hand - run.energy_zero[0]
    row[ENERGY_BRAKES] = state.heat[0] + state.heat[1] + state.heat[2] + state.heat[3] - run.energy_zero[1]
    row[ENERGY_KINETIC] = kinetic(state)
    row[ENERGY_STOPS] = state.lost_at_stops - run.energy_zero[2]
    row[TARGET_X], row[TARGET_Y], row[TARGET_VX], row[TARGET_VY] = (
        grip.target[0], grip.target[1], grip.target[2], grip.target[3],
    )  # fmt: skip
    row[ARM_HELD_X], row[ARM_HELD_Y], row[ARM_FORCE_MAX] = grip.held[0], grip.held[1], grip.force_max
    for i in range(3):
        row[ARM_STIFFNESS + i] = grip.stiffness[i]


@kernel
def decide_again(path, controller, mechanisms, brake_records, states, memory, given, codes, currents):
    """Decision codes (n,) and currents (n, 4), A, of the ticks of a movement, from the rows alone.

    given (n, 6): tip (m), its velocity (m/s) and the sensed hand force (N).
    """
    mechanism, brakes, state = mechanisms[0], brake_records[0], states[0]
    for n in range(given.shape[0]):
        for i in range(4):
            state.tip[i] = given[n, i]
        look(mechanism, state)
        codes[n] = decide(
            controller, brakes, path, memory, given[n, 0], given[n, 1], given[n, 2], given[n, 3], given[n, 4],
            given[n, 5], state.g, state.mass, currents[n],
        )  # fmt: skip
