"""`python -m tests.benchmarks.screen_bench [SECONDS]`: what the windows cost at several sizes, and how far the picture
is behind the pointer.

Each case runs in a process of its own, as the app does: Qt takes its scale when it starts.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from core.files import InputError

#: width, height (px), scale: a small screen, a usual one, the same at 200 %
SIZES = ((1280, 720, 1), (1920, 1080, 1), (960, 540, 2))
START_S = 4.0  # what a case takes besides being measured, about: for the progress bar
LONGEST_S = 300.0  # of a case: on the first use kernels are compiled
LOOK_S = 0.25
FRAME_MS = 1e3 / 60.0
ON = (
    "every layer on (field, directions, force, trail, linkage), four traces, energy ledger,\n"
    "plan; four-brake; ticks at 1 kHz; with the participant's window: a pointer that moves 125 times a second"
)


def run_screens(seconds: float, progress: Callable[[float], None] = lambda share: None) -> dict:
    """All cases, each for so long (s), as plain data. InputError where no window can be opened."""
    machine = {"processors": os.cpu_count(), "load_before": _load()}
    cases = [("tests.benchmarks.screen_cost", size, both) for size in SIZES for both in ("0", "1")]
    cases.append(("tests.benchmarks.pointer_lag", SIZES[1]))
    found: list[dict] = []
    for module, *about in cases:
        found.append(_case(module, seconds, *about, progress=lambda share: progress((len(found) + share) / len(cases))))
    *windows, pointer = found
    return {"on": ON, "machine": machine, "seconds": seconds, "windows": windows, "pointer": pointer}


def _load() -> float | None:
    """What the machine had to do over the last minute, where it says so."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None


def _case(
    module: str, seconds: float, size: tuple[int, int, int], *more: str, progress: Callable[[float], None]
) -> dict:
    """One case; its line of JSON."""
    width, height, scale = size
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH", ""))))
    environment = {**os.environ, "QT_SCALE_FACTOR": str(scale), "PYTHONPATH": path}
    command = [sys.executable, "-m", module, str(seconds), str(width), str(height), *more]
    began_s, said, wrong = time.perf_counter(), "", ""
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        while process.returncode is None:
            passed_s = time.perf_counter() - began_s
            progress(min(passed_s / (seconds + START_S), 1.0))
            if passed_s > seconds + LONGEST_S:
                process.kill()
                raise InputError(f"--screens: {width} x {height} px did not end within {passed_s:.0f} s")
            try:
                said, wrong = process.communicate(timeout=LOOK_S)
            except subprocess.TimeoutExpired:
                continue
            except BaseException:
                process.kill()
                raise
    if process.returncode or not said.strip():
        last = (wrong.strip() or "no output").splitlines()[-1]
        raise InputError(f"--screens: no window can be measured at {width} x {height} px ({last})")
    return json.loads(said.splitlines()[-1])


def table(result: dict) -> str:
    """The same to read."""
    machine = result["machine"]
    first = result["windows"][0]
    lines = [
        f"platform {first['platform']}, {machine['processors']} processors, load {machine['load_before']}; "
        f"each case {result['seconds']:g} s",
        result["on"],
        "",
        f"{'':39}{'frames':>8}{'share of a core':>17}   {'a frame, ms':32}{'over':>6}",
        f"{'windows':26}{'screen':13}{'a s':>8}{'all':>9}{'least s':>8}   "
        f"{'p50':>5}{'p99':>7}{'longest':>9}{'most cpu':>10} {'50 ms':>6}",
    ]
    for one in result["windows"]:
        screen = f"{one['width'] * one['scale']:.0f}x{one['height'] * one['scale']:.0f}"
        screen += "" if one["scale"] == 1.0 else f" {one['scale']:.0%}"
        lines.append(
            f"{one['windows']:24}{screen:>15}{one['frames_per_s']:8.1f}"
            f"{one['core_share']:9.1%}{one['core_share_least']:8.1%}   "
            f"{one['p50_ms']:5.1f}{one['p99_ms']:7.1f}{one['max_ms']:9.1f}{one['max_cpu_ms']:10.1f} "
            f"{one['long_frames']:6}"
        )
    pointer = result["pointer"]
    if "refused" in pointer:
        return "\n".join([*lines, "", f"pointer to picture: not measured, {pointer['refused']}"])
    ways = {name: pointer[f"{name}_ms"] for name in ("p50", "p95", "max")}
    times = ", ".join(f"{name} {way:.1f} ({way / FRAME_MS:.1f} frames)" for name, way in ways.items())
    return "\n".join(
        [
            *lines,
            "",
            f"pointer to the participant's picture, {pointer['width']}x{pointer['height']}, both windows, ms: {times}",
            f"of which, p50: to the memory that the loop reads {pointer['aimed_p50_ms']:.1f}, to the tick that used it "
            f"{pointer['tick_p50_ms']:.1f}, to the end of painting {pointer['drawn_p50_ms']:.1f}",
            f"{pointer['within']:.1%} of {pointer['moves'] + pointer['lost']} moves within two frames and a tick "
            f"({pointer['limit_ms']:.1f} ms); {pointer['lost']} overtaken by the next",
        ]
    )


if __name__ == "__main__":
    print(table(run_screens(float(sys.argv[1]) if len(sys.argv) > 1 else 5.0)))
