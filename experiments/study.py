"""`phd study`: the paper's whole study with simulated operators, from plan to box plots."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from core import row
from core.control import PRESETS
from core.device import Device
from core.errors import InputError
from experiments.boxplots import draw_boxplots
from experiments.operator import draw_person
from experiments.plan import participant_index
from experiments.session import Choices, Session, check_reach, write_pooled_table
from experiments.tick import TICK_S
from experiments.trials_table import TrialRow

#: Ticks run at a time: long enough that a call costs nothing, short enough that an interrupt is heard.
CHUNK_TICKS = 8192


def run_study(
    out: Path,
    operators: int,
    seed: int,
    devices: Sequence[Device],
    rules: str = "settled",
    low_gain: float = 5.0,
    progress: Callable[[float], None] | None = None,
) -> dict:
    """Run every operator's session into `out`, a new or empty folder; the summary. InputError for wrong input."""
    out = Path(out)
    check_reach(devices)
    make_empty(out)
    choices = Choices(seed, rules, low_gain)
    began = time.perf_counter()
    simulating, ticks, done = 0.0, 0, 0
    rows = np.empty((CHUNK_TICKS, row.WIDTH))
    for operator in range(1, operators + 1):
        label = f"{operator:02d}"
        generator = np.random.default_rng(np.random.SeedSequence([seed, participant_index(label)]))
        session = Session(out, label, devices, choices, draw_person(generator), sync=False)
        for planned in session.plan:
            trial, writer = session.begin(planned)
            with writer:
                while not trial.finished:
                    start = time.perf_counter()
                    n = trial.run(rows)
                    simulating += time.perf_counter() - start
                    writer.write(rows[:n])
                ticks += trial.ticks
                session.finish(trial, writer)
            done += 1
            if progress:
                progress(done / (operators * len(session.plan)))
    table = write_pooled_table(out)
    assumed = any(device.assumed for device in devices)
    draw_boxplots(table, out / "figures", choices.note(assumed) + ", simulated operators")
    return {
        "out": str(out),
        "trials": len(table),
        **{f"done_controller_{number}": share_done(table, number) for number in PRESETS},
        "rules": rules,
        "low_gain_N_s_m": low_gain,
        "parameters": "assumed" if assumed else "as in the files",
        "simulated_s": ticks * TICK_S,
        "simulation_wall_s": simulating,
        "wall_s": time.perf_counter() - began,
    }


def share_done(rows: Sequence[TrialRow], controller: int) -> float:
    """Share of a controller's trials that reached the end."""
    of_it = [r.status == "done" for r in rows if r.controller == controller]
    return float(np.mean(of_it)) if of_it else 0.0


def make_empty(folder: Path) -> None:
    """A new or empty folder; InputError otherwise."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise InputError(f"{folder}: is not empty, a study needs a new or empty folder")
        (folder / ".writable").touch()
        (folder / ".writable").unlink()
    except OSError as error:
        raise InputError(f"{folder}: cannot be used ({(error.strerror or str(error)).lower()})") from None
