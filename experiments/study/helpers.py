"""Processes beside this one, on the other cores. Those of a study run operators, simulate error bars and draw figures.

On Linux they are forked, so that they begin with all that is loaded; elsewhere they load it while the first trials run.
"""

import contextlib
import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.sharedctypes import Synchronized
from multiprocessing.synchronize import Event
from typing import NamedTuple

LOOK_S = 0.5  # how often a process looks whether its parent lives
MOST_ON_WINDOWS = 61  # processes that one process can wait for, there
_SYNCHRONIZE, _FOR_EVER = 0x100000, 0xFFFFFFFF  # of Windows


class Shared(NamedTuple):
    """Counters and a stop signal that all processes of a study share."""

    begun: Synchronized  # operators that some process has taken on
    finished: Synchronized  # trials
    stop: Event  # no further trial is to begin

    def operators(self, count: int) -> Iterator[int]:
        """The operators (1..) that no process has taken on yet, one at a time, until the study is to stop."""
        while not self.stop.is_set():
            with self.begun:
                self.begun.value += 1
                operator = self.begun.value
            if operator > count:
                return
            yield operator


class Helpers(NamedTuple):
    """The processes of a study, and the counters that they share with this one."""

    pool: ProcessPoolExecutor
    processes: int
    shared: Shared


_CONTEXT = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")


@contextlib.contextmanager
def process_pool(processes: int, shared: Shared | None = None) -> Iterator[ProcessPoolExecutor]:
    """So many processes; they begin before this returns, and end with this process, however that ends.

    To be called before any lock is taken: a forked process would hold it as well. OSError if one of them is killed.
    """
    pool = ProcessPoolExecutor(processes, _CONTEXT, _begin, (os.getpid(), shared))
    pool.submit(os.getpid)
    try:
        yield pool
    except BrokenProcessPool:
        raise OSError("a process of this work was killed; a study or a sweep goes on with --resume") from None
    finally:
        pool.shutdown(cancel_futures=True)


@contextlib.contextmanager
def helpers(most: int) -> Iterator[Helpers]:
    """A study's processes, at least one and at most so many. At the end the trials that they run are ended."""
    shared = Shared(_CONTEXT.Value("i", 0), _CONTEXT.Value("i", 0), _CONTEXT.Event())
    count = max(1, min(cores() - 1, most))
    with process_pool(count, shared) as pool:
        try:
            yield Helpers(pool, count, shared)
        finally:
            shared.stop.set()


def cores() -> int:
    """The number of processor cores that this process may use; on Windows at most as many as it can wait for."""
    return (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else min(os.cpu_count() or 1, MOST_ON_WINDOWS)
    )


_in_helper: list[Shared] = []


def _begin(parent: int, shared: Shared | None) -> None:
    """Prepare a process. It ignores interrupts: its parent gets them, too, and ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    end_with(parent)
    if shared is not None:
        _in_helper[:] = [shared]


def shared_in_helper() -> Shared:
    """In a process of a study: the counters that it shares with the others."""
    return _in_helper[0]


def end_with(parent: int) -> None:
    """From now on this process ends when its parent does."""

    def look() -> None:
        if sys.platform == "win32":  # where a process keeps the number of a parent that is gone
            kernel32 = ctypes.WinDLL("kernel32")
            kernel32.OpenProcess.restype = ctypes.c_void_p
            handle = kernel32.OpenProcess(_SYNCHRONIZE, False, parent)
            kernel32.WaitForSingleObject(ctypes.c_void_p(handle), _FOR_EVER)  # at once where there is no such process
        else:
            while os.getppid() == parent:
                time.sleep(LOOK_S)
        os._exit(1)

    threading.Thread(target=look, name="looks at its parent", daemon=True).start()
