"""The ticks of a live trial: what runs at 1 kHz, compiled, without the interpreter and without allocating.

where a tick comes from   the simulated device: `run_ticks` writes one row (a board would exchange one frame)
what is done with it      `due`: the deadline and the beat; `why_end`; `keep`: lateness, and into the ring
"""

from app.ipc.ring import AIMS, BRAKES_OFF, CONDUCTOR_SILENT, NO_CAUSE, RING_FULL, STOPPED
from app.loop.clock import fence, native, now_ns, sleep_until
from core.kernel import kernel
from core.tick_log import END, LATENESS_US
from experiments.trial.tick import run_ticks

TICK_NS = 1_000_000
#: Ticks run at once after a stall. Our choice: after a longer one (a machine that slept) the trial's time waits, so
#: that the handle does not race through seconds on a target that nobody aimed at; the lateness of the tick says so.
MOST_BEHIND_NS = 100 * TICK_NS
SILENT_NS = 2_000_000_000  # a conductor that has not beaten for so long is gone, not only short of processors
ROOM = 1024  # ticks of the ring that are kept free: an aborted trial still ends in recorded ticks

#: Our choice: the pointer takes the handle when it comes this near (m), and keeps it until the trial ends. So the
#: handle never leaps to a pointer that happened to be elsewhere: at first it is pulled with 2.4 N at most.
GRASP_RADIUS_M = 0.012


@kernel
def take_aim(control, grip, tip):
    """The newest place of the pointer is where the spring pulls to, once the pointer has touched the handle.

    With another hand than the mouse it is the newest force.
    """
    pushed = control.push_count
    if pushed != 0:
        grip.held[0], grip.held[1] = control.pushes[(pushed - 1) % AIMS, 0], control.pushes[(pushed - 1) % AIMS, 1]
        return
    count = control.aim_count
    if count == 0:
        return
    x, y = control.aims[(count - 1) % AIMS, 0], control.aims[(count - 1) % AIMS, 1]
    away_x, away_y = x - tip[0], y - tip[1]
    if away_x * away_x + away_y * away_y <= GRASP_RADIUS_M * GRASP_RADIUS_M:
        control.taken = 1
    if control.taken != 0:
        grip.target[0], grip.target[1], grip.target[2], grip.target[3] = x, y, 0.0, 0.0


@kernel
def why_end(control, now, size):
    """NO_CAUSE, or why the trial must end now (ns), with a ring of `size` ticks."""
    if control.brakes_off != 0:
        return BRAKES_OFF
    if control.stop != 0:
        return STOPPED
    if now - control.conductor_beat > SILENT_NS:
        return CONDUCTOR_SILENT
    if control.head - control.tail > size - ROOM:
        return RING_FULL
    return NO_CAUSE


@native
def due(control, deadline, timespec):
    """Wait for a tick's deadline (ns); how late it is, and the deadline of the next, both ns."""
    now = sleep_until(deadline, timespec)
    control.loop_beat = now
    late = now - deadline
    return late, (deadline if late < MOST_BEHIND_NS else now) + TICK_NS


@native
def keep(control, written, late):
    """Let the others see the tick that has been written into its place, or count it where there was none."""
    written[0, LATENESS_US] = 1e-3 * late
    fence()
    control.head += 1


@native
def run_trial(
    controls, ring, spare, timespec,
    path, controller, mechanism, brakes, hand, state, trial, runs, operator, noise, memory,
):  # fmt: skip
    """One trial in real time on the simulated device, from its first tick to its last. spare: a row for lost ticks."""
    control, run = controls[0], runs[0]
    size = ring.shape[0]
    deadline = now_ns(timespec)
    while run.finished == 0:
        late, deadline = due(control, deadline, timespec)
        cause = why_end(control, control.loop_beat, size)
        if cause != NO_CAUSE and run.stop == 0 and run.phase != END:  # one that has ended is what it is
            control.cause = cause
            run.stop = 1
        if run.simulated_hand == 0:
            take_aim(control, hand.grips[0], state[0].tip)
            run.held = 1 if control.push_count != 0 else control.taken
        full = control.head - control.tail >= size
        place = control.head % size
        written = spare if full else ring[place : place + 1]
        run_ticks(
            path, controller, mechanism, brakes, hand, state, trial, runs, operator, noise, memory, written
        )  # fmt: skip
        if full:
            control.dropped += 1
        else:
            keep(control, written, late)


@native
def run_idle(lateness, timespec):
    """The loop's deadlines with nothing to do; lateness (n,) in us."""
    deadline = now_ns(timespec)
    for n in range(lateness.shape[0]):
        late = sleep_until(deadline, timespec) - deadline
        lateness[n] = 1e-3 * late
        deadline += TICK_NS
