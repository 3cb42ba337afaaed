"""What both windows say and hide in states that are easy to get wrong: start blocked, blind, paused, after a break."""

import numpy as np
import pytest
from fake_client import GREEN, LONG_BREAK, PLAN, RED, movement, opened, paper, ready, running
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel
from screens import Screens, cut_texts, settle, visible_texts

from app.ipc import messages as m
from app.window import words
from app.window.painting import theme
from app.window.painting.layers import OFF
from app.window.painting.linkage_view import REACHABLE
from app.window.painting.marks import HAND
from core import tick_log
from experiments.language import ENGLISH_WORDS

KEY = Qt.Key
NOTES = ("13:02 asked to move a little slower", "13:06 break, 2 min")


def test_nobody_is_told_that_the_next_trial_comes_while_its_start_is_blocked(screens: Screens) -> None:
    for over in (0, 12):
        promises     = {ENGLISH_WORDS[key] for key in ("next_soon", "next_space", "first_space", "start_soon")}
        screens.hear(opened(), ready(over, checks=RED))
        assert screens.run.centre.small.text() == screens.participant.view.shown.small == ENGLISH_WORDS["stopped_how"]
        screens.hear(ready(over))
        assert screens.run.centre.small.text() in promises and screens.participant.view.shown.small in promises


def test_feedback_stays_while_the_start_is_blocked(screens: Screens) -> None:
    screens.hear(opened(protocol=paper(feedback="time")), ready(3, checks=RED))
    assert screens.participant.view.shown == words.Shown("Well done", "2.4 seconds")


def test_what_the_banner_says_is_not_said_again_in_the_panel(screens: Screens) -> None:
    screens.hear(opened(), ready(12, checks=RED))
    assert screens.main.preflight.advice.isVisible() and not screens.run.panel.notice.isVisible()
    waiting = (*GREEN[:4], m.Check("Recording", m.WAITING, "waiting"))
    screens.hear(ready(12, checks=waiting))
    assert not screens.main.preflight.advice.isVisible() and "waiting" in screens.run.panel.notice.text()
    assert screens.run.panel.notice.isVisible()


def test_the_whole_plan_is_in_sight_at_1280_x_720(screens: Screens) -> None:
    for checks in (GREEN, RED):
        console = screens.hear(opened(), ready(12, checks=checks, notes=NOTES))
        settle(console)
        grid = screens.run.panel.grid
        assert not screens.run.panel._scroll.verticalScrollBar().isVisible()
        cells = list(grid.cells().values())
        assert len(cells) == len(PLAN) and all(grid.rect().contains(cell.toAlignedRect()) for cell in cells)
        assert min(cell.height() for cell in cells) > 8.0
        assert not any(a.intersects(b) for i, a in enumerate(cells) for b in cells[i + 1 :])
        assert cut_texts(console) == []


def test_a_blind_console_has_no_reachable_force_and_gets_it_back_with_the_key(screens: Screens) -> None:
    """With the brakes that are stuck it would tell the controllers apart."""
    screens.hear(opened(), running(blind=True))
    screens.tick(movement(PLAN[0].segment, "AEB", 1.0))
    workspace = screens.run.centre.workspace
    assert workspace.view.instant.reachable() is None and not workspace.buttons[REACHABLE].isVisible()
    screens.hear(running(blind=False))
    screens.tick(movement(PLAN[0].segment, "AEB", 1.1)[1000:])
    assert workspace.view.instant.reachable() is not None and workspace.buttons[REACHABLE].isVisible()


def test_after_a_break_the_participant_sees_the_path_that_comes(screens: Screens) -> None:
    screens.hear(opened(), ready(22, stage=m.BREAK, card=LONG_BREAK))
    view = screens.participant.view
    assert view.path is None and view.tip is None
    screens.hear(ready(22))
    assert view.path == opened().protocol.paths[PLAN[22].segment] and view.tip is not None


def test_energy_makes_no_claim_before_there_is_a_tick(screens: Screens) -> None:
    screens.hear(opened(), ready())
    assert "no brake added energy" not in screens.run.energy.said and "no trial yet" in screens.run.energy.said
    screens.hear(running())
    screens.tick(movement(PLAN[0].segment, "AEB", 0.5))
    assert "no brake added energy" in screens.run.energy.said and "under 1 nJ" in screens.run.energy.said


def test_a_plan_that_is_done_has_no_time_left(screens: Screens) -> None:
    screens.hear(opened(), ready(59))
    assert "min left" in screens.run.panel.left.text()
    screens.hear(ready(60, stage=m.FINISHED))
    assert "min left" not in screens.run.panel.left.text()


def test_the_line_over_the_workspace_is_whole_at_1280_x_720(screens: Screens) -> None:
    for state in ("blocked", "failed"):
        console = screens.hear(opened(), ready(12, checks=RED) if state == "blocked" else ready(12, stage=m.FAILED))
        settle(console)
        small = screens.run.centre.small
        assert small.fontMetrics().horizontalAdvance(small.text()) <= small.width()
        assert small.text() in visible_texts(console)


def test_a_hidden_trace_has_neither_curve_nor_scale(screens: Screens) -> None:
    console = screens.hear(opened(), running(blind=True))
    screens.tick(movement(PLAN[0].segment, "AEB", 1.0))
    settle(console)
    currents = screens.run.traces.currents
    before = currents.grab().toImage()
    rows = movement(PLAN[0].segment, "AEB", 1.2)[1000:]
    rows[:, tick_log.CURRENT : tick_log.CURRENT + 4] = np.array([3.0, 2.0, 1.0, 0.0])
    screens.tick(rows)
    assert currents.grab().toImage() == before


@pytest.mark.parametrize("moment", [False, True])
def test_on_the_bench_a_step_is_named_for_what_it_is_and_waits_while_it_is_done(screens: Screens, moment: bool) -> None:
    says = "A moment ..." if moment else "Hold the handle in its jig, then go on."
    rig = m.Card(f"Make {PLAN[0].configuration} ready", says, "" if moment else "Go on", device_page=True)
    screens.hear(opened(real_device=True), ready(stage=m.RERIG, card=rig))
    card = screens.run.cards.notice
    assert card is not None and card.title.text() == f"Make {PLAN[0].configuration} ready" and card.text.text() == says
    assert screens.press(KEY.Key_Space) == ([] if moment else [m.Confirm()])


def test_brakes_that_the_board_took_off_are_said_so_and_others_with_who_did(screens: Screens) -> None:
    banner = screens.hear(opened(), ready(9, brakes_off="the board: no command for 50 ms")).preflight.advice
    assert banner.text().startswith("Brakes are off: the board: no command for 50 ms.")
    screens.hear(ready(9, brakes_off="Esc on the console"))
    assert banner.text().startswith("Brakes are off: Esc on the console.")


def test_the_key_on_a_button_is_legible_whatever_the_button_looks_like(screens: Screens) -> None:
    screens.hear(opened(), ready(9))

    def hint(button) -> str:
        label = button.findChild(QLabel)
        return label.palette().color(label.foregroundRole()).name()

    panel = screens.run.panel
    assert (hint(panel.start), hint(panel.pause), hint(panel.abort)) == (theme.TEXT, theme.QUIET, theme.BRAKE_OFF)
    screens.hear(ready(9, paused=True))
    assert (hint(panel.start), hint(panel.pause)) == (theme.BRAKE_OFF, theme.TEXT)


def test_all_numbers_in_one_picture_are_of_one_tick(screens: Screens) -> None:
    screens.hear(opened(), running())
    rows = movement(PLAN[0].segment, "AEB", 1.0)
    for begin in range(0, len(rows), 16):
        screens.client.rows, screens.client.taken = rows[begin : begin + 16], True
        screens.windows.frame()
        labels, read = screens.run.centre.workspace.view.labels, screens.run.traces
        assert HAND not in labels.words or read.force.value.split()[0] in labels.words[HAND]
        for joint, doing in labels.doing.items():
            current = read.currents.value.split(joint + " ")[1].split()[0]
            assert (doing.state == OFF) == (current in ("0.00", "–"))
