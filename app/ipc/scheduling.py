"""The best scheduling that the control loop can get, and what it got.

Linux: real-time (FIFO) with its memory locked where the user may; otherwise the shortest slice of the default
scheduler. Both: no timer slack, and a processor core that the other processes of the program leave. None of this exists
on Windows and macOS, where the loop runs as any program does.
"""

import ctypes
import gc
import os
import platform
import sys
from pathlib import Path
from typing import NamedTuple

PRIORITY = 50  # below the kernel's own threads for interrupts
SLICE_NS = 100_000  # the shortest that the default scheduler grants
ADVICE = (
    "Allow real-time scheduling: lines `NAME - rtprio 50` and `NAME - memlock unlimited` for your user in "
    "/etc/security/limits.d/phd.conf, then log in again."
)

#: the cores that the program may use, as a process's environment hands them down to the ones that it starts: its own
#: may be fewer by then, for everything but the loop leaves the loop's core
CORES_VARIABLE = "PHD_CORES"

_SET_TIMER_SLACK = 29  # prctl
_LOCK_NOW_AND_LATER = 3  # mlockall: MCL_CURRENT | MCL_FUTURE
#: system calls sched_setattr, sched_getattr by machine: the C library has no name for them
_ATTRIBUTES = {"x86_64": (314, 315), "aarch64": (274, 275)}


class _Attributes(ctypes.Structure):
    _fields_ = [("size", ctypes.c_uint32), ("policy", ctypes.c_uint32), ("flags", ctypes.c_uint64)] + [
        ("nice", ctypes.c_int32), ("priority", ctypes.c_uint32),
        ("runtime", ctypes.c_uint64), ("deadline", ctypes.c_uint64), ("period", ctypes.c_uint64),
    ]  # fmt: skip


class Scheduling(NamedTuple):
    """What the control loop got."""

    real_time: bool
    locked: bool  # its memory cannot be swapped out
    core: int  # its own; -1: none
    means: str  # in words

    @property
    def words(self) -> str:
        """All of it."""
        place = f", core {self.core}" if self.core >= 0 else ""
        return f"{self.means}{place}{', memory not locked' if self.real_time and not self.locked else ''}"


def take_scheduling(real_time: bool = True) -> Scheduling:
    """The best scheduling there is, for the calling thread, which is the loop.

    real_time = False leaves the privileged ways out: to measure what a user without them gets.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    if sys.platform != "linux":
        return Scheduling(False, False, -1, f"default: {platform.system()} offers nothing better here")
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_SET_TIMER_SLACK, 1, 0, 0, 0)
    core = _own_core()
    locked = real_time and libc.mlockall(_LOCK_NOW_AND_LATER) == 0
    if real_time and _fifo():
        return Scheduling(True, locked, core, f"real-time: FIFO {PRIORITY}")
    return Scheduling(False, locked, core, f"default{', short slice' if _short_slice(libc) else ''}")


def program_cores() -> set[int]:
    """The cores that the program may use."""
    given = os.environ.get(CORES_VARIABLE)
    if given is None:
        given = os.environ[CORES_VARIABLE] = ",".join(map(str, os.sched_getaffinity(0)))
    return {int(core) for core in given.split(",")}


def leave_core(core: int) -> None:
    """Keep the calling thread, and those that it starts, off the loop's core (-1: on all again)."""
    if sys.platform == "linux":
        cores = program_cores()
        os.sched_setaffinity(0, cores - {core} or cores)


def stolen_ms(core: int) -> float:
    """How long the host of a virtual machine has kept a core (-1: all) from it since it started, ms in steps of 10.

    0 on a machine of its own, and where the system does not say.
    """
    name = f"cpu{core}" if core >= 0 else "cpu"
    try:
        lines = Path("/proc/stat").read_text().splitlines()
    except OSError:
        return 0.0
    fields = next((line.split() for line in lines if line.startswith(f"{name} ")), [])
    return 1e3 * int(fields[8]) / os.sysconf("SC_CLK_TCK") if len(fields) > 8 else 0.0


def _own_core() -> int:
    """Keep to the last core that we may use, unless it is the only one."""
    cores = program_cores()
    if len(cores) < 2:
        return -1
    os.sched_setaffinity(0, {max(cores)})
    return max(cores)


def _fifo() -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return False
    return os.sched_getscheduler(0) == os.SCHED_FIFO


def _short_slice(libc: ctypes.CDLL) -> bool:
    """Whether the default scheduler (Linux 6.12 and later) says that it has taken our slice."""
    calls = _ATTRIBUTES.get(platform.machine())
    if calls is None:
        return False
    wanted = _Attributes(size=ctypes.sizeof(_Attributes), runtime=SLICE_NS)
    got = _Attributes()
    return (
        libc.syscall(calls[0], 0, ctypes.byref(wanted), 0) == 0
        and libc.syscall(calls[1], 0, ctypes.byref(got), ctypes.sizeof(got), 0) == 0
        and got.policy == 0
        and got.runtime == SLICE_NS
    )
