"""The ticks of a live trial: what runs at 1 kHz, compiled, without the interpreter and without allocating.

A simulated trial is one call, `run_trial`: the tick kernel at the deadlines of the clock. A real device's samples come
by way of Python, which calls `end_early` and `put` for each.
"""

import math

from app.ipc.ring import (
    AIMS,
    BRAKES_OFF,
    END_TRIAL,
    GRASP_RADIUS_M,
    HAND_BACK,
    MOST_BEHIND_NS,
    RING_FULL,
    SERVER_SILENT,
    STOPPED,
)
from app.loop.clock import fence, native, now_ns, sleep_until
from core.kernels import kernel
from core.tick_log import END, LATENESS_US, MOVE
from experiments.trial.tick import run_ticks

TICK_NS = 1_000_000
SILENT_NS = 2_000_000_000  # a session server that has not beaten for so long is gone, not only short of processors
#: m/s, at which the hand brings a handle home that was let go. Our choice: 20 cm take a second, and the pointer can
#: still catch it (it takes hold of it within `GRASP_RADIUS_M`).
HOMEWARD_M_S = 0.2
ROOM = 1024  # ticks of the ring that are kept free: an aborted trial still ends in recorded ticks


@kernel
def take_aim(control, grip, tip, phase, force_max):
    """The newest place of the pointer is where the spring pulls to, while the pointer holds the handle.

    It takes hold by touching the handle. When it leaves its workspace it lets go: the spring has no force until the
    pointer touches the handle again. Where there is a home (see `CONTROL`) that is so in the movement alone: before
    and after it the spring goes on from where the pointer left it, and goes home; else a handle that was let go in
    mid-flight would come to rest where no pointer reaches it. force_max (N): of the spring. With another hand than the
    mouse it is the newest force.
    """
    pushed = control.push_count
    if pushed != 0:
        grip.held[0], grip.held[1] = control.pushes[(pushed - 1) % AIMS, 0], control.pushes[(pushed - 1) % AIMS, 1]
        return
    count = control.aim_count
    if count == 0 and control.astray == 0:
        return
    x = y = math.nan  # nowhere yet
    if count != 0:
        x, y = control.aims[(count - 1) % AIMS, 0], control.aims[(count - 1) % AIMS, 1]
    away_x, away_y = x - tip[0], y - tip[1]
    if count > control.stale and away_x * away_x + away_y * away_y <= GRASP_RADIUS_M * GRASP_RADIUS_M:
        control.taken, control.astray = 1, 0
    elif control.taken != 0 and not math.isfinite(away_x + away_y):
        control.taken, control.astray = 0, 1
        if phase == MOVE:
            control.let_go += 1
    if control.taken != 0:
        grip.target[0], grip.target[1], grip.target[2], grip.target[3] = x, y, 0.0, 0.0
        grip.force_max = force_max
    elif control.astray != 0 and control.comes_home != 0 and phase != MOVE:
        go_home(control.home, grip)
        grip.force_max = force_max
    else:
        grip.target[0], grip.target[1], grip.target[2], grip.target[3] = tip[0], tip[1], 0.0, 0.0
        grip.force_max = 0.0


@kernel
def go_home(home, grip):
    """Move the target of the spring a tick's way towards home (m), in a straight line."""
    way_x, way_y = home[0] - grip.target[0], home[1] - grip.target[1]
    share = min(HOMEWARD_M_S * 1e-9 * TICK_NS / max(math.sqrt(way_x * way_x + way_y * way_y), 1e-12), 1.0)
    grip.target[0] += share * way_x
    grip.target[1] += share * way_y
    grip.target[2] = grip.target[3] = 0.0


@kernel
def end_early(controls, runs, now, size):
    """End a trial that must end now (ns) at its next tick; one that has ended stays so. size: of the ring, ticks."""
    control, run = controls[0], runs[0]
    if run.stop != 0 or run.phase == END:
        return
    if control.brakes_off != 0:
        control.cause = BRAKES_OFF
    elif control.stop == END_TRIAL:
        control.cause = STOPPED
    elif now - control.server_beat > SILENT_NS:
        control.cause = SERVER_SILENT
    elif control.head - control.tail > size - ROOM:
        control.cause = RING_FULL
    else:
        return
    run.stop = 1


@native
def due(control, deadline, timer):
    """Wait for a tick's deadline (ns); how late it is, and the deadline of the next, both ns."""
    now = sleep_until(deadline, timer)
    control.loop_beat = now
    late = now - deadline
    return late, (deadline if late < MOST_BEHIND_NS else now) + TICK_NS


@native
def put(controls, ring, row):
    """Let the others see a tick, or count it where there is no room."""
    control, size = controls[0], ring.shape[0]
    if control.head - control.tail >= size:
        control.dropped += 1
        return
    place = control.head % size
    for i in range(ring.shape[1]):
        ring[place, i] = row[i]
    fence()
    control.head += 1


@native
def run_trial(controls, ring, row, timer, trial):
    """One `RunningTrial` in real time on the simulated device, to its last tick or until it is to be handed back.

    row: room for a tick.
    """
    control, run, grip, body = controls[0], trial.run[0], trial.data.hand.grips[0], trial.data.body[0]
    force_max = grip.force_max
    control.begun = deadline = now_ns(timer)
    while run.finished == 0 and control.stop != HAND_BACK:
        late, deadline = due(control, deadline, timer)
        end_early(controls, trial.run, control.loop_beat, ring.shape[0])
        if run.simulated_hand == 0:
            take_aim(control, grip, body.tip, run.phase, force_max)
            run.held = 1 if control.push_count != 0 else control.taken
        run_ticks(trial, row)
        row[0, LATENESS_US] = 1e-3 * late
        put(controls, ring, row[0])
        worked = now_ns(timer) - control.loop_beat
        control.worked += worked
        control.worked_most = max(control.worked_most, worked)
    grip.force_max = force_max


@native
def run_idle(lateness, timer):
    """The loop's deadlines with nothing to do; lateness (n,) in us."""
    deadline = now_ns(timer)
    for n in range(lateness.shape[0]):
        late = sleep_until(deadline, timer) - deadline
        lateness[n] = 1e-3 * late
        deadline += TICK_NS
