"""Everything in a database that means something is covered by a checksum or a count, or follows from what is."""

import json
import shutil
from pathlib import Path

import pytest
from damage import edited, flips, found, make_whole
from sessions import crash_in_trial, kill, new_session, of, run_trials, session_of

from core.files import InputError
from experiments.store.database import DATABASE, TABLES, checksum
from experiments.store.files import STUDY
from experiments.store.journal import read_journal
from experiments.store.session import Session
from experiments.store.study_plan import read_study

SESSION = f"sub-01/ses-01/{DATABASE}"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return make_whole(tmp_path_factory.mktemp("damage") / "data")


@pytest.fixture
def data(whole, tmp_path):
    """A copy to spoil."""
    return shutil.copytree(whole, tmp_path / "data")


def tables() -> list[str]:
    return [table for table in TABLES if table != "ticks"]


def test_a_flipped_bit_anywhere_is_named_or_means_nothing(data):
    seen = flips(data, 12, seed=1)
    assert seen["named"] + seen["unreadable"] > 2  # half of a small database is empty
    assert found(data) == {}


@pytest.mark.parametrize("table", tables())
def test_a_row_that_is_gone_is_named_in_every_table(data, table):
    path = of(data) / DATABASE
    content = path.read_bytes()
    with edited(path) as db:
        numbers = [number for (number,) in db.execute(f"SELECT rowid FROM {table}")]
    if table == "blind_key":
        assert not numbers
        return
    for number in {numbers[len(numbers) // 2], numbers[-1]}:
        with edited(path) as db:
            db.execute(f"DELETE FROM {table} WHERE rowid = ?", [number])
        assert found(data), (table, number)
        path.write_bytes(content)
    with edited(path) as db:
        db.execute(f"DELETE FROM {table}")
    assert found(data), table


@pytest.mark.parametrize("table", [table for table in tables() if table != "blind_key"])
def test_a_value_that_was_changed_and_rows_that_were_exchanged_are_named_in_every_table(data, table):
    path = of(data) / DATABASE
    content = path.read_bytes()
    columns = [column.split()[0] for column in TABLES[table]]
    for column in columns:
        with edited(path) as db:
            (first,) = db.execute(f"SELECT {column} FROM {table} LIMIT 1").fetchone()
            other = first + 1000 if isinstance(first, int | float) else f"{first} "
            db.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = (SELECT min(rowid) FROM {table})", [other])
        assert found(data), (table, column)
        path.write_bytes(content)
    with edited(path) as db:
        key, *others = columns
        (one, *a), (two, *b) = db.execute(f"SELECT {key}, {', '.join(others)}, crc FROM {table} LIMIT 2").fetchall()
        for number, values in ((one, b), (two, a)):
            sets = ", ".join(f"{name} = ?" for name in (*others, "crc"))
            db.execute(f"UPDATE {table} SET {sets} WHERE {key} = ?", [*values, number])
    assert a == b or found(data), table


def test_the_key_of_a_blind_session_is_guarded_too(tmp_path):
    data = make_whole(tmp_path / "data", blind=True)
    assert found(data) == {}
    for change in ("DELETE FROM blind_key", "UPDATE blind_key SET controller = 6 - controller"):
        content = (of(data) / DATABASE).read_bytes()
        with edited(of(data) / DATABASE) as db:
            db.execute(change)
        assert "blind_key" in str(found(data)[SESSION])
        with pytest.raises(InputError, match="was changed"):
            Session.resume(data, "01", sync=False)
        (of(data) / DATABASE).write_bytes(content)


def sql(statement: str):
    """The database after a statement."""

    def change(path: Path, _: Path) -> None:
        with edited(path) as db:
            db.execute(statement)

    return change


def content_of(before: bytes, after: bytes):
    """The file with bytes in place of others; in place of the whole file where `before` is empty."""

    def change(path: Path, _: Path) -> None:
        content = path.read_bytes()
        assert before in content
        path.write_bytes(content.replace(before, after) if before else after)

    return change


def row_of_another_session(path: Path, elsewhere: Path) -> None:
    """A whole row, with its checksum: of the participant with the same plan, protocol and place."""
    with session_of(elsewhere, 3):
        pass
    with edited(path) as db:
        db.execute("ATTACH ? AS other", [str(of(elsewhere) / DATABASE)])
        db.execute("REPLACE INTO result SELECT * FROM other.result")
        db.commit()


def old_row(path: Path, _: Path) -> None:
    """An earlier state of a row, whole as it was then."""
    with edited(path) as db:
        (identity,) = db.execute("SELECT value FROM about WHERE name = 'identity'").fetchone()
        *values, cells, _crc = db.execute("SELECT * FROM result WHERE number = 1").fetchone()
        then = *values, cells.replace("excluded", "done")
        db.execute("REPLACE INTO result VALUES (?, ?, ?, ?)", [*then, checksum(json.loads(identity), "result", then)])


def damaged_index(path: Path, _: Path) -> None:
    """By which rows are found."""
    with edited(path) as db:
        (page,) = db.execute("SELECT rootpage FROM sqlite_schema WHERE name LIKE '%autoindex_counts%'").fetchone()
        (size,) = db.execute("PRAGMA page_size").fetchone()
    content, begin = path.read_bytes(), (page - 1) * size
    index = content[begin : begin + size].replace(b"result", b"resulu")
    path.write_bytes(content[:begin] + index + content[begin + size :])


def another_database(path: Path, _: Path) -> None:
    path.unlink()
    with edited(path) as db:
        db.execute("CREATE TABLE event (number INT)")


GOES_ON, REPAIRED = "", "cannot be repaired"
#: change -> what verify names, and what opening the session says
CHANGES = {
    "row of another session": (row_of_another_session, "result 1: does not match its checksum", "result 1"),
    "older row": (old_row, "result: is not as it was when the session was closed", GOES_ON),
    "no counts": (sql("DELETE FROM counts WHERE name = 'sealed'"), "the counts are missing", GOES_ON),
    "other count": (
        sql("UPDATE counts SET rows = 0 WHERE name = 'sealed'"), "the count of sealed does not match", GOES_ON,
    ),
    "index": (damaged_index, "autoindex_counts", GOES_ON),
    "plan": (sql("DELETE FROM plan WHERE run = 7"), "plan", "plan: does not match plan_sha256"),
    "event": (sql("UPDATE event SET crc = crc + 1 WHERE number = 2"), "event 2", REPAIRED),
    "trial": (sql("UPDATE trial SET crc = crc + 1 WHERE number = 2"), "run-002.parquet", REPAIRED),
    "earlier format": (sql("PRAGMA user_version = 1"), "is of format 1", "use the version that recorded it"),
    "later format": (sql("PRAGMA user_version = 3"), "is of format 3", "this version of PHD reads format 2"),
    "no database": (content_of(b"", b"not a database at all"), "session.db", "session.db"),
    "another database": (another_database, "is no database of PHD", "no database of PHD"),
    "name of a column": (content_of(b"TABLE event (number", b"TABLE event (nvmber"), "is damaged", "is damaged"),
}  # fmt: skip


@pytest.mark.parametrize("change, named, said", CHANGES.values(), ids=CHANGES)
def test_what_was_changed_is_named_by_verify_and_said_or_refused_as_the_session_is_opened(
    data, tmp_path, change, named, said
):
    assert found(data) == {}
    change(of(data) / DATABASE, tmp_path / "other")
    assert named in str(found(data))
    if said in (GOES_ON, REPAIRED):
        session = Session.resume(data, "01", sync=False)
        assert said in session.repaired.sentence()
        session.close()
    else:
        with pytest.raises(InputError, match=said):
            Session.resume(data, "01", sync=False)


def test_what_was_killed_and_goes_on_has_no_fault_and_lost_lines_are_named_all_the_same(tmp_path):
    session = new_session(tmp_path)
    crash_in_trial(session)
    for _ in range(2):
        with_more = Session.resume(tmp_path, "01", sync=False)
        run_trials(with_more, 1)
        kill(with_more)
    assert found(tmp_path) == {}
    with edited(of(tmp_path) / DATABASE) as db:  # the last line of a session that was never closed
        db.execute("DELETE FROM event WHERE number = (SELECT max(number) FROM event)")
    assert any("is missing" in fault for fault in found(tmp_path)[SESSION])
    Session.resume(tmp_path, "01", sync=False).close()
    assert read_journal(of(tmp_path)).faults


def test_damage_stays_named_after_the_session_has_gone_on(data):
    with edited(of(data) / DATABASE) as db:
        db.execute("UPDATE event SET about = replace(about, 'sneezed', 'laughed')")
    session = Session.resume(data, "01", sync=False)
    run_trials(session, 1)
    session.close()
    assert "does not match its checksum" in str(found(data)[SESSION])


def test_a_flipped_bit_in_what_a_study_was_begun_with_is_named_or_means_nothing(data):
    path = data / STUDY
    content, meant = path.read_bytes(), read_study(data)
    for place in range(5, len(content), len(content) // 8):
        changed = bytearray(content)
        changed[place] ^= 4
        path.write_bytes(changed)
        if not found(data):
            assert read_study(data).protocol.text == meant.protocol.text
    path.write_bytes(content)


def test_a_session_that_is_missing_from_a_study_or_is_another_one_is_named(data, tmp_path):
    kept = tmp_path / "kept"
    (data / "sub-01").rename(kept)
    assert "is missing, and study.db counts it" in found(data)["sub-01/ses-01"]
    with session_of(data, 1):
        pass
    assert "is another session than the one that the study ran" in found(data)["sub-01/ses-01"]
    shutil.rmtree(data / "sub-01")
    kept.rename(data / "sub-01")
    assert found(data) == {}
