"""Many jobs into one table, without recordings: on all cores or a cluster, resumed after a kill.

OUT/KIND.json         the files that decide the work, in full
OUT/parts/000001.csv  the rows of one job, once it is done: work that was killed goes on with the others
OUT/KIND.csv          all rows, once all jobs are done; the parts are then gone

A job's rows depend on nothing but the job, so the table is the same, byte by byte, whatever ran where and when.
"""

import contextlib
import csv
import json
import math
import shutil
import signal
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, NamedTuple, Protocol, TypeVar

from core.device import Device
from core.files import InputError
from experiments.analysis.trials_table import csv_bytes
from experiments.atomic_files import make_empty_folder, rename, write_new_file, written_beside
from experiments.progress import Progress
from experiments.store.files import LOCK, hold_lock
from experiments.study.helpers import cores, process_pool

PARTS = "parts"
AT_A_TIME = 1000  # jobs that wait for a process: there may be a million


class Done(NamedTuple):
    """The result of a job."""

    rows: bytes  # its lines of the table
    ticks: int  # simulated


class Job(Protocol):
    """A part of the work that a process does at a time."""

    @property
    def number(self) -> int:
        """The job's place in the table, from 1."""

    def run(self) -> Done: ...


AnyJob = TypeVar("AnyJob", bound=Job, covariant=True)


@dataclass(frozen=True)
class Work(Generic[AnyJob]):
    """Jobs whose rows make one table."""

    kind: str  # "sweep": names its files, and it in refusals
    name: str
    texts: Mapping[str, str]  # everything that decides it, in full
    columns: tuple[str, ...]
    jobs: Sequence[AnyJob]


class Finished(NamedTuple):
    """The result of a run of work."""

    table: Path
    already_done: int  # jobs
    ticks: int
    wall_s: float


def run_work(work: Work, out: Path, resume: bool, cluster: str | None, progress: Progress) -> Finished:
    """Run every job that is not done yet, then write the table. InputError for wrong input.

    cluster: address of a Dask scheduler, whose workers must have this program; None: the cores of this machine.
    """
    with _workers(cluster, len(work.jobs)) as workers:  # refused before anything is written
        return _run_waiting(work, out, resume, workers, progress)


def _run_waiting(work: Work, out: Path, resume: bool, workers: Executor, progress: Progress) -> Finished:
    began = time.perf_counter()
    stored, table = out / f"{work.kind}.json", out / f"{work.kind}.csv"
    if not resume:
        make_empty_folder(
            out, f"{_a(work)} needs a new or empty folder (or --resume)", (LOCK, f".{stored.name}.partial")
        )
    elif not out.is_dir():
        raise InputError(f"{out}: holds no {work.kind} to resume")
    with hold_lock(out):
        if resume:
            _compare(stored, work)
        else:
            about = {"name": work.name, "texts": dict(work.texts)}
            write_new_file(stored, json.dumps(about, indent=1, sort_keys=True).encode() + b"\n", sync=True)
        parts = {job.number: out / PARTS / f"{job.number:06d}.csv" for job in work.jobs}
        width = len(work.columns)
        done_before = {path.name for path in (out / PARTS).glob("*.csv") if _cells_of(path) == width}
        waiting = [] if table.exists() else [job for job in work.jobs if parts[job.number].name not in done_before]
        done, ticks = len(work.jobs) - len(waiting), 0
        progress(done / len(work.jobs))
        if waiting:
            (out / PARTS).mkdir(exist_ok=True)
        with _ending_at_once(out):
            for number, (rows, more) in _results(waiting, workers):
                with written_beside(parts[number], rows, sync=False) as partial:
                    rename(partial, parts[number])
                done, ticks = done + 1, ticks + more
                progress(done / len(work.jobs))
        if not table.exists():
            rows = b"".join(part.read_bytes() for part in parts.values())
            write_new_file(table, csv_bytes([work.columns]) + rows, sync=True)
        shutil.rmtree(out / PARTS, ignore_errors=True)
    return Finished(table, len(work.jobs) - len(waiting), ticks, time.perf_counter() - began)


def going_on(out: Path) -> str:
    """The message of work that was interrupted and can go on."""
    return f"{out}: interrupted; continue with the same command and --resume"


def table_lines(lines: Iterable[Sequence[object]]) -> bytes:
    """Lines of the table; the cell of a number that is missing or not finite is empty."""
    return csv_bytes([["" if isinstance(cell, float) and not math.isfinite(cell) else cell for cell in line]
                      for line in lines])  # fmt: skip


def device_texts(devices: Iterable[Device]) -> dict[str, str]:
    """The files of devices and of their brakes, in full, by their names in refusals."""
    texts = {}
    for device in devices:
        texts[f"device {device.name}"] = device.text
        texts |= {f"brake {name} of {device.name}": brake for name, brake in device.brake_texts.items()}
    return texts


def local_or_shipped(path: Path, name: str) -> str | Path:
    """A file beside the work's own where there is one of that name, else the shipped thing of that name."""
    local = path.parent / name
    return local if local.is_file() else name


def _a(work: Work) -> str:
    return work.kind if work.kind.endswith("s") else f"a {work.kind}"


def _results(jobs: Sequence[Job], workers: Executor) -> Iterator[tuple[int, Done]]:
    """The results of the jobs as they come. The first runs here: its kernels are compiled once, for all processes."""
    if jobs:
        yield _run(jobs[0])
    for start in range(1, len(jobs), AT_A_TIME):
        for result in as_completed([workers.submit(_run, job) for job in jobs[start : start + AT_A_TIME]]):
            yield result.result()


def _run(job: Job) -> tuple[int, Done]:
    return job.number, job.run()


@contextlib.contextmanager
def _workers(cluster: str | None, jobs: int) -> Iterator[Executor]:
    """The cores of this machine, or the workers of a cluster. InputError: no scheduler answers there."""
    if cluster is None:
        with process_pool(max(1, min(cores(), jobs - 1))) as pool:
            yield pool
        return
    try:
        from dask.distributed import Client
    except ImportError:
        raise InputError("--cluster: needs dask.distributed (pip install -c constraints.txt -e '.[cluster]')") from None
    try:
        client = Client(cluster, timeout=10)
    except (OSError, ValueError) as error:
        raise InputError(f"--cluster: no Dask scheduler answers at {cluster} ({error})") from None
    with client:
        yield client.get_executor(pure=False)


def _cells_of(part: Path) -> int:
    """The number of cells in the rows of a part; an earlier version's has fewer, and its job runs again."""
    with part.open(encoding="utf-8", newline="") as rows:
        return len(next(csv.reader(rows), ()))


@contextlib.contextmanager
def _ending_at_once(out: Path) -> Iterator[None]:
    """An interrupt ends the process on the spot: finished jobs are on the disk, and the workers see that their parent
    is gone. An orderly end would wait for them, sometimes for ever.
    """

    def end(number: int, _: object) -> None:
        with contextlib.suppress(OSError, ValueError):  # stderr may be closed
            print(f"phd: {going_on(out)}", file=sys.stderr, flush=True)
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)

    before = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _compare(path: Path, work: Work) -> None:
    """InputError unless the folder's work is this one: a changed file would mix two in one table."""
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))["texts"]
    except FileNotFoundError:
        raise InputError(f"{path.parent}: holds no {work.kind} to resume (no {path.name})") from None
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is damaged ({type(error).__name__}: {error})") from None
    changed = sorted(key for key in {*stored, *work.texts} if stored.get(key) != work.texts.get(key))
    if changed:
        raise InputError(f"{path}: {_a(work)} was begun with another {', '.join(changed)}; use a new folder")
