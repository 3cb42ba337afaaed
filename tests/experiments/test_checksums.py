"""Everything in a session folder that means something is covered by a checksum, or follows from what is."""

import contextlib
import json
import random
import shutil

import pytest
from disks import flip_a_bit
from protocols import PAPER
from sessions import closed_session, crash_in_trial, new_session, of, run_trials, session_of, without_checksums

from app.cli import main
from core.files import InputError
from experiments.session.checksums import END, next_line, noted_end, read_sealed
from experiments.session.files import STORED, STUDY, StudyPlan, read_study, write_pooled_table, write_study
from experiments.session.journal import ANSWERS, NAME, NOTE, exclude_run, journal_summary, read_journal, write_event
from experiments.session.session import Session
from experiments.session.verify import verify
from experiments.trial.population import load_population


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder with a study's record and one session: three trials, a note, answers, a redone and an excluded trial."""
    data = tmp_path_factory.mktemp("checksums") / "data"
    with session_of(data, 3) as session:
        session.note("the hand slipped")
        session.journal(ANSWERS, configuration="three-brake", block=1, values={"effort": 40})
        session.redo(2, "slipped")
        session.exclude(1, "sneezed")
    write_study(data, StudyPlan(1, PAPER, load_population()))
    write_pooled_table(data)
    return data


@pytest.fixture
def data(whole, tmp_path):
    """A copy to spoil."""
    return shutil.copytree(whole, tmp_path / "data")


def found(data) -> dict[str, list[str]]:
    """File name -> faults of a folder."""
    named: dict[str, list[str]] = {}
    for fault in verify(data)["faults"]:
        named.setdefault(fault["file"].rpartition("/")[2], []).append(fault["fault"])
    return named


def notes(data) -> list[str]:
    """What verify says that is no fault."""
    return [f"{note['file'].rpartition('/')[2]}: {note['note']}" for note in verify(data)["notes"]]


def lines_of(data) -> list[bytes]:
    return (of(data) / NAME).read_bytes().splitlines(keepends=True)


# ----------------------------------------------------------------------------------------------------------- bit flips


def test_a_flipped_bit_anywhere_in_the_journal_is_named(data):
    path, draw = of(data) / NAME, random.Random(1)
    content = path.read_bytes()
    assert not read_journal(of(data)).faults and found(data) == {}
    for place in [*draw.sample(range(len(content)), 150), *range(len(content) - 60, len(content))]:
        flip_a_bit(path, place, draw.randrange(8))
        journal = read_journal(of(data))
        assert journal.faults, (place, content[place - 20 : place + 5])
        assert len(journal.entries) >= len(lines_of(data)) - 3, "the other lines are read"
        path.write_bytes(content)
    flip_a_bit(path, content.index(b"slipped"))
    assert "does not match its checksum" in found(data)[NAME][0]


@pytest.mark.parametrize("name", [STORED, STUDY])
def test_a_flipped_bit_in_a_record_is_noticed_or_means_the_same(data, name):
    path, draw = (data if name == STUDY else of(data)) / name, random.Random(2)
    content, about = path.read_bytes(), read_sealed((data if name == STUDY else of(data)) / name)
    noticed, places = 0, draw.sample(range(len(content)), 150)
    for place in places:
        flip_a_bit(path, place, draw.randrange(8))
        try:
            means = read_sealed(path)
            assert means == about or "crc32" not in means, (place, content[place - 20 : place + 5])
        except InputError:
            noticed += 1
        path.write_bytes(content)
    assert noticed > 0.95 * len(places)
    flip_a_bit(path, content.index(b"paper"))
    assert "was changed" in found(data)[name][0]


def test_a_flipped_bit_in_the_note_of_where_the_journal_ends_is_noticed_or_means_the_same(data):
    path = of(data) / END
    content, meant = path.read_bytes(), noted_end(of(data))
    for place in range(len(content)):
        for bit in (place % 8, (place + 5) % 8):
            flip_a_bit(path, place, bit)
            with contextlib.suppress(InputError):
                assert noted_end(of(data)) == meant, (place, bit)
            path.write_bytes(content)
    flip_a_bit(path, content.index(b"crc32"))
    assert "journal.end: is damaged (its checksum is missing)" in found(data)[NAME][0]


def test_a_flipped_bit_in_the_table_is_noticed(data):
    path, draw = of(data) / "trials.csv", random.Random(3)
    content = path.read_bytes()
    for place in [content.index(b"controller_name"), *draw.sample(range(len(content)), 15)]:
        flip_a_bit(path, place, draw.randrange(8))
        assert found(data) or notes(data), (place, content[place - 20 : place + 5])
        path.write_bytes(content)


# ------------------------------------------------------------------------------------------------- lines of the journal


def test_a_line_that_is_missing_doubled_or_out_of_place_is_named(data):
    path, lines = of(data) / NAME, lines_of(data)
    for place in range(len(lines)):
        path.write_bytes(b"".join(lines[:place] + lines[place + 1 :]))
        assert read_journal(of(data)).faults, place
        path.write_bytes(b"".join(lines[: place + 1] + lines[place:]))
        twice = f"line {place + 2}: is the same as line {place + 1}"
        assert read_journal(of(data)).faults == [twice]
    assert found(data)[NAME] == [twice]
    path.write_bytes(b"".join([*lines[:5], lines[6], lines[5], *lines[7:]]))
    assert any("out of place" in fault for fault in found(data)[NAME])
    path.unlink()
    assert "missing" in found(data)[NAME]


def test_a_doubled_line_counts_once(data):
    session = new_session(data, "02")
    write_event(session.folder, NOTE, text="once")
    session.close()
    path = session.folder / NAME
    path.write_bytes(path.read_bytes() + path.read_bytes().splitlines(keepends=True)[-1])
    assert [entry.event for entry in read_journal(session.folder).entries].count(NOTE) == 1


def test_a_line_that_a_crash_cut_off_is_no_fault_and_said_to_be_unfinished(tmp_path):
    session = closed_session(tmp_path, 1)
    path = session.folder / NAME
    whole = path.read_bytes()
    line = next_line({"time": "2026-01-01T00:00:00+00:00", "event": "note", "text": "cut {"}, whole)
    for length in range(1, len(line) - 1):
        path.write_bytes(whole + line[:length])
        journal = read_journal(session.folder)
        assert not journal.faults and journal.notes == ["line 4: was not finished, a crash cut it off"], length
    write_event(session.folder, NOTE, text="later")
    journal = read_journal(session.folder)
    assert not journal.faults and journal.notes == ["line 4: was not finished, a crash cut it off"]
    assert journal.entries[-1].about == {"text": "later"}
    flip_a_bit(path, path.read_bytes().rindex(b"cut {"))  # nobody reads it, but the chain goes over it
    assert read_journal(session.folder).faults


def test_what_was_damaged_before_the_session_went_on_stays_named(data):
    path = of(data) / NAME
    flip_a_bit(path, path.read_bytes().index(b"sneezed"))
    with Session.resume(data, "01", sync=False)._lock:
        pass
    assert "does not match its checksum" in found(data)[NAME][0]


def test_lost_last_lines_of_a_session_that_was_closed_are_named_for_good(data):
    path, lines = of(data) / NAME, lines_of(data)
    path.write_bytes(b"".join(lines[:-1]))
    assert found(data)[NAME] == [f"its last lines are missing, {len(lines) - 1} of {len(lines)} are there"]
    Session.resume(data, "01", sync=False).close()
    Session.resume(data, "01", sync=False).close()
    assert len(lines_of(data)) > len(lines)
    assert any("lacks the line that was its last one" in fault for fault in found(data)[NAME])


def test_a_recording_whose_beginning_is_in_no_line_is_named(data):
    path, lines = of(data) / NAME, lines_of(data)
    (of(data) / END).unlink()
    path.write_bytes(b"".join(lines[:5]))  # before run 3 was begun
    assert any("no line that says that run 3 was begun" in fault for fault in found(data)[NAME])


def test_a_session_that_is_killed_and_goes_on_has_no_fault(tmp_path):
    crash_in_trial(new_session(tmp_path))
    for _ in range(2):
        with_more = Session.resume(tmp_path, "01", sync=False)
        run_trials(with_more, 1)
        with_more._lock.release()  # as the end of a killed process does: no end is noted
    assert found(tmp_path) == {} and notes(tmp_path) == []
    exclude_run(of(tmp_path), with_more.rows[-1].run, "a reason")
    assert found(tmp_path) == {} and read_sealed(of(tmp_path) / END)["lines"] == len(lines_of(tmp_path))


# ------------------------------------------------------------------------------------------- record, table, old folders


@pytest.mark.parametrize("key", ["person", "hand", "participant", "blind"])
@pytest.mark.parametrize("old", [False, True], ids=["", "of an earlier version"])
def test_a_record_that_lacks_something_is_named(data, key, old):
    if old:
        without_checksums(data)
    path = of(data) / STORED
    about = json.loads(path.read_bytes())
    del about[key]
    path.write_text(json.dumps(about))
    assert ("it lacks " + key if old else "does not match its checksum") in found(data)[STORED][0]


def test_a_changed_participant_is_named_wherever_it_stands(data):
    without_checksums(data)
    for path, old, new in (
        (of(data) / STORED, '"participant": "01"', '"participant": "07"'),
        (of(data) / "trials.csv", "\n01,", "\n07,"),
        (data / "trials.csv", "\n01,", "\n07,"),
    ):
        content = path.read_text()
        path.write_text(content.replace(old, new, 1))
        assert "07" in " ".join(found(data)[path.name]), path
        path.write_text(content)


@pytest.mark.parametrize("pooled", [False, True], ids=["of the session", "of all sessions"])
def test_a_row_twice_is_named_and_recover_puts_it_right(data, pooled, capsys):
    path = (data if pooled else of(data)) / "trials.csv"
    before = path.read_bytes()
    path.write_bytes(before + before.splitlines(keepends=True)[-1])
    assert any("2 rows" in fault and "run 3" in fault for fault in found(data)["trials.csv"])
    assert main(["recover", str(data)]) == 0
    assert path.read_bytes() == before


def test_a_folder_of_an_earlier_version_opens_and_is_said_to_have_no_checksums(data):
    summary = journal_summary(of(data))
    without_checksums(data)
    count = len(lines_of(data))
    assert found(data) == {}
    assert notes(data) == [
        f"{STUDY}: no checksum, written by an earlier version",
        f"{NAME}: lines 1 to {count}: no checksum, written by an earlier version",
        f"{STORED}: no checksum, written by an earlier version",
    ]
    assert vars(journal_summary(of(data))) | {"notes": []} == vars(summary)
    assert read_study(data).operators == 1


def test_a_folder_that_an_earlier_version_began_goes_on_and_is_guarded_from_then_on(data):
    without_checksums(data)
    old = len(lines_of(data))
    session = Session.resume(data, "01", sync=False)
    run_trials(session, 1)
    session.close()
    write_pooled_table(data)
    assert found(data) == {} and f"{NAME}: lines 1 to {old}: no checksum, written by an earlier version" in notes(data)
    path = of(data) / NAME
    content = path.read_bytes()
    flip_a_bit(path, content.index(b"sneezed"))
    assert f"by the checksum in line {old + 1}" in found(data)[NAME][0]
    path.write_bytes(content + b'{"time": "2026-01-01T00:00:00+00:00", "event": "note", "text": "by that version"}\n')
    assert found(data) == {}, "it goes on with the earlier version once more"
    write_event(of(data), NOTE, text="and with this one")
    assert found(data) == {} and read_journal(of(data)).entries[-2].about == {"text": "by that version"}


def test_a_crash_before_the_first_line_of_the_journal_is_no_fault(tmp_path):
    session = new_session(tmp_path)
    session._lock.release()
    (session.folder / NAME).unlink()
    assert found(tmp_path) == {}
    resumed = Session.resume(tmp_path, "01", sync=False)
    run_trials(resumed, 1)
    resumed.close()
    assert found(tmp_path) == {}
