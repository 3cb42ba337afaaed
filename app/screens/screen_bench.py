"""`phd bench --screens`: what the windows cost at several sizes, and how far the picture is behind the pointer.

Each case runs in a process of its own, as the app does. Times depend on what else the machine does: the processor's
share is the least of slices of two seconds, frames are given with and without what the machine gave to others.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from core.errors import InputError

#: width, height (px), scale: a small screen, a usual one, a small one at 200 %
SIZES = ((1280, 720, 1), (1920, 1080, 1), (1280, 720, 2))
LONGEST_S = 300.0  # of a case: on the first use kernels are compiled
ON = (
    "every layer on (field, SDOF directions, reachable force, trail, linkage), four traces, energy ledger, timing "
    "strip, plan; four-brake; ticks at 1 kHz; with the participant's window: a pointer that moves 125 times a second"
)


def run_screens(seconds: float, progress: Callable[[float], None] = lambda share: None) -> dict:
    """All cases, each for so long (s), as plain data. InputError where no window can be opened."""
    machine = {"processors": os.cpu_count(), "load_before": _load()}
    cases = [(size, both) for size in SIZES for both in (False, True)]
    drawn = []
    for i, (size, both) in enumerate(cases):
        drawn.append(_case("app.screens.screen_cost", seconds, size, "1" if both else "0"))
        progress((i + 1.0) / (len(cases) + 1.0))
    pointer = _case("app.screens.pointer_lag", seconds, SIZES[0])
    progress(1.0)
    return {"on": ON, "machine": machine, "seconds": seconds, "windows": drawn, "pointer": pointer}


def _load() -> float | None:
    """What the machine had to do over the last minute, where it says so."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None


def _case(module: str, seconds: float, size: tuple[int, int, int], *more: str) -> dict:
    """One case; its line of JSON."""
    width, height, scale = size
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH", ""))))
    environment = {**os.environ, "QT_SCALE_FACTOR": str(scale), "PYTHONPATH": path}
    command = [sys.executable, "-m", module, str(seconds), str(width), str(height), *more]
    try:
        ended = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=LONGEST_S + seconds
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"--screens: {width} x {height} did not end within {LONGEST_S + seconds:.0f} s") from None
    if ended.returncode or not ended.stdout.strip():
        last = (ended.stderr.strip() or "no output").splitlines()[-1]
        raise InputError(f"--screens: no window can be measured at {width} x {height} px ({last})")
    return json.loads(ended.stdout.splitlines()[-1])


def table(result: dict) -> str:
    """The same to read."""
    machine = result["machine"]
    first = result["windows"][0]
    lines = [
        f"platform {first['platform']}, {machine['processors']} processors, load {machine['load_before']}",
        result["on"],
        "",
        f"{'':37}{'frames':>8}{'share of a core':>23}   {'a frame, ms'}",
        f"{'windows':24}{'px':>9}{'':4}{'a s':>8}{'least':>8}{'middle':>7}{'at 60':>8}   "
        f"{'p50':>5}{'p99':>6}{'max':>6}{'cpu max':>9}",
    ]
    lines += [
        f"{one['windows']:24}{one['width']:>5}x{one['height']:<4}x{one['scale']:<2g}{one['frames_per_s']:8.1f}"
        f"{one['core_share']:8.1%}{one['core_share_middle']:7.1%}{one['core_share_at_60']:8.1%}   "
        f"{one['p50_ms']:5.1f}{one['p99_ms']:6.1f}{one['max_ms']:6.1f}{one['max_cpu_ms']:9.1f}"
        for one in result["windows"]
    ]
    pointer = result["pointer"]
    if "refused" in pointer:
        return "\n".join([*lines, "", f"pointer to picture: not measured, {pointer['refused']}"])
    moves = f"{pointer['within']:.1%} of {pointer['moves']} moves within two frames and a tick"
    times = " ".join(f"{name} {pointer[name + '_ms']:.1f}" for name in ("p50", "p99", "max"))
    return "\n".join([*lines, "", f"pointer to picture, ms: {times}; {moves}"])
