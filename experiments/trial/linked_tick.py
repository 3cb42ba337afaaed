"""One tick of a trial on a device on the bench: what was sensed comes in a row of the log, the rest of it is written.

    phase    approach -> hold -> move -> end, as on the simulated device (`tick.next_phase`)
    astray   currents that are measured and were not asked for, or the other way round
    guard    limits of place and speed, and the release of a trapped hand
    decide   the same controllers, on the newest sample alone: what came late is recorded and decides nothing
    ledger   energies as well as sensors and brake model tell: an estimate, unlike the simulated device's

The brakes' torques cannot be sensed. The column is an estimate: what the brake model (Eqs. 1, 2 and 4, without
backlash) says that a brake does at the measured current while its joint turns; 0 while the joint rests, for what a
resting brake holds is not known.
"""

import math

import numpy as np

from core.brake import begin_lag, lagged_yield
from core.control.algorithm import OFF, release
from core.control.controllers import decide
from core.kernel import kernel
from core.simulator.simulation import kinetic
from core.simulator.stick_slip_mode import look
from core.stops import stop_gap
from core.tick_log import (
    CURRENT,
    DECIDED,
    DECISION,
    END,
    ENERGY_BRAKES,
    ENERGY_HAND,
    ENERGY_KINETIC,
    ENERGY_STOPS,
    HAND_FX,
    HAND_FY,
    MEASURED,
    MOVE,
    PHASE,
    SENSED_FX,
    SENSED_FY,
    STUCK,
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
from experiments.trial.operator import TICK_S
from experiments.trial.tick import ABORTED, enter, next_phase

#: why a trial on the bench was aborted, after those of `tick`
OUT_OF_PLACE, TOO_FAST, TRAPPED, ASTRAY = 10, 11, 12, 13
REASONS = {
    OUT_OF_PLACE: "the handle was where the device file says it cannot be: check the homing",
    TOO_FAST: "the handle moved faster than {speed_max:g} m/s",
    ASTRAY: "the brakes did not get the currents that were asked for",
    TRAPPED: "a hand pushed with more than {force:g} N for {time:g} s against a full lock: the brakes let go",
}

#: rad or sine, beyond a hard stop. Our choice: a stop gives and an encoder has steps; further out the pose is wrong.
PLACE_SLACK = 0.03
#: m/s. Assumed: three times what a person does on the path; the board has a limit of its own for each joint.
SPEED_MAX_M_S = 1.5
#: rad/s. A joint that turns more slowly counts as resting, in the columns `stuck` and `torque`. Our choice: `settled`
#: has the same number, six times the noise of 20 um encoder steps.
RESTING_RAD_S = 0.02
#: A brake whose mean current over about ASTRAY_MEAN ticks differs from what it was asked to have by more than
#: ASTRAY_A + ASTRAY_SHARE of its largest for ASTRAY_TICKS on end does not obey. Assumed: ten times the noise.
ASTRAY_A, ASTRAY_SHARE, ASTRAY_TICKS, ASTRAY_MEAN = 0.1, 0.1, 200, 50

WATCH = np.dtype(
    [
        ("speed_max", "f8"),  # m/s
        ("release_force", "f8"),  # N; infinite: a trapped hand is not released
        ("release_ticks", "i8"),
        ("trapped_ticks", "i8"),  # pushed for, against a full lock; falls as fast as it rose
        ("power", "f8"),  # W, of the hand at the last tick
        ("excess", "f8", (4,)),  # A, mean of what is measured beyond what was asked for
        ("astray_ticks", "i8"),
        ("theta", "f8", (4,)),  # work space
        ("gap", "f8", (5,)),
        ("side", "f8", (5,)),
    ]
)


@kernel
def linked_tick(path, controller, mechanisms, brake_records, grips, states, watches, runs, memory, row, newest):
    """One sample: `row` (BENCH_WIDTH,) holds what was sensed and is completed. newest: 0 where another follows."""
    mechanism, brakes, grip = mechanisms[0], brake_records[0], grips[0]
    state, watch, run = states[0], watches[0], runs[0]
    take_in(mechanism, state, grip, row)
    spend(brakes, state, watch, row)
    next_phase(run, path, state, grip)
    astray(brakes, watch, run, row)
    if run.phase == MOVE:
        guard(mechanism, brakes, state, watch, run)
    row[DECIDED] = 0.0
    if run.phase != MOVE:
        release(run.current)
        run.decision = OFF
    elif newest != 0:
        row[DECIDED] = 1.0
        tip = state.tip
        run.decision = decide(
            controller, brakes, path, memory, tip[0], tip[1], tip[2], tip[3],
            state.hand_force[0], state.hand_force[1], state.g, state.mass, run.current,
        )  # fmt: skip
    complete(brakes, state, run, row)
    run.tick += 1
    run.phase_tick += 1
    if run.phase == END and run.phase_tick >= run.end_ticks:
        run.finished = 1


@kernel
def take_in(mechanism, state, grip, row):
    """Stage: what was sensed, and what follows from it by the linkage alone."""
    state.tip[0], state.tip[1], state.tip[2], state.tip[3] = row[TIP_X], row[TIP_Y], row[TIP_VX], row[TIP_VY]
    state.acceleration[0], state.acceleration[1] = row[TIP_AX], row[TIP_AY]
    state.hand_force[0], state.hand_force[1] = row[HAND_FX], row[HAND_FY]
    grip.held[0], grip.held[1] = row[HAND_FX], row[HAND_FY]
    row[SENSED_FX], row[SENSED_FY] = row[HAND_FX], row[HAND_FY]
    look(mechanism, state)


@kernel
def spend(brakes, state, watch, row):
    """Stage: the estimated ledger over the last tick, and the estimated torques."""
    power = state.hand_force[0] * state.tip[2] + state.hand_force[1] * state.tip[3]
    state.work_hand += 0.5 * (power + watch.power) * TICK_S
    watch.power = power
    for i in range(4):
        state.torque[i] = 0.0
        if brakes.present[i] == 0.0:
            continue
        current = row[MEASURED + i]
        current = min(max(current, 0.0), brakes.current_max[i]) if math.isfinite(current) else 0.0
        begin_lag(brakes, i, current, state.torque_yield[i], state.rate[i], 0.0, TICK_S, state.lag)
        state.torque_yield[i] = lagged_yield(state.lag, i, TICK_S)
        if abs(state.rate[i]) >= RESTING_RAD_S:
            state.torque[i] = -math.copysign(state.torque_yield[i], state.rate[i])
        state.heat[i] += state.torque_yield[i] * abs(state.rate[i]) * TICK_S


@kernel
def astray(brakes, watch, run, row):
    """Stage: the trial ends where a brake does not have, for a while, the current of the last decision.

    A driver that stays on, one that is dead, and a board that takes no commands are seen by nothing else.
    """
    wrong = False
    for i in range(4):
        if brakes.present[i] == 0.0 or not math.isfinite(row[MEASURED + i]):
            continue
        watch.excess[i] += (row[MEASURED + i] - run.current[i] - watch.excess[i]) / ASTRAY_MEAN
        wrong = wrong or not abs(watch.excess[i]) <= ASTRAY_A + ASTRAY_SHARE * brakes.current_max[i]
    watch.astray_ticks = watch.astray_ticks + 1 if wrong else 0
    if watch.astray_ticks >= ASTRAY_TICKS and run.phase != END:
        enter(run, END, ABORTED, ASTRAY)


@kernel
def guard(mechanism, brakes, state, watch, run):
    """Stage: while currents may flow, the trial ends, brakes off, where the device or the hand must be spared."""
    x, y, vx, vy = state.tip[0], state.tip[1], state.tip[2], state.tip[3]
    stop_gap(mechanism, state.distal_side, x, y, watch.theta, watch.gap, watch.side)
    for j in range(5):
        if not watch.gap[j] >= -PLACE_SLACK:
            enter(run, END, ABORTED, OUT_OF_PLACE)
            return
    if not math.sqrt(vx * vx + vy * vy) <= watch.speed_max:
        enter(run, END, ABORTED, TOO_FAST)
        return
    pushed = math.sqrt(state.hand_force[0] ** 2 + state.hand_force[1] ** 2) >= watch.release_force
    if pushed and full_lock(brakes, run.current):
        watch.trapped_ticks += 1
        if watch.trapped_ticks >= watch.release_ticks:
            enter(run, END, ABORTED, TRAPPED)
    elif watch.trapped_ticks > 0:
        watch.trapped_ticks -= 1


@kernel
def full_lock(brakes, current):
    """Whether every brake has all its current."""
    for i in range(4):
        if current[i] < brakes.current_max[i]:
            return False
    return True


@kernel
def complete(brakes, state, run, row):
    """Stage: the rest of the row."""
    row[T], row[PHASE], row[DECISION] = run.tick * TICK_S, run.phase, run.decision
    resting = 0
    for i in range(4):
        row[CURRENT + i], row[TORQUE + i] = run.current[i], state.torque[i]
        if brakes.present[i] != 0.0 and abs(state.rate[i]) < RESTING_RAD_S:
            resting |= 1 << i
    row[STUCK] = resting
    row[ENERGY_HAND] = state.work_hand
    row[ENERGY_BRAKES] = state.heat[0] + state.heat[1] + state.heat[2] + state.heat[3]
    row[ENERGY_KINETIC] = kinetic(state)
    row[ENERGY_STOPS] = 0.0
    row[TARGET_X], row[TARGET_Y] = state.tip[0], state.tip[1]
