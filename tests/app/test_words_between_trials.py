"""What stands on the screens between trials: feedback whatever comes next, whole, with what to do; other windows."""

import pytest
from fake_client import LONG_BREAK, PLAN, opened, paper, ready, result, running
from PySide6.QtWidgets import QLabel
from screens import Screens, cut_texts, settle, visible_texts

from app.ipc import messages as m
from app.window import words
from experiments.analysis.trials_table import STATUSES
from experiments.language import ENGLISH_WORDS, FOLDER, language_text
from experiments.protocol import Cues

CUES = Cues(too_fast_s=3.0, too_slow_s=6.0)  # the trials of the fake client take 2.4 s
GIVEN = opened(protocol=paper(feedback="error", cues=CUES))
ERROR, CUE = "mm from the line on average", ENGLISH_WORDS["slower"]


@pytest.mark.parametrize("status", STATUSES)
def test_after_a_trial_of_any_status_there_is_a_large_line(status: str) -> None:
    row = result(PLAN[0], status)
    large = words.between(ready(1, rows=(row,)), opened()).large
    assert large and (large == ENGLISH_WORDS["done"]) == (status == "done")


def test_a_session_that_was_resumed_is_welcomed_back_and_not_praised() -> None:
    assert words.between(ready(0), opened()).large == ENGLISH_WORDS["welcome"]
    assert words.between(ready(5, newest=None), opened()).large == ENGLISH_WORDS["welcome_back"]
    assert words.between(ready(6), opened()).large == ENGLISH_WORDS["done"]


def test_after_practice_there_is_how_it_ended_and_no_second_welcome(screens: Screens) -> None:
    for status in ("done", "stopped", "timeout"):
        practised = result(PLAN[0]._replace(block=0), status)
        screens.hear(opened(), running(0, running=PLAN[0]._replace(block=0)), ready(0, newest=practised))
        assert screens.run.centre.large.text() == ENGLISH_WORDS[status] and not screens.run.card_shown


def test_the_participant_reads_the_language_of_the_protocol(screens: Screens) -> None:
    protocol = paper(language="de", language_text=language_text("de", FOLDER))
    german = protocol.sentences
    screens.hear(opened(protocol=protocol), ready(1))
    assert screens.participant.view.shown.large == screens.run.centre.large.text() == "Gut gemacht"
    screens.hear(ready(1, stage=m.QUESTIONS))
    assert german["effort"] in [label.text() for label in screens.participant.questions.findChildren(QLabel)]


def test_feedback_and_cue_are_said_whatever_comes_after_the_trial(screens: Screens) -> None:
    for following in (
        {}, {"paused": True}, {"stage": m.BREAK, "card": LONG_BREAK}, {"stage": m.RERIG}, {"stage": m.FINISHED}
    ):  # fmt: skip
        screens.hear(GIVEN, running(2), ready(3, **following))
        for said in (screens.participant.view.shown.small, screens.run.centre.small.text()):
            assert ERROR in said and CUE in said, following
        screens.hear(opened(), ready(3, **following))
        assert ERROR not in screens.participant.view.shown.small, following


def test_a_step_says_to_the_participant_what_its_card_has_for_them(screens: Screens) -> None:
    screens.hear(opened(), ready(3, stage="a text", card=m.Card("Text", "", participant="Think of a line")))
    assert screens.participant.view.shown.large == screens.run.centre.large.text() == "Think of a line"


def test_feedback_is_on_the_page_of_questions_that_covers_everything_else(screens: Screens) -> None:
    console = screens.hear(GIVEN, running(2), ready(3, stage=m.QUESTIONS))
    for page in (screens.run.questions, screens.participant.questions):
        assert any(ERROR in label.text() for label in page.findChildren(QLabel))
    settle(console)
    assert any(ERROR in text for text in visible_texts(console)) and cut_texts(screens.run.questions) == []
    screens.hear(opened(), ready(3, stage=m.QUESTIONS))
    assert not any(ERROR in text for text in visible_texts(console))


def test_who_has_the_space_bar_is_told_of_it_beside_the_feedback(screens: Screens) -> None:
    said = words.between(ready(3), GIVEN, own_start=True).small
    assert ERROR in said and CUE in said and ENGLISH_WORDS["next_space"] in said
