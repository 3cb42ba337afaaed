"""What the Home page is told of the next session before it is opened, and what it reads once it is."""

from pathlib import Path

import pytest
from protocols import PAPER, changed
from sessions import new_session
from simulated_loop import local_window

from app.ipc import messages as m
from app.ipc.messages import Setup
from experiments.inputs import OPERATOR


@pytest.mark.parametrize("hand", ["mouse", OPERATOR])
def test_before_a_session_it_is_known_whether_it_is_blind(tmp_path: Path, hand: str) -> None:
    data, file = tmp_path / "data", tmp_path / "pilot.toml"
    file.write_text(changed(PAPER.text, blind="true"), encoding="utf-8")
    with local_window(Setup(data, str(file), hand=hand, real_time=False)) as bench:
        bench.until_stage("no session")
        assert bench.opened is not None and bench.opened.blind == (hand != OPERATOR)
        snapshot = bench.open("02")
        assert snapshot.blind == (hand != OPERATOR) and snapshot.said.startswith("Participant 02: 60 trials to run.")


def test_a_session_of_another_hand_is_opened_and_the_sentence_says_why_no_trial_can_be_run(tmp_path: Path) -> None:
    data = tmp_path / "data"
    session = new_session(data, "01")
    session.skip("short of time")
    session.close()
    with local_window(Setup(data, real_time=False)) as bench:
        bench.until_stage("no session")
        bench.client.send(m.Open("01", resume=True))
        said = bench.until(lambda s: s.said_bad).said
    assert "Participant 01: 59 of 60 trials left." in said
    assert "because they could not be compared with the earlier ones" in said


def test_a_folder_in_which_every_participant_has_a_session_can_still_be_opened(tmp_path: Path) -> None:
    file = tmp_path / "pilot.toml"
    file.write_text(changed(PAPER.text, participants='["01"]'), encoding="utf-8")
    session = new_session(tmp_path / "data", "01")
    session.close()
    with local_window(Setup(tmp_path / "data", str(file), real_time=False)) as bench:
        assert bench.until_stage("no session").stage == "no session"
