"""What keeps a session from starting, as Home says it: each reason by itself, and all of them together."""

from pathlib import Path

import pytest
from fake_client import GREEN, RED, before, paper
from status_messages import status

from app.ipc import messages as m
from app.session_server.preflight import check_real, check_sensor
from app.window.home.start import Loaded, Wanted, start_blockers
from app.window.widgets.preflight import advice
from core.files import InputError
from experiments.store.overview import SessionOverview

LOADED = Loaded(paper(), "", "", 60, "01")
WANTED = Wanted("01", None, LOADED, 0, [])
BEGUN = SessionOverview(Path("data/sub-01/ses-01"), "01", "paper", 14, 60, 1.7e9)
ONLY_TWO = Loaded(paper(participants=("A", "B")), "", "", 60, "A")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    (
        ({"participant": ""}, "Name the participant."),
        ({"participant": "P-1"}, "Participant 'P-1': must be letters a to z and digits only."),
        ({"participant": "é"}, "Participant 'é': must be letters a to z and digits only."),
        ({"participant": 21 * "a"}, "Participant aaaaaaaaaaaaaaaaaaaaa: must have at most 20 characters, not 21."),
        ({"participant": "", "loaded": None}, "Loading …"),
        ({"loaded": None}, "Loading …"),
        ({"loaded": InputError("blocks must be at least 1")}, "This protocol cannot be run."),
        ({"loaded": ONLY_TWO}, "The protocol's participants are A, B."),
        ({"form_problems": ["Fill in age."]}, "Fill in age."),
        ({"operators": 2}, "This folder holds a study of 2 simulated operators"),
        ({"found": BEGUN._replace(problem="session.db cannot be read")}, "session.db cannot be read"),
    ),
)
def test_each_reason_is_a_sentence_of_its_own_and_stands_before_what_the_checks_say(changes, sentence) -> None:
    wanted = WANTED._replace(**changes)
    (found,) = start_blockers(wanted, "", before(), False)
    assert found.startswith(sentence)
    both = start_blockers(wanted, "", before(checks=RED), False)
    assert both[0] == found and len(both) == 2 and "no answer for 3 s" in both[1]


def test_nothing_keeps_a_whole_choice_or_a_session_that_is_there_from_going_on() -> None:
    assert start_blockers(WANTED, "", before(), False) == []
    unread = Wanted("01", BEGUN, None, 3, ["Fill in age."])  # what a new session needs does not matter to it
    assert start_blockers(unread, "", before(), False) == []


def test_while_a_session_is_open_that_is_the_only_reason() -> None:
    (only,) = start_blockers(
        WANTED._replace(participant="", form_problems=["Fill in age."]), "02", before(checks=RED), False
    )
    assert only.startswith("The session of 02 is open: close it to open or choose another.")


def test_what_a_step_of_the_session_puts_right_keeps_trials_from_starting_and_is_no_fault() -> None:
    checks = check_real(status(homed=False), ""), check_sensor(status(zeroed=False))
    snapshot = before(checks=(*checks, *GREEN[2:]))
    assert [check.state for check in checks] == [m.DUE, m.DUE] and advice(snapshot) == [], "amber, in no red banner"
    assert snapshot.trial_blocker.startswith("Device: not homed yet. Home the encoders")
    assert snapshot.session_blocker(real_device=True) == "" and not snapshot.place_known
    looked_for = check_real(status(problem="no answer"), "", connecting=True)
    assert (looked_for.state, looked_for.text) == (m.WAITING, "connecting …")
    lost = status(problem="no answer")
    assert (check_real(lost, "").state, check_sensor(lost).state) == (m.BAD, m.WAITING), "a sensor of no board"
    assert check_real(status(), "").state == check_sensor(status()).state == m.GOOD
