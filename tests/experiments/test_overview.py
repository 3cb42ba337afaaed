"""What a data folder tells at a glance: how far its sessions are, who agreed to take part, what each controller is."""

import json
import re
import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from exports import rows, table
from msgspec.structs import replace as changed
from protocols import PAPER, protocol_of, short
from rows import read_rows
from sessions import closed_session, files, new_session, run_trials

from core.files import InputError
from experiments.export.export import export
from experiments.protocol_file import Consent
from experiments.store.consent import ConsentAnswer
from experiments.store.database import Database
from experiments.store.files import write_pooled_table
from experiments.store.journal import CONSENT, read_events
from experiments.store.overview import scan_folder
from experiments.store.recording import RecordingWriter
from experiments.store.session import Participant, Session
from experiments.store.stored import put_protocol, read_stored
from experiments.store.verify import verify
from experiments.study.analyze import analyze

FORM = '\n[form]\nhandedness = ["right", "left"]\nage = "number"\nremarks = "text"\n'
FEW = short(paths=1, devices='["three-brake"]')  # five trials


def test_sessions_stand_with_how_far_they_are_and_the_newest_first(tmp_path: Path) -> None:
    for participant, trials in (("01", 5), ("02", 2)):
        session = new_session(tmp_path, participant, FEW)
        if participant == "02":
            session.skip("short of time")
        run_trials(session, trials)
        session.close()
    overview = scan_folder(tmp_path)
    newest, oldest = overview.sessions
    assert (newest.participant, newest.done, newest.planned, newest.complete) == ("02", 3, 5, False)
    assert (newest.lacking, oldest.lacking) == (1, 0), "a skipped trial is over without a result"
    assert (oldest.participant, oldest.done, oldest.complete, oldest.protocol) == ("01", 5, True, "paper")
    assert (overview.done, overview.planned, overview.operators, overview.problem) == (8, 10, 0, "")
    session = Session.resume(tmp_path, "02", sync=False)
    session.redo(2, "something disturbed the trial")
    session.close()
    assert scan_folder(tmp_path).sessions[0].done == 2, "a trial that comes again is not done"


def test_a_folder_without_sessions_and_a_session_that_is_damaged_are_named(tmp_path: Path) -> None:
    assert scan_folder(tmp_path / "none").sessions == () and not scan_folder(tmp_path / "none").problem
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "a.txt").write_text("dear")
    assert "holds no session" in scan_folder(tmp_path / "letters").problem
    session = new_session(tmp_path / "data", "01", FEW)
    session.close()
    shutil.copytree(session.folder, tmp_path / "data" / "sub-02" / "ses-01")
    (own, copy) = scan_folder(tmp_path / "data").sessions
    assert "is a copy" in copy.problem and copy.changed_s == own.changed_s, "as old as the session of which it is one"
    shutil.rmtree(tmp_path / "data" / "sub-02")
    (session.folder / "session.db").write_bytes(b"x" * 9000)
    (damaged,) = scan_folder(tmp_path / "data").sessions
    assert "session.db" in damaged.problem and not damaged.complete


@pytest.mark.parametrize(
    ("form", "says"),
    [({"age": "old"}, "age must be a number"), ({"handedness": "both"}, "handedness must be one of right, left"),
     ({"weight": 70.0}, "does not ask for 'weight'"), ({"remarks": 1.0}, "remarks must be a text")],
)  # fmt: skip
def test_an_answer_that_the_protocol_does_not_ask_for_makes_no_session(tmp_path: Path, form: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Session(tmp_path, Participant("01", form=form), protocol_of(FEW.text + FORM), sync=False)
    assert not list(tmp_path.iterdir())


PAGE = Path(__file__).resolve().parents[2] / "docs" / "files-and-commands.md"


def test_the_queries_of_the_page_on_files_give_the_events_and_the_measures(tmp_path: Path) -> None:
    closed_session(tmp_path, 1, protocol=FEW)
    queries = re.findall(r"```sql\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[:2]
    with closing(sqlite3.connect(tmp_path / "sub-01" / "ses-01" / "session.db")) as database:
        events, measures = (database.execute(query).fetchall() for query in queries)
    assert events[0][2] == "created" and len(measures) == 1 and measures[0][1] == "done" and measures[0][2] > 0.0


# ------------------------------------------------------------------------------------------------------------- consent

TEXT = "You may stop at any time."
ASKS = changed(PAPER, consent=Consent(TEXT), text=f'{PAPER.text}\n[consent]\ntext = "{TEXT}"\n')
YES, NO = (ConsentAnswer(agreed, "2026-11-26T10:00:00.000+00:00") for agreed in (True, False))


def begin(data: Path, participant: str, consent: ConsentAnswer | None, protocol=ASKS) -> Path:
    """A session that is closed at once; its folder."""
    session = Session(data, Participant(participant, consent=consent), protocol, sync=False)
    session.close()
    return session.folder


def faults(folder: Path) -> list[str]:
    return [fault["fault"] for fault in verify(folder)["faults"]]


def test_no_session_begins_without_the_answer_and_nobody_is_asked_for_one_in_vain(tmp_path: Path) -> None:
    for protocol, consent, says in ((ASKS, None, "has not been asked"), (PAPER, YES, "does not ask for consent")):
        with pytest.raises(InputError, match=says):
            begin(tmp_path, "01", consent, protocol)
    assert not list(tmp_path.rglob("*"))


def test_who_declines_leaves_the_answer_and_nothing_else_and_an_export_counts_it(tmp_path: Path) -> None:
    data = tmp_path / "data"
    agreed, declined = begin(data, "01", YES), begin(data, "02", NO)
    for folder, answer in ((agreed, YES), (declined, NO)):
        (entry,) = (entry for entry in read_events(folder) if entry.event is CONSENT)
        assert (entry.about["agreed"], entry.about["answered"]) == answer
        assert read_stored(folder).about["consent"] == answer._asdict()
    assert set(files(declined)) == {"session.db", ".lock"}
    before = files(data)
    with pytest.raises(InputError, match="declined to take part; name another participant"):
        Session.resume(data, "02", sync=False)
    assert files(data) == before
    found = {session.participant: session for session in scan_folder(data).sessions}
    assert found["02"].declined and found["02"].complete and found["02"].planned == 0
    assert not found["01"].declined and found["01"].planned == len(Session.resume(data, "01").plan)
    assert faults(data) == [] and any("declined" in note["note"] for note in verify(data)["notes"])
    closed_session(data, 1, participant="03", protocol=ASKS)  # a simulated operator, who is not asked
    summary = export(data, {"csv": tmp_path / "csv"})
    assert summary["left_out"] == ["sub-02/ses-01 (the participant declined to take part)"]
    assert "1 agreed to take part, 1 declined" in (tmp_path / "csv" / "README.md").read_text()


def test_recordings_of_who_declined_and_a_missing_answer_are_named_and_not_gone_on_with(tmp_path: Path) -> None:
    with Database(begin(tmp_path / "a", "02", NO)) as database:
        RecordingWriter(database, ("trials", 1), "A", {}).flush()
    assert "there are recordings of a participant who declined to take part" in faults(tmp_path / "a")
    with Database(begin(tmp_path / "b", "01", None, PAPER)) as database:
        put_protocol(database, ASKS)
    assert "the participant was not asked for the consent that the protocol wants" in faults(tmp_path / "b")
    with pytest.raises(InputError, match="was not asked for consent"):
        Session.resume(tmp_path / "b", "01", sync=False)


# ------------------------------------------------------------------------------------------------ names of controllers

#: Two controllers that Table I has not, with numbers of their own.
OTHERS = """
[[controller]]
number = 3
name = "Free hand"
kind = "none"

[[controller]]
number = 8
name = "Rail, 2 mm"
kind = "proportional"
gain_N_s_m = 70.0
gap_m = 0.002
"""
NAMES = {3: "Free hand", 8: "Rail, 2 mm"}
WORDS = {3: "none", 8: "proportional, gap 2 mm, gain 70 N s/m"}


def named(data: Path, blind: bool) -> Path:
    """A session of the paper's protocol with other controllers: two trials done, one skipped, one redone."""
    text = short(blocks=2, paths=1).text
    protocol = protocol_of(re.sub(r"\[\[controller\]\].*\n(.+\n)+", "", text) + OTHERS)
    session = new_session(data, protocol=protocol, blind=blind)
    run_trials(session, 2)
    session.skip("late")
    session.redo(1, "looked away")
    session.close()
    write_pooled_table(data)
    return data


def test_every_row_of_every_table_has_the_name_that_the_protocol_gives_and_dictionaries_say_what_it_is(tmp_path):
    data = named(tmp_path / "data", blind=False)
    for path in data.rglob("trials.csv"):
        found = rows(path)
        assert {row["status"] for row in found} == {"done", "skipped", "redone"}
        assert [row["controller_name"] for row in found] == [NAMES[int(row["controller"])] for row in found]
        assert list(found[0])[-1] == "controller_name"
    analyze(data, tmp_path / "again")
    again = [replace(row, recording="") for row in read_rows(tmp_path / "again" / "trials.csv")]
    assert again == [replace(row, recording="") for row in read_rows(data / "trials.csv")] and faults(data) == []
    outs = {"bids": tmp_path / "bids", "csv": tmp_path / "csv"}
    export(data, outs)
    wanted = {str(number): f"{NAMES[number]}: {WORDS[number]}" for number in NAMES}
    scans = json.loads((outs["bids"] / "scans.json").read_text())
    columns = json.loads((outs["csv"] / "columns.json").read_text())["trials.csv"]
    for key, described in (("Levels", scans), ("levels", columns)):
        assert described["controller"][key] == wanted
        assert described["controller_name"][key] == {NAMES[number]: WORDS[number] for number in NAMES}
    [path] = outs["bids"].rglob("*_scans.tsv")
    header, *lines = table(path)
    number, name = header.index("controller"), header.index("controller_name")
    assert [line[name] for line in lines] == [NAMES[int(line[number])] for line in lines]


def test_while_a_session_is_blind_no_file_but_key_and_protocol_has_a_name(tmp_path):
    coded = named(tmp_path / "data", blind=True)
    told, tells = (b"Free hand", b"Rail, 2 mm", b"gap 2 mm"), (b"current_", b"torque", b'"seed"')
    for path in coded.rglob("trials.csv"):
        assert all(row["controller_name"] == row["controller"] in ("K1", "K2") for row in rows(path))
    outs = {"bids": tmp_path / "bids", "csv": tmp_path / "csv"}
    export(coded, outs)
    analyze(coded, tmp_path / "again")
    for folder in (coded, *outs.values(), tmp_path / "again"):
        for name, content in files(folder).items():
            if not name.endswith(("session.db", ".parquet", ".png", ".pdf")):
                assert not [word for word in told if word in content], name
            if folder in outs.values() and name.startswith("sub-01"):
                assert not [word for word in tells if word in content], name
    levels = json.loads((outs["bids"] / "scans.json").read_text())["controller"]["Levels"]
    assert set(levels.values()) == {"coded, the session is blind"}
