"""Consent: who agrees goes on; of who declines only the answer is kept; resume, verify and export know it."""

from pathlib import Path

import pytest
from msgspec.structs import replace
from protocols import PAPER
from sessions import closed_session, files

from core.files import InputError
from experiments.export.export import export
from experiments.protocol_file import Consent
from experiments.store.consent import ConsentAnswer
from experiments.store.database import Database
from experiments.store.journal import CONSENT, read_events
from experiments.store.overview import scan_folder
from experiments.store.recording import RecordingWriter
from experiments.store.session import Participant, Session
from experiments.store.stored import put_protocol, read_stored
from experiments.store.verify import verify

TEXT = "You may stop at any time."
ASKS = replace(PAPER, consent=Consent(TEXT), text=f'{PAPER.text}\n[consent]\ntext = "{TEXT}"\n')
AT = "2026-11-26T10:00:00.000+00:00"
YES, NO = ConsentAnswer(True, AT), ConsentAnswer(False, AT)


def begin(data: Path, participant: str, consent: ConsentAnswer | None, protocol=ASKS, **form) -> Path:
    """A session that is closed at once; its folder."""
    session = Session(data, Participant(participant, form=form, consent=consent), protocol, sync=False)
    session.close()
    return session.folder


def faults(folder: Path) -> list[str]:
    return [fault["fault"] for fault in verify(folder)["faults"]]


def test_no_session_begins_without_the_answer_and_nobody_is_asked_for_one_in_vain(tmp_path: Path) -> None:
    for protocol, consent, says in ((ASKS, None, "has not been asked"), (PAPER, YES, "does not ask for consent")):
        with pytest.raises(InputError, match=says):
            begin(tmp_path, "01", consent, protocol)
    assert not list(tmp_path.rglob("*"))


def test_who_declines_leaves_the_answer_and_nothing_else(tmp_path: Path) -> None:
    agreed, declined = begin(tmp_path, "01", YES), begin(tmp_path, "02", NO)
    for folder, answer in ((agreed, YES), (declined, NO)):
        (entry,) = (entry for entry in read_events(folder) if entry.event is CONSENT)
        assert (entry.about["agreed"], entry.about["answered"]) == answer
        assert read_stored(folder).about["consent"] == answer._asdict()
    assert set(files(declined)) == {"session.db", ".lock"}
    Session.resume(tmp_path, "01", sync=False).close()
    before = files(tmp_path)
    with pytest.raises(InputError, match="declined to take part; name another participant"):
        Session.resume(tmp_path, "02", sync=False)
    assert files(tmp_path) == before
    found = {session.participant: session for session in scan_folder(tmp_path).sessions}
    assert found["02"].declined and found["02"].complete and found["02"].planned == 0
    assert not found["01"].declined and found["01"].planned == len(Session.resume(tmp_path, "01").plan)
    assert faults(tmp_path) == [] and any("declined" in note["note"] for note in verify(tmp_path)["notes"])


def test_recordings_of_who_declined_and_a_missing_answer_are_named_and_not_gone_on_with(tmp_path: Path) -> None:
    with Database(begin(tmp_path / "a", "02", NO)) as database:
        RecordingWriter(database, ("trials", 1), "A", {}).flush()
    assert "there are recordings of a participant who declined to take part" in faults(tmp_path / "a")
    with Database(begin(tmp_path / "b", "01", None, PAPER)) as database:
        put_protocol(database, ASKS)
    assert "the participant was not asked for the consent that the protocol wants" in faults(tmp_path / "b")
    with pytest.raises(InputError, match="was not asked for consent"):
        Session.resume(tmp_path / "b", "01", sync=False)


def test_an_export_says_who_agreed_and_who_declined(tmp_path: Path) -> None:
    data = tmp_path / "data"
    begin(data, "01", YES)
    begin(data, "02", NO)
    closed_session(data, 1, participant="03", protocol=ASKS)  # a simulated operator, who is not asked
    summary = export(data, {"bids": tmp_path / "bids", "csv": tmp_path / "csv"})
    assert summary["left_out"] == ["sub-02/ses-01 (the participant declined to take part)"]
    for form in ("bids", "csv"):
        assert "1 agreed to take part, 1 declined" in (tmp_path / form / "README.md").read_text()
