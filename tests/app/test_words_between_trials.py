"""What stands on the screens between trials: feedback whatever comes next, whole, with what to do; other windows."""

import pytest
from fake_client import LONG_BREAK, PLAN, opened, ready, result, running
from PySide6.QtWidgets import QLabel
from screens import Screens, cut_texts, opened_screens, settle, visible_texts

from app.ipc import messages as m
from app.window import words
from app.window.painting.labels import OneLine
from experiments.analysis.trials_table import STATUSES

GIVEN = opened(feedback="error", cues=(3.0, 6.0))  # the trials of the fake bench take 2.4 s
ERROR, CUE = "mm from the line on average", words.SLOWER


@pytest.fixture
def screens(qtbot):
    yield from opened_screens()


@pytest.mark.parametrize("status", STATUSES)
def test_after_a_trial_of_any_status_there_is_a_large_line(status: str) -> None:
    assert words.after(result(PLAN[0], status), opened()).large


@pytest.mark.parametrize(
    "following",
    [
        {}, {"paused": True}, {"stage": m.BREAK, "card": LONG_BREAK},
        {"stage": m.RERIG}, {"stage": m.FINISHED},
    ],
)  # fmt: skip
def test_feedback_and_cue_are_said_whatever_comes_after_the_trial(screens: Screens, following: dict) -> None:
    console = screens.hear(GIVEN, running(2), ready(3, **following))
    for said in (screens.participant.view.shown.small, screens.run.centre.small.text()):
        assert ERROR in said and CUE in said
    screens.hear(opened(), ready(3, **following))
    assert ERROR not in screens.participant.view.shown.small


def test_feedback_is_on_the_page_of_questions_that_covers_everything_else(screens: Screens) -> None:
    console = screens.hear(GIVEN, running(2), ready(3, stage=m.QUESTIONS))
    for page in (screens.run.questions, screens.participant.questions):
        assert any(ERROR in label.text() for label in page.findChildren(QLabel))
    settle(console)
    assert any(ERROR in text for text in visible_texts(console)) and cut_texts(screens.run.questions) == []
    screens.hear(opened(), ready(3, stage=m.QUESTIONS))
    assert not any("last trial:" in text for text in visible_texts(console))


def test_who_has_the_space_bar_is_told_of_it_beside_the_feedback(screens: Screens) -> None:
    said = words.between(ready(3), GIVEN, own_start=True).small
    assert ERROR in said and CUE in said and words.SPACE_NEXT in said


@pytest.mark.parametrize(
    "said", [words.TAKE_IT, words.PREPARING.small, *(phase.small for phase in words.PHASES.values()), "feedback"]
)
def test_at_1280_x_720_on_one_screen_nothing_that_the_participant_reads_is_cut(screens: Screens, said: str) -> None:
    console = screens.hear(GIVEN, ready(3))
    if said != "feedback":
        screens.run.centre._write(words.Shown("Move to the start", said))
    settle(console)
    small = screens.run.centre.small
    assert not isinstance(small, OneLine) and small.isVisible() and cut_texts(screens.run.centre) == []
