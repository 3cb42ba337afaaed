"""What is refused before a session, and what a refusal leaves behind: nothing."""

import contextlib
import re
from pathlib import Path

import pytest
from live import live_window
from msgspec.structs import replace
from protocols import PAPER, changed, protocol_of, short
from sessions import files, new_session, run_trials

from app.ipc import messages as m
from app.ipc.client import Client
from app.ipc.messages import Setup
from app.session_server.server import in_words, take_folder
from core.files import InputError
from experiments.session import files as files_module
from experiments.session.files import other_protocol, refuse_existing
from experiments.session.journal import NAME as JOURNAL
from experiments.session.session import Session

BAD_PROTOCOL = "name = 3\n"


def everything(folder: Path) -> set[str]:
    """Every file and folder in it, by name."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


def refuse(setup: Setup) -> str:
    """What a session server answers that refuses to begin."""
    with contextlib.ExitStack() as left, pytest.raises((InputError, OSError)) as refusal:
        take_folder(setup, left)
    return in_words(refusal.value, setup.data_dir)


@pytest.mark.parametrize("there", ["", "data", "data/notes.txt", "data/sub-07/ses-01/session.json"])
def test_a_refused_bench_leaves_nothing_behind(tmp_path: Path, there: str) -> None:
    (tmp_path / "bad.toml").write_text(BAD_PROTOCOL)
    place = tmp_path / there
    if place.suffix:
        place.parent.mkdir(parents=True)
        place.write_text("{}")
    elif there:
        place.mkdir()
    before = everything(tmp_path)
    data = tmp_path / ("data" if there else "not/yet/data")
    assert "bad.toml: name must be text" in refuse(Setup(data, str(tmp_path / "bad.toml"), real_time=False))
    assert everything(tmp_path) == before


def test_a_folder_that_cannot_be_made_is_one_sentence_and_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert "not a directory" in refuse(Setup(tmp_path / "file" / "data", real_time=False))
    assert everything(tmp_path) == {"file"}


@pytest.mark.parametrize(
    "step", ["session.write_key", "session.write_new_file", "files.hold_lock", "journal.write_event"]
)
def test_a_session_that_the_disk_does_not_take_leaves_no_trace_and_can_be_begun_later(tmp_path, monkeypatch, step):
    def full(*_args, **_more):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(f"experiments.session.{step}", full)
        with pytest.raises(OSError, match="No space left"):
            new_session(tmp_path, blind=True)
    assert everything(tmp_path) == set()
    new_session(tmp_path, blind=True).close()


@pytest.mark.parametrize("name", ["", "../x", "a b", "é", "01/ses-02", "x\n"])
def test_a_participant_whose_name_no_folder_could_have_is_refused(tmp_path, name):
    with pytest.raises(InputError, match="letters and digits"):
        new_session(tmp_path, name)
    assert everything(tmp_path) == set()


def test_a_session_that_another_process_begins_meanwhile_is_not_touched(tmp_path, monkeypatch):
    other = new_session(tmp_path)
    run_trials(other, 1)
    other.close()
    before = files(tmp_path)
    seen = []
    monkeypatch.setattr(files_module, "refuse_existing", lambda *a: seen and refuse_existing(*a) or seen.append(1))
    with pytest.raises(InputError, match="exists already"):
        new_session(tmp_path)
    assert files(tmp_path) == before and (tmp_path / "sub-01" / "ses-01" / JOURNAL).exists()


def test_a_session_by_another_protocol_than_the_one_before_is_noticed(tmp_path):
    new_session(tmp_path, "01", short()).close()
    assert other_protocol(tmp_path, "01", PAPER) == ""  # there is no other one
    assert other_protocol(tmp_path, "02", short()) == ""
    assert other_protocol(tmp_path, "02", PAPER) == "01"
    (tmp_path / "sub-03" / "ses-01").mkdir(parents=True)
    (tmp_path / "sub-03" / "ses-01" / "session.json").write_text("{")
    assert other_protocol(tmp_path, "02", PAPER) == "01"


def test_a_second_window_is_refused_and_the_first_one_goes_on(tmp_path: Path) -> None:
    with live_window(Setup(tmp_path / "data", hand="operator", real_time=False)) as first:
        first.until_stage(m.NO_SESSION)
        other = Client(Setup(tmp_path / "data", real_time=False))
        assert "is in use by a running process" in other.refused()
        (said,) = other.receive()
        assert said.stage == m.FAILED and not other.alive
        other.stop("")
        first.look()
        assert first.client.alive


def test_a_plan_of_one_trial_and_one_of_a_thousand_can_be_begun_and_resumed(tmp_path: Path) -> None:
    one = re.sub(r"\[\[path\]\]\s*number = 2\n(.+\n)+", "", PAPER.text)
    one = re.sub(r"\[\[controller\]\]\s*number = [2345]\n(.+\n)+", "", one)
    for name, text, trials in (("one", changed(one, blocks="1"), 1), ("many", changed(PAPER.text, blocks="50"), 1000)):
        protocol = replace(protocol_of(text), devices=PAPER.devices[:1]) if name == "one" else protocol_of(text)
        session = Session(tmp_path / name, "01", protocol, None, sync=False)
        assert len(session.plan) == trials and session.next_planned() == session.plan[0]
        session.skip("short of time")
        session.close()
        again = Session.resume(tmp_path / name, "01", sync=False)
        assert again.settled == 1 and again.next_planned() == (session.plan[1] if trials > 1 else None)
        again.close()
