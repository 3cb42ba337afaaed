"""The console, offscreen, on a fake bench: what it shows of what it is told, what it sends of what is done to it."""

import gc
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from fake_client import (
    GREEN,
    LONG_BREAK,
    PLAN,
    PRESETS,
    RED,
    FakeClient,
    before,
    movement,
    opened,
    pulse,
    ready,
    result,
    running,
    ticks,
)
from PySide6.QtCore import QEvent, QObject, QSettings, Qt, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QFileDialog, QLabel, QProgressDialog, QPushButton, QWidget
from screens import Screens, settle, visible_texts
from sessions import session_of
from texts_on_screen import faults

from app.ipc import messages as m
from app.window import program
from app.window.main_window import PAGES, SMALLEST, MainWindow
from app.window.run.session_cards import REDO
from app.window.widgets import memory, words
from app.window.widgets.page import ANALYSE, DEVICE, HOME, RUN, TRY
from app.window.widgets.preflight import ALLOW, ARE_OFF, OFF, OFF_BY_KEY, Checklist
from app.window.widgets.work import VerbProcess
from core import tick_log
from core.files import InputError
from experiments.store.overview import DataOverview, SessionOverview

KEY, ALT, CTRL = Qt.Key, Qt.KeyboardModifier.AltModifier, Qt.KeyboardModifier.ControlModifier


@pytest.mark.parametrize("state", [m.BAD, m.WAITING])
def test_no_trial_starts_while_a_check_is_red_or_waiting_and_the_reason_is_readable(screens: Screens, state) -> None:
    check = m.Check("Disk", state, "12 MB free", "Free some space.")
    console = screens.hear(opened(), ready(checks=(*GREEN[:3], check, GREEN[4])))
    assert screens.press(KEY.Key_Space) == [] and not screens.run.panel.start.isEnabled()
    assert any("12 MB free" in text for text in visible_texts(console))
    assert screens.run.strip.banner.isVisible() == (state == m.BAD)
    if state == m.BAD:
        assert "Disk: 12 MB free. Free some space." in screens.run.strip.banner.toolTip()
    screens.hear(ready())
    assert screens.press(KEY.Key_Space) == [m.Start()]


def test_a_wait_ends_in_dots_without_a_full_stop(qtbot) -> None:
    qtbot.addWidget(shown := Checklist())
    shown.show_checks((m.Check("Device", m.WAITING, "connecting …", "The board is being reached."),))
    assert "connecting … The board is being reached." in [label.text() for label in shown.findChildren(QLabel)]


def test_a_caution_is_shown_and_does_not_block(screens: Screens) -> None:
    late = m.Check("Loop", m.CAUTION, "12 ticks missed", "Close other programs.")
    screens.hear(opened(), ready(checks=(*GREEN[:2], late, *GREEN[3:])))
    assert "Close other programs." in screens.main.preflight.pills[0].toolTip()
    assert screens.press(KEY.Key_Space) == [m.Start()]


def test_a_red_check_differs_from_an_amber_one_and_from_a_green_mark_by_more_than_its_colour(screens: Screens) -> None:
    screens.hear(opened(), ready(checks=RED))
    marks = [pill.mark.text() for pill in screens.main.preflight.pills]
    assert len({*marks, screens.main.preflight.mark.text()}) == 4  # red twice, amber, waiting, green


#: what the server says -> the mark, the names of the pills
LIGHTS = {
    "ready": (ready(), "Ready", []),
    "no session": (before(), "Ready", []),
    "a trial": (running(), "No faults", []),
    "paused": (ready(paused=True), "No faults", []),
    "brakes off by Esc": (ready(brakes_off="Esc"), None, []),
    "a break": (ready(stage=m.BREAK), "No faults", []),
    "preparing": (m.Snapshot(m.PREPARING), "One moment …", []),
    "faults": (ready(checks=RED), None, ["Device", "Disk", "Loop", "Recording"]),
    "stopped": (ready(stage=m.FAILED, notice="The disk is full."), None, []),
}


@pytest.mark.parametrize("case", LIGHTS)
def test_pills_are_of_what_is_not_green_and_green_is_one_mark(screens: Screens, case: str) -> None:
    said, mark, pills = LIGHTS[case]
    preflight = screens.hear(opened(), said).preflight
    assert [pill.name.text() for pill in preflight.pills if pill.isVisible()] == pills
    assert preflight.all_well.isVisible() == (mark is not None)
    assert mark is None or preflight.all_well.text() == mark


def test_no_word_in_the_header_is_cut_and_the_words_of_the_reddest_are_kept_the_longest(screens: Screens) -> None:
    for size in (SMALLEST, (1280, 720), (1920, 1080)):
        screens.main.resize(*size)
        screens.hear(opened(), ready(checks=RED))
        settle(screens.main)
        pills = screens.main.preflight.pills
        worded = [pill.words.isVisible() for pill in pills]
        assert worded == sorted(worded, reverse=True) and all(pill.name.isVisible() for pill in pills)
        assert any(worded) or size == SMALLEST
        assert screens.main.width() == size[0] and faults(screens.main) == []


@pytest.mark.parametrize("where", ["main", "participant"])
def test_escape_switches_the_brakes_off_from_either_window_and_its_cause_is_shown(screens: Screens, where) -> None:
    screens.hear(opened(), running())
    window = getattr(screens, where)
    window.show()
    screens.press(KEY.Key_Escape, window)
    (cause,) = screens.client.off_causes
    assert cause.startswith("Esc was pressed") and where in cause
    screens.hear(ready(1, brakes_off=cause))
    assert cause in screens.run.strip.banner.toolTip() and not screens.run.panel.start.isEnabled()
    assert screens.press(KEY.Key_Space) == [] and screens.press(KEY.Key_B, modifier=CTRL) == [m.AllowBrakes()]


def test_settings_are_remembered_and_help_answers_on_every_page(screens: Screens, monkeypatch) -> None:
    main, kept = screens.main, {}
    monkeypatch.setattr(memory, "remember", kept.__setitem__)
    screens.hear(opened(), ready(1))
    screens.press(KEY.Key_F3)
    assert main.shown == DEVICE and main.tabs[DEVICE].isChecked()
    screens.press(KEY.Key_Comma, modifier=CTRL)
    for _ in range(2):
        QTest.keyClick(main.focusWidget(), KEY.Key_Tab)
    assert main.focusWidget().text() == "100 %", "Tab stops at what is chosen"
    QTest.keyClick(main.focusWidget(), KEY.Key_Right)
    assert kept == {memory.SIZE: "1.15"} and main.focusWidget().text() == "115 %"
    QTest.mouseClick(main.settings, Qt.MouseButton.LeftButton)
    card = main.cards.question
    for field, value in (
        (card.theme, "light"),
        (card.sound, memory.OFF),
        (card.scale, "1.15"),
        (card.scale, "1.0"),
    ):
        field.show_value(value)
        field.changed.emit(value)
    assert kept == {memory.DARK_OR_LIGHT: "light", memory.SOUND: memory.OFF, memory.SIZE: "1.0"}
    for entry, says in zip(
        main.help.menu().actions(), ("start the next trial", "one brake at a time", "session.db", "Reed"), strict=True
    ):
        entry.trigger()
        settle(main)
        assert says in " ".join(visible_texts(main))
    screens.press(KEY.Key_Escape)
    assert main.cards.question is None and screens.client.off_causes == []


def test_a_folder_that_cannot_be_served_is_named_and_another_can_be_chosen(screens, monkeypatch, tmp_path) -> None:
    main, asked = screens.main, []
    main.restart_asked.disconnect()
    main.restart_asked.connect(lambda *setup: asked.append(setup))
    screens.client.alive, screens.client.wants_other_folder = False, True
    screens.hear(m.Snapshot(m.FAILED, notice="/data: another PHD window is using this folder", notice_bad=True))
    settle(main)
    assert "/data: another PHD window is using this folder." in " ".join(visible_texts(main)).replace("\u200b", "")
    monkeypatch.setattr(QFileDialog, "getExistingDirectory", lambda *_: str(tmp_path))
    QTest.mouseClick(main.cards.question.buttons[0], Qt.MouseButton.LeftButton)
    assert asked == [(screens.client.setup._replace(data_dir=tmp_path), None)]


def test_between_trials_escape_first_closes_what_is_open_and_the_red_button_names_it_when_it_acts(screens) -> None:
    def red(*messages: object) -> str:
        return screens.hear(*messages).preflight.brakes.text()

    assert red(opened(), running()) == OFF_BY_KEY
    wide = screens.main.preflight.brakes.width()
    screens.press(KEY.Key_A, modifier=ALT)
    assert red() == OFF_BY_KEY
    screens.press(KEY.Key_Escape, screens.run.cards.question.own)
    assert len(screens.client.off_causes) == 1 and screens.run.cards.question is None
    screens.client.off_causes.clear()
    assert red() == red(ready(3)) == OFF_BY_KEY
    screens.press(KEY.Key_N, modifier=ALT)
    assert red() == OFF
    screens.press(KEY.Key_Escape, screens.run.panel.note)
    assert screens.client.off_causes == [] and not screens.run.panel.note.hasFocus() and red() == OFF_BY_KEY
    screens.main.show_keys()
    assert red() == OFF
    screens.main.show_page(TRY)
    card = screens.main.cards.question
    assert card.parentWidget().childAt(card.geometry().center()) in (card, *card.findChildren(QWidget)), "it is covered"
    screens.main.show_page(RUN)
    screens.press(KEY.Key_Escape)
    assert red() == OFF_BY_KEY
    screens.press(KEY.Key_Escape)
    assert len(screens.client.off_causes) == 1
    for said, text in ((ready(3, brakes_off="Esc"), ALLOW), (ready(3, stage=m.FAILED), ARE_OFF), (before(), OFF)):
        assert red(said) == text
        settle(screens.main)
        assert screens.main.preflight.brakes.width() == wide, "nothing beside it moves"


def test_redo_names_the_last_run_and_its_reason_and_never_one_that_was_redone(screens: Screens) -> None:
    screens.hear(opened(), ready(5))
    assert screens.press(KEY.Key_R, modifier=ALT) == [] and "trial 5" in screens.run.cards.question.title.text()
    assert screens.press(KEY.Key_2, screens.run.cards.question.own, ALT) == [m.Redo(5, REDO.reasons[1])]
    assert screens.run.cards.question is None
    rows = (result(PLAN[0]), result(PLAN[1], "redone"))
    screens.hear(opened(), ready(rows=rows, coming=PLAN[1]))
    screens.press(KEY.Key_R, modifier=ALT)
    assert screens.press(KEY.Key_1, screens.run.cards.question.own, ALT)[0].run == 1


def test_skip_takes_a_reason_in_ones_own_words_and_never_none(screens: Screens) -> None:
    screens.hear(opened(), ready(5))
    screens.press(KEY.Key_S, modifier=ALT)
    question = screens.run.cards.question
    assert screens.press(KEY.Key_Return, question.own) == [] and not question.confirm.isEnabled()
    QTest.keyClicks(question.own, "3 spare parts are missing, as p. 2 says")  # what are commands elsewhere
    assert screens.press(KEY.Key_Return, question.own) == [m.Skip("3 spare parts are missing, as p. 2 says")]


def test_an_abort_question_goes_when_its_trial_has_ended(screens: Screens) -> None:
    screens.hear(opened(), running())
    QTest.mouseClick(screens.run.panel.abort, Qt.MouseButton.LeftButton)
    assert screens.run.cards.question is not None
    screens.hear(ready(1))
    assert screens.run.cards.question is None and screens.press(KEY.Key_A, modifier=ALT) == []


def test_enter_presses_a_cards_first_button_as_it_says_while_a_choice_has_the_keyboard(screens: Screens) -> None:
    screens.hear(opened(), ready(3))
    screens.main.show_settings()
    assert words.from_home(screens.client.setup.data_dir) in visible_texts(screens.main)
    sound = next(field for field in screens.main.cards.question.findChildren(QPushButton) if field.text() == "Off")
    sound.setFocus()
    assert "Close  Enter" in visible_texts(screens.main)
    QTest.keyClick(sound, KEY.Key_Return)
    assert screens.main.cards.question is None


def test_a_session_is_closed_between_trials_and_what_was_asked_of_it_goes_with_it(screens: Screens) -> None:
    screens.hear(opened(), running(3))
    assert not screens.run.panel.leave.isVisible()
    screens.hear(ready(3))
    screens.run.panel.note.setText("not sent")
    QTest.mouseClick(screens.run.panel.leave, Qt.MouseButton.LeftButton)
    asked = " ".join(visible_texts(screens.main))
    assert "What is recorded stays" in asked and "lost then: the note." in asked
    QTest.keyClick(screens.run.cards.question.buttons[0], KEY.Key_Return)
    assert screens.client.sent[-1] == m.Leave()
    screens.hear(opened(""), before())
    assert screens.run.cards.question is None and not screens.run.panel.leave.isEnabled()
    assert screens.run.panel.note.text() == "", "another participant comes next"


def test_the_card_says_that_space_keeps_its_trial_and_starts_the_next_and_no_other_button_has_the_key(
    screens: Screens, monkeypatch
) -> None:
    monkeypatch.setattr("app.window.run.trial_card.IGNORE_SPACE_S", 0.0)
    for snapshot, says, sent in (
        (ready(1), "Keep, start next trial", [m.Start()]),
        (ready(2, paused=True), "Keep", []),
    ):
        screens.hear(opened(), running(len(snapshot.rows) - 1), snapshot)
        card, start = screens.run.card, screens.run.panel.start
        assert card.keep.isVisible() and card.keep.text() == says and not start.key.isVisible()
        screens.client.sent.clear()
        QTest.mouseClick(card.keep, Qt.MouseButton.LeftButton)
        assert screens.client.sent == sent and not screens.run.card_shown and start.key.isVisible()


def test_the_card_judges_the_whole_trial_also_where_another_page_was_at_the_front_meanwhile(screens: Screens) -> None:
    rows = movement(PLAN[0].segment, "AEB", 1.0)
    rows[200, tick_log.LATENESS_US] = 2.0 * tick_log.MISSED_US
    screens.hear(opened(), running(0))
    screens.main.show_page(HOME)
    screens.tick(rows[:500])
    screens.main.show_page(RUN)
    screens.tick(rows[500:])
    screens.hear(ready(1))
    assert "1 tick missed" in screens.run.card.flags.text()


class OwnWindows(QObject):
    """The kinds of widgets that are shown as windows of their own."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[str] = []

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Show and isinstance(watched, QWidget) and watched.isWindow():
            self.seen.append(type(watched).__name__)
        return False


def test_no_part_of_a_page_is_a_window_of_its_own_while_it_is_made(qtbot) -> None:
    watch, application = OwnWindows(), QApplication.instance()
    application.installEventFilter(watch)
    qtbot.addWidget(main := MainWindow(FakeClient()))
    for name in PAGES:
        main.show_page(name)
    one = SessionOverview(Path("sub-01/ses-01"), "01", "paper", 14, 60, 1.8e9)
    main.pages[HOME].data.show_overview(DataOverview(Path("data"), (one,)))
    application.removeEventFilter(watch)
    assert watch.seen == []


def test_analyse_and_the_footer_name_the_data_folder_before_it_is_served(screens: Screens, tmp_path: Path) -> None:
    client = FakeClient()
    client.setup = client.setup._replace(data_dir=tmp_path)
    screens.main.show_client(client, None)
    screens.main.show_page(ANALYSE)
    assert str(tmp_path) in screens.main.pages[ANALYSE].empty.text()
    assert screens.main.footer.folder.text() == words.from_home(tmp_path)


def test_the_footer_shows_the_whole_folder_where_there_is_room_and_the_proof_of_recording_always(screens) -> None:
    folder = "/home/somebody/studies/2026/paper/data2/sub-03/ses-01"
    for wide in (1400, SMALLEST[0]):
        screens.main.resize(wide, 700)
        screens.hear(opened(folder=folder), ready(3), pulse(""))
        screens.main.show_page(ANALYSE)
        settle(screens.main)
        footer = screens.main.footer
        needed = [one.fontMetrics().horizontalAdvance(one.text()) for one in (footer.folder, footer.recording)]
        assert footer.recording.width() >= needed[1] and (wide < 1400 or footer.folder.width() >= needed[0])


def test_the_grid_marks_each_status_and_the_running_trial(screens: Screens) -> None:
    rows = tuple(map(result, PLAN[:5], ("done", "timeout", "aborted", "redone", "recovered")))
    screens.hear(opened(), running(5, rows=rows))
    grid = screens.run.strip.plan
    assert [grid.statuses[run] for run in range(1, 6)] == ["done", "timeout", "aborted", "redone", "recovered"]
    assert grid.marked == 6 and grid.running
    assert screens.run.strip.progress.text().startswith(
        "3 of 60 done · 1 without a result · about "
    )  # the others come again


def test_a_repeated_trial_fills_the_cell_of_the_first(screens: Screens) -> None:
    again = PLAN[3]._replace(run=61)
    rows = (*map(result, PLAN[:3]), result(PLAN[3], "redone"), result(again, "done"))
    screens.hear(opened(), ready(rows=rows, coming=PLAN[4]))
    assert screens.run.strip.plan.statuses[4] == "done" and len(screens.run.strip.plan.statuses) == 4


def test_a_window_that_comes_later_shows_the_same(screens: Screens) -> None:
    screens.hear(opened(), ready(0))
    screens.hear(running(0))
    now = (opened(), running(12, notes=("13:02 slower",)), pulse())
    first = visible_texts(screens.hear(*now))
    later = Screens()
    assert visible_texts(later.hear(*now)) == first
    later.close()


def test_proof_of_recording_is_readable(screens: Screens) -> None:
    screens.hear(opened(), running(22), pulse("run-023"))
    said = screens.main.footer.recording.text()
    assert all(part in said for part in ("run-023", "18\u202f412 rows", "4.2 MB", "0.1 s ago", "22 earlier"))
    origin = screens.main.footer.folder.toolTip()
    assert "Seed 1" in origin and opened().plan_sha256[:4] in origin


def test_ticks_reach_workspace_participant_and_traces(screens: Screens) -> None:
    over = next(i for i, trial in enumerate(PLAN) if trial.segment == 1)
    screens.participant.show()
    screens.hear(opened(), running(over))
    screens.tick(ticks(tick_log.MOVE, TIP_X=0.03, TIP_Y=0.397, HAND_FX=3.0, HAND_FY=-4.0, ENERGY_BRAKES=0.5,
                       PATH_DISTANCE=-0.003))  # fmt: skip
    assert screens.run.live.error.newest == pytest.approx((3.0,))  # mm
    assert screens.run.live.force.newest == pytest.approx((5.0,))
    assert screens.run.workspace.view.tip == screens.participant.view.tip == (0.03, 0.397)
    assert screens.run.workspace.view.line.startswith("Participant reads: Go")


def test_a_blind_console_tells_no_controllers_apart(screens: Screens) -> None:
    seen = []
    names = {preset.name for preset in PRESETS.values()}
    for over, trial in enumerate(PLAN[:10]):
        console = screens.hear(opened(), running(over, blind=True))
        screens.tick(movement(trial.segment, "AEB", 0.4))
        texts = visible_texts(console)
        told = [text for text in texts if not text.startswith("directions")]  # the name of a layer
        assert not any(name in text for name in names for text in told)
        assert screens.run.strip.currents.isHidden() and not screens.run.strip.energy.isVisible()
        seen.append([text for text in texts if "path" in text and f"{trial.segment}" in text])
        screens.press(KEY.Key_R, modifier=ALT)
    assert all(seen)
    screens.hear(running(9))
    assert any(PRESETS[PLAN[9].controller].name in text for text in visible_texts(screens.main))


def test_a_break_cannot_be_ended_before_its_time(screens: Screens, monkeypatch) -> None:
    now = [100.0]
    monkeypatch.setattr("time.perf_counter", lambda: now[0])
    screens.hear(opened(), ready(12, stage=m.BREAK, card=LONG_BREAK))
    assert "1:00" in screens.run.cards.notice.title.text() and screens.press(KEY.Key_Space) == []
    now[0] += 30.0
    screens.hear()
    assert "0:30" in screens.run.cards.notice.title.text()
    now[0] += 30.1
    screens.hear()
    notice = screens.run.cards.notice
    assert notice.title.text() == "The break is over" and "rest" not in notice.text.text()
    assert screens.press(KEY.Key_Space) == [m.Confirm()]


def test_the_end_of_the_plan_is_said_nothing_more_starts_and_a_blind_session_is_opened_by_somebody_with_a_name(screens):
    console = screens.hear(opened(), ready(60, stage=m.FINISHED))
    assert "Session complete" in visible_texts(console) and not screens.run.panel.start.isEnabled()
    screens.run.panel.note.setText("a last no")
    sent = len(screens.client.sent)
    screens.run.cards.notice.buttons[1].click()
    assert "Not saved" in screens.run.cards.question.text.text() and len(screens.client.sent) == sent
    screens.run.cards.leave()
    screens.run.panel.note.clear()
    screens.run.cards.notice.buttons[1].click()
    assert screens.client.sent[sent:] == [m.Leave()]
    screens.hear(opened(), ready(60, stage=m.FINISHED, blind=True))
    QTest.mouseClick(screens.run.cards.notice.buttons[1], Qt.MouseButton.LeftButton)
    question = screens.run.cards.question
    assert screens.press(KEY.Key_Return, question.own) == []
    QTest.keyClicks(question.own, "R. Book")
    assert screens.press(KEY.Key_Return, question.own) == [m.Unblind("R. Book")]


@pytest.mark.parametrize("death", ["silent", "said"])
def test_the_end_of_the_bench_is_said_in_red_and_stops_everything(screens: Screens, death: str) -> None:
    screens.hear(opened(), running(3, notice=m.NOT_NOW[m.RUNNING], notice_bad=True))
    if death == "silent":
        screens.client.alive = False
        screens.hear()
        said = screens.run.strip.banner.toolTip()
        assert said == words.server_died(running(3)) and m.NOT_NOW[m.RUNNING] not in said
        assert "has stopped in the middle of trial 4" in said and "brakes are off" in said
    else:
        screens.hear(ready(3, stage=m.FAILED, notice="The disk is full.", notice_bad=True))
        assert screens.run.strip.banner.toolTip() == "The disk is full."
    assert screens.run.strip.banner.isVisible()
    assert not screens.main.preflight.brakes.isEnabled()
    screens.press(KEY.Key_Escape)
    assert len(screens.client.off_causes) == 1  # zero current can be asked for even then
    assert screens.press(KEY.Key_Space) == []
    assert all(screens.press(key, modifier=ALT) == [] for key in (KEY.Key_R, KEY.Key_S, KEY.Key_P, KEY.Key_A))


def test_a_bench_that_dies_in_a_trial_is_said_so_whatever_was_refused_before(screens: Screens) -> None:
    refused = m.NOT_NOW[m.RUNNING]
    screens.hear(opened(), running(3, notice=refused, notice_bad=True))
    screens.tick(movement(PLAN[3].segment, "AEB", 0.4))
    seen = screens.run.workspace.view.tip
    screens.client.alive = False
    screens.hear()
    assert screens.run.workspace.view.tip == seen != (0.0, 0.0), "the handle is drawn where it was seen last"
    said = screens.run.strip.banner.toolTip()
    assert refused not in said and "has stopped in the middle of trial 4" in said and "brakes are off" in said
    assert said.endswith("it comes again.")


def test_a_bench_that_dies_with_ticks_in_its_memory_does_not_say_that_they_are_kept(screens: Screens) -> None:
    for last in (running(3, in_memory="run 4, 812 ticks"), ready(4, in_memory="run 4, 812 ticks")):
        assert "is lost: run 4, 812 ticks" in words.server_died(last) and "kept" not in words.server_died(last)
    assert words.KEPT in words.server_died(ready(4))
    said_so = ready(4, stage=m.FAILED, notice="It failed.", notice_bad=True)
    assert words.server_died(said_so) == "It failed."


def test_closing_while_a_trial_is_recorded_asks_first(screens: Screens) -> None:
    console = screens.hear(opened(), running())
    assert not console.close() and console.isVisible() and not screens.client.stopped
    screens.main.cards.question.buttons[0].click()
    assert console.isVisible() and screens.main.cards.question is None
    console.close()
    screens.hear(ready(1))
    assert screens.main.cards.question is None, "its trial has ended meanwhile"
    screens.hear(running(1))
    console.close()
    assert "Alt+C" in screens.main.cards.question.buttons[1].text()
    screens.press(KEY.Key_C, console.focusWidget(), ALT)
    assert not console.isVisible() and screens.client.stopped == "the window was closed"


UNDONE = "/data is gone. Bring it back. All its 812 ticks are in memory. It is tried again every 5 s"
STUCK = (*GREEN[:4], m.Check("Recording", m.BAD, "incomplete", f"{UNDONE}."))


def test_closing_with_ticks_in_memory_alone_asks_first_and_names_them(screens: Screens) -> None:
    console = screens.hear(opened(), ready(3, not_written=UNDONE, in_memory="run 4, 812 ticks"))
    assert not console.close() and not screens.client.stopped
    assert "would be lost: run 4, 812 ticks" in " ".join(visible_texts(console))
    screens.main.cards.question.buttons[1].click()
    assert not console.isVisible() and screens.client.stopped


def test_closing_with_changes_in_the_editor_asks_first_and_names_its_protocol(screens: Screens) -> None:
    console = screens.hear(opened(""), before())
    editor = console.page(HOME).editor
    editor.open("displays")
    editor.text.appendPlainText("# mine")
    assert not console.close() and not screens.client.stopped
    assert "lost then: what was changed in the editor (Displays protocol, a copy)." in " ".join(visible_texts(console))
    console.press_escape()
    editor.undo()
    assert console.close() and screens.client.stopped


def test_enter_presses_the_button_with_the_keyboard_and_so_does_space_where_it_starts_nothing(screens: Screens) -> None:
    console = screens.hear(opened(), ready(3))
    for key, name, comes in (
        (KEY.Key_Return, ANALYSE, ANALYSE),
        (KEY.Key_Space, HOME, HOME),
        (KEY.Key_Enter, RUN, RUN),
    ):
        console.tabs[name].setFocus()
        assert screens.press(key, console.tabs[name]) == [] and console.shown == comes
    console.tabs[HOME].setFocus()
    assert screens.press(KEY.Key_Space, console.tabs[HOME]) == [m.Start()] and console.shown == RUN


def test_answers_and_a_note_that_are_not_sent_are_on_both_screens_and_asked_about(screens: Screens) -> None:
    console = screens.hear(opened(), ready(10, stage=m.QUESTIONS))
    theirs, here = screens.participant.questions, screens.run.questions
    theirs.scales["effort"].set(55)
    here.scales["smoothness"].set(20)
    screens.run.panel.note.setText("left-handed")
    assert theirs.values == here.values and (here.values["effort"], theirs.values["smoothness"]) == (55, 20)
    assert not console.close() and not screens.client.stopped
    asked = " ".join(visible_texts(console))
    assert "lost then: the questionnaire that is answered in part and the note." in asked
    console.press_escape()
    screens.run.panel.note.clear()
    screens.hear(ready(10))
    assert set(theirs.values.values()) == set(here.values.values()) == {None} and console.close()


def test_closing_between_trials_just_closes_and_ends_what_pages_do(screens: Screens) -> None:
    console, ended = screens.hear(opened(), ready(3)), []
    analyse = console.page(ANALYSE)
    analyse.side.end, analyse.export_task.stop = lambda: ended.append("replay"), lambda wait: ended.append("export")
    console.page(HOME).data.export_task.stop = lambda wait: ended.append("export of all")
    assert console.close() and screens.client.stopped and ended[:3] == ["replay", "export", "export of all"]


def test_who_closes_the_bar_of_the_set_up_ends_it_and_the_bar_stays_closed(qapp, monkeypatch) -> None:
    class Compiling(VerbProcess):
        def begin(self, *_: str, **__: object) -> None:
            QTimer.singleShot(0, self.go_on)

        def go_on(self) -> None:
            (bar,) = (window for window in qapp.topLevelWidgets() if isinstance(window, QProgressDialog))
            bar.close()
            self.progressed.emit(500)
            seen.append(bar.isVisible())
            self.done.emit(InputError("it was ended early"))

    seen: list[bool] = []
    monkeypatch.setattr(program, "VerbProcess", Compiling)
    monkeypatch.setattr(program, "is_compiled", lambda _: False)
    assert not program.compile_kernels() and seen == [False]


def test_frames_do_not_use_up_references_to_none(screens: Screens) -> None:
    """With some versions of Qt's binding a live plot loses references to None until the process dies."""
    console = screens.hear(opened(), running())
    rows = movement(PLAN[0].segment, "AEB", 1.4)

    def frames(some: np.ndarray) -> None:
        for part in np.array_split(some, len(some) // 16):
            screens.tick(part)
            console.grab()

    frames(rows[:160])
    lost = []
    for begin in range(160, 1120, 320):  # three times: what is freed late, of windows before this one, goes once
        gc.collect()
        before = sys.getrefcount(None)
        frames(rows[begin : begin + 320])
        gc.collect()
        lost.append(abs(sys.getrefcount(None) - before))
    assert min(lost) < 20, lost  # less than one a frame


def click_trial(screens: Screens, run: int) -> None:
    settle(screens.main)
    plan = screens.run.strip.plan
    QTest.mouseClick(plan, Qt.MouseButton.LeftButton, pos=plan.cells[run].center().toPoint())


def test_a_cell_of_the_plan_opens_the_card_of_its_trial_and_space_closes_it(qtbot, screens: Screens, tmp_path) -> None:
    with session_of(tmp_path, 2) as session:
        rows, folder = tuple(session.rows), str(session.folder)
    screens.hear(opened(folder=folder), ready(2, rows=rows))
    click_trial(screens, rows[0].run)
    qtbot.waitUntil(lambda: screens.run.card_shown, timeout=60_000)
    assert screens.run.card.row == rows[0]
    assert (
        screens.press(KEY.Key_X, modifier=ALT) == []
    )  # it asks why first, in the order of its buttons or in own words
    QTest.keyClicks(screens.run.cards.question.own, "he sneezed")
    assert screens.press(KEY.Key_Return, screens.run.cards.question.own) == [m.Exclude(rows[0].run, "he sneezed")]
    screens.hear(ready(2, rows=rows))
    click_trial(screens, rows[1].run)
    qtbot.waitUntil(lambda: screens.run.card_shown and screens.run.card.row == rows[1], timeout=60_000)
    qtbot.waitUntil(lambda: screens.run.card.ready, timeout=60_000)
    assert screens.press(KEY.Key_Space) == [] and not screens.run.card_shown
    assert screens.press(KEY.Key_Space) == [m.Start()]


def test_the_card_of_an_earlier_trial_leaves_its_flags_to_no_other(qtbot, screens: Screens, tmp_path) -> None:
    with session_of(tmp_path, 2) as session:
        rows, folder = tuple(session.rows), str(session.folder)
    screens.hear(opened(folder=folder), ready(1, rows=rows[:1]), running())
    late = movement(PLAN[1].segment, "AEB", 1.4)
    late[7, tick_log.LATENESS_US] = tick_log.MISSED_US
    screens.tick(late)
    screens.hear(ready(2, rows=rows))
    card = screens.run.card
    assert screens.run.card_shown and card.row == rows[1] and "1 tick missed" in card.flags.text()
    click_trial(screens, rows[0].run)
    screens.hear(ready(2, rows=rows))  # while the recording is read
    qtbot.waitUntil(lambda: card.row == rows[0], timeout=60_000)
    assert "1 tick missed" not in card.flags.text()
    qtbot.waitUntil(lambda: card.ready, timeout=60_000)
    assert screens.press(KEY.Key_Space) == [] and card.row == rows[1] and "1 tick missed" in card.flags.text()


def test_another_setup_starts_another_server_while_the_window_goes_on(screens: Screens, monkeypatch) -> None:
    started, ended = [], threading.Event()

    class Next(FakeClient):
        def __init__(self, setup: m.Setup) -> None:
            super().__init__()
            self.setup = setup
            started.append(self)

    monkeypatch.setattr("app.window.windows.Client", Next)
    monkeypatch.setattr(screens.client, "stop", lambda reason: ended.wait())
    old, setup = screens.client, m.Setup(Path("elsewhere"))
    screens.hear(opened(""), before())
    screens.windows.restart(setup, m.Open("02"))
    screens.windows.frame()
    assert not started and screens.main.snapshot.stage == m.PREPARING
    ended.set()
    screens.windows._ending.join()
    screens.windows.frame()
    (screens.client,) = started
    assert screens.client.setup == setup and screens.client is not old
    screens.hear(opened(""), before())
    assert screens.client.sent == [m.Open("02")]


def test_a_page_needs_no_key_of_its_own(qtbot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.window.main_window.HOME", RUN)
    monkeypatch.setitem(PAGES, "Notes", PAGES[RUN])
    window = MainWindow(FakeClient())
    qtbot.addWidget(window)
    window.tabs["Notes"].click()
    assert window.shown == "Notes" and window.tabs["Notes"].isChecked()


def test_where_no_file_manager_opens_the_path_is_said_and_can_be_pasted(
    screens: Screens, tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr("app.window.main_window.QDesktopServices.openUrl", lambda url: False)
    screens.hear(opened(folder=str(tmp_path / "not there yet")), ready())
    QTest.mouseClick(screens.main.footer.folder, Qt.MouseButton.LeftButton)
    said = screens.main.cards.question.text.text().replace("\u200b", "")
    assert f"The folder is {tmp_path}, copied" in said and "Paste it into a terminal" in said
    assert QApplication.clipboard().text() == str(tmp_path)


def test_settings_that_cannot_be_kept_say_so(screens: Screens, monkeypatch) -> None:
    path = "/dev/null/phd.ini"  # no user may write there
    monkeypatch.setattr(memory, "file", lambda: QSettings(path, QSettings.Format.IniFormat))
    screens.main.show_settings()
    said = screens.main.cards.question.text.text().replace("\u200b", "")
    assert said == f"What you choose is forgotten when you close the window: {path} cannot be written to."


def test_what_is_in_memory_alone_is_said_once_and_no_trial_starts(screens: Screens) -> None:
    screens.hear(opened(), ready(3, not_written=UNDONE, in_memory="run 4", checks=STUCK, notice=f"{UNDONE}.",
                                 notice_bad=True))  # fmt: skip
    assert screens.run.notice.text() == "Lost if this program ends: run 4."  # the banner may have no room for it
    said = "\n".join(visible_texts(screens.main)).replace("\u200b", "")
    assert said.count("All its 812 ticks are in memory") == 1 and not screens.run.panel.start.isEnabled()
