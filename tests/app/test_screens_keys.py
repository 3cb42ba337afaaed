"""Every key does what the screen says that it does: brakes off in any window, cards, questions, the start page."""

import pytest
from fake_client import GREEN, PRACTICE, before, opened, ready, running
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QWidget
from screens import Screens, cut_texts, opened_screens, settle

from app.cli import main
from app.ipc import messages as m
from app.window.cards import ABORT_REASONS
from app.window.painting.theme import show_whole
from app.window.questionnaire import ITEMS
from app.window.results_window import ResultsWindow

KEY, ALT = Qt.Key, Qt.KeyboardModifier.AltModifier


@pytest.fixture
def screens(qtbot):
    yield from opened_screens()


def focus(screens: Screens) -> QWidget | None:
    """Who has the keyboard in the console."""
    return screens.console.focusWidget()


def shown_results(screens: Screens, tmp_path) -> ResultsWindow:
    screens.hear(opened(folder=str(tmp_path / "data" / "sub-01" / "ses-01")), ready(3))
    screens.press(KEY.Key_F2)
    return next(top for top in QApplication.topLevelWidgets() if isinstance(top, ResultsWindow) and top.isVisible())


# ------------------------------------------------------------------------------------------------- brakes off


def test_escape_on_the_results_is_brakes_off_while_a_trial_runs_and_else_closes_them(
    screens: Screens, tmp_path
) -> None:
    results = shown_results(screens, tmp_path)
    screens.hear(running(3))
    screens.press(KEY.Key_Escape, results)
    (cause,) = screens.client.off_causes
    assert "results" in cause and results.isVisible()
    screens.hear(ready(4, brakes_off=cause))
    screens.press(KEY.Key_Escape, results)
    assert not results.isVisible() and len(screens.client.off_causes) == 1


def test_escape_is_brakes_off_in_a_trial_that_began_while_the_device_page_was_open(screens: Screens) -> None:
    console = screens.hear(opened(), ready(3))
    screens.press(KEY.Key_F3)
    console.device_shown, console.snapshot = True, running(3)  # before the page has gone
    screens.press(KEY.Key_Escape)
    assert len(screens.client.off_causes) == 1


@pytest.mark.parametrize("card", ["abort", "close"])
def test_no_card_of_a_running_trial_promises_escape_and_escape_is_brakes_off(screens: Screens, card: str) -> None:
    console = screens.hear(opened(), running())
    screens.press(KEY.Key_A) if card == "abort" else console.close()
    question = console.cards.question
    assert not any("Esc" in button.text() for button in question.findChildren(type(console.preflight.brakes)))
    screens.press(KEY.Key_Escape, focus(screens))
    assert len(screens.client.off_causes) == 1


def test_the_question_before_an_abort_can_be_left_by_its_key_and_the_trial_goes_on(screens: Screens) -> None:
    console = screens.hear(opened(), running())
    screens.press(KEY.Key_A)
    assert "Alt+0" in console.cards.question.cancel.text()
    assert screens.press(KEY.Key_0, console.cards.question.own, ALT) == []
    assert console.cards.question is None and screens.client.off_causes == []


# ------------------------------------------------------------------------------------------------- cards


def test_a_reason_may_begin_with_any_digit(screens: Screens) -> None:
    console = screens.hear(opened(), running())
    screens.press(KEY.Key_A)
    QTest.keyClicks(console.cards.question.own, "3 s too late, as p. 2 says")
    assert screens.client.sent == [] and console.cards.question is not None
    assert screens.press(KEY.Key_Return, console.cards.question.own) == [m.Abort("3 s too late, as p. 2 says")]


@pytest.mark.parametrize("number", range(1, len(ABORT_REASONS) + 1))
def test_alt_and_a_digit_choose_a_reason_as_its_button_says_whatever_is_typed(screens: Screens, number: int) -> None:
    console = screens.hear(opened(), running())
    screens.press(KEY.Key_A)
    question = console.cards.question
    settle(console)
    assert cut_texts(console) == []
    QTest.keyClicks(question.own, "half a rea")
    sent = screens.press(KEY(KEY.Key_0 + number), question.own, ALT)
    assert sent == [m.Abort(ABORT_REASONS[number - 1])] and console.cards.question is None


@pytest.mark.parametrize("backwards", [False, True])
def test_tab_stays_on_a_card_and_enter_presses_what_has_the_keyboard(screens: Screens, backwards: bool) -> None:
    console = screens.hear(opened(), running())
    console.close()
    go_on, close = console.cards.question.buttons
    settle(console)
    assert cut_texts(console) == []
    seen = [focus(screens)]
    for _ in range(2):
        QTest.keyClick(focus(screens), KEY.Key_Backtab if backwards else KEY.Key_Tab)
        seen.append(focus(screens))
    assert seen == [go_on, close, go_on]
    QTest.keyClick(focus(screens), KEY.Key_Return)
    assert console.cards.question is None and console.isVisible()


def test_closing_during_a_trial_has_a_key(screens: Screens) -> None:
    console = screens.hear(opened(), running())
    console.close()
    assert "Alt+C" in console.cards.question.buttons[1].text()
    screens.press(KEY.Key_C, focus(screens), ALT)
    assert not console.isVisible() and screens.client.stopped


def test_enter_confirms_what_a_card_asks_after_a_note_was_written_and_after_a_click_beside_it(screens: Screens) -> None:
    console = screens.hear(opened(), ready(30, stage=m.RERIG))
    screens.press(KEY.Key_N)
    QTest.keyClicks(console.panel.note, "bolts")
    assert screens.press(KEY.Key_Return, console.panel.note) == [m.Note("bolts")]  # and nothing is confirmed
    assert screens.press(KEY.Key_Return, focus(screens)) == [m.Confirm()]
    console.centre.workspace.view.setFocus()
    assert screens.press(KEY.Key_Return, console.centre.workspace.view) == [m.Confirm()]


def test_a_notice_that_comes_while_a_note_is_written_takes_none_of_it_for_an_answer(screens: Screens) -> None:
    console = screens.hear(opened(), ready(29))
    screens.press(KEY.Key_N)
    QTest.keyClicks(console.panel.note, "a long")
    screens.hear(ready(30, stage=m.RERIG))
    for letter in " note":
        QTest.keyClicks(focus(screens), letter)
    assert screens.client.sent == []
    assert screens.press(KEY.Key_Return, focus(screens)) == [m.Note("a long note")]
    assert screens.press(KEY.Key_Return, focus(screens)) == [m.Confirm()]


# ------------------------------------------------------------------------------------------------- questions


@pytest.mark.parametrize("own_window", [False, True])
@pytest.mark.parametrize("key", [KEY.Key_Return, KEY.Key_Enter, KEY.Key_Space])
def test_the_questions_can_be_answered_by_keyboard_alone(screens: Screens, key: Qt.Key, own_window: bool) -> None:
    window: QWidget = screens.participant if own_window else screens.console
    if own_window:
        screens.windows.show_or_hide_participant()
    screens.hear(opened(), ready(9))
    screens.hear(ready(10, stage=m.QUESTIONS))
    questions = screens.participant.questions if own_window else screens.console.questions
    for i, (item, *_) in enumerate(ITEMS):
        assert window.focusWidget() is questions.scales[item]
        assert questions.lacking.text() == f"{i} of {len(ITEMS)} answered" and not questions.done.isEnabled()
        screens.press(KEY.Key_Right, window.focusWidget())
        screens.press(KEY.Key_Tab, window.focusWidget())
    assert window.focusWidget() is questions.done and questions.lacking.text() == ""
    assert screens.press(key, questions.done) == [m.Answers({item: 50.0 for item, *_ in ITEMS})]


# ------------------------------------------------------------------------------------------------- the start page


def test_b_allows_the_brakes_on_the_start_page_as_its_banner_says(screens: Screens) -> None:
    console = screens.hear(opened(""), before())
    console.start_page.participant.setFocus()
    screens.hear(before(brakes_off="Esc on the console"))
    assert "B or the button" in console.preflight.advice.text()
    assert screens.press(KEY.Key_B, focus(screens)) == [m.AllowBrakes()]
    assert console.start_page.participant.text() == "01"
    screens.hear(before())
    assert focus(screens) is console.start_page.participant


def test_b_allows_the_brakes_after_a_practice_trial_that_was_stopped(screens: Screens) -> None:
    console = screens.hear(opened(""), before())
    console.start_page.participant.setFocus()
    screens.press(KEY.Key_F4, console.start_page.participant)
    QTest.qWait(250)  # a button pressed by its key shows that it is
    screens.hear(before(stage=m.RUNNING, running=PRACTICE))
    screens.press(KEY.Key_Escape)
    screens.hear(before(brakes_off="Esc on the console", said="Stopped."))
    screens.press(KEY.Key_Escape)
    assert console.start_page.isVisible()
    assert screens.press(KEY.Key_B, focus(screens))[-1] == m.AllowBrakes()
    assert console.start_page.participant.text() == "01"


@pytest.mark.parametrize("label", ["a_b", "01 b", "ä"])
def test_a_label_that_is_none_is_said_to_be_none(screens: Screens, label: str) -> None:
    page = screens.hear(opened(""), before()).start_page
    assert page.wrong.isHidden()
    page.participant.setText(label)
    assert page.wrong.isVisible() and not page.new.isEnabled()
    page.participant.setText("")
    assert page.wrong.isHidden()


def test_what_was_refused_is_said_of_the_label_that_was_asked_for_alone(screens: Screens) -> None:
    page = screens.hear(opened(""), before()).start_page
    screens.press(KEY.Key_Return, page.participant)
    screens.hear(before(said="sub-01/ses-01: is in use by a running process", said_bad=True))
    assert page.problem.isVisible()
    page.participant.setText("02")
    assert page.problem.isHidden()
    screens.hear(before(said="sub-01/ses-01: is in use by a running process", said_bad=True, resumable=("07",)))
    assert page.problem.isHidden()


def test_a_protocol_that_is_blind_says_so_and_cannot_be_asked_not_to_be(screens: Screens) -> None:
    page = screens.hear(opened("", blind=True), before(finished=("07",))).start_page
    assert page.blind.isChecked() and not page.blind.isEnabled()
    page.offer("02")
    assert page.blind.isChecked()
    assert screens.press(KEY.Key_Return, page.participant) == [m.Open("02", False, True)]
    screens.hear(opened("", blind=False), before(finished=("07",)))
    assert not page.blind.isChecked() and page.blind.isEnabled()
    page.participant.setText("07")  # there is a session: whether it is blind was settled with it
    assert page.blind.isHidden()


def test_a_session_of_another_protocol_does_not_look_as_if_it_were_of_this_one(screens: Screens) -> None:
    console = screens.hear(
        opened(""), before(resumable=("02", "05"), otherwise=(("05", "pilot-2"), ("06", "pilot-3")), finished=("06",))
    )
    page = console.start_page
    assert [button.text() for button in page.resumable][0] == "Resume participant 02"
    assert "pilot-2" in page.resumable[1].text()
    ours = page.about.text()
    for label, says in (("05", "pilot-2"), ("06", "pilot-3"), ("02", "paper"), ("09", "paper")):
        page.participant.setText(label)
        assert says in page.about.text() and (page.about.text() == ours) == (says == "paper")
        settle(console)
        assert cut_texts(console) == []


# ------------------------------------------------------------------------------------------------- one screen


def view_of_participant(screens: Screens) -> list[str]:
    """F11 on one screen: what is then read there."""
    if not screens.participant.isVisible():
        screens.windows.show_or_hide_participant()
    return [screens.participant.view.said.large, screens.participant.view.said.small]


STATES = {
    "start": before(),
    "ready": ready(3),
    "stopped": ready(3, brakes_off="Esc on the console"),
    "paused": ready(3, paused=True),
    "re-rig": ready(30, stage=m.RERIG),
    "break": ready(12, stage=m.BREAK),
    "over": ready(60, stage=m.FINISHED),
}


@pytest.mark.parametrize("state", STATES)
def test_over_the_console_the_view_says_how_to_get_back_to_it_and_beside_it_does_not(screens: Screens, state) -> None:
    screens.hear(opened("" if state == "start" else "01"), STATES[state])
    large, small = view_of_participant(screens)
    assert "F11" in small and ("B lets" in small) == (state == "stopped")
    assert "F11" not in screens.console.centre.small.text()
    screens.participant.own_start = False
    screens.hear(STATES[state])
    assert screens.participant.view.said.large == large and "F11" not in screens.participant.view.said.small


def test_after_practice_on_one_screen_its_keys_are_said_and_do_it(screens: Screens) -> None:
    console = screens.hear(opened(""), before())
    screens.press(KEY.Key_F4, console.start_page.participant)
    QTest.qWait(250)
    screens.hear(before(stage=m.RUNNING, running=PRACTICE))
    view_of_participant(screens)
    screens.participant.view.show_pointer((0.0, 0.4))
    busy = (*GREEN[:4], GREEN[4]._replace(state=m.WAITING))
    screens.hear(before(checks=busy))
    screens.hear(before())  # a moment later all is well again
    said = screens.participant.view.said
    assert said.large == "Well done" and all(key in said.small for key in ("Space", "Esc", "F11"))
    assert screens.participant.view.pointer is None  # nothing is left that a hand could take hold of
    assert screens.press(KEY.Key_Space, screens.participant) == [m.Practice()]
    screens.press(KEY.Key_Escape, screens.participant)
    assert not screens.participant.isVisible() and console.start_page.isVisible()
    assert "Well done" not in view_of_participant(screens) and screens.client.off_causes == []


# ------------------------------------------------------------------------------------------------- windows


def test_with_a_second_screen_the_console_has_the_keyboard_at_the_start(screens: Screens, monkeypatch) -> None:
    monkeypatch.setattr(screens.windows, "_other_screen", screens.console.screen)
    screens.windows.show()
    QTest.qWait(100)
    assert screens.participant.isVisible() and QApplication.activeWindow() is screens.console
    screens.windows.show_or_hide_participant()
    screens.windows.show_or_hide_participant()
    QTest.qWait(100)
    assert screens.participant.isVisible() and QApplication.activeWindow() is screens.console


def test_over_the_console_the_participants_view_has_the_keyboard(screens: Screens) -> None:
    screens.windows.show()
    screens.windows.show_or_hide_participant()
    QTest.qWait(100)
    assert QApplication.activeWindow() is screens.participant


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
        show_whole(window, width, height)
        assert window.isMaximized() != fits
        if fits:
            assert (window.width(), window.height()) == (width, height)
        window.showNormal()
        assert window.width() < room.width() and window.height() < room.height()
        window.hide()


# ------------------------------------------------------------------------------------------------- the command


@pytest.mark.parametrize("command", ["--bogus", "run --bogus", "devices --bogus", "doctor --json --bogus"])
def test_an_unknown_option_leads_to_the_help_of_its_verb(capsys, command: str) -> None:
    assert main(command.split()) == 2
    verb = "run" if command.startswith("--") else command.split()[0]
    said = capsys.readouterr().err
    assert "--bogus" in said and f"(see phd {verb} --help)" in said
