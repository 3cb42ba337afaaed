"""Compiled loops that `phd bench` times. In a file of their own, so that changes elsewhere compile no kernel anew."""

from core.control.controllers import decide
from core.dynamics import motion
from core.kernel import kernel
from core.simulator.event import accept
from core.simulator.event_location import first_event
from core.simulator.runge_kutta import rk4
from core.simulator.stick_slip import solve_mass
from experiments.trial.operator import operate
from experiments.trial.tick import log_row


@kernel
def accelerations(mechanisms, torque, x, y, vx, vy, count):
    """`count` closed-form accelerations under brake torques (4,), N m, each at a place that the last one decides.

    As in a Runge-Kutta step, where no stage can begin before the last has ended. Returns the last one's x, m/s2.
    """
    mechanism = mechanisms[0]
    px, py, ux, uy = x, y, vx, vy
    ax = 0.0
    for _ in range(count):
        q = motion(mechanism, px, py, ux, uy)
        p, r = q.arm_1, q.arm_2
        fx = torque[0] * p.base_x + torque[1] * p.elbow_x + torque[2] * r.base_x + torque[3] * r.elbow_x - q.bias_x
        fy = torque[0] * p.base_y + torque[1] * p.elbow_y + torque[2] * r.base_y + torque[3] * r.elbow_y - q.bias_y
        ax, ay = solve_mass(q.mass_xx, q.mass_xy, q.mass_yy, fx, fy)
        px, py, ux, uy = x + 1e-6 * ax, y + 1e-6 * ay, vx + 1e-6 * ax, vy + 1e-6 * ay
    return ax


@kernel
def smooth_steps(mechanisms, brake_records, hand, states, scratches, step, lagged, count):
    """`count` trial steps of RK4 from one state."""
    total = 0.0
    for k in range(count):
        rk4(mechanisms[0], brake_records[0], hand, states[0], scratches[0], k * step, step, lagged)
        total += scratches[0].tip[0]
    return total


@kernel
def looks_for_events(mechanisms, brake_records, states, scratches, step, lagged, count):
    """`count` looks for events inside one and the same trial step."""
    total = 0
    for _ in range(count):
        scratches[0].seen = 0
        total += first_event(mechanisms[0], brake_records[0], states[0], scratches[0], step, lagged)[0]
    return total


@kernel
def acceptances(mechanisms, brake_records, states, scratches, step, lagged, count):
    """`count` times one trial step is taken as the new state."""
    for _ in range(count):
        accept(mechanisms[0], brake_records[0], states[0], scratches[0], step, lagged)


@kernel
def decisions(controller, brake_records, path, memory, states, runs, count):
    """`count` decisions of a controller in one state."""
    state, run = states[0], runs[0]
    tip, total = state.tip, 0
    for _ in range(count):
        total += decide(
            controller, brake_records[0], path, memory, tip[0], tip[1], tip[2], tip[3],
            state.hand_force[0], state.hand_force[1], state.g, state.mass, run.current,
        )[0]  # fmt: skip
    return total


@kernel
def operations(operators, hand, path, runs, states, noise, count):
    """`count` ticks of the simulated operator in one state of the device."""
    tip = states[0].tip
    for k in range(count):
        operate(operators[0], hand.grips[0], path, runs[0].phase, runs[0].tick + k, runs[0].phase_tick + k,
                tip[0], tip[1], noise)  # fmt: skip


@kernel
def log_rows(mechanisms, brake_records, states, hand, runs, rows, count):
    """`count` rows of the log."""
    for k in range(count):
        row = rows[k % rows.shape[0]]
        log_row(mechanisms[0], brake_records[0], states[0], hand.grips[0], runs[0], k * 1e-3, row)
