"""The clock of the benchmarks: the processor's time of this thread, so that what else the machine does is not timed."""

import sys
import time

#: s. Windows counts a thread's time in steps of 16 ms, longer than a scene takes: there it is the time that passes.
clock = time.perf_counter if sys.platform == "win32" else time.thread_time
