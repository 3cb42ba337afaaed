"""The best scheduling that the control loop can get, what it got, and how much time the system then kept from it.

Linux: real-time (FIFO) with its memory locked where the user may; otherwise the shortest slice of the default
scheduler. Both: no timer slack. Windows: the multimedia class "Pro Audio" where its service runs, otherwise the highest
priority of a thread. Both systems: a processor core that the other processes of the program leave.

Time is lost to the host of a virtual machine, which takes the core away ("steal"), and to other programs, which get the
core while the loop is ready to run. Linux counts both; what a system does not count is None, not 0.
"""

import contextlib
import ctypes
import gc
import os
import platform
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

PRIORITY = 50  # below the kernel's own threads for interrupts
SLICE_NS = 100_000  # the shortest that the default scheduler grants
ADVICE = {
    "linux": "Allow real-time scheduling: lines `NAME - rtprio 50` and `NAME - memlock unlimited` for your user in "
    "/etc/security/limits.d/phd.conf, then log in again.",
    "win32": "Start Windows' service `Multimedia Class Scheduler` (services.msc) and start again.",
}.get(sys.platform, "")

#: the cores that the program may use, as a process's environment hands them down to the ones that it starts: its own
#: may be fewer by then, for everything but the loop leaves the loop's core
CORES_VARIABLE = "PHD_CORES"

_SET_TIMER_SLACK = 29  # prctl
_LOCK_NOW_AND_LATER = 3  # mlockall: MCL_CURRENT | MCL_FUTURE
#: system calls sched_setattr, sched_getattr by machine: the C library has no name for them
_ATTRIBUTES = {"x86_64": (314, 315), "aarch64": (274, 275)}

_HIGHEST = 15  # SetThreadPriority: THREAD_PRIORITY_TIME_CRITICAL
_CRITICAL = 2  # AvSetMmThreadPriority: AVRT_PRIORITY_CRITICAL
_KEEP_LEAST = 1  # SetProcessWorkingSetSizeEx: QUOTA_LIMITS_HARDWS_MIN_ENABLE
WORKING_SET = (256 << 20, 512 << 20)  # bytes of memory that Windows leaves the loop at least, and at most when short


class _Attributes(ctypes.Structure):
    _fields_ = [("size", ctypes.c_uint32), ("policy", ctypes.c_uint32), ("flags", ctypes.c_uint64)] + [
        ("nice", ctypes.c_int32), ("priority", ctypes.c_uint32),
        ("runtime", ctypes.c_uint64), ("deadline", ctypes.c_uint64), ("period", ctypes.c_uint64),
    ]  # fmt: skip


class Scheduling(NamedTuple):
    """The scheduling of the control loop."""

    real_time: bool
    locked: bool  # its memory cannot be swapped out
    core: int  # its own; -1: none
    means: str  # in words
    timer: str = ""  # likewise, on a system that has several kinds

    @property
    def words(self) -> str:
        """The scheduling as shown to the user."""
        place = f", core {self.core}" if self.core >= 0 else ""
        timer = f", {self.timer}" if self.timer else ""
        return f"{self.means}{place}{timer}{', memory not locked' if self.real_time and not self.locked else ''}"


def take_scheduling(real_time: bool = True) -> Scheduling:
    """Take the best scheduling for the calling thread, which is the loop.

    real_time = False leaves out what needs a privilege: to measure what a user without it gets.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    if sys.platform == "win32":
        return _windows(real_time)
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
        given = os.environ[CORES_VARIABLE] = ",".join(map(str, _process_cores()))
    return {int(core) for core in given.split(",") if core}


def leave_core(core: int) -> None:
    """Keep the calling thread, and those that it starts, off the loop's core (-1: on all again).

    Windows: all threads of the process.
    """
    cores = program_cores()
    cores = cores - {core} or cores
    if sys.platform == "win32":
        kernel32 = _kernel32()
        kernel32.SetProcessAffinityMask(kernel32.GetCurrentProcess(), _mask(cores))
    else:
        os.sched_setaffinity(0, cores)


def _process_cores() -> list[int]:
    """The cores that this process may use."""
    if sys.platform == "win32":
        kernel32, ours, every = _kernel32(), ctypes.c_size_t(), ctypes.c_size_t()
        kernel32.GetProcessAffinityMask(kernel32.GetCurrentProcess(), ctypes.byref(ours), ctypes.byref(every))
        return [core for core in range(64) if ours.value >> core & 1]
    return sorted(os.sched_getaffinity(0))


def _own_core() -> int:
    """Keep the calling thread on the last core that we may use, unless it is the only one."""
    cores = program_cores()
    if len(cores) < 2:
        return -1
    if sys.platform == "win32":
        kernel32 = _kernel32()
        kernel32.SetThreadAffinityMask(kernel32.GetCurrentThread(), _mask({max(cores)}))
    else:
        os.sched_setaffinity(0, {max(cores)})
    return max(cores)


def _fifo() -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return False
    return os.sched_getscheduler(0) == os.SCHED_FIFO


def _short_slice(libc: ctypes.CDLL) -> bool:
    """Whether the default scheduler (Linux 6.12 and later) grants our slice."""
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


# ----------------------------------------------------------------------------------------------------------- lost time

STEAL = 7  # place in a line of /proc/stat


def read_proc(path: str) -> str:
    """Read a file of Linux's /proc. OSError: there is none (under Wine one sees the files of Linux)."""
    if sys.platform != "linux":
        raise FileNotFoundError(path)
    return Path(path).read_text(encoding="utf-8")


class LostTime(NamedTuple):
    """Time lost since the machine or the loop started, or between two readings."""

    stolen_ms: float | None  # the host kept the loop's core (without one: all cores), in steps of 10 ms
    waited_ms: float | None  # the loop was ready to run and did not
    switches: int | None  # how often its core was taken from it

    def since(self, before: "LostTime") -> "LostTime":
        """The time lost since an earlier reading."""
        pairs = zip(self, before, strict=True)
        return LostTime._make(None if now is None or then is None else now - then for now, then in pairs)


def lost_time(pid: int, core: int, read: Callable[[str], str] = read_proc) -> LostTime:
    """Time lost by the loop. pid: of its process (0: not known); core: its own (-1: none). read: of /proc."""
    waited = switches = None
    if pid:
        with contextlib.suppress(OSError, ValueError, IndexError):  # not Linux, or the process has ended
            waited = 1e-6 * int(read(f"/proc/{pid}/schedstat").split()[1])
        with contextlib.suppress(OSError, ValueError, KeyError):
            lines = dict(line.split(":", 1) for line in read(f"/proc/{pid}/status").splitlines())
            switches = int(lines["nonvoluntary_ctxt_switches"])
    stolen = _jiffies(core, read)
    stolen_ms = None if stolen is None else 1e3 * stolen[STEAL] / os.sysconf("SC_CLK_TCK")
    return LostTime(stolen_ms, waited, switches)


def stolen_share(read: Callable[[str], str] = read_proc) -> float | None:
    """The share of all cores' time that the host has taken since the machine started."""
    counted = _jiffies(-1, read)
    return None if counted is None else counted[STEAL] / max(1, sum(counted[: STEAL + 1]))


def _jiffies(core: int, read: Callable[[str], str]) -> list[int] | None:
    """The line of a core (-1: of all) in /proc/stat."""
    name = f"cpu{core}" if core >= 0 else "cpu"
    with contextlib.suppress(OSError, ValueError):
        for line in read("/proc/stat").splitlines():
            first, *counts = line.split()
            if first == name and len(counts) > STEAL:
                return [int(count) for count in counts]
    return None


# ----------------------------------------------------------------------------------------------------------- Windows


if sys.platform == "win32":

    def _kernel32() -> Any:
        """Windows' own functions, with handles and masks of the size of a pointer."""
        kernel32 = ctypes.WinDLL("kernel32")
        for get in (kernel32.GetCurrentProcess, kernel32.GetCurrentThread):
            get.restype = ctypes.c_void_p
        kernel32.SetThreadPriority.argtypes = (ctypes.c_void_p, ctypes.c_int)
        for take in (kernel32.SetProcessAffinityMask, kernel32.SetThreadAffinityMask):
            take.argtypes = (ctypes.c_void_p, ctypes.c_size_t)
        kernel32.GetProcessAffinityMask.argtypes = (ctypes.c_void_p,) * 3
        size = ctypes.c_size_t
        kernel32.SetProcessWorkingSetSizeEx.argtypes = (ctypes.c_void_p, size, size, ctypes.c_uint32)
        return kernel32

    def _mask(cores: set[int]) -> int:
        return sum(1 << core for core in cores)

    def _windows(real_time: bool) -> Scheduling:
        kernel32, core = _kernel32(), _own_core()
        kept = bool(kernel32.SetProcessWorkingSetSizeEx(kernel32.GetCurrentProcess(), *WORKING_SET, _KEEP_LEAST))
        if real_time and _multimedia():
            return Scheduling(True, kept, core, "real-time: multimedia class Pro Audio")
        highest = kernel32.SetThreadPriority(kernel32.GetCurrentThread(), _HIGHEST)
        return Scheduling(False, kept, core, f"default{', highest priority of a thread' if highest else ''}")

    def _multimedia() -> bool:
        """Whether Windows' multimedia service gives the calling thread priority."""
        avrt, task = ctypes.WinDLL("avrt"), ctypes.c_uint32()
        avrt.AvSetMmThreadCharacteristicsW.restype = ctypes.c_void_p
        avrt.AvSetMmThreadPriority.argtypes = (ctypes.c_void_p, ctypes.c_int)
        handle = avrt.AvSetMmThreadCharacteristicsW("Pro Audio", ctypes.byref(task))
        return bool(handle and avrt.AvSetMmThreadPriority(handle, _CRITICAL))
