"""Before a session: one click to a practice trial, a new session, an interrupted one."""

import pytest
from fake_client import PRACTICE, RED, before, opened, ready, ticks
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from screens import Screens, opened_screens, visible_texts

from app.ipc import messages as m
from core import tick_log

LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def screens(qtbot):
    yield from opened_screens()


def test_nothing_can_be_started_while_it_is_being_prepared(screens: Screens) -> None:
    page = screens.hear(m.Snapshot(m.PREPARING)).start_page
    assert not page.new.isEnabled() and not page.practice.isEnabled() and "Preparing" in page.why.text()
    screens.hear(opened(""), before(checks=RED))
    assert not page.new.isEnabled() and not page.practice.isEnabled() and "Device" in page.why.text()
    screens.hear(before())
    assert page.new.isEnabled() and page.practice.isEnabled() and page.why.text() == ""


def test_one_click_runs_a_practice_trial_and_escape_leads_back(screens: Screens) -> None:
    console = screens.hear(opened(""), before())
    QTest.mouseClick(console.start_page.practice, LEFT)
    assert screens.client.sent == [m.Practice()]
    screens.hear(before(stage=m.RUNNING, running=PRACTICE))
    assert console.desk.isVisible() and "Practice · counts nowhere" in visible_texts(console)
    screens.tick(ticks(tick_log.MOVE))
    assert console.centre.large.text() == "Go"
    screens.hear(before())
    assert console.desk.isVisible() and console.centre.large.text() == "Well done"
    assert screens.press(Qt.Key.Key_Space) == [m.Practice()]
    screens.press(Qt.Key.Key_Escape)
    assert console.start_page.isVisible() and screens.client.off_causes == []


def test_a_practice_trial_is_also_a_key_away(screens: Screens, qtbot) -> None:
    console = screens.hear(opened(""), before())
    console.start_page.participant.clearFocus()
    screens.press(Qt.Key.Key_F4, console.start_page.participant)
    qtbot.waitUntil(lambda: bool(screens.client.sent), timeout=60_000)  # a button pressed by its key shows that it is
    assert screens.client.sent == [m.Practice()]


def test_enter_opens_a_session_for_the_participant_that_is_typed(screens: Screens) -> None:
    page = screens.hear(opened(""), before()).start_page
    page.participant.setText("")
    QTest.keyClicks(page.participant, "t07")
    assert screens.press(Qt.Key.Key_Return, page.participant) == [m.Open("t07", False, False)]
    page.blind.setChecked(True)
    assert screens.press(Qt.Key.Key_Return, page.participant) == [m.Open("t07", False, True)]


@pytest.mark.parametrize("label", ["", "0 2", "../x", "ä"])
def test_a_label_that_is_none_opens_nothing(screens: Screens, label: str) -> None:
    page = screens.hear(opened(""), before()).start_page
    page.participant.setText(label)
    assert screens.press(Qt.Key.Key_Return, page.participant) == [] and not page.new.isEnabled()


def test_interrupted_sessions_are_offered_to_go_on(screens: Screens) -> None:
    page = screens.hear(opened(""), before(resumable=("02", "05"))).start_page
    assert [button.text() for button in page.resumable] == ["Resume participant 02", "Resume participant 05"]
    QTest.mouseClick(page.resumable[1], LEFT)
    assert screens.client.sent == [m.Open("05", True, False)]
    page.participant.setText("02")
    assert screens.press(Qt.Key.Key_Return, page.participant) == [m.Open("02", True, False)]


def test_a_finished_session_is_opened_again_by_its_name_and_never_a_new_one(screens: Screens) -> None:
    page = screens.hear(opened(""), before(finished=("01", "02"))).start_page
    page.participant.setText("02")
    assert page.new.text().startswith("Open this finished session") and not page.resumable
    assert screens.press(Qt.Key.Key_Return, page.participant) == [m.Open("02", True, False)]


def test_a_refusal_is_readable_on_the_page(screens: Screens) -> None:
    refused = before(said="sub-01/ses-01: exists already, name another participant", said_bad=True)
    page = screens.hear(opened(""), refused).start_page
    assert page.problem.isVisible() and "exists already" in page.problem.text()


def test_an_open_session_leaves_the_page(screens: Screens) -> None:
    console = screens.hear(opened(""), before())
    screens.hear(opened("07"), ready())
    assert console.desk.isVisible() and console.preflight.title.text() == "Participant 07"
