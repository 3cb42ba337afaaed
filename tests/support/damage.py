"""A study of one session with everything in it, and damage to it."""

import contextlib
import random
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from protocols import PAPER
from sessions import of, session_of

from experiments.store.database import DATABASE, TABLES
from experiments.store.files import write_pooled_table
from experiments.store.journal import ANSWERS
from experiments.store.recording import read_recording
from experiments.store.study_plan import StudyPlan, note_sessions, write_study
from experiments.store.verify import verify
from experiments.trial.population import load_population


def make_whole(data: Path, blind: bool = False) -> Path:
    """A study with one session: three trials, one of them redone, one excluded, one cut off; notes and answers."""
    with session_of(data, 3, blind=blind) as session:
        session.note("the hand slipped")
        session.journal(ANSWERS, configuration="three-brake", block=1, values={"effort": 40})
        session.redo(2, "slipped")
        session.exclude(1, "sneezed")
    write_study(data, StudyPlan(1, PAPER, load_population()))
    note_sessions(data)
    write_pooled_table(data)
    return data


def found(data: Path) -> dict[str, list[str]]:
    """File name -> faults of a folder."""
    named: dict[str, list[str]] = {}
    for fault in verify(data)["faults"]:
        named.setdefault(fault["file"], []).append(fault["fault"])
    return named


def contents(data: Path) -> dict[str, object]:
    """What the session's database means: every row, and every tick."""
    with contextlib.closing(sqlite3.connect(of(data) / DATABASE)) as db:
        rows = {table: db.execute(f"SELECT * FROM {table} ORDER BY 1").fetchall() for table in TABLES}
    recordings = [read_recording(path) for path in sorted((of(data) / "trials").glob("run-*.parquet"))]
    return {**rows, "recordings": [(one.whole, one.rows) for one in recordings]}


@contextlib.contextmanager
def edited(path: Path) -> Iterator[sqlite3.Connection]:
    """A database that somebody edits by hand."""
    with contextlib.closing(sqlite3.connect(path)) as db:
        yield db
        db.commit()


def flips(data: Path, count: int, seed: int) -> dict[str, int]:
    """Flip a bit, in each byte that is drawn; how many were named, made the file unreadable, or meant nothing.

    AssertionError: one changed what the database says, and verify did not say so.
    """
    path, draw = of(data) / DATABASE, random.Random(seed)
    content, meant = path.read_bytes(), contents(data)
    seen = {"named": 0, "unreadable": 0, "in unused bytes": 0}
    for place in draw.choices(range(len(content)), k=count):
        bit = draw.randrange(8)
        changed = bytearray(content)
        changed[place] ^= 1 << bit
        path.write_bytes(changed)
        faults = found(data)
        if faults:
            unreadable = any("is damaged" in fault or "no database" in fault for of in faults.values() for fault in of)
            seen["unreadable" if unreadable else "named"] += 1
        else:
            assert contents(data) == meant, f"bit {bit} of byte {place} changed the session and was not named"
            seen["in unused bytes"] += 1
    path.write_bytes(content)
    return seen
