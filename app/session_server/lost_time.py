"""Why a tick was late: what the system counts of the time that it kept from the control loop.

The host of a virtual machine keeps a processor core from it ("steal"); the scheduler lets another program have the core
while the loop is ready to run, or takes it from the loop. What a tick itself takes the loop measures (`Ring`). Linux
counts all of this; where a system does not, it is None, never 0.
"""

import contextlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple


def read(path: str) -> str:
    """A file of Linux. OSError: it has none, or this is another system (under Wine one sees the files of Linux)."""
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


def lost_time(pid: int, core: int, read: Callable[[str], str] = read) -> LostTime:
    """Of the loop's process (0: not known) and its core (-1: it has none of its own)."""
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


STEAL = 7  # place in a line of /proc/stat


def stolen_share(read: Callable[[str], str] = read) -> float | None:
    """The share of all cores' time that the host has kept since the machine started."""
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
