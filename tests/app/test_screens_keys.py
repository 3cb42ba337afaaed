"""Every key does what the screen says that it does: brakes off in any window, cards, questions, the start page."""

from functools import partial
from itertools import pairwise

import pytest
from fake_client import CARDS, PRESETS, opened, ready, running
from PySide6.QtCore import QRect, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLabel, QWidget
from screens import Screens, settle, visible_texts
from texts_on_screen import faults

from app.ipc import messages as m
from app.window.participant.questionnaire import ITEMS
from app.window.second_screen import MOST_MOVES
from app.window.widgets.keys import KEYS
from app.window.widgets.page import RUN, TRY
from app.window.widgets.theme import show_fitted

KEY, ALT, CTRL = Qt.Key, Qt.KeyboardModifier.AltModifier, Qt.KeyboardModifier.ControlModifier


def focus(screens: Screens) -> QWidget | None:
    """Who has the keyboard in the console."""
    return screens.main.focusWidget()


@pytest.mark.parametrize("backwards", [False, True])
def test_tab_stays_on_a_card_and_enter_presses_what_has_the_keyboard(screens: Screens, backwards: bool) -> None:
    console = screens.hear(opened(), running())
    console.close()
    go_on, close = screens.main.cards.question.buttons
    seen = [focus(screens)]
    for _ in range(2):
        QTest.keyClick(focus(screens), KEY.Key_Backtab if backwards else KEY.Key_Tab)
        seen.append(focus(screens))
    assert seen == [go_on, close, go_on]
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


def test_one_who_cancels_a_question_types_on_where_they_were(screens: Screens) -> None:
    screens.hear(opened(), ready(30, stage=m.RERIG))
    note = screens.run.panel.note
    screens.press(KEY.Key_N, modifier=ALT)
    home_asks = partial(screens.main.show_page, RUN, m.Leave())
    for ask in (screens.main.close, screens.run.panel.leave.click, home_asks):
        QTest.keyClicks(note, "b")
        ask()
        assert focus(screens) is not note
        assert screens.press(KEY.Key_Escape) == [] and focus(screens) is note
    note.clear()


@pytest.mark.parametrize("name", [RUN, TRY])
def test_f1_lists_every_key_of_the_window_and_of_its_page_each_with_what_it_does(screens: Screens, name: str) -> None:
    screens.hear(opened(), ready(3))
    screens.main.show_page(name)
    screens.press(KEY.Key_F1)
    settle(screens.main)
    card, page = screens.main.cards.question, screens.main.page(name)
    read = [label.text() for label in card.findChildren(QLabel)]
    named = dict(pairwise(read))
    for key in KEYS.values():
        assert named[" or ".join(key.keys)] == key.does
    chips = {entry.text().split()[-1]: entry.toolTip() for entry in page.workspace.layers.values()}
    assert len(chips) >= 4 and all(named[key].endswith(shows[1:]) for key, shows in chips.items())
    if name == TRY:
        assert [(named[str(n)].partition(": ")[0]) for n in range(1, 6)] == [p.name for p in PRESETS.values()]
    assert faults(card) == []
    screens.press(KEY.Key_Escape)
    screens.main.show_page(RUN)


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


def view_of_participant(screens: Screens) -> list[str]:
    """F11 on one screen: what is then read there."""
    if not screens.participant.isVisible():
        screens.windows.show_or_hide_participant()
    return [screens.participant.view.shown.large, screens.participant.view.shown.small]


STATES = {
    "ready": ready(3),
    "stopped": ready(3, brakes_off="Esc on the console"),
    "paused": ready(3, paused=True),
    "re-rig": ready(30, stage=m.RERIG),
    "break": ready(12, stage=m.BREAK),
    "over": ready(60, stage=m.FINISHED),
}


def test_over_the_console_the_view_says_how_to_get_back_to_it_and_beside_it_does_not(screens: Screens) -> None:
    screens.hear(opened())
    for state, snapshot in STATES.items():
        view_of_participant(screens)
        screens.participant.own_start = True
        screens.hear(snapshot)
        large, small = view_of_participant(screens)
        assert "F11" in small and ("Ctrl+B" in small) == (state == "stopped"), state
        assert "F11" not in screens.run.workspace.view.line, state
        screens.participant.own_start = False
        screens.hear(snapshot)
        assert screens.participant.view.shown.large == large and "F11" not in screens.participant.view.shown.small


def comes_to_have_the_keyboard(qtbot, window: QWidget) -> None:
    """And keeps it."""
    QTest.qWait(100)
    qtbot.waitUntil(lambda: QApplication.activeWindow() is window, timeout=60_000)


def test_with_a_second_screen_the_console_has_the_keyboard_at_the_start(qtbot, screens: Screens, monkeypatch) -> None:
    monkeypatch.setattr(screens.windows.second_screen, "other", screens.main.screen)
    screens.windows.show()
    comes_to_have_the_keyboard(qtbot, screens.main)
    screens.windows.show_or_hide_participant()
    screens.windows.show_or_hide_participant()
    assert screens.participant.isVisible()
    comes_to_have_the_keyboard(qtbot, screens.main)


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


class Elsewhere:
    """A screen beside all others, on which nothing can be shown."""

    def name(self) -> str:
        return "beamer"

    def geometry(self) -> QRect:
        return QRect(5000, 0, 800, 600)


def test_a_participants_window_that_does_not_land_where_it_should_is_moved_and_then_said_so(
    screens: Screens, monkeypatch
) -> None:
    second, there = screens.windows.second_screen, screens.main.screen()
    monkeypatch.setattr(second, "other", lambda: there)
    screens.windows.show()
    assert second._timer.isActive(), "it is looked at once it has had the time to land"
    monkeypatch.setattr(second, "other", Elsewhere)
    placed = []
    monkeypatch.setattr(second, "_place", placed.append)
    for _ in range(MOST_MOVES):
        second.look()
    assert len(placed) == MOST_MOVES and screens.main.cards.question is None
    second.look()
    assert "should cover the screen beamer" in screens.main.cards.question.text.text()
    screens.main.cards.leave()
    second.look()
    assert screens.main.cards.question is None, "it is said once"
    monkeypatch.setattr(second, "other", lambda: there)
    second.look()
    assert len(placed) == MOST_MOVES and screens.main.cards.question is None


def test_over_the_console_the_participants_view_has_the_keyboard(qtbot, screens: Screens) -> None:
    screens.windows.show()
    screens.windows.show_or_hide_participant()
    comes_to_have_the_keyboard(qtbot, screens.participant)


def test_a_window_opens_whole_with_its_frame_or_over_all_of_its_screen(qtbot) -> None:
    window = QWidget()
    qtbot.addWidget(window)
    room = window.screen().availableSize()
    for width, height, fits in (
        (room.width() // 2, room.height() // 2, True),
        (room.width(), room.height(), False),
        (2 * room.width(), room.height() // 2, False),
        (room.width() // 2, room.height(), False),
    ):
        show_fitted(window, width, height)
        assert window.isMaximized() != fits
        if fits:
            assert (window.width(), window.height()) == (width, height)
        window.showNormal()
        assert window.width() < room.width() and window.height() < room.height()
        window.hide()
