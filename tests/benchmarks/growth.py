"""How the cost of a study grows: seconds and memory of each command that reads or writes one, against its trials.

python -m tests.benchmarks.growth     studies of 60 to 480 trials: some minutes, 2 GB of temporary files

Timed figures depend on what else runs: they are shown, never judged. docs/speed-and-error.md has the figures.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

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
    memory_MB: float  # most that its largest process held
    written_MB: float


def measure_all() -> list[Cost]:
    """Make a study of each size and run every command on it."""
    costs: list[Cost] = []
    with tempfile.TemporaryDirectory(prefix="phd-growth-") as folder:
        for n, people in enumerate(PEOPLE):
            study, out = Path(folder) / f"study-{people}", Path(folder) / f"out-{people}"
            made = "study", "--operators", str(people), "--seed", "1", "--out", str(study)
            if n == 0:  # the first compiles, and reads every file of the program for the first time
                cost_of("study", 0, (*made[:-1], f"{study}-warm"), Path(f"{study}-warm"))
            trials = TRIALS_OF_ONE * people
            costs.append(cost_of("study", trials, made, study))
            out.mkdir()
            for name, words in COMMANDS.items():
                arguments = tuple(word.format(study=study, out=out) for word in words)
                costs.append(cost_of(name, trials, arguments, out))
    return costs


def cost_of(name: str, trials: int, arguments: tuple[str, ...], out: Path) -> Cost:
    """Run `phd` with these arguments and count what it writes into `out`."""
    before, start = size_of(out), time.perf_counter()
    process = subprocess.Popen([sys.executable, "-m", "app.cli", *arguments], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0, f"phd {arguments[0]} failed"
    memory_MB = usage.ru_maxrss * 1e3 / MB  # of kB
    return Cost(name, trials, time.perf_counter() - start, memory_MB, (size_of(out) - before) / MB)


def size_of(folder: Path) -> int:
    """Bytes of all files in a folder."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def table(costs: list[Cost]) -> str:
    """For each command seconds against trials, the straight line through them, memory and what is written."""
    sizes = sorted({cost.trials for cost in costs})
    lines = [
        f"{'':24} {'seconds, by trials':^{8 * len(sizes)}}  start  ms a  growth   memory (MB)   written",
        f"{'command':24} "
        + "".join(f"{size:8d}" for size in sizes)
        + "      s  trial  power  least   most  MB a trial",
    ]
    for name in dict.fromkeys(cost.command for cost in costs):
        own = [cost for cost in costs if cost.command == name]
        trials = np.array([cost.trials for cost in own], dtype=float)
        seconds = np.array([cost.seconds for cost in own])
        slope, start = np.polyfit(trials, seconds, 1)
        power = np.log(seconds[-1] / seconds[-2]) / np.log(trials[-1] / trials[-2])
        memory = [cost.memory_MB for cost in own]
        shown = "".join(f"{duration:8.2f}" for duration in seconds)
        lines.append(
            f"{name:24} {shown}  {start:5.1f} {1e3 * slope:6.1f} {power:6.2f} {min(memory):6.0f} {max(memory):6.0f}  "
            f"{own[-1].written_MB / own[-1].trials:10.3f}"
        )
    lines += [
        "",
        "start and ms a trial: the straight line through the seconds. growth power: 1 where the second half of the",
        "trials costs what the first half did, less where a constant part is left, more where it grows faster.",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(measure_all()))
