"""The clock of the control loop: now, and sleep until then, in nanoseconds of the clock of `time.perf_counter_ns`.

They are calls of the system that compiled code makes without the interpreter. Linux: CLOCK_MONOTONIC. Windows:
QueryPerformanceCounter and a waitable timer. Without the jit they are Python's own, and what calls them runs as Python
(`native` leaves it uncompiled).
"""

import ctypes
import sys
import time

import llvmlite.binding
import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from core.kernels import kernel

#: Whether the loop runs as compiled code from its first tick to its last.
NATIVE = not numba.config.DISABLE_JIT

#: The last part of a wait is spent looking at the clock: a processor core that sleeps takes 50 to 150 us to wake on a
#: virtual machine. Our choice: a fifth of the loop's core for p99 lateness of about a microsecond. Windows: assumed,
#: because its high-resolution timers end at steps of 500 us.
SPIN_NS = 600_000 if sys.platform == "win32" else 200_000

#: What calls of the clock need stands in one array, the timer (`new_timer`): room for the system's answer (two words),
#: ns to spin, and two numbers or handles of the system.
_SPIN, _FIRST, _SECOND = 2, 3, 4

FINE_TIMER, COARSE_TIMER = "high-resolution timer", "timer of 1 ms: the loop never sleeps"


def new_timer() -> np.ndarray:
    """The arguments that calls of the clock need; one per thread."""
    timer = np.zeros(5, dtype=np.int64)
    timer[_SPIN] = SPIN_NS
    if NATIVE and sys.platform == "win32":
        _prepare_windows(timer)
    return timer


if sys.platform == "win32":

    def _prepare_windows(timer: np.ndarray) -> None:
        """Ticks per second of the counter and a waitable timer: of high resolution (Windows 10 1803 and later), else
        one of 1 ms, beside which the loop looks at the clock all the time.
        """
        kernel32 = ctypes.WinDLL("kernel32", use_last_error=True)
        rate = ctypes.c_int64()
        kernel32.QueryPerformanceFrequency(ctypes.byref(rate))
        create = kernel32.CreateWaitableTimerExW
        create.restype = ctypes.c_void_p
        all_access, fine = 0x1F0003, 0x2
        handle = create(None, None, fine, all_access)
        if not handle:
            ctypes.WinDLL("winmm").timeBeginPeriod(1)
            handle = create(None, None, 0, all_access)
            timer[_SPIN] = 2_000_000
        if not handle:
            raise ctypes.WinError(ctypes.get_last_error())
        timer[_FIRST], timer[_SECOND] = rate.value, handle


def timer_words(timer: np.ndarray) -> str:
    """Which timer the system gave; "": there is only one kind."""
    if not NATIVE or sys.platform != "win32":
        return ""
    return FINE_TIMER if timer[_SPIN] == SPIN_NS else COARSE_TIMER


if NATIVE and sys.platform == "win32":
    for _name in ("QueryPerformanceCounter", "SetWaitableTimer", "WaitForSingleObject"):
        _address = ctypes.cast(getattr(ctypes.WinDLL("kernel32"), _name), ctypes.c_void_p).value
        llvmlite.binding.add_symbol(_name, _address)
    _counter = types.ExternalFunction("QueryPerformanceCounter", types.int32(types.intp))
    _set = types.ExternalFunction(
        "SetWaitableTimer",
        types.int32(types.intp, types.intp, types.int32, types.intp, types.intp, types.int32),
    )
    _wait = types.ExternalFunction("WaitForSingleObject", types.uint32(types.intp, types.uint32))
    _LONGEST_MS = 1000

    @kernel
    def now_ns(timer):
        """Nanoseconds now."""
        _counter(timer.ctypes.data)
        ticks, rate = timer[0], timer[_FIRST]
        return ticks // rate * 1_000_000_000 + ticks % rate * 1_000_000_000 // rate

    @kernel
    def _sleep(now, wake, timer):
        timer[0] = (now - wake) // 100  # negative: from now on, in steps of 100 ns
        _set(timer[_SECOND], timer.ctypes.data, 0, 0, 0, 0)
        _wait(timer[_SECOND], _LONGEST_MS)

elif NATIVE:
    _CLOCK, _ABSOLUTE = 1, 1  # CLOCK_MONOTONIC, as Python's time.perf_counter_ns; TIMER_ABSTIME
    _gettime = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.intp))
    _nanosleep = types.ExternalFunction(
        "clock_nanosleep", types.int32(types.int32, types.int32, types.intp, types.intp)
    )

    @kernel
    def now_ns(timer):
        """Nanoseconds now."""
        _gettime(_CLOCK, timer.ctypes.data)
        return timer[0] * 1_000_000_000 + timer[1]

    @kernel
    def _sleep(now, wake, timer):
        timer[0], timer[1] = wake // 1_000_000_000, wake % 1_000_000_000
        _nanosleep(_CLOCK, _ABSOLUTE, timer.ctypes.data, 0)


if NATIVE:

    @intrinsic
    def fence(typing_context):
        """Nothing that was written before is seen by another process after what is written next."""

        def generate(context, builder, signature, arguments):
            builder.fence("seq_cst")
            return context.get_dummy_value()

        return types.void(), generate

    @kernel
    def sleep_until(deadline, timer):
        """Wait until a deadline (ns) unless it is past; nanoseconds now."""
        now, wake = now_ns(timer), deadline - timer[_SPIN]
        while now < wake:  # a signal may end the sleep early
            _sleep(now, wake, timer)
            now = now_ns(timer)
        while now < deadline:
            now = now_ns(timer)
        return now

    native = kernel
else:

    def fence():
        """Nothing to do: the interpreter keeps the order."""

    def now_ns(timer):
        """Nanoseconds now."""
        return time.perf_counter_ns()

    def sleep_until(deadline, timer):
        """Sleep until a deadline (ns) unless it is past; nanoseconds now."""
        now = time.perf_counter_ns()
        while now < deadline:
            time.sleep(1e-9 * (deadline - now))
            now = time.perf_counter_ns()
        return now

    def native(function):
        """Left to the interpreter, which makes the same calls."""
        return function
