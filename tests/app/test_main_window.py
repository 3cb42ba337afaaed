"""The window around the pages, on a fake bench: lights, keys, footer, help, what closing asks, the server's end."""

import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from fake_client import PLAN, RED, FakeClient, before, movement, opened, pulse, ready, running
from page_driver import LEFT
from page_table import press, read
from PySide6.QtCore import Qt
from PySide6.QtGui import QImage
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QFileDialog, QWidget
from screens import Screens, settle, visible_texts
from tried import tried
from waiting import wait_until

from app.ipc import messages as m
from app.window.canvas.linkage_view import REACHABLE
from app.window.widgets import memory, words
from app.window.widgets.page import ANALYSE, HOME, RUN
from app.window.widgets.preflight import ARE_OFF, TURN_OFF, TURN_ON, Preflight
from core import tick_log

KEY, ALT, CTRL = Qt.Key, Qt.KeyboardModifier.AltModifier, Qt.KeyboardModifier.ControlModifier


#: what the server says -> the mark, the names of the pills
LIGHTS = {
    "ready": (ready(), "Ready", []),
    "no session": (before(), "Ready", []),
    "a trial": (running(), "No faults", []),
    "paused": (ready(paused=True), "No faults", []),
    "brakes off by Esc": (ready(brakes_off="Esc"), None, []),
    "preparing": (m.Snapshot(m.PREPARING), "One moment …", []),
    "faults": (ready(checks=RED), None, ["Device", "Disk", "Loop", "Recording"]),
    "stopped": (ready(stage=m.FAILED, notice="The disk is full."), None, []),
}


def test_pills_are_of_what_is_not_green_and_differ_by_shape_and_green_is_one_mark(screens: Screens) -> None:
    at_first = Preflight()
    assert (at_first.mark.text(), at_first.all_well.text()) == ("○", "One moment …"), (
        "before the server has said anything"
    )
    for case, (said, mark, names) in LIGHTS.items():
        preflight = screens.hear(opened(), said).preflight
        pills = [pill for pill in preflight.pills if pill.isVisible()]
        assert [pill.name.text() for pill in pills] == names, case
        assert preflight.all_well.isVisible() == (mark is not None)
        assert mark is None or preflight.all_well.text() == mark
        shapes = {m.BAD: "✕", m.CAUTION: "▲", m.WAITING: "○"}
        states = {check.name: check.state for check in said.checks}
        assert [pill.mark.text() for pill in pills] == [shapes[states[name]] for name in names]


def test_settings_are_remembered_and_help_answers_on_every_page(screens: Screens, monkeypatch) -> None:
    main, kept = screens.main, {}
    monkeypatch.setattr(memory, "remember", kept.__setitem__)
    screens.hear(opened(), ready(1))
    screens.press(KEY.Key_Comma, modifier=CTRL)
    card = main.cards.question
    for field, value in ((card.theme, "light"), (card.sound, memory.OFF), (card.scale, "1.15")):
        field.show_value(value)
        field.changed.emit(value)
    assert kept == {memory.DARK_OR_LIGHT: "light", memory.SOUND: memory.OFF, memory.SIZE: "1.15"}
    for entry, says in zip(
        main.help.menu().actions(), ("start the next trial", "one brake at a time", "session.db", "Reed"), strict=True
    ):
        entry.trigger()
        settle(main)
        assert says in " ".join(visible_texts(main))
    screens.press(KEY.Key_Escape)
    assert main.cards.question is None


def test_a_folder_that_cannot_be_served_is_named_and_another_can_be_chosen(screens, monkeypatch, tmp_path) -> None:
    main, asked = screens.main, []
    main.restart_asked.disconnect()
    main.restart_asked.connect(lambda *setup: asked.append(setup))
    screens.client.alive, screens.client.wants_other_folder = False, True
    screens.hear(m.Snapshot(m.FAILED, notice="/data: another PHD window is using this folder", notice_bad=True))
    settle(main)
    assert "/data: another PHD window is using this folder." in " ".join(visible_texts(main)).replace("\u200b", "")
    monkeypatch.setattr(QFileDialog, "getExistingDirectory", lambda *_: str(tmp_path))
    QTest.mouseClick(main.cards.question.buttons[0], LEFT)
    assert asked == [(screens.client.setup._replace(data_dir=tmp_path), None)]


def test_the_brakes_button_always_names_its_key_and_escape_always_does_what_it_says(screens: Screens) -> None:
    button = screens.main.preflight.brakes
    for said, text, enabled, sends in (
        (running(), TURN_OFF, True, 1), (ready(3), TURN_OFF, True, 1), (ready(3, stage=m.BREAK), TURN_OFF, True, 1),
        (ready(3, brakes_off="Esc"), TURN_ON, True, 0), (ready(3, stage=m.FAILED), ARE_OFF, False, 1),
        (before(), TURN_OFF, False, 0), (tried(), TURN_OFF, True, 1),
    ):  # fmt: skip
        screens.hear(opened(), said)
        wide = button.width()
        screens.main.show_keys()
        card = screens.main.cards.question
        assert card.parentWidget().childAt(card.geometry().center()) in (card, *card.findChildren(QWidget)), "covered"
        screens.hear()
        assert (button.text(), button.isEnabled(), button.width()) == (text, enabled, wide), said.stage
        screens.client.off_causes.clear()
        screens.press(KEY.Key_Escape)
        assert len(screens.client.off_causes) == sends and screens.main.cards.question is None, said.stage


def test_a_second_press_just_after_the_brakes_went_off_does_not_turn_them_on(screens: Screens, monkeypatch) -> None:
    button, now = screens.main.preflight.brakes, [100.0]
    monkeypatch.setattr("time.perf_counter", lambda: now[-1])
    screens.hear(opened(), ready(3))
    QTest.mouseClick(button, LEFT)
    screens.hear(ready(3, brakes_off="the button was pressed"))
    for passed_s, sent in ((0.9, []), (1.1, [m.AllowBrakes()])):
        now.append(100.0 + passed_s)
        screens.client.sent.clear()
        QTest.mouseClick(button, LEFT)
        assert screens.client.sent == sent


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


def test_proof_of_recording_is_readable_in_the_footer_of_a_page_that_has_one(screens: Screens) -> None:
    screens.hear(opened(), running(22), pulse("run-023"))
    screens.main.show_page(ANALYSE)
    said = (
        "Recording run-023 | 18\u202f412 rows | 4.2 MB | 0.1 s ago | 22 earlier | Seed 1 | " + opened().plan_sha256[:4]
    )
    assert all(part in read(screens.main) for part in said.split(" | "))
    assert "22 recordings verified" in read(screens.hear(pulse("")))


#: the newest that the server has sent, how it ends -> what the banner says, and what it does not
DEATHS = {
    "in a trial": (running(3, notice=m.NOT_NOW[m.RUNNING], notice_bad=True), "",
                   "has stopped in the middle of trial 4 | brakes are off | it comes again.", m.NOT_NOW[m.RUNNING]),
    "in a trial, with ticks in memory": (running(3, in_memory="trial 4, 812 ticks"), "",
                                         "is lost: trial 4, 812 ticks", words.KEPT),
    "between trials": (ready(4), "", f"has stopped: the brakes are off | {words.KEPT}", "in the middle"),
    "with data in memory": (ready(4, in_memory="trial 4, 812 ticks"), "", "is lost: trial 4, 812 ticks", words.KEPT),
    "as it says itself": (ready(3), "The disk is full.", "The disk is full.", "has stopped"),
}  # fmt: skip


@pytest.mark.parametrize("case", DEATHS)
def test_the_end_of_the_server_is_said_in_red_and_stops_everything(screens: Screens, case: str) -> None:
    last, itself, says, never = DEATHS[case]
    screens.hear(opened(), last)
    if last.running is not None:
        screens.tick(movement(PLAN[3].path, "AEB", 0.4))
    seen = screens.run.workspace.view.tip
    screens.client.alive = False
    screens.hear(*([ready(3, stage=m.FAILED, notice=itself, notice_bad=True)] if itself else []))
    said = screens.run.strip.banner.toolTip()
    assert all(part in said for part in says.split(" | ")) and never not in said
    assert screens.run.strip.banner.isVisible() and not screens.main.preflight.brakes.isEnabled()
    assert screens.run.workspace.view.tip == seen != (0.0, 0.0), "the handle is drawn where it was seen last"
    screens.press(KEY.Key_Escape)
    assert len(screens.client.off_causes) == 1, "zero current can be asked for even then"
    assert all(press(screens, key) == [] for key in ("Space", "Alt+R", "Alt+S", "Alt+P", "Alt+A"))


UNDONE = "/data is gone. Bring it back. All its 812 ticks are in memory. It is tried again every 5 s"


def edit(screens: Screens) -> None:
    editor = screens.main.page(HOME).editor
    editor.open("displays")
    editor.text.appendPlainText("# mine")


def answer(screens: Screens) -> None:
    screens.participant.questions.scales["effort"].set(55)
    screens.run.questions.scales["smoothness"].set(20)
    screens.run.panel.note.setText("left-handed")
    theirs, here = screens.participant.questions.values, screens.run.questions.values
    assert theirs == here and (here["effort"], theirs["smoothness"]) == (55, 20), "they are on both screens"


#: what is said, what is done -> what closing asks, what is done so that it asks no more
AT_STAKE: dict[str, tuple[tuple, Callable, str, Callable]] = {
    "a recording": ((opened(), running()), lambda _: None, "Keep recording | Abort and close  Alt+C",
                    lambda screens: screens.hear(ready(1))),
    "ticks in memory": ((opened(), ready(3, not_written=UNDONE, in_memory="trial 4, 812 ticks")), lambda _: None,
                        "would be lost: trial 4, 812 ticks", lambda screens: screens.hear(ready(4))),
    "an edited protocol": ((opened(""), before()), edit,
                           "lost then: what was changed in the editor (Displays protocol, a copy).",
                           lambda screens: screens.main.page(HOME).editor.undo()),
    "answers and a note": ((opened(), ready(10, stage=m.QUESTIONS)), answer,
                           "lost then: the questionnaire that is answered in part and the note.",
                           lambda screens: (screens.run.panel.note.clear(), screens.hear(ready(10)))),
}  # fmt: skip


@pytest.mark.parametrize("case", AT_STAKE)
def test_closing_asks_where_something_would_be_cut_off_or_lost_and_names_it(screens: Screens, case: str) -> None:
    said, done, asks, settled = AT_STAKE[case]
    console = screens.hear(*said)
    done(screens)
    assert not console.close() and console.isVisible() and not screens.client.stopped
    assert all(part in read(console) for part in asks.split(" | "))
    console.cards.question.buttons[0].click()
    assert console.isVisible() and console.cards.question is None
    console.close()
    settled(screens)
    if case in ("a recording", "ticks in memory"):
        assert console.cards.question is None, "it is true no more"
        screens.hear(said[-1])
        console.close()
    elif console.cards.question is None:
        console.close()
    if console.isVisible():
        screens.press(KEY.Key_C, console.focusWidget(), ALT)
    assert not console.isVisible() and screens.client.stopped == "the window was closed"


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
    wait_until(lambda: screens.windows.frame() or started)
    (screens.client,) = started
    assert screens.client.setup == setup and screens.client is not old
    screens.hear(opened(""), before())
    assert screens.client.sent == [m.Open("02")]


def pictures(screens: Screens, blind: bool) -> list[tuple[QImage, QImage]]:
    """Console with every layer on and participant's window after one movement of a hand through two controllers."""
    one, found = movement(PLAN[0].path, "AEB", 0.4), []
    other = one.copy()
    other[:, tick_log.CURRENT : tick_log.CURRENT + 4] = 0.0
    other[:, tick_log.TORQUE : tick_log.TORQUE + 4] *= -0.3
    other[:, tick_log.STUCK] = 0.0
    other[:, tick_log.ENERGY_BRAKES] += 0.2 * other[:, tick_log.T]
    for rows in (one, other):
        console = screens.hear(opened(), running(1, blind=blind), running(0, blind=blind), pulse())
        for button in screens.run.workspace.layers.values():
            button.setChecked(True)
        screens.participant.show()
        settle(console)  # curves are painted piece by piece from the first tick on, both times
        for begin in range(0, len(rows), 16):
            screens.tick(rows[begin : begin + 16])
        settle(console)
        found.append((console.grab().toImage(), screens.participant.view.grab().toImage()))
    return found


def test_what_the_controller_does_is_seen_on_a_console_with_the_key_alone_and_never_by_the_participant(screens) -> None:
    for blind in (True, False):
        (console, participant), (other_console, other_participant) = pictures(screens, blind)
        assert (console == other_console) == blind and participant == other_participant
        assert screens.run.workspace.layers[REACHABLE].isVisible() != blind
