"""What cannot be is refused before anything opens; what is known of a session before it is opened."""

import contextlib
from pathlib import Path

import numpy as np
import pytest
from disks import full
from protocols import PAPER, changed, short
from refusals import refusal
from sessions import closed_session, files, new_session
from simulated_loop import local_window

from app.cli import main
from app.ipc.messages import Setup
from app.session_server.server import read_protocol, refusal_of, take_folder
from app.session_server.session_progress import SessionProgress
from core.files import InputError
from experiments.inputs import OPERATOR
from experiments.store import files as files_module
from experiments.store.database import DATABASE
from experiments.store.files import refuse_existing
from experiments.store.journal import unmeasured_row
from experiments.store.session import Participant, Session
from experiments.store.stored import other_protocol, read_stored
from experiments.trial.population import load_population

NAMED = changed(PAPER.text, participants='["07", "08"]', devices='["four-brake"]')


@pytest.fixture
def named(tmp_path) -> Path:
    path = tmp_path / "named.toml"
    path.write_text(NAMED)
    return path


def test_a_participant_whom_the_protocol_does_not_name_is_refused_at_once(named, tmp_path, capsys):
    told = refusal(capsys, "run", named, "--participant", "09", "--print-plan")
    assert "07, 08" in told and "09" in told
    setup = Setup(tmp_path / "data", str(named), participant="09")
    with pytest.raises(InputError, match="07, 08"):
        read_protocol(setup)
    assert main(["run", str(named), "--participant", "08", "--print-plan"]) == 0
    assert read_protocol(setup._replace(participant="08")).participants == ("07", "08")
    assert read_protocol(setup._replace(hand=OPERATOR)).name == PAPER.name  # a simulated one takes any place
    assert main(["run", str(named), "--participant", "09", "--print-plan", "--input", "operator"]) == 0


def test_a_session_that_is_there_is_taken_up_whoever_the_protocol_names_now(named, tmp_path):
    data = tmp_path / "data"
    Session(data, Participant("09"), PAPER, sync=False).close()
    assert read_protocol(Setup(data, str(named), participant="09")).participants == ("07", "08")


def test_no_questionnaire_is_put_to_a_simulated_operator(tmp_path):
    asking = short(1, 1, on="true")
    person = load_population().draw(np.random.default_rng(1))
    asked = {}
    for name, who in (("01", person), ("02", None)):
        session = Session(tmp_path, Participant(name, operator=who), asking, sync=False)
        for _ in range(len(session.plan) // len(asking.devices)):
            trial = session.plan[len(session.rows)]
            session.rows.append(unmeasured_row(session.folder, trial._asdict(), "done"))
        asked[name] = SessionProgress(session).questions_due
        session.close()
    assert asked["01"] is None and asked["02"] is not None


@pytest.mark.parametrize("hand", ["mouse", OPERATOR])
def test_before_a_session_it_is_known_whether_it_is_blind(tmp_path: Path, hand: str) -> None:
    data, file = tmp_path / "data", tmp_path / "pilot.toml"
    file.write_text(changed(PAPER.text, blind="true"), encoding="utf-8")
    with local_window(Setup(data, str(file), hand=hand, real_time=False)) as bench:
        bench.until_stage("no session")
        assert bench.opened is not None and bench.opened.blind == (hand != OPERATOR)
        snapshot = bench.open("02", blind=True)  # though it was asked for
        assert snapshot.blind == (hand != OPERATOR) and snapshot.notice.startswith("Participant 02: 60 trials to run.")
        assert bool(read_stored(next(data.rglob("ses-01"))).key) == (hand != OPERATOR)


def test_a_folder_in_which_every_participant_has_a_session_can_still_be_opened(tmp_path: Path) -> None:
    file = tmp_path / "pilot.toml"
    file.write_text(changed(PAPER.text, participants='["01"]'), encoding="utf-8")
    session = new_session(tmp_path / "data", "01")
    session.close()
    with local_window(Setup(tmp_path / "data", str(file), real_time=False)) as bench:
        assert bench.until_stage("no session").stage == "no session"


BAD_PROTOCOL = "name = 3\n"


def everything(folder: Path) -> set[str]:
    """Every file and folder in it, by name."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


def refuse(setup: Setup) -> str:
    """What a session server answers that refuses to begin."""
    with contextlib.ExitStack() as left, pytest.raises((InputError, OSError)) as refusal:
        take_folder(setup, left)
    return refusal_of(refusal.value, setup.data_dir)


@pytest.mark.parametrize("there", ["", "data", "data/notes.txt", "data/sub-07/ses-01/session.db"])
def test_a_refused_bench_leaves_nothing_behind(tmp_path: Path, there: str) -> None:
    (tmp_path / "bad.toml").write_text(BAD_PROTOCOL)
    place = tmp_path / there
    if place.suffix:
        place.parent.mkdir(parents=True)
        place.write_text("{}" * 9000)
    elif there:
        place.mkdir()
    before = everything(tmp_path)
    data = tmp_path / ("data" if there else "not/yet/data")
    assert "bad.toml: name must be text" in refuse(Setup(data, str(tmp_path / "bad.toml")))
    if place.name == "session.db":
        assert "session.db" in refuse(Setup(data, participant="07")), "a session that is damaged"
    assert everything(tmp_path) == before


def test_a_folder_that_another_window_uses_is_refused_and_left_to_it(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("app.session_server.server.LOCK_S", 0.05)
    with local_window(Setup(tmp_path / "data", hand=OPERATOR, sync=False)) as first:
        first.open()
        before = everything(tmp_path)
        assert "is using this folder" in refuse(Setup(tmp_path / "data"))
        assert everything(tmp_path) == before and first.start().running.run == 1


@pytest.mark.parametrize(
    "step", ["session.new_key", "session.put_session", "files.hold_lock", "database.Database.commit"]
)
def test_a_session_that_the_disk_does_not_take_leaves_no_trace_and_can_be_begun_later(tmp_path, monkeypatch, step):
    with monkeypatch.context() as patch:
        patch.setattr(f"experiments.store.{step}", full)
        with pytest.raises(OSError, match="No space left"):
            new_session(tmp_path, blind=True)
    assert everything(tmp_path) == set()
    new_session(tmp_path, blind=True).close()


def test_a_session_that_another_process_begins_meanwhile_is_not_touched(tmp_path, monkeypatch):
    closed_session(tmp_path, 1)
    before = files(tmp_path)
    seen = []
    monkeypatch.setattr(files_module, "refuse_existing", lambda *a: seen and refuse_existing(*a) or seen.append(1))
    with pytest.raises(InputError, match="exists already"):
        new_session(tmp_path)
    assert files(tmp_path) == before and (tmp_path / "sub-01" / "ses-01" / DATABASE).exists()


def test_a_session_by_another_protocol_than_the_one_before_is_noticed(tmp_path):
    new_session(tmp_path, "01", short()).close()
    assert other_protocol(tmp_path, "01", PAPER) == ""  # there is no other one
    assert other_protocol(tmp_path, "02", short()) == ""
    assert other_protocol(tmp_path, "02", PAPER) == "01"
    (tmp_path / "sub-03" / "ses-01").mkdir(parents=True)
    (tmp_path / "sub-03" / "ses-01" / "session.db").write_text("{")
    assert other_protocol(tmp_path, "02", PAPER) == "01"
