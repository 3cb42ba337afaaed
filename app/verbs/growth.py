"""How the cost of a study grows: seconds and memory of each command that reads or writes one, against its trials.

Timed figures depend on what else runs: they are shown, never judged.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from core.files import InputError
from experiments.progress import Progress, no_progress

#: Simulated people of the studies, 60 trials each.
PEOPLE = (1, 2, 4, 8)
TRIALS_OF_ONE = 60
MB = 1e6
#: What is measured of each study, after it was made: name -> arguments of `phd`.
COMMANDS = {
    "verify": ("verify", "{study}"),
    "recover": ("recover", "{study}"),
    "analyze": ("analyze", "{study}", "--out", "{out}/analysis"),
    "export --bids": ("export", "{study}", "--bids", "{out}/bids"),
    "export --csv": ("export", "{study}", "--csv", "{out}/csv"),
    "export --csv --compress": ("export", "{study}", "--csv", "{out}/compressed", "--compress"),
}


class Cost(NamedTuple):
    """The cost of one command on one study."""

    command: str
    trials: int
    seconds: float
    memory_MB: float | None  # most that its largest process held; None where the system does not tell
    written_MB: float


def measure_all(progress: Progress = no_progress) -> list[dict]:
    """Make a study of each size and run every command on it; a row each. InputError if a command fails."""
    found: list[Cost] = []
    with tempfile.TemporaryDirectory(prefix="phd-growth-") as folder:
        for n, people in enumerate(PEOPLE):
            study, out = Path(folder) / f"study-{people}", Path(folder) / f"out-{people}"
            made = "study", "--operators", str(people), "--seed", "1", "--out", str(study)
            if n == 0:  # the first compiles, and reads every file of the program for the first time
                cost_of("study", 0, (*made[:-1], f"{study}-warm"), Path(f"{study}-warm"))
            trials = TRIALS_OF_ONE * people
            found.append(cost_of("study", trials, made, study))
            out.mkdir()
            for k, (name, words) in enumerate(COMMANDS.items()):
                arguments = tuple(word.format(study=study, out=out) for word in words)
                found.append(cost_of(name, trials, arguments, out))
                progress((n + (k + 1) / len(COMMANDS)) / len(PEOPLE))
    return [cost._asdict() for cost in found]


def cost_of(name: str, trials: int, arguments: tuple[str, ...], out: Path) -> Cost:
    """Run `phd` with these arguments and count what it writes into `out`."""
    before, start = size_of(out), time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "app.cli", *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    errors = process.stderr.read()
    if hasattr(os, "wait4"):
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        memory = usage.ru_maxrss * 1e3 / MB  # in kB
    else:
        process.wait()
        memory = None
    if process.returncode:
        last = (errors.splitlines() or ["no word"])[-1]
        raise InputError(f"phd {arguments[0]}: ended with {process.returncode} while its cost was measured: {last}")
    return Cost(name, trials, time.perf_counter() - start, memory, (size_of(out) - before) / MB)


def size_of(folder: Path) -> int:
    """Bytes of all files in a folder."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def table(rows: list[dict]) -> str:
    """For each command seconds against trials, the straight line through them, memory and what is written."""
    sizes = sorted({row["trials"] for row in rows})
    lines = [
        f"{'':24} {'seconds, by trials':^{8 * len(sizes)}}  start  ms a  growth   memory (MB)   written",
        f"{'command':24} "
        + "".join(f"{size:8d}" for size in sizes)
        + "      s  trial  power  least   most  MB a trial",
    ]
    for name in dict.fromkeys(row["command"] for row in rows):
        own = [row for row in rows if row["command"] == name]
        trials = np.array([row["trials"] for row in own], dtype=float)
        seconds = np.array([row["seconds"] for row in own])
        slope, start = np.polyfit(trials, seconds, 1)
        power = np.log(seconds[-1] / seconds[-2]) / np.log(trials[-1] / trials[-2])
        memory = [row["memory_MB"] for row in own]
        known = [megabytes for megabytes in memory if megabytes is not None]
        held = f"{min(known):6.0f} {max(known):6.0f}" if known else f"{'-':>6} {'-':>6}"
        shown = "".join(f"{duration:8.2f}" for duration in seconds)
        each = own[-1]["written_MB"] / own[-1]["trials"]
        lines.append(f"{name:24} {shown}  {start:5.1f} {1e3 * slope:6.1f} {power:6.2f} {held}  {each:10.3f}")
    lines += [
        "",
        "start and ms a trial: the straight line through the seconds. growth power: 1 where the second half of the",
        "trials costs what the first half did, less where a constant part is left, more where it grows faster.",
    ]
    return "\n".join(lines)
