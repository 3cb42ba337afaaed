"""The participant's window: plain words, no numbers, no names; true to scale; the pointer as the hand."""

import re
from pathlib import Path

import numpy as np
import pytest
from fake_client import LONG_BREAK, PRACTICE, PRESETS, opened, paper, ready, running, ticks
from page_driver import LEFT
from PySide6.QtCore import Qt
from PySide6.QtGui import QImage
from PySide6.QtTest import QTest
from screens import Screens, point, settle, visible_texts
from texts_on_screen import faults

from app.ipc import messages as m
from app.window.participant.questionnaire import ITEMS
from app.window.run.run_page import INSTRUCTED
from app.window.widgets.palette import colour_for
from core import tick_log
from experiments.inputs import MOUSE, OPERATOR
from experiments.language import language_text, shipped_languages
from experiments.protocol_file import Consent, Cues, Instruction


@pytest.fixture
def screens(screens: Screens) -> Screens:
    screens.participant.resize(1280, 720)
    screens.participant.show()
    return screens


def said(screens: Screens) -> str:
    return " ".join(screens.participant.view.shown)


MOUSE_HAND = opened()
TIMED = opened(protocol=paper(feedback="time", cues=Cues(too_fast_s=3.0, too_slow_s=6.0)))  # the trial took 2.4 s
SLOW = opened(protocol=paper(cues=Cues(too_fast_s=0.5, too_slow_s=2.0)))
#: what the server says, the phase of the ticks (None: there are none) and whether the pointer has the handle -> what is
#: read in large, what of the quiet line, and what is not
SAYS = {
    "approach": ((MOUSE_HAND, running()), tick_log.APPROACH, True, "Move to the start", "green circle", "pointer"),
    "move": ((MOUSE_HAND, running()), tick_log.MOVE, True, "Go", "Follow the line", "pointer"),
    "move, for a while": ((MOUSE_HAND, running()), tick_log.MOVE, True, "", "Follow the line", "pointer"),
    "move, by a sensor": ((opened(hand="force sensor"), running(1)), tick_log.MOVE, False, "Go", "Follow", "pointer"),
    "finished": ((MOUSE_HAND, ready(9, stage=m.FINISHED)), None, True, "Thank you!", "", "trial"),
    "approach, let go": ((MOUSE_HAND, running()), tick_log.APPROACH, False, "Move to the start", "pointer", "circle"),
    "move, let go": ((MOUSE_HAND, running()), tick_log.MOVE, False, "Go", "pointer", "line"),
    "done": ((MOUSE_HAND, running(), ready(1)), None, True, "Thank you", "One moment", "2.4"),
    "break": ((MOUSE_HAND, ready(9, stage=m.BREAK)), None, True, "Take a break", "Rest your hand", "trial"),
    "re-rig": ((MOUSE_HAND, ready(9, stage=m.RERIG)), None, True, "One moment", "prepared", "trial"),
    "time, too fast": ((TIMED, running(), ready(1)), None, True, "Thank you", "2.4 seconds · A little slower", "mm"),
    "too slow": ((SLOW, running(), ready(1)), None, True, "Thank you", "A little faster", "2.4"),
}  # fmt: skip


@pytest.mark.parametrize("case", SAYS)
def test_what_the_participant_reads_is_plain_and_the_path_is_away_between_parts(screens: Screens, case: str) -> None:
    messages, phase, taken, large, small, never = SAYS[case]
    for message in messages:
        screens.hear(message)
    if phase is not None:
        screens.tick(ticks(phase, 2000 if "while" in case else 16), taken=taken)
    shown = screens.participant.view.shown
    assert shown.large == large and small in shown.small and never not in shown.small
    away = isinstance(messages[-1], m.Snapshot) and messages[-1].stage in (m.BREAK, m.RERIG, m.FINISHED)
    assert (len(screens.participant.view.outline) == 0) == away


def test_nothing_shown_to_the_participant_has_numbers_names_or_jargon(screens: Screens) -> None:
    stages = [
        *(ready(9, stage=stage, card=LONG_BREAK) for stage in (m.RERIG, m.BREAK, m.FINISHED, m.FAILED)),
        ready(0), ready(9), ready(9, paused=True), ready(9, brakes_off="watchdog"), m.Snapshot(m.PREPARING), running(9),
    ]  # fmt: skip
    names = "|".join(preset.name for preset in PRESETS.values())
    screens.hear(opened())
    for snapshot in stages:
        screens.hear(snapshot)
        for phase in range(4) if snapshot.running else (None,):
            if phase is not None:
                screens.tick(ticks(phase))
            text = " ".join((*screens.participant.view.shown, *visible_texts(screens.participant)))
            assert not re.search(rf"\d|brake|controller|tip|{names}", text.replace("1:00", "")), text


def test_the_linkage_is_seen_only_where_the_protocol_says_so(screens: Screens) -> None:
    for over, shown in enumerate((False, True)):
        screens.hear(opened(protocol=paper(show_linkage=shown)), running(over))
        screens.tick(ticks(tick_log.MOVE))
        view = screens.participant.view
        assert (view.moving_box() == view.rect()) == shown, "what a linkage covers is painted anew"


def test_the_trace_is_seen_unless_the_protocol_hides_it(screens: Screens) -> None:
    view = screens.participant.view
    for shown in (True, False):
        screens.hear(opened(protocol=paper(show_trace=shown)), running(int(shown)))
        view.extend_trail(np.array(((-0.05, 0.3), (0.05, 0.3))))
        seen = view.grab().toImage().convertToFormat(QImage.Format.Format_RGB32)
        pixels = np.frombuffer(seen.constBits(), np.uint32) & 0xFFFFFF
        assert (int(colour_for("trace")[1:], 16) in pixels) == shown


def test_where_a_force_sensor_is_the_hand_the_pointer_is_none(screens: Screens) -> None:
    screens.hear(opened(hand="force sensor"), running())
    view = screens.participant.view
    point(view, view.to_screen((0.0, 0.3)))
    assert screens.client.aimed == []


def test_the_questions_wait_for_all_answers_and_are_empty_the_next_time(screens: Screens) -> None:
    screens.hear(opened(), ready(10, stage=m.QUESTIONS))
    questions = screens.participant.questions
    assert questions.isVisible() and not questions.done.isEnabled()
    for i, (item, *_) in enumerate(ITEMS):
        scale = questions.scales[item]
        QTest.mouseClick(scale, LEFT, pos=scale.rect().center())
        for _ in range(i):
            QTest.keyClick(scale, Qt.Key.Key_Right)
    screens.hear(ready(10, stage=m.PREPARING))  # the control loop had died, and is there again
    screens.hear(ready(10, stage=m.QUESTIONS))
    QTest.mouseClick(questions.done, LEFT)
    (answers,) = screens.client.sent
    assert answers == m.Answers({item: 50.0 + 5.0 * i for i, (item, *_) in enumerate(ITEMS)})
    screens.hear(ready(10))
    screens.hear(ready(20, stage=m.QUESTIONS))
    assert all(scale.value is None for scale in questions.scales.values())


@pytest.mark.parametrize("language", shipped_languages())
def test_no_text_is_cut_or_covered_and_what_is_to_be_read_grows_with_the_screen(screens, language) -> None:
    def of(**keys) -> m.Opened:
        return opened(protocol=paper(language_text=language_text(language, Path()), **keys), folder=str(keys))

    long = (Instruction(text="Follow the line as exactly as you can, at a speed of your own. " * 8), Instruction("2"))
    cues, window = Cues(too_fast_s=3.0, too_slow_s=6.0), screens.participant
    for said, read in (
        ((of(), ready(22, stage=m.BREAK, card=LONG_BREAK)), None),
        ((of(feedback="error", cues=cues), running(2), ready(3)), None),
        ((of(instruction=long), ready(0)), window.instructions.text),
        ((of(), ready(10, stage=m.QUESTIONS)), window.questions.done),
    ):
        screens.hear(*said)
        sizes = []
        for width, height in ((640, 480), (960, 540), (1920, 1080)):
            window.resize(width, height)
            settle(window)
            assert faults(window) == [], (width, height)
            sizes.append(read.font().pixelSize() if read else len(sizes))
        assert sizes == sorted(sizes) and sizes[-1] > 1.4 * sizes[1]


def test_the_start_ring_has_the_radius_that_counts_and_the_dot_fits_into_it(screens: Screens) -> None:
    screens.hear(opened(), running())
    view = screens.participant.view
    for width, height in ((1280, 720), (1920, 1080)):
        screens.participant.resize(width, height)
        settle(screens.participant)
        assert view.rings_px == pytest.approx((0.003 * view.scale, 0.01 * view.scale))
        assert view.handle_px < view.rings_px[0]


def test_the_hold_fills_the_ring_and_who_leaves_it_early_is_told(screens: Screens) -> None:
    screens.hear(opened(), running())
    screens.tick(ticks(tick_log.APPROACH, 100))
    screens.tick(ticks(tick_log.HOLD, 250, start=0.1))
    assert screens.participant.view.held == pytest.approx(0.5, abs=0.01)
    screens.tick(ticks(tick_log.APPROACH, 16, start=0.35))
    assert screens.participant.view.held == 0.0 and "until it is full" in said(screens)
    screens.tick(ticks(tick_log.APPROACH, 16, start=2.5))
    assert "until it is full" not in said(screens)


def test_the_participant_sees_where_the_hand_pulls_while_the_pointer_is_over_the_other_window(screens: Screens) -> None:
    screens.hear(opened(), running())
    screens.participant.show()
    screens.tick(rows := ticks(tick_log.MOVE))
    assert screens.participant.view.pointer == tuple(rows[-1, tick_log.TARGET_X : tick_log.TARGET_Y + 1])


def instructed(screens: Screens, folder: str, hand: str = MOUSE) -> None:
    pages = (Instruction(text="Hold the handle."), Instruction(text="Follow the line."))
    screens.hear(opened(protocol=paper(instruction=pages), folder=folder, hand=hand), ready(0))


def test_no_trial_starts_while_instructions_are_unread_whoever_turns_their_pages(screens: Screens) -> None:
    window, start = screens.participant, screens.run.panel.start
    space = lambda: screens.press(Qt.Key.Key_Space)  # noqa: E731
    ways = (
        (space, lambda: screens.press(Qt.Key.Key_Space, window)),
        (lambda: QTest.mouseClick(start, LEFT), lambda: QTest.mouseClick(window.instructions, LEFT)),
    )
    for folder, (first, second) in enumerate(ways):
        instructed(screens, f"{folder}")
        screens.client.sent.clear()
        assert start.text() == "Next page" and screens.run.workspace.view.line == INSTRUCTED.small
        assert window.instructions.isVisible() and window.instructions.text.text() == "Hold the handle."
        first()
        assert window.instructions.text.text() == "Follow the line."
        second()
        assert window.view.isVisible() and start.text() == "Start" and screens.client.sent == []
        space()
        assert screens.client.sent == [m.Start()]
        for practice in range(2):  # rows are of the plan alone: after practice there are none yet
            screens.hear(ready(0, stage=m.RUNNING, running=PRACTICE._replace(repetition=practice)))
            screens.hear(ready(0))
            assert window.view.isVisible() and start.text() == "Start"


def test_on_one_screen_instructions_stand_on_run_and_a_simulated_hand_has_none(screens: Screens) -> None:
    screens.participant.hide()
    instructed(screens, "one screen")
    page = screens.run.instructions
    assert page.isVisible() and page.text.text() == "Hold the handle."
    assert screens.press(Qt.Key.Key_Space) == [] and page.text.text() == "Follow the line."
    QTest.mouseClick(page, LEFT)
    assert not page.isVisible() and screens.press(Qt.Key.Key_Space) == [m.Start()]
    instructed(screens, "another")
    screens.participant.show()
    assert screens.participant.instructions.isVisible() and not page.isVisible()
    screens.participant.hide()
    assert page.isVisible(), "it goes to the other screen, and comes back"
    instructed(screens, "simulated", hand=OPERATOR)
    assert not page.isVisible() and screens.run.panel.start.text() == "Start"


def test_consent_is_answered_on_the_participants_screen_and_no_key_agrees(screens: Screens) -> None:
    answers: list[bool] = []
    screens.participant.consent.answered.disconnect()
    screens.participant.consent.answered.connect(answers.append)
    screens.participant.ask_consent(Consent("You may stop.\n" * 60, "Yes", "No"))
    page = screens.participant.consent
    settle(screens.participant)
    assert page.isVisible() and page.area.verticalScrollBar().maximum() > 0
    for key in (Qt.Key.Key_Space, Qt.Key.Key_Return):
        screens.press(key, screens.participant)
    assert answers == [] == screens.client.sent
    QTest.mouseClick(page.agree, LEFT)
    screens.participant.ask_consent(None)
    assert answers == [True] and screens.participant.view.isVisible()


def test_tones_come_at_go_and_at_the_end_once_each_and_only_where_the_protocol_has_them(screens, monkeypatch) -> None:
    played: list[str] = []
    monkeypatch.setattr(screens.participant.tones, "play", played.append)
    for over, on in enumerate((True, False)):
        screens.hear(opened(protocol=paper(tones=on)), running(over))
        for phase in (tick_log.APPROACH, tick_log.HOLD, tick_log.MOVE, tick_log.MOVE, tick_log.END, tick_log.END):
            screens.tick(ticks(phase))
        assert played == ["go", "end"]
        screens.hear(ready(over + 1))
