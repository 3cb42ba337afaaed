"""Every key does what the screen says that it does: brakes off in any window, cards, questions, the start page."""

import pytest
from fake_client import CARDS, opened, ready, running
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QWidget
from screens import Screens, visible_texts

from app.ipc import messages as m
from app.window.participant.questionnaire import ITEMS

KEY, ALT, CTRL = Qt.Key, Qt.KeyboardModifier.AltModifier, Qt.KeyboardModifier.ControlModifier


def focus(screens: Screens) -> QWidget | None:
    """Who has the keyboard in the console."""
    return screens.main.focusWidget()


def test_tab_stays_on_a_card_and_enter_presses_what_has_the_keyboard(screens: Screens) -> None:
    console = screens.hear(opened(), running())
    console.close()
    go_on, close = screens.main.cards.question.buttons
    seen = [focus(screens)]
    for key in (KEY.Key_Tab, KEY.Key_Tab, KEY.Key_Backtab, KEY.Key_Tab):
        QTest.keyClick(focus(screens), key)
        seen.append(focus(screens))
    assert seen == [go_on, close, go_on, close, go_on]
    QTest.keyClick(focus(screens), KEY.Key_Return)
    assert screens.main.cards.question is None and console.isVisible()


def test_a_re_rig_is_confirmed_by_enter_after_a_note_was_written_and_after_a_click_beside_it(screens: Screens) -> None:
    texts = visible_texts(screens.hear(opened(), ready(30, stage=m.RERIG)))
    assert {CARDS[m.RERIG].text, "Change to four-brake"} <= set(texts) and not screens.run.panel.start.isEnabled()
    screens.press(KEY.Key_N, modifier=ALT)
    QTest.keyClicks(screens.run.panel.note, "bolts")
    assert screens.press(KEY.Key_Return, screens.run.panel.note) == [m.Note("bolts")]  # and nothing is confirmed
    assert screens.press(KEY.Key_Return, focus(screens)) == [m.Confirm()]
    screens.run.workspace.view.setFocus()
    assert screens.press(KEY.Key_Return, screens.run.workspace.view) == [m.Confirm()]


def test_a_notice_that_comes_while_a_note_is_written_takes_none_of_it_for_an_answer(screens: Screens) -> None:
    screens.hear(opened(), ready(29))
    screens.press(KEY.Key_N, modifier=ALT)
    QTest.keyClicks(screens.run.panel.note, "prs nab")  # letters that are commands elsewhere
    screens.hear(ready(30, stage=m.RERIG))
    for letter in " note":
        QTest.keyClicks(focus(screens), letter)
    assert screens.client.sent == []
    assert screens.press(KEY.Key_Return, focus(screens)) == [m.Note("prs nab note")]
    assert screens.press(KEY.Key_Return, focus(screens)) == [m.Confirm()]
    screens.hear(ready(30, notes=("13:02 prs nab note",)))
    assert "13:02 prs nab note" in screens.run.notes.text() and screens.run.cards.notice is None


@pytest.mark.parametrize("own_window", [False, True])
def test_the_questions_can_be_answered_by_keyboard_alone(screens: Screens, own_window: bool) -> None:
    window: QWidget = screens.participant if own_window else screens.main
    if own_window:
        screens.windows.show_or_hide_participant()
    screens.hear(opened())
    for key in (KEY.Key_Return, KEY.Key_Enter, KEY.Key_Space):
        screens.hear(ready(9))
        screens.hear(ready(10, stage=m.QUESTIONS))
        questions = screens.participant.questions if own_window else screens.run.questions
        for i, (item, *_) in enumerate(ITEMS):
            assert window.focusWidget() is questions.scales[item]
            assert questions.lacking.text() == f"{len(ITEMS) - i} not answered yet" and not questions.done.isEnabled()
            screens.press(KEY.Key_Right, window.focusWidget())
            screens.press(KEY.Key_Tab, window.focusWidget())
        assert window.focusWidget() is questions.done and questions.lacking.text() == ""
        assert screens.press(key, questions.done) == [m.Answers({item: 50.0 for item, *_ in ITEMS})], key


def comes_to_have_the_keyboard(qtbot, window: QWidget) -> None:
    """And keeps it."""
    QTest.qWait(100)
    qtbot.waitUntil(lambda: QApplication.activeWindow() is window, timeout=60_000)


def test_without_their_screen_the_participant_is_asked_in_the_main_window(screens: Screens, monkeypatch) -> None:
    monkeypatch.setattr(screens.windows.second_screen, "other", screens.main.screen)
    screens.windows.show()
    assert screens.participant.isVisible() and screens.run.participant_answers
    monkeypatch.setattr(screens.windows.second_screen, "other", lambda: None)  # it is unplugged
    QApplication.instance().screenRemoved.emit(screens.main.screen())
    QApplication.processEvents()
    assert not screens.participant.isVisible() and not screens.run.participant_answers
    monkeypatch.setattr(screens.windows.second_screen, "other", screens.main.screen)  # and plugged in again
    QApplication.instance().screenAdded.emit(screens.main.screen())
    QApplication.processEvents()
    assert screens.participant.isVisible() and screens.run.participant_answers


def test_a_click_on_the_second_screen_leaves_the_keyboard_to_the_cards_of_the_console(qtbot, screens, monkeypatch):
    """The participant has it while they answer, and no longer."""
    monkeypatch.setattr(screens.windows.second_screen, "other", screens.main.screen)
    screens.windows.show()
    screens.hear(opened(), ready(10, stage=m.QUESTIONS))
    screens.participant.activateWindow()
    comes_to_have_the_keyboard(qtbot, screens.participant)
    screens.participant.questions.answered.emit({})
    comes_to_have_the_keyboard(qtbot, screens.main)
    screens.hear(ready(10, stage=m.RERIG))
    screens.participant.activateWindow()  # as a click does
    comes_to_have_the_keyboard(qtbot, screens.main)
