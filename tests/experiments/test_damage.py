"""Everything in a database that means something is covered by a checksum or a count, or follows from what is.

Run as a script with a number of flips, it does as many and prints what it saw:
python tests/experiments/test_damage.py 500
"""

import contextlib
import json
import shutil
import sqlite3
import sys
import tempfile
from pathlib import Path

import pytest

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[k] / place) for k, place in ((2, ""), (1, "support"))]

from damage import edited, flips, found, make_whole
from sessions import crash_in_trial, kill, new_session, of, run_trials, session_of

from core.files import InputError
from experiments.store.database import DATABASE, TABLES, checksum
from experiments.store.files import STUDY
from experiments.store.journal import read_journal
from experiments.store.session import Session
from experiments.store.study_plan import read_study
from experiments.store.verify import verify

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


def test_a_whole_study_has_no_fault_and_is_one_plain_file_a_session(data):
    assert found(data) == {}
    assert sorted(path.name for path in of(data).iterdir()) == [".lock", DATABASE, "trials", "trials.csv"]


def test_a_flipped_bit_anywhere_is_named_or_means_nothing(data):
    seen = flips(data, 30, seed=1)
    assert seen["named"] + seen["unreadable"] > 7  # half of a small database is empty
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
    for number in {numbers[0], numbers[len(numbers) // 2], numbers[-1]}:
        with edited(path) as db:
            db.execute(f"DELETE FROM {table} WHERE rowid = ?", [number])
        assert SESSION in found(data) or found(data), (table, number)
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


def test_a_row_of_another_session_does_not_match(data, tmp_path):
    """Whole rows, with their checksums: of the participant with the same plan, protocol and place."""
    with session_of(tmp_path / "other", 3):
        pass
    with edited(of(data) / DATABASE) as db:
        db.execute("ATTACH ? AS other", [str(of(tmp_path / "other") / DATABASE)])
        db.execute("REPLACE INTO result SELECT * FROM other.result")
        db.commit()
    assert "result 1: does not match its checksum" in str(found(data)[SESSION])
    assert checksum("a", "about", ("x", "1")) != checksum("a", "blind_key", ("x", 1)), "nor one of another table"


def old_row(db: sqlite3.Connection) -> None:
    """An earlier state of a row, whole as it was then."""
    (identity,) = db.execute("SELECT value FROM about WHERE name = 'identity'").fetchone()
    *values, cells, _ = db.execute("SELECT * FROM result WHERE number = 1").fetchone()
    then = *values, cells.replace("excluded", "done")
    db.execute("REPLACE INTO result VALUES (?, ?, ?, ?)", [*then, checksum(json.loads(identity), "result", then)])


@pytest.mark.parametrize("change, says", [
    (old_row, "result: is not as it was when the session was closed"),
    (lambda db: db.execute("DELETE FROM counts WHERE name = 'sealed'"), "the counts are missing"),
    (lambda db: db.execute("UPDATE counts SET rows = 0 WHERE name = 'sealed'"), "the count of sealed does not match"),
])  # fmt: skip
def test_a_session_that_was_closed_is_as_it_was(data, change, says):
    with edited(of(data) / DATABASE) as db:
        change(db)
    assert says in str(found(data)[SESSION])


def test_a_damaged_index_by_which_rows_are_found_is_named(data):
    path = of(data) / DATABASE
    with edited(path) as db:
        (page,) = db.execute("SELECT rootpage FROM sqlite_schema WHERE name LIKE '%autoindex_counts%'").fetchone()
        (size,) = db.execute("PRAGMA page_size").fetchone()
    content, begin = path.read_bytes(), (page - 1) * size
    index = content[begin : begin + size].replace(b"result", b"resulu")
    path.write_bytes(content[:begin] + index + content[begin + size :])
    assert "autoindex_counts" in str(found(data))


def test_a_session_without_its_whole_plan_is_not_gone_on_with(tmp_path):
    crash_in_trial(new_session(tmp_path))
    with edited(of(tmp_path) / DATABASE) as db:
        db.execute("DELETE FROM plan WHERE run = 7")
    with pytest.raises(InputError, match="plan: does not match plan_sha256"):
        Session.resume(tmp_path, "01", sync=False)


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


@pytest.mark.parametrize("what", ["event", "result", "trial"])
def test_a_session_with_a_row_that_was_changed_says_so_as_it_is_opened(data, what):
    with edited(of(data) / DATABASE) as db:
        db.execute(f"UPDATE {what} SET crc = crc + 1 WHERE number = 2")
    if what == "result":
        with pytest.raises(InputError, match="result 2: does not match its checksum"):
            Session.resume(data, "01", sync=False)
    else:
        session = Session.resume(data, "01", sync=False)
        assert "cannot be repaired" in session.repaired.sentence()
        session.close()


def test_a_flipped_bit_in_what_a_study_was_begun_with_is_named_or_means_nothing(data):
    path = data / STUDY
    content, meant = path.read_bytes(), read_study(data)
    for place in range(5, len(content), len(content) // 16):
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


def test_a_later_format_is_refused_in_one_sentence(data):
    with edited(of(data) / DATABASE) as db:
        db.execute("PRAGMA user_version = 2")
    with pytest.raises(InputError, match="is of format 2, this version of PHD reads formats up to 1"):
        Session.resume(data, "01", sync=False)
    assert "is of format 2" in str(found(data))


def test_a_file_that_is_no_database_of_ours_is_refused_in_one_sentence(data):
    for content in (b"", b"SQLite format 3\0" + b"x" * 200, b"not a database at all"):
        (of(data) / DATABASE).write_bytes(content)
        if content:
            assert "session.db" in str(found(data))
    with contextlib.closing(sqlite3.connect(of(data) / "other.db")) as db:
        db.execute("CREATE TABLE event (number INT)")
        db.commit()
    (of(data) / "other.db").replace(of(data) / DATABASE)
    assert "is no database of PHD" in str(verify(data)["faults"])


@pytest.mark.parametrize("wrong", [b"nvmber", b"n\xf4mber"])
def test_a_flipped_bit_in_the_names_of_columns_is_one_sentence(data, wrong):
    path = of(data) / DATABASE
    path.write_bytes(path.read_bytes().replace(b"TABLE event (number", b"TABLE event (" + wrong))
    assert "session.db" in str(found(data)) and "is damaged" in str(found(data))
    with pytest.raises(InputError, match="is damaged"):
        Session.resume(data, "01", sync=False)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        print(flips(make_whole(Path(name) / "data"), int(sys.argv[1]), seed=2))
