"""One tick of a trial (1 kHz): the same list of stages for every kind of hand and of device.

    SENSE    a real device's sample, which stands in the row, becomes the state; its ledger is an estimate. Of a
             simulated device with encoders: what its controller is to see
    PHASE    approach -> hold -> move -> end
    GUARD    a real device that does not obey, stands where it cannot be, moves too fast or traps a hand ends the trial
    HAND     the simulated operator moves its virtual hand (a person's pointer or force is set from outside)
    SLAVE    a teleoperated slave follows the tip, and the force that it sends arrives: `reflect` is to show it
    DECIDE   the controller, during `move` only: brakes are off in every other phase; its velocity field goes to LOG
    SETTLE   the simulated device: currents to the brakes, which of them stick and which slip
    LOG      one row
    STEP     the simulated device moves on by a tick

A simulated device passes GUARD unchanged, and SENSE, too, where its sensing is ideal: its state is the truth. A real
one passes SETTLE and STEP: its wires get the currents after the tick, and its next sample shows their effect.

The brakes' torques of a real device cannot be sensed. The column is an estimate: what the brake model (Eqs. 1, 2 and 4,
without backlash) gives for a brake at the measured current while its joint turns; 0 while the joint rests, for the
torque of a resting brake is not known.
"""

import math
from typing import NamedTuple

import numpy as np

from core import tick_log as log
from core.brake import lagged_yield, time_constant, torque_gain
from core.control.algorithm import OFF, Controller, Tick, release
from core.control.controllers import decide
from core.control.velocity_field import HOLDS, NEAREST, NO_FIELD, PIECE, SIDE, TRAVEL, WANTED, seen_in
from core.kernels import inlined, kernel
from core.kernels.by_address import FAILED
from core.mechanism import PLACES
from core.obstacles import nearest_obstacle
from core.path import Path, follow, on_piece
from core.records import new_record
from core.simulator.event import advance_event
from core.simulator.runge_kutta import kinetic
from core.simulator.simulation import apply, stuck_bits
from core.simulator.state import Data, Model, Record
from core.simulator.stick_slip_mode import resolve, update_kinematics
from core.stops import stop_gap
from core.tick_log import APPROACH, END, HOLD, MOVE, TICK_S
from experiments.protocol import TrialRules
from experiments.slave import SLAVE, follow_master, set_slave
from experiments.trial.encoder_sensing import EncoderSensing, see
from experiments.trial.operator import Moment, begin_approach, operate

RUNNING, DONE, TIMEOUT, ABORTED = range(4)
STATUSES = ("running", "done", "timeout", "aborted")

#: why a trial was aborted, as codes of `core.faults`; those from OUT_OF_PLACE to TRAPPED come from a real device
(
    NO_REASON,
    APPROACH_TOO_LONG,
    FORCE_NOT_FINITE,
    BY_EXPERIMENTER,
    OUT_OF_PLACE,
    TOO_FAST,
    DISOBEYED,
    TRAPPED,
    CONTROLLER_FAILED,
    DECISION_UNDECLARED,
) = range(10)
REASONS = (
    "",
    "start-not-reached",
    "force-not-finite",
    "",  # the reason was given with the abort
    "out-of-place",
    "too-fast",
    "disobeyed",
    "trapped",
    "controller-failed",
    "decision-undeclared",
)

#: rad or sine, beyond a hard stop. Our choice: a stop gives and an encoder has steps; further out the pose is wrong.
PLACE_SLACK = 0.03
#: m/s. Assumed: three times what a person does on the path; the board has a limit of its own for each joint.
SPEED_MAX_M_S = 1.5
#: rad/s. A joint of a real device that turns more slowly counts as resting, in the columns `stuck` and `torque`. Our
#: choice: `settled` has the same number, six times the noise of 20 um encoder steps.
RESTING_RAD_S = 0.02
#: A brake whose mean current over about DISOBEYED_MEAN ticks differs from the current that it was asked to have by more
#: than DISOBEYED_A + DISOBEYED_SHARE of its largest, for DISOBEYED_TICKS on end, does not obey. Assumed: ten times the
#: noise.
DISOBEYED_A, DISOBEYED_SHARE, DISOBEYED_TICKS, DISOBEYED_MEAN = 0.1, 0.1, 200, 50

ROUNDING_M = 1e-9  # of progress at the end
#: Our choice: a person's approach, which may take its time, ends a forgotten trial after 10 minutes.
PERSON_APPROACH_S = 600.0

#: What only the trial of a real device has.
BENCH = np.dtype(
    [
        ("release_force", "f8"),  # N; infinite: a trapped hand is not released
        ("release_ticks", "i8"),
        # what changes
        ("newest", "i8"),  # 0: another sample has come already, so that this tick is recorded and decides nothing
        ("trapped_ticks", "i8"),  # pushed for, against a full lock; falls as fast as it rose
        ("power", "f8"),  # W, of the hand at the last tick
        ("excess", "f8", (4,)),  # A, mean of the measured current less the one that was asked for
        ("disobeyed_ticks", "i8"),
    ]
)
RUN = np.dtype(
    [
        ("start_radius", "f8"),  # m, within which the start is held
        ("end_radius", "f8"),  # m, within which the end is reached
        ("hold_ticks", "i8"),
        ("approach_ticks", "i8"),  # longest approach
        ("move_ticks", "i8"),  # time-out
        ("end_ticks", "i8"),  # recorded after the end, brakes off
        ("simulated_hand", "i8"),  # 1: the operator drives; 0: the target is set from outside
        ("substeps", "i8"),  # steps of the simulated device in a tick; the controller decides once a tick all the same
        ("real", "i8"),  # 1: a real device; its rows come with its samples in them
        ("bench", BENCH),
        ("slave", SLAVE),
        # what changes
        ("tick", "i8"),
        ("phase", "i8"),
        ("phase_tick", "i8"),
        ("status", "i8"),
        ("reason", "i8"),
        ("stop", "i8"),  # set to 1 from outside: abort
        ("held", "i8"),  # set to 0 from outside: no hand is at the handle, and the start is not held
        ("finished", "i8"),
        ("decision", "i8"),
        ("current", "f8", (4,)),  # A
        ("energy_zero", "f8", (3,)),  # J, ledger at the start of the trial: hand, brakes, stops
    ]
)


def new_run(rules: TrialRules, simulated_hand: bool, real: bool = False) -> np.ndarray:
    """A trial before its first tick, by the trial rules of a protocol."""
    approach_s = rules.approach_time_out_s if simulated_hand else PERSON_APPROACH_S
    run = new_record(
        RUN,
        start_radius=rules.start_radius_m,
        end_radius=rules.end_radius_m,
        hold_ticks=round(rules.hold_s / TICK_S),
        approach_ticks=round(approach_s / TICK_S),
        move_ticks=round(rules.time_out_s / TICK_S),
        end_ticks=round(rules.end_s / TICK_S),
        simulated_hand=int(simulated_hand),
        substeps=1,
        real=int(real),
        phase=APPROACH,
        held=1,
        decision=OFF,
    )
    bench = run["bench"][0]
    bench["newest"], bench["release_force"] = 1, rules.release.force_N if rules.release else math.inf
    bench["release_ticks"] = round(rules.release.time_s / TICK_S) if rules.release else 0
    if rules.slave:
        set_slave(run["slave"][0], rules.slave)
    return run


class RunningTrial(NamedTuple):
    """A trial as the tick sees it."""

    path: Path
    way: Path  # that the simulated operator takes: the path or a detour round obstacles
    controller: Controller
    model: Model
    data: Data
    run: Record  # RUN
    operator: Record  # OPERATOR
    noise: np.ndarray  # (n, 2), standard normal draws of the operator
    memory: np.ndarray  # of the controller
    sensing: EncoderSensing


@kernel
def run_ticks(trial, rows):
    """Run ticks of a `RunningTrial` until rows are full or it is finished; returns how many were run.

    rows: (n, WIDTH), or (n, BENCH_WIDTH) of a real device, one for each sample, which stands in it already.
    """
    model, data = trial.model, trial.data
    model = Model(model.mechanism[0], model.brakes[0], model.fidelity, model.integrator)
    data = Data(data.hand, data.body[0], data.braking[0], data.ledger[0], data.scratch[0])
    trial = RunningTrial(
        trial.path, trial.way, trial.controller, model, data, trial.run[0], trial.operator[0], trial.noise,
        trial.memory, trial.sensing,
    )  # fmt: skip
    run, body, braking, memory, sensors = trial.run, data.body, data.braking, trial.memory, trial.sensing.sensors[0]
    for n in range(rows.shape[0]):
        if run.finished != 0:
            return n
        row, t = rows[n], run.tick * TICK_S
        if run.tick == 0:
            begin(trial)
        if run.real != 0:
            sense(trial, row)
        seen = body
        if sensors.on != 0:
            seen = trial.sensing.seen[0]
            see(model.mechanism, body, sensors, seen)
        next_phase(trial)
        if run.real != 0:
            guard(trial, row)
        if run.simulated_hand != 0:
            now = Moment(run.phase, run.tick, run.phase_tick)
            operate(trial.operator, data.hand.grips[0], trial.way, now, body.tip, trial.noise)
        memory[WANTED] = memory[WANTED + 1] = memory[NEAREST] = memory[NEAREST + 1] = memory[HOLDS] = math.nan
        if run.slave.on != 0:
            follow_master(run.slave, seen.tip, run.tick, memory)
        choose_currents(trial, seen, row)
        row[log.SENSED_FX], row[log.SENSED_FY] = seen.hand_force[0], seen.hand_force[1]
        if run.real == 0:
            apply(model, braking, run.current)
            resolve(model, data, t)
        log_row(trial, t, row)
        log_shown(trial, row)
        log_obstacle(trial, row)
        if run.real == 0:
            step_device(trial, t)
        run.tick += 1
        run.phase_tick += 1
        if run.phase == END and run.phase_tick >= run.end_ticks:
            run.finished = 1
    return rows.shape[0]


@kernel
def step_device(trial, t):
    """Stage STEP: from t on, in `substeps` equal steps with the tick's currents."""
    run, model, data = trial.run, trial.model, trial.data
    step = TICK_S / run.substeps
    for k in range(run.substeps):
        if k > 0:
            apply(model, data.braking, run.current)
            resolve(model, data, t + k * step)
        advance_event(model, data, run.current, t + k * step, step)


@kernel
def begin(trial):
    """First tick: the ledger's zero, and the operator sets out for the start."""
    run, body, ledger = trial.run, trial.data.body, trial.data.ledger
    run.energy_zero[0] = ledger.work_hand
    run.energy_zero[1] = ledger.heat[0] + ledger.heat[1] + ledger.heat[2] + ledger.heat[3]
    run.energy_zero[2] = ledger.lost_at_stops
    if run.simulated_hand != 0:
        begin_approach(trial.operator, body.tip[0], body.tip[1], trial.way)


@kernel
def sense(trial, row):
    """Stage: a real device's sample becomes the state, with what follows from it by linkage and brake model."""
    body, braking, ledger, grip = trial.data.body, trial.data.braking, trial.data.ledger, trial.data.hand.grips[0]
    for i in range(4):
        body.tip[i] = row[log.TIP_X + i]
    body.acceleration[0], body.acceleration[1] = row[log.TIP_AX], row[log.TIP_AY]
    body.hand_force[0], body.hand_force[1] = row[log.HAND_FX], row[log.HAND_FY]
    grip.held[0], grip.held[1] = row[log.HAND_FX], row[log.HAND_FY]
    grip.target[0], grip.target[1] = row[log.TIP_X], row[log.TIP_Y]
    update_kinematics(trial.model.mechanism, body)
    estimate_energies(trial.model.brakes, body, braking, ledger, trial.run.bench, row)


@kernel
def estimate_energies(brakes, body, braking, ledger, bench, row):
    """A real device's ledger over the last tick and its torques, estimated from sensors and brake model."""
    power = body.hand_force[0] * body.tip[2] + body.hand_force[1] * body.tip[3]
    ledger.work_hand += 0.5 * (power + bench.power) * TICK_S
    bench.power = power
    for i in range(4):
        braking.torque[i] = 0.0
        if brakes.present[i] == 0.0:
            continue
        current = row[log.MEASURED + i]
        current = min(max(current, 0.0), brakes.current_max[i]) if math.isfinite(current) else 0.0
        gain = torque_gain(brakes, i, current)
        constant = time_constant(brakes, i, current, body.rate[i], gain > braking.torque_yield[i])
        braking.torque_yield[i] = lagged_yield(gain, braking.torque_yield[i], TICK_S, constant)
        if abs(body.rate[i]) >= RESTING_RAD_S:
            braking.torque[i] = -math.copysign(braking.torque_yield[i], body.rate[i])
        ledger.heat[i] += braking.torque_yield[i] * abs(body.rate[i]) * TICK_S


@kernel
def next_phase(trial):
    """Stage: the trial's phases; a force that is not finite or a stop from outside ends it at once, brakes off."""
    run, path, body, grip = trial.run, trial.path, trial.data.body, trial.data.hand.grips[0]
    x, y = body.tip[0], body.tip[1]
    if run.phase == END:
        return
    wanted = grip.target[0] + grip.target[1] + grip.target[2] + grip.target[3] + grip.held[0] + grip.held[1]
    if not math.isfinite(wanted):
        for i in range(4):
            grip.target[i] = body.tip[i] if i < 2 else 0.0
        grip.held[0] = grip.held[1] = 0.0
        enter(run, END, ABORTED, FORCE_NOT_FINITE)
        return
    if run.stop != 0:
        enter(run, END, ABORTED, BY_EXPERIMENTER)
        return
    if run.phase == APPROACH:
        if at_start(run, path, x, y):
            enter(run, HOLD, RUNNING, NO_REASON)
        elif run.tick >= run.approach_ticks:
            enter(run, END, ABORTED, APPROACH_TOO_LONG)
    elif run.phase == HOLD:
        if not at_start(run, path, x, y):
            enter(run, APPROACH, RUNNING, NO_REASON)
        elif run.phase_tick >= run.hold_ticks:
            enter(run, MOVE, RUNNING, NO_REASON)
    elif arrived(path, int(trial.memory[PIECE]), run.end_radius, x, y):
        enter(run, END, DONE, NO_REASON)
    elif run.phase_tick >= run.move_ticks:
        enter(run, END, TIMEOUT, NO_REASON)


@kernel
def at_start(run, path, x, y):
    """Whether the handle is held at the start of the path."""
    dx, dy = x - path.x0, y - path.y0
    return run.held != 0 and dx * dx + dy * dy <= run.start_radius * run.start_radius


@kernel
def arrived(path, piece, end_radius, x, y):
    """Whether the end of the path is reached, and along the path; piece: that the tip has come to."""
    dx, dy = x - path.x1, y - path.y1
    if dx * dx + dy * dy > end_radius * end_radius:
        return False
    progress, _, _, _ = on_piece(path, follow(path, piece, x, y), x, y)
    return progress >= path.length - end_radius - ROUNDING_M


@kernel
def enter(run, phase, status, reason):
    """Enter a phase; `end` settles the trial's status."""
    run.phase, run.phase_tick = phase, 0
    run.status, run.reason = status, reason


@kernel
def guard(trial, row):
    """Stage: the trial ends, brakes off, where a real device does not obey, or it or the hand must be spared."""
    run, bench, body, brakes = trial.run, trial.run.bench, trial.data.body, trial.model.brakes
    if run.phase == END:
        return
    if disobeys(brakes, run, row):
        enter(run, END, ABORTED, DISOBEYED)
        return
    if run.phase != MOVE:  # no currents flow
        return
    x, y, vx, vy, scratch = body.tip[0], body.tip[1], body.tip[2], body.tip[3], trial.data.scratch
    stop_gap(trial.model.mechanism, body.distal_side, x, y, scratch.theta, scratch.gap, scratch.gap_side)
    for j in range(PLACES):
        if not scratch.gap[j] >= -PLACE_SLACK:
            enter(run, END, ABORTED, OUT_OF_PLACE)
            return
    if not math.sqrt(vx * vx + vy * vy) <= SPEED_MAX_M_S:
        enter(run, END, ABORTED, TOO_FAST)
        return
    pushed = math.sqrt(body.hand_force[0] ** 2 + body.hand_force[1] ** 2) >= bench.release_force
    if pushed and full_lock(brakes, run.current):
        bench.trapped_ticks += 1
        if bench.trapped_ticks >= bench.release_ticks:
            enter(run, END, ABORTED, TRAPPED)
    elif bench.trapped_ticks > 0:
        bench.trapped_ticks -= 1


@kernel
def disobeys(brakes, run, row):
    """Whether a brake has not had the current of the last decision for a while.

    A driver that stays on, one that is dead, and a board that takes no commands are seen by nothing else.
    """
    bench, wrong = run.bench, False
    for i in range(4):
        if brakes.present[i] == 0.0 or not math.isfinite(row[log.MEASURED + i]):
            continue
        bench.excess[i] += (row[log.MEASURED + i] - run.current[i] - bench.excess[i]) / DISOBEYED_MEAN
        wrong = wrong or not abs(bench.excess[i]) <= DISOBEYED_A + DISOBEYED_SHARE * brakes.current_max[i]
    bench.disobeyed_ticks = bench.disobeyed_ticks + 1 if wrong else 0
    return bench.disobeyed_ticks >= DISOBEYED_TICKS


@kernel
def full_lock(brakes, current):
    """Whether every brake has all its current."""
    for i in range(4):
        if current[i] < brakes.current_max[i]:
            return False
    return True


@inlined
def choose_currents(trial, seen, row):
    """Stage: the controller decides on the newest sample; outside the movement the brakes are off."""
    run, memory = trial.run, trial.memory
    if run.real != 0:
        row[log.DECIDED] = 1.0 if run.phase == MOVE and run.bench.newest != 0 else 0.0
    if run.phase == MOVE and run.bench.newest != 0:
        sensed = seen_in(seen.tip, seen.hand_force)
        tick = Tick(sensed, seen.g, seen.mass, trial.model.brakes, memory, run.current)
        run.decision, field = decide(trial.controller, trial.path, tick)
        if run.decision < 0:
            enter(run, END, ABORTED, CONTROLLER_FAILED if run.decision == FAILED else DECISION_UNDECLARED)
            run.decision = OFF
        log_field(field, memory, row)
    else:
        log_field(NO_FIELD, memory, row)
        if run.phase == MOVE:
            piece = follow(trial.path, int(memory[PIECE]), seen.tip[0], seen.tip[1])
            row[log.PATH_DISTANCE] = memory[TRAVEL] * on_piece(trial.path, piece, seen.tip[0], seen.tip[1])[1]
        else:
            release(run.current)
            run.decision = OFF
    row[log.TRAVEL_SENSE] = memory[TRAVEL]


@kernel
def log_field(field, memory, row):
    """Into the row: the velocity field; the distance is positive where the tip is to the left of `forward`."""
    row[log.PATH_DISTANCE] = math.copysign(field.distance, memory[TRAVEL] * memory[SIDE])
    row[log.FORWARD_X], row[log.FORWARD_Y] = field.t_x, field.t_y
    row[log.DESIRED_X], row[log.DESIRED_Y] = field.beta_x, field.beta_y


@kernel
def log_row(trial, t, row):
    """Stage: one row of the log, after the events at t; a real device's sample stands in it already."""
    run, data, grip = trial.run, trial.data, trial.data.hand.grips[0]
    body, braking, ledger = data.body, data.braking, data.ledger
    row[log.T], row[log.PHASE], row[log.DECISION] = t, run.phase, run.decision
    row[log.TIP_AX], row[log.TIP_AY] = body.acceleration[0], body.acceleration[1]
    row[log.HAND_FX], row[log.HAND_FY] = body.hand_force[0], body.hand_force[1]
    for i in range(4):
        row[log.TIP_X + i] = body.tip[i]
        row[log.CURRENT + i], row[log.TORQUE + i] = run.current[i], braking.torque[i]
    row[log.STUCK] = stuck_bits(trial.model, body, braking) if run.real == 0 else resting_bits(trial.model.brakes, body)
    row[log.ENERGY_HAND] = ledger.work_hand - run.energy_zero[0]
    row[log.ENERGY_BRAKES] = ledger.heat[0] + ledger.heat[1] + ledger.heat[2] + ledger.heat[3] - run.energy_zero[1]
    row[log.ENERGY_KINETIC] = kinetic(body)
    row[log.ENERGY_STOPS] = ledger.lost_at_stops - run.energy_zero[2]
    row[log.TARGET_X], row[log.TARGET_Y] = grip.target[0], grip.target[1]
    if run.real == 0:  # else it is how late the sample came, and the hand is a person's
        row[log.LATENESS_US] = 0.0
        row[log.TARGET_VX], row[log.TARGET_VY] = grip.target[2], grip.target[3]
        row[log.ARM_HELD_X], row[log.ARM_HELD_Y], row[log.ARM_FORCE_MAX] = grip.held[0], grip.held[1], grip.force_max
        for i in range(3):
            row[log.ARM_STIFFNESS + i] = grip.stiffness[i]


@kernel
def log_shown(trial, row):
    """Stage: into the row, the force to be shown, the nearest that brakes can exert, and theirs, Eq. (7)."""
    body, braking, slave, memory = trial.data.body, trial.data.braking, trial.run.slave, trial.memory
    row[log.SLAVE_X] = slave.place[0] if slave.on != 0 else math.nan
    row[log.SLAVE_Y] = slave.place[1] if slave.on != 0 else math.nan
    for axis in range(2):
        row[log.WANTED_FX + axis], row[log.NEAREST_FX + axis] = memory[WANTED + axis], memory[NEAREST + axis]
        row[log.SHOWN_FX + axis] = math.nan
        if math.isfinite(memory[WANTED + axis]):
            shown = 0.0
            for i in range(4):
                shown += body.g[i, axis] * braking.torque[i]
            row[log.SHOWN_FX + axis] = shown


@kernel
def log_obstacle(trial, row):
    """Stage: into the row, how far the nearest obstacle is, and whether the guard can keep the tip out of it."""
    around, tip = trial.controller.around[0], trial.data.body.tip
    row[log.GUARD_HOLDS] = trial.memory[HOLDS]
    row[log.OBSTACLE_DISTANCE] = math.nan
    if around.count > 0:
        row[log.OBSTACLE_DISTANCE] = nearest_obstacle(around.edges, around.count, tip[0], tip[1]).distance


@kernel
def resting_bits(brakes, body):
    """Which brakes of a real device rest (bit i for joint i): whether they hold is not known."""
    bits = 0
    for i in range(4):
        if brakes.present[i] != 0.0 and abs(body.rate[i]) < RESTING_RAD_S:
            bits |= 1 << i
    return bits
