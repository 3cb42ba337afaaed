"""The clock of the control loop: now, and sleep until then, in nanoseconds of the system's steady clock.

On Linux they are calls of the C library that kernels make without the interpreter; elsewhere, or without the jit, they
are Python's own, and whatever calls them runs as Python (`native` leaves it uncompiled).
"""

import sys
import time

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from core.kernel import kernel

#: Whether the loop runs as compiled code from its first tick to its last.
NATIVE = sys.platform == "linux" and not numba.config.DISABLE_JIT

#: The last part of a wait is spent looking at the clock: a processor core that sleeps takes 50 to 150 us to wake on a
#: virtual machine. Our choice: a fifth of the loop's core for p99 lateness of about a microsecond.
SPIN_NS = 200_000


def new_timespec() -> np.ndarray:
    """Room for the C library's answer, seconds and nanoseconds; one per thread."""
    return np.zeros(2, dtype=np.int64)


if NATIVE:
    _MONOTONIC = 1  # CLOCK_MONOTONIC; Python's time.monotonic_ns is the same
    _ABSOLUTE = 1  # TIMER_ABSTIME
    _gettime = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.intp))
    _nanosleep = types.ExternalFunction(
        "clock_nanosleep", types.int32(types.int32, types.int32, types.intp, types.intp)
    )

    @intrinsic
    def fence(typing_context):
        """Nothing that was written before is seen by another process after what is written next."""

        def generate(context, builder, signature, arguments):
            builder.fence("seq_cst")
            return context.get_dummy_value()

        return types.void(), generate

    @kernel
    def now_ns(timespec):
        """Nanoseconds now."""
        _gettime(_MONOTONIC, timespec.ctypes.data)
        return timespec[0] * 1_000_000_000 + timespec[1]

    @kernel
    def sleep_until(deadline, timespec):
        """Wait until a deadline (ns) unless it is past; nanoseconds now."""
        now, wake = now_ns(timespec), deadline - SPIN_NS
        while now < wake:  # a signal may end the sleep early
            timespec[0], timespec[1] = wake // 1_000_000_000, wake % 1_000_000_000
            _nanosleep(_MONOTONIC, _ABSOLUTE, timespec.ctypes.data, 0)
            now = now_ns(timespec)
        while now < deadline:
            now = now_ns(timespec)
        return now

    native = kernel
else:

    def fence():
        """Nothing to do: the interpreter keeps the order."""

    def now_ns(timespec):
        """Nanoseconds now."""
        return time.monotonic_ns()

    def sleep_until(deadline, timespec):
        """Sleep until a deadline (ns) unless it is past; nanoseconds now."""
        now = time.monotonic_ns()
        while now < deadline:
            time.sleep(1e-9 * (deadline - now))
            now = time.monotonic_ns()
        return now

    def native(function):
        """Left to the interpreter, which makes the same calls."""
        return function
