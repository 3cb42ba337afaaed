"""A power cut or kill -9 at any moment, and a refusing disk: what was acknowledged is there, nothing counts twice."""

import json
import os
import random
import shutil
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from recorded_disk import ACK, KILLED, NAMES, SOME, SYNCED, RecordedDisk
from sessions import of, recording_path

from experiments.recording import Recording
from experiments.store.files import STUDY, is_half_created, rows_of, runs_used
from experiments.store.journal import read_events
from experiments.store.recording import read_recording
from experiments.store.session import Session
from experiments.store.study_plan import read_study
from experiments.store.verify import verify

#: A session with a trial, one under which the disk fails for a while, one that the disk refuses until the end; each
#: commit is acknowledged, as the window is told of it.
PROGRAM = """
import json, os
import numpy as np
from protocols import PAPER, short
from core import tick_log
from experiments.store.journal import read_events
from experiments.store.session import Participant, Session
from experiments.store.study_plan import StudyPlan, write_study
from experiments.trial.population import load_population

acks = os.open(disk / "ack", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
def ack(**what):
    os.write(acks, (json.dumps(what) + "\\n").encode())

def piece(trial, writer, ticks=400):
    rows = np.empty((ticks, tick_log.WIDTH))
    writer.write(rows[:trial.run(rows)])

def flush(session, writer):
    try:
        writer.flush()
    except OSError as error:
        assert error.errno == 5, error
    ack(run=writer.place[1], ticks=writer.written.ticks)

def whole(session):
    trial, writer = session.begin(session.next_planned())
    ack(events=len(read_events(session.folder)))
    while not trial.finished:
        piece(trial, writer)
        flush(session, writer)
    row = session.finish(trial, writer)
    ack(row=row.run, status=row.status)

population = load_population()
who = Participant("01", operator=population.draw(np.random.default_rng(3)), population=population.operators)
data = disk / "data"
session = Session(data, who, short())
ack(events=len(read_events(session.folder)))
whole(session)
session.note("it goes well")
ack(events=len(read_events(session.folder)))
trial, writer = session.begin(session.next_planned())
for k in range(6):
    told.write_text("fsync session.db" if k == 2 else "write session.db" if k == 3 else "")
    piece(trial, writer)
    flush(session, writer)
    assert (session.database.trouble is not None) == (k in (2, 3)), k
while not trial.finished:
    piece(trial, writer)
row = session.finish(trial, writer)
ack(row=row.run, status=row.status)
session.close()
write_study(data, StudyPlan(1, PAPER, population))
ack(study=True)
session = Session.resume(data, "01")
session.exclude(1, "sneezed")
ack(row=1, status="excluded")
trial, writer = session.begin(session.next_planned())
for k in range(4):
    told.write_text("write session.db" if k == 2 else told.read_text())
    piece(trial, writer)
    flush(session, writer)
assert "they are in" in session.end()
ack(run=3, ticks=writer.rows)
told.write_text("")
session = Session.resume(data, "01")
assert session.repaired.ticks_kept_elsewhere
ack(row=3, status="recovered")
whole(session)
session.close()
"""


@pytest.fixture(scope="module")
def disk(tmp_path_factory: pytest.TempPathFactory) -> RecordedDisk:
    return recorded(tmp_path_factory.mktemp("disk"))


def recorded(folder: Path) -> RecordedDisk:
    """The disk of `PROGRAM`."""
    disk = RecordedDisk(folder)
    done = disk.run(PROGRAM)
    assert done.returncode == 0, done.stderr
    return disk


def check(image: Path, acks: list[str], whole: dict[int, Recording]) -> str:
    """Everything that was acknowledged is there; what the session was in a word. whole: run -> the trial uncut."""
    said = [json.loads(ack) for ack in acks]
    session = of(image / "data")
    if is_half_created(session):
        assert not said
        return "not begun"
    events = len(read_events(session))
    opened = Session.resume(image / "data", "01", sync=False)
    opened.close()
    assert not opened.repaired.not_repaired
    faults = verify(image / "data")["faults"]
    assert {fault["file"] for fault in faults} <= {"trials.csv", "sub-01/ses-01"}, faults
    rows = {row.run: row for row in rows_of(session)}
    assert len(rows) == len(rows_of(session)), "a trial counts twice"
    for ack in said:
        assert events >= ack.get("events", 0)
        if "row" in ack:
            assert rows[ack["row"]].status in (ack["status"], "excluded")
        if "study" in ack:
            read_study(image / "data")
    for run, ticks in {ack["run"]: ack["ticks"] for ack in said if ack.get("ticks")}.items():  # the last of each run
        kept, uncut = read_recording(recording_path(session, run)), whole[run]
        assert kept.whole and kept.rows >= ticks, (run, ticks, kept.rows)
        for name, values in kept.columns.items():
            assert np.array_equal(values, uncut.columns[name][: kept.rows], equal_nan=True)
    left = {"study": (image / "data" / STUDY).exists(), "rescued": opened.repaired.ticks_kept_elsewhere > 0}
    return next((name for name in ("rescued", "study") if left[name]), "session")


def told(records: list) -> list[int]:
    """The moments at which something was just acknowledged: the last of each kind."""
    kinds: dict[tuple, list[int]] = {}
    for k, record in enumerate(records, start=1):
        if record[3].endswith(f"/{ACK}") and record[4]:
            said = json.loads(record[4])
            kinds.setdefault((*said, said.get("run"), said.get("row")), []).append(k)
    return sorted({moments[-1] for moments in kinds.values()}, reverse=True)


def cuts(disk: RecordedDisk, count: int, seed: int) -> Counter:
    """Cut the power as something was acknowledged, and at random moments; what was found, by kind of cut."""
    records, draw, seen = disk.records(), random.Random(seed), Counter()
    with tempfile.TemporaryDirectory() as name:
        moments = [(len(records), NAMES), *((moment, SYNCED) for moment in told(records))]
        moments += [(draw.randrange(len(records)), draw.choice((SYNCED, NAMES, SOME))) for _ in range(count)]
        moments += [(draw.randrange(len(records)), KILLED) for _ in range(count)]
        whole: dict[int, Recording] = {}
        for number, (moment, how) in enumerate(moments):
            image = Path(name) / "image"
            acks = disk.cut(records[:moment], image, how, seed + number)
            os.environ["XDG_DATA_HOME"] = str(image / "own")
            if not whole:
                Session.resume(image / "data", "01", sync=False).close()
                runs = runs_used(of(image / "data"))
                whole = {run: read_recording(recording_path(of(image / "data"), run)) for run in runs}
                assert len(whole) == 4 and all(one.whole and one.rows > 0 for one in whole.values())
            else:
                seen[f"{how}: {check(image, acks, whole)}"] += 1
            shutil.rmtree(image)
    return seen


def test_a_power_cut_or_a_kill_at_any_moment_costs_nothing_that_was_acknowledged(disk, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", "")
    seen = cuts(disk, 3, seed=1)
    assert {name.partition(": ")[2] for name in seen} >= {"session", "study", "rescued"}, seen


def test_where_there_is_no_shared_memory_a_journal_of_the_other_kind_keeps_all(tmp_path):
    """As on a network folder."""
    disk = RecordedDisk(tmp_path)
    done = disk.run(f'told.write_text("shm session.db")\n{PROGRAM.partition("for k in range(6)")[0]}')
    assert done.returncode == 0, done.stderr
    records = disk.records()
    assert any(record[3].endswith("session.db-journal") for record in records)
    assert not any(record[3].endswith("session.db-wal") and record[4] for record in records)
    whole = {1: read_recording(recording_path(of(disk.root / "data"), 1))}
    moments = [*((moment, SYNCED) for moment in told(records)[::3]), (len(records) // 2, SOME)]
    for number, (moment, how) in enumerate(moments):
        image = tmp_path / f"image-{number}"
        check(image, disk.cut(records[:moment], image, how, number), whole)
