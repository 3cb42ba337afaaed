"""`phd study --sweep`: many studies at once, without recordings, on all cores or a cluster, into one tidy table.

OUT/sweep.json        what the sweep is, in full
OUT/parts/000001.csv  the rows of one job, once it is done: a sweep that was killed goes on with the others
OUT/sweep.csv         all rows, once all jobs are done; the parts are then gone

A job's trials depend on nothing but the job, so the table is the same, byte by byte, whatever ran where and when.
"""

import contextlib
import csv
import functools
import io
import itertools
import json
import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import joblib
import msgspec
import numpy as np

from core import tick_log
from core.control.controllers import ALGORITHMS, PARAMETERS, Preset, make_preset
from core.device import Device
from core.files import InputError, Table, choice, parse_toml, read_text
from core.path import PathFile, build_path, point_at
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis.metrics import NO_METRICS, Metrics, trial_metrics
from experiments.plan import PlannedTrial
from experiments.protocol import PARAMETER_TYPES, Count, Rules, Text, TrialRules, load_protocol, plain_text
from experiments.recording.atomic_files import give_new_name, make_empty_folder, written_beside
from experiments.recording.schema import recording_of
from experiments.session.files import LOCK, hold_lock
from experiments.trial.population import Population, load_population
from experiments.trial.tick import TICK_S
from experiments.trial.trial import Trial

Names = Annotated[tuple[Text, ...], msgspec.Meta(min_length=1)]
MOST_JOBS = 1_000_000


class _SweptKind(Table, frozen=True):
    """What every swept controller has."""

    kind: Annotated[str, choice(*ALGORITHMS)]

    def __post_init__(self) -> None:
        self.presets()

    def presets(self) -> list[Preset]:
        """Every combination of its values. ValueError if its parameters are not those of its algorithm."""
        combinations = itertools.product(*(getattr(self, name) or (None,) for name in PARAMETERS))
        given = [dict(zip(PARAMETERS, values, strict=True)) for values in combinations]
        return [make_preset(self.kind, self.kind, one) for one in given]


#: One algorithm, each parameter with every value that it is to have.
SweptController = msgspec.defstruct(
    "SweptController",
    [(name, Annotated[tuple[kind, ...], msgspec.Meta(min_length=1)] | None, None)
     for name, kind in PARAMETER_TYPES.items()],
    bases=(_SweptKind,), frozen=True, kw_only=True, forbid_unknown_fields=True,
)  # fmt: skip


class SweepFile(Table, frozen=True):
    """One sweep as it stands in its file."""

    name: Text
    controller: Annotated[tuple[SweptController, ...], msgspec.Meta(min_length=1)]
    protocol: Text = "paper"
    operators: Count = 3
    repetitions: Count = 3
    seed: Annotated[int, msgspec.Meta(ge=0)] = 1
    populations: Names = ("average",)
    devices: Names | None = None
    rules: Annotated[tuple[Rules, ...], msgspec.Meta(min_length=1)] | None = None

    def __post_init__(self) -> None:
        plain_text(self.name, "name")
        for key in ("populations", "devices", "rules"):
            values = getattr(self, key) or ()
            if len(set(values)) < len(values):
                raise ValueError(f"{key}: the same one stands there twice")


@dataclass(frozen=True)
class Job:
    """What one process does at a time: every path and repetition of one person in one cell."""

    number: int  # in the order of the table
    population: Population
    device: Device
    rules: str
    preset: Preset
    operator: int
    seed: int
    repetitions: int
    paths: dict[int, PathFile]
    trial: TrialRules


@dataclass(frozen=True)
class Sweep:
    """A sweep, checked and spread out."""

    name: str
    texts: dict[str, str]  # every file that decides it, in full
    assumed: bool
    jobs: tuple[Job, ...]


def load_sweep(path: Path) -> Sweep:
    """The sweep of a file. InputError, one sentence with file and key, for anything that cannot be run."""
    text = read_text(path)
    file = parse_toml(text, SweepFile, str(path))
    devices = None if file.devices is None else [_beside(path, name) for name in file.devices]
    protocol = load_protocol(_beside(path, file.protocol), devices=devices)
    populations = [load_population(_beside(path, name)) for name in file.populations]
    names = [one.name for one in populations]
    if len(set(names)) < len(names):
        raise InputError(f"{path}: populations: two have the same name ({', '.join(names)})")
    presets = [preset for controller in file.controller for preset in controller.presets()]
    if len(set(presets)) < len(presets):
        raise InputError(f"{path}: controller: the same controller stands there twice")
    rules = file.rules or (protocol.rules,)
    varied = populations, protocol.devices, rules, presets, range(1, file.operators + 1)
    count = math.prod(map(len, varied))
    if count > MOST_JOBS:
        raise InputError(f"{path}: {count} people in cells are more than the {MOST_JOBS} that one sweep may have")
    alike = file.seed, file.repetitions, protocol.paths, protocol.trial
    jobs = tuple(Job(number, *cell, *alike) for number, cell in enumerate(itertools.product(*varied), start=1))
    texts = {"sweep": text, f"protocol {protocol.name}": protocol.text}
    texts |= {f"population {one.name}": one.text for one in populations}
    for device in protocol.devices:
        texts |= {f"device {device.name}": device.text}
        texts |= {f"brake {name} of {device.name}": brake for name, brake in device.brake_texts.items()}
    assumed = protocol.assumed or any(one.assumed for one in populations)
    return Sweep(file.name, texts, assumed, jobs)


def _beside(path: Path, name: str) -> str | Path:
    """A file beside the sweep's where there is one of that name, else the shipped thing of that name."""
    there = path.parent / name
    return there if there.is_file() else name


STORED, TABLE, PARTS = "sweep.json", "sweep.csv", "parts"
CHUNK_TICKS = 65_536
LOOK_S = 0.5  # how often a worker looks whether its parent lives
ENERGIES = ("energy_residual_J", "energy_added_max_J")
COLUMNS = (
    "population", "configuration", "rules", "kind", *PARAMETERS, "operator", "segment", "repetition", "status",
    *Metrics._fields, *ENERGIES,
)  # fmt: skip


def run_sweep(
    sweep: Sweep,
    out: Path,
    resume: bool = False,
    cluster: str | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> dict:
    """Run every job that is not done yet, then write the table; the summary. InputError for wrong input.

    cluster: address of a Dask scheduler, whose workers must have this program; None: the cores of this machine.
    """
    began = time.perf_counter()
    out = Path(out)
    if not resume:
        make_empty_folder(out, "a sweep needs a new or empty folder (or --resume)", (LOCK, f".{STORED}.partial"))
    elif not out.is_dir():
        raise InputError(f"{out}: holds no sweep to resume")
    with hold_lock(out):
        (compare if resume else store)(out, sweep)
        parts = {job.number: out / PARTS / f"{job.number:06d}.csv" for job in sweep.jobs}
        waiting = [] if (out / TABLE).exists() else [job for job in sweep.jobs if not parts[job.number].exists()]
        done, ticks = len(sweep.jobs) - len(waiting), 0
        if waiting:
            (out / PARTS).mkdir(exist_ok=True)
        with ending_at_once():
            for number, data, more in results(waiting, cluster):
                with written_beside(parts[number], data, sync=False) as partial:
                    partial.rename(parts[number])
                done, ticks = done + 1, ticks + more
                progress(done / len(sweep.jobs))
        rows = gather(out / TABLE, list(parts.values()))
    return {
        "out": str(out / TABLE),
        "name": sweep.name,
        "jobs": len(sweep.jobs),
        "already_done": len(sweep.jobs) - len(waiting),
        "trials": len(rows),
        "share_done": float(np.mean([row["status"] == "done" for row in rows])),
        "parameters": "assumed" if sweep.assumed else "as in the files",
        "simulated_s": ticks * TICK_S,
        "wall_s": time.perf_counter() - began,
    }


# -------------------------------------------------------------------------------------------------------------- a job


def run_job(job: Job) -> tuple[int, bytes, int]:
    """The job's number, its rows as they stand in the table, and how many ticks that took."""
    person = job.population.draw(np.random.default_rng(np.random.SeedSequence([job.seed, job.operator])))
    first = build_path(next(iter(job.paths.values())), "path")
    x, y, _, _ = point_at(first, 0.5 * first.length)
    assumed = job.trial.assumptions
    simulation = SimulatedDevice(assumed.applied_to(job.device), (x, y), fidelity=assumed.simulated_fidelity)
    text, ticks = io.StringIO(), 0
    writer = csv.writer(text, lineterminator="\n")
    for repetition in range(1, job.repetitions + 1):
        for segment, path in job.paths.items():
            # as in a study: the same noise for every controller, device and rule set
            generator = np.random.default_rng(np.random.SeedSequence([job.seed, job.operator, segment, repetition]))
            planned = PlannedTrial(1, 1, job.device.name, 1, segment, repetition)
            trial = Trial(simulation, planned, path, job.preset, job.rules, job.trial, person, generator)
            rows = run_trial(trial)
            writer.writerow(table_row(job, trial, rows))
            ticks += len(rows)
    return job.number, text.getvalue().encode(), ticks


def run_trial(trial: Trial) -> np.ndarray:
    """Every tick of a trial (n, tick_log.WIDTH)."""
    blocks = []
    while not trial.finished:
        block = np.empty((CHUNK_TICKS, tick_log.WIDTH))
        blocks.append(block[: trial.run(block)])
    return np.concatenate(blocks)


def table_row(job: Job, trial: Trial, rows: np.ndarray) -> list[object]:
    """A trial's row of the table, in the order of `COLUMNS`; a measure that is missing or not finite is empty."""
    outcome, preset = trial.outcome(), job.preset
    recording = recording_of(rows, job.device.braked)
    metrics = trial_metrics(recording, trial.path) if recording.in_phase("move").any() else NO_METRICS
    measured = (*metrics, *(outcome[name] for name in ENERGIES))
    return [
        job.population.name, job.device.name, job.rules, preset.kind, *map(preset.value, PARAMETERS), job.operator,
        trial.planned.segment, trial.planned.repetition, outcome["status"],
        *("" if value is None or not math.isfinite(value) else repr(float(value)) for value in measured),
    ]  # fmt: skip


# --------------------------------------------------------------------------------------------------------- the workers


def results(jobs: Sequence[Job], cluster: str | None) -> Iterator[tuple[int, bytes, int]]:
    """The results of the jobs as they come, from all cores or the cluster's workers."""
    if cluster is None:
        if jobs:  # its kernels are compiled here, if they have to be, rather than by every worker at the same time
            yield run_job(jobs[0])
        calls = (joblib.delayed(run_beside_parent)(job, os.getpid()) for job in jobs[1:])
        workers = max(1, min(joblib.cpu_count(), len(jobs) - 1))
        yield from joblib.Parallel(n_jobs=workers, return_as="generator_unordered")(calls)
        return
    try:
        from dask.distributed import Client
    except ImportError:
        raise InputError("--cluster: needs dask.distributed (pip install -c constraints.txt -e '.[cluster]')") from None
    try:
        client = Client(cluster, timeout=10)
    except (OSError, ValueError) as error:
        raise InputError(f"--cluster: no Dask scheduler answers at {cluster} ({error})") from None
    with client, joblib.parallel_config(backend="dask"):
        yield from joblib.Parallel(return_as="generator_unordered")(joblib.delayed(run_job)(job) for job in jobs)


@contextlib.contextmanager
def ending_at_once() -> Iterator[None]:
    """An interrupt ends the process on the spot: finished jobs are on the disk, and the workers see that their parent
    is gone. An orderly end would wait for them, sometimes for ever.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, signal.SIG_DFL) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def run_beside_parent(job: Job, parent: int) -> tuple[int, bytes, int]:
    """A job in a worker of this machine, which ends when the sweep does, however that ends."""
    if os.getpid() != parent:
        end_with(parent)
    return run_job(job)


@functools.cache
def end_with(parent: int) -> None:
    """From now on this process ends when its parent does."""

    def look() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK_S)
        os._exit(1)

    threading.Thread(target=look, name="looks at its parent", daemon=True).start()


# ----------------------------------------------------------------------------------------------------------- the files


def store(out: Path, sweep: Sweep) -> None:
    """Write what the sweep is into its folder."""
    about = json.dumps({"name": sweep.name, "texts": sweep.texts}, indent=1, sort_keys=True).encode() + b"\n"
    with written_beside(out / STORED, about) as partial:
        give_new_name(partial, out / STORED)


def compare(out: Path, sweep: Sweep) -> None:
    """InputError unless the folder's sweep is this one: a changed file would mix two sweeps in one table."""
    try:
        stored = json.loads((out / STORED).read_text(encoding="utf-8"))["texts"]
    except FileNotFoundError:
        raise InputError(f"{out}: holds no sweep to resume (no {STORED})") from None
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{out / STORED}: is damaged ({type(error).__name__}: {error})") from None
    changed = sorted(key for key in {*stored, *sweep.texts} if stored.get(key) != sweep.texts.get(key))
    if changed:
        raise InputError(f"{out / STORED}: the sweep was begun with another {', '.join(changed)}; use a new folder")


def gather(table: Path, parts: Sequence[Path]) -> list[dict[str, str]]:
    """The rows of the table, which is written from the parts if it is not there yet; the parts then go."""
    if not table.exists():
        data = (",".join(COLUMNS) + "\n").encode() + b"".join(part.read_bytes() for part in parts)
        with written_beside(table, data) as partial:
            give_new_name(partial, table)
    for part in parts:
        part.unlink(missing_ok=True)
    with contextlib.suppress(FileNotFoundError):
        parts[0].parent.rmdir()
    with table.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
