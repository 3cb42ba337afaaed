"""The faults of the fault matrix: how each begins and ends, and what is to come of it."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from simulated_bench import TIP

from core import tick_log

if TYPE_CHECKING:
    from fault_cases import Case

BETWEEN = "between"
PHASES = (BETWEEN, *tick_log.PHASES)
AWAY, START, END = (0.02, 0.36), TIP, (0.032, 0.40)
PULL = (START[0] - 0.04, START[1] + 0.04)  # away from the path with 23 N: the controller locks everything
HARD_PULL = (START[0] - 0.3, START[1] + 0.3)  # with 40 N: more than the release bears
LOCKED_TICKS = 12  # on end, before a fault comes upon the move
SILENT_S = 2.0  # after which a session server counts as gone


class Killed(Exception):
    """The loop is no more: it does nothing else."""


class Fault(NamedTuple):
    """One fault, and what is to come of it."""

    name: str
    text: str = ""  # of hardware.emulated_board.line_faults
    goes_on: tuple[str, ...] = ()  # phases in which the trial goes on, since no harm is done there
    causes: tuple[str, ...] = ()  # part of what the person reads
    board: bool = True  # the board, or its silence, makes the currents zero: within 50 ms
    seen_ms: float = 200.0  # longest until the trial is over; infinite: it takes as long as it takes to show
    device: str = "four-brake"
    acts: Callable[["Case"], None] | None = None  # at its beginning
    each: Callable[["Case"], None] | None = None  # and at each tick after
    ends: Callable[["Case"], None] | None = None


def pull(x: float, y: float) -> Callable[["Case"], None]:
    return lambda case: case.bench.hand.obey({"target": [x, y]})


def push(x: float, y: float) -> Callable[["Case"], None]:
    return lambda case: case.bench.hand.obey({"force": [x, y]})


def turn(rad: float) -> Callable[["Case"], None]:
    """The encoder at A turns so far more than its joint at each tick: a coupling slips, a line counts noise."""

    def act(case: "Case") -> None:
        if case.board.ticks - case.at < 700 and not case.past:
            case.board.device.sensors.at_power_up[0] -= rad

    return act


def fall_silent(case: "Case") -> None:
    """The session server hangs since almost as long as the loop bears."""
    case.server_lives, case.ago_ms = False, round(1e3 * SILENT_S) - 20
    case.ring.control.server_beat = round(1e9 * (case.bench.now() - SILENT_S + 0.02))


def die(case: "Case") -> None:
    raise Killed


NO_CURRENTS = (BETWEEN, "approach", "hold", "end")  # phases
SILENT = "no sample came from the board for 50 ms"
LATE = "the board got no command for 50 ms"

HARD = [
    Fault("stall 0.4 s", "stall+0.4", (), (SILENT, "no sample for 200 ms")),
    Fault("stall 70 ms", "stall+0.07", (BETWEEN,), (LATE, SILENT)),
    Fault("delay 80 ms", "delay=0.08+0.5", (BETWEEN,), (SILENT, LATE)),
    Fault("unplug", "unplug+0.5", (), ("it is gone", "nothing listens there", "the board was unplugged")),
    Fault("brown-out", "brown-out+0.1", (), (SILENT, "the supply voltage was too low")),
    Fault("bad encoder", "bad-encoder=A+0.1", (), ("an encoder's signal is bad",)),
    Fault("saturated force sensor", "saturated-force+0.1", (), ("the force sensor is at the end",)),
    Fault("over-current", "over-current=E+0.1", (), ("a brake drew more current than its limit",)),
    Fault("over-speed", "", (), ("turned faster than", "moved faster than", "contradict each other"), False,
          each=turn(0.04)),
    Fault("stuck encoder", "stuck-encoder=A+1", (BETWEEN, "end"), ("contradict each other",), False, math.inf,
          "four-encoders"),
    Fault("out of workspace", "", (BETWEEN, "end"), ("the device file says it cannot be", "contradict each other"),
          False, math.inf, each=turn(0.002)),
    Fault("hand trapped", "", NO_CURRENTS, ("the brakes let go",), False, math.inf,
          acts=pull(*HARD_PULL), ends=pull(*START)),
    Fault("recorder silent", "", (BETWEEN, "end"), ("the process that records did not answer",), False,
          1e3 * SILENT_S + 10.0, acts=fall_silent),
    Fault("loop held up 0.2 s", "", NO_CURRENTS, (LATE,), acts=lambda case: case.bench.pass_time(200),
          seen_ms=400.0),
    Fault("lid closed 5 s", "", (), (LATE, "the board ended the connection"),
          acts=lambda case: case.bench.pass_time(5000), seen_ms=5200.0),
    Fault("loop killed", "", (), ("The control loop ended unexpectedly",), acts=die),
    Fault("Esc", "", ("end",), ("Esc, participant's window",), False,
          acts=lambda case: case.ring.switch_off("Esc, participant's window")),
    Fault("uncounted start", "uncounted-start+0.1", (), (SILENT, "the board was powered up again, though")),
]  # fmt: skip
SOFT = [
    Fault("drop a fifth", "drop=0.2"),
    Fault("corrupt a fifth", "corrupt=0.2"),
    Fault("duplicate half", "duplicate=0.5"),
    Fault("delay 20 ms", "delay=0.02"),
    Fault("jitter 10 ms", "jitter=0.01"),
]
