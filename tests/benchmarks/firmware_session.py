"""`python -m tests.benchmarks.firmware_session [TRIALS] [--image]`: the paper's session behind the Python board and
behind the board in C as Cortex-M4 machine code, and whether both leave the same bytes.

A whole session with a simulated person and the chain of the bench (device, sensors, board, frames, link, filter, trial,
recording, table), headless and in simulated time: the plant is the clock. By default the core alone runs in the
emulator (some minutes); --image: the whole firmware with its serial ports.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from core import tick_log
from experiments.protocol import load_protocol
from experiments.recording import Sensors
from experiments.store import files
from experiments.store.session import Participant, Session
from experiments.trial.population import load_population
from experiments.trial.real_trial import RealTrial
from hardware.emulated_board.board import Board
from hardware.serial_device import SerialDevice
from tests.benchmarks.board_bench import settings
from tests.benchmarks.board_trials import ALL, BoardInStep, Setting, exchanged

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "support")]
from firmware_board import Image, Pipe, firmware_boards  # noqa: E402
from reference_board import made, on_a_cortex_m4  # noqa: E402


def run_session(
    folder: Path, board: type[Board], trials: int, progress: Callable[[int], None] = lambda n: None
) -> Path:
    """The first trials of a participant's session over boards of this kind; its folder."""
    protocol = load_protocol()
    coming = settings(protocol)[:trials]
    population = load_population()
    session = Session(folder, Participant("01", operator=coming[0].person, population=population.operators), protocol,
                      sync=False)  # fmt: skip
    try:
        for n, setting in enumerate(coming, 1):
            one_trial(session, setting, board)
            progress(n)
    finally:
        session.close()
    return session.folder


def one_trial(session: Session, setting: Setting, board: type[Board]) -> None:
    """A trial from its first tick to its row."""
    operator = setting.operator()
    bench = BoardInStep(setting.device, operator, setting.start, ALL, board)
    link = SerialDevice(setting.device, bench.name, clock=bench.now, open_port=lambda name: bench)
    link.open()
    link.home(setting.start)
    trial, writer = session.begin(setting.planned, Sensors(link.encoders, link.force_channels))
    assert isinstance(trial, RealTrial)
    with writer:
        trial.connect(link)
        bench.begin()
        for rows in exchanged(trial, operator, lambda: bench.ticks):
            writer.write(np.array(rows).reshape(-1, tick_log.BENCH_WIDTH))
        session.finish(trial, writer)
    link.close()


def differing(one: Path, other: Path) -> list[str]:
    """The files of recordings and table that are not the same in both sessions, byte for byte."""
    names = sorted(str(file.relative_to(one)) for file in [*(one / files.TRIALS).iterdir(), one / files.TABLE])
    there = sorted(str(file.relative_to(other)) for file in [*(other / files.TRIALS).iterdir(), other / files.TABLE])
    assert names == there
    return [name for name in names if (one / name).read_bytes() != (other / name).read_bytes()]


def main(arguments: list[str]) -> int:
    """Run both and compare; 0: they are the same."""
    trials = next((int(word) for word in arguments if word.isdigit()), 60)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        running = Image(made("plant-f405.elf")) if "--image" in arguments else Pipe(on_a_cortex_m4())
        kinds = {"Python": Board, "Cortex-M4": firmware_boards(lambda: running)}
        sessions = {}
        try:
            for kind, board in kinds.items():
                began = time.perf_counter()
                sessions[kind] = run_session(folder / kind, board, trials, lambda n: print(".", end="", flush=True))
                print(f" {kind}: {n_rows(sessions[kind])} trials in {time.perf_counter() - began:.0f} s")
        finally:
            running.close()
        wrong = differing(*sessions.values())
        recordings = len(list((sessions["Python"] / files.TRIALS).iterdir()))
        same = recordings - sum(name.startswith(files.TRIALS) for name in wrong)
        table = "differs" if files.TABLE in wrong else "the same"
        print(f"{same} of {recordings} recordings are the same, byte for byte; {files.TABLE} is {table}")
        return 1 if wrong else 0


def n_rows(folder: Path) -> int:
    """How many trials are in a session's table."""
    return len((folder / files.TABLE).read_text().splitlines()) - 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
