"""The memory that loop, session server and window share: a ring of ticks and a block of flags.

One writer for each part: the loop writes ticks, `head` and its beat; the session server `tail`, `stop` and its
beat; the window the pointer's place and `brakes_off`. A reader needs no lock: a count is raised only after what it
counts is there.
"""

import math
import mmap
import os
import secrets
import sys
import time
from typing import Any

import numpy as np

from core import tick_log
from core.faults import Cause

TICKS = 1 << 14  # 16 s: the longest that a disk may make the recorder wait
AIMS = 16  # places of the pointer: the newest one is not overwritten while it is read
TEXT, CODE = 240, 24  # bytes of a cause, of the code of a fault

#: why the loop ended a trial before its end
NO_CAUSE, STOPPED, BRAKES_OFF, SERVER_SILENT, RING_FULL = range(5)

#: requests of the session server for a running trial: end it; hand it back between two ticks, so that it can be changed
#: and run on (on a simulated device alone)
END_TRIAL, HAND_BACK = 1, 2

#: how the pointer holds the handle: not yet, now, no more
UNTOUCHED, TAKEN, LET_GO = range(3)

#: Our choice: the pointer takes the handle when it comes this near (m), and keeps it until the trial ends. So the
#: handle never leaps to a pointer that happened to be elsewhere: it comes 12 mm at most.
GRASP_RADIUS_M = 0.012

#: Ticks run at once after a stall. Our choice: after a longer one (a machine that slept) the trial's time waits, so
#: that the handle does not race after an old target; the lateness of the tick shows it.
MOST_BEHIND_NS = 100_000_000

CONTROL = np.dtype(
    [
        # by the window
        ("aim_count", "i8"),  # how many places of the pointer were reported; the newest is aims[(aim_count - 1) % AIMS]
        ("aims", "f8", (AIMS, 2)),  # m; not a number: the pointer has left its workspace
        ("brakes_off", "i8"),  # 1: no currents until the session server allows them again
        ("why_off", "u1", (TEXT,)),  # its cause, UTF-8 ..
        ("off_code", "u1", (CODE,)),  # .. and the code of its fault, if it is one
        ("presses", "i8"),  # of the brakes-off, so far
        # by the session server
        ("push_count", "i8"),  # how often a force was pushed; 0: the pointer is the hand
        ("pushes", "f8", (AIMS, 2)),  # N, likewise
        ("home", "f8", (2,)),  # m, to which the hand brings a handle that the pointer has let go ..
        ("comes_home", "i8"),  # .. if this is 1: outside the movement
        ("stale", "i8"),  # places of the pointer from before it had to let go: they do not take the handle
        ("server_beat", "i8"),  # ns
        ("stop", "i8"),  # END_TRIAL, HAND_BACK; 0: go on
        ("tail", "i8"),  # ticks that the recorder has taken
        # by the loop
        ("loop_beat", "i8"),  # ns
        ("begun", "i8"),  # ns, when the first tick of this trial was due (of a simulated device)
        ("head", "i8"),  # ticks in the ring since it was made
        ("dropped", "i8"),  # ticks of this trial that found no room
        ("cause", "i8"),  # NO_CAUSE ..
        ("taken", "i8"),  # 1: the pointer has hold of the handle
        ("astray", "i8"),  # 1: the pointer has let the handle go, and has not touched it since
        ("let_go", "i8"),  # how often the hand let the handle go during the movement of this trial
        ("core", "i8"),  # of the processor, that the loop has for itself; -1: none
        ("pid", "i8"),  # of its process; 0: not known
        ("worked", "i8"),  # ns that the ticks of this trial took (on a simulated device) ..
        ("worked_most", "i8"),  # .. and that the longest took
        # by who made it
        ("width", "i8"),  # columns of a tick
    ]
)
_TICKS_AT = -(-CONTROL.itemsize // 64) * 64


class Ring:
    """One process's view of the shared memory."""

    def __init__(self, handle: str = "", ticks: int = TICKS, width: int = tick_log.WIDTH) -> None:
        """Map the ring that was inherited under this handle; "": make a new one, with room for `ticks` of `width`
        columns. OSError if there is no memory for it.
        """
        memory = self._map(handle, _TICKS_AT + ticks * width * 8)
        self.controls = np.frombuffer(memory, CONTROL, 1).view(np.recarray)
        self.control = self.controls[0]
        if not handle:
            self.control.width = width
        self.rows = np.frombuffer(memory, np.float64, offset=_TICKS_AT).reshape(-1, int(self.control.width))
        self._shown = int(self.control.head)
        if not handle:
            self.control.core = -1

    @property
    def inherited(self) -> dict[str, Any]:
        """Options for `start_python` with which a child process can map the ring by our `handle`."""
        return {} if sys.platform == "win32" else {"pass_fds": (int(self.handle),)}

    def _map(self, handle: str, size: int) -> mmap.mmap:
        """Shared memory without a name in any folder; it ends with the last process that has it."""
        if sys.platform == "win32":  # where memory is inherited by a name of its own
            self.handle = handle or f"phd-{secrets.token_hex(16)}:{size}"
            name, _, bytes_there = self.handle.partition(":")
            return mmap.mmap(-1, int(bytes_there), tagname=name)
        if handle:
            self.handle = handle
            return mmap.mmap(int(handle), 0)
        self._file = open(os.memfd_create("phd-ring"), "w+b", buffering=0)
        missing = bytes(size)  # every page is there: a full memory is noticed now
        while missing:
            missing = missing[self._file.write(missing) :]
        self.handle = str(self._file.fileno())
        return mmap.mmap(self._file.fileno(), 0)  # let go with the last array on it

    # the window

    def aim(self, x: float, y: float) -> None:
        """Report the place of the pointer, m."""
        count = int(self.control.aim_count)
        self.control.aims[count % AIMS] = x, y
        self.control.aim_count = count + 1

    def let_go(self) -> None:
        """The pointer has left its workspace: release the handle until the pointer touches it again."""
        self.aim(math.nan, math.nan)

    def press_brakes_off(self, cause: str) -> None:
        """Press the brakes-off; an `allow` that was requested before does not end it."""
        self.control.presses += 1
        self.switch_off(cause)

    @property
    def presses(self) -> int:
        return int(self.control.presses)

    def switch_off(self, cause: str) -> None:
        """Allow no currents from the next tick on; the first cause stands."""
        if not self.control.brakes_off:
            code = cause.code if isinstance(cause, Cause) else ""
            for field, text, size in (("why_off", cause, TEXT), ("off_code", code, CODE)):
                self.control[field] = np.frombuffer(text.encode()[:size].ljust(size, b"\0"), np.uint8)
            self.control.brakes_off = 1

    @property
    def why_off(self) -> str:
        """Why no currents may flow; "": they may."""
        if not self.control.brakes_off:
            return ""
        fields = (self.control.why_off, self.control.off_code)
        why, code = (field.tobytes().rstrip(b"\0").decode(errors="ignore") for field in fields)
        return Cause(why, code) if code else why or "no cause given"

    def newest(self) -> np.ndarray:
        """The ticks since the last call, copied: (n, width); without the oldest if there were too many."""
        head, size = int(self.control.head), len(self.rows)
        rows = self._copy(max(self._shown, head - size), head)
        overwritten = int(self.control.head) - size - (head - len(rows)) + 1  # meanwhile; one may be half written
        self._shown = head
        return rows[max(0, overwritten) :]

    # the session server

    def begin_trial(self, grasp: int = UNTOUCHED, home: tuple[float, float] | None = None) -> None:
        """Prepare the ring for a trial. grasp: how the pointer holds the handle.

        home: where the hand returns a handle that is let go outside the movement, m; None: it coasts.
        """
        control = self.control
        control.comes_home = int(home is not None)
        if home is not None:
            self.control.home = home
        control.stop = control.cause = control.dropped = control.let_go = control.worked = control.worked_most = 0
        control.taken, control.astray = int(grasp == TAKEN), int(grasp == LET_GO)
        control.stale = control.aim_count if grasp == LET_GO else 0
        self.control.tail = self.control.head
        self.control.loop_beat = time.perf_counter_ns()
        self.beat()

    @property
    def grasp(self) -> int:
        """How the pointer holds the handle: UNTOUCHED, TAKEN or LET_GO."""
        return TAKEN if self.control.taken else LET_GO if self.control.astray else UNTOUCHED

    def push(self, fx: float, fy: float) -> None:
        """Report the force of the hand, N."""
        count = int(self.control.push_count)
        self.control.pushes[count % AIMS] = fx, fy
        self.control.push_count = count + 1

    def last(self, column: int) -> float:
        """A column of the newest tick; 0 before the first."""
        return float(self.rows[(int(self.control.head) - 1) % len(self.rows), column])

    def beat(self) -> None:
        """Show that the session server lives."""
        self.control.server_beat = time.perf_counter_ns()

    @property
    def loop_silent_s(self) -> float:
        """Seconds since the loop's last tick."""
        return 1e-9 * (time.perf_counter_ns() - int(self.control.loop_beat))

    def unrecorded_ticks(self) -> np.ndarray:
        """The ticks not yet recorded, copied: (n, width). They stay until `mark_recorded`."""
        return self._copy(int(self.control.tail), int(self.control.head))

    def mark_recorded(self, n: int) -> None:
        """Let the loop overwrite the oldest n ticks: they are recorded."""
        self.control.tail += n

    def allow(self) -> None:
        """Allow currents again."""
        self.control.brakes_off = 0

    def _copy(self, first: int, head: int) -> np.ndarray:
        start, end = first % len(self.rows), head % len(self.rows)
        if first == head:
            return np.empty((0, self.rows.shape[1]))
        if start < end:
            return self.rows[start:end].copy()
        return np.concatenate([self.rows[start:], self.rows[:end]])
