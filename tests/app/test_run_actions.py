"""What the Run page offers can be done, and what cannot be done is not offered: by button and by key alike."""

from itertools import product

import pytest
from fake_client import LONG_BREAK, PLAN, before, opened, ready, result, running
from PySide6.QtCore import Qt
from screens import Screens

from app.ipc import messages as m
from app.session_server.commands import COMMANDS
from app.window.run.actions import possible
from app.window.widgets.keys import KEYS
from app.window.widgets.parts import KeyButton
from experiments.analysis.trials_table import STATUSES
from experiments.store.journal import MARKS

ALT = Qt.KeyboardModifier.AltModifier
STATES = {
    "no session": before(),
    "card": ready(3),
    "paused": ready(3, paused=True),
    "running": running(3),
    "break": ready(3, stage=m.BREAK, card=LONG_BREAK),
    "aborted": ready(1, rows=(result(PLAN[0], "aborted"),)),
    "finished": ready(len(PLAN), stage=m.FINISHED),
    "failed": ready(3, stage=m.FAILED, notice="The loop is gone."),
}
ASKING = {"redo": m.Redo, "exclude": m.Exclude, "skip": m.Skip, "abort": m.Abort, "pause": m.Pause}


def test_whatever_is_possible_is_a_command_that_the_server_takes_then() -> None:
    stages = (*m.NOT_NOW, m.RERIG)
    for stage, status, full in product(stages, STATUSES, ("", "The disk is full")):
        snapshot = ready(1, stage=stage, rows=(result(PLAN[0], status),), not_written=full)
        for on_card in (None, snapshot.rows[0]):
            can = possible(snapshot, on_card, waiting=False)
            for offered, command in (
                (can.start, m.Start), (can.pause, m.Pause), (can.skip, m.Skip), (can.redo, m.Redo),
                (can.exclude, m.Exclude), (can.leave, m.Leave),
            ):  # fmt: skip
                rule = COMMANDS[command]
                if offered:
                    assert not rule.stages or stage in rule.stages, (stage, command)
                    assert not (rule.stored and full), (stage, command)
            for row, mark in ((can.redo, "redone"), (can.exclude, "excluded")):
                assert row is None or row.status in MARKS[mark][0], (mark, status)


@pytest.mark.parametrize("state", STATES)
def test_a_key_acts_exactly_where_its_button_can_be_pressed_and_no_button_is_dead(screens: Screens, state) -> None:
    for action in ASKING:
        screens.hear(opened() if state != "no session" else opened(""), STATES[state])
        screens.main.show_page("Run")
        key, panel = KEYS[action].keys[0], screens.run.panel
        behind = panel.behind if panel.more.isVisible() else ()  # the entries of a menu press these
        buttons = (one for one in screens.run.findChildren(KeyButton) if one.isVisible() or one in behind)
        offered = [one for one in buttons if one.key.text() == key and one.isEnabled()]
        for act in (
            lambda key=key: screens.press(getattr(Qt.Key, f"Key_{key[-1]}"), modifier=ALT),
            *(one.click for one in offered),
        ):
            screens.client.sent.clear()
            screens.run.cards.leave()
            act()
            asked = screens.run.cards.question
            acted = bool(screens.client.sent) or asked is not None
            assert acted == bool(offered), (state, action)
            screens.hear(STATES[state])  # the server's answer
        screens.run.cards.leave()


def test_a_command_is_said_on_its_button_until_the_server_has_answered_and_no_other_is_taken(screens: Screens) -> None:
    screens.hear(opened(), ready())
    panel = screens.run.panel
    assert screens.press(Qt.Key.Key_Space) == [m.Start()] and panel.start.text() == "Starting …"
    offered = [one for one in screens.run.findChildren(KeyButton) if one.isVisible() and one.isEnabled()]
    assert offered == [] and screens.press(Qt.Key.Key_Space) == []
    screens.hear(ready(notice=f"{m.DISK_WAIT}: the trial is opened."))
    assert panel.start.text() == "Starting …" and not panel.start.isEnabled()
    screens.hear(ready(notice="No.", notice_bad=True))
    assert panel.start.text() == "Start" and panel.start.isEnabled()
    screens.hear(ready(paused=True))
    assert screens.press(Qt.Key.Key_P, modifier=ALT) == [m.Pause(False)] and panel.pause.text() == "Resuming …"
    screens.hear(ready())
    assert panel.pause.text() == "Pause" and panel.start.isEnabled()
