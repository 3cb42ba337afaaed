"""What both windows say, hide and sound in states that are easy to get wrong: start blocked, blind, between trials."""

import io
import sys
import wave
from pathlib import Path

import numpy as np
import pytest
from fake_client import (
    GREEN,
    LONG_BREAK,
    PLAN,
    RED,
    before,
    movement,
    opened,
    paper,
    pulse,
    ready,
    result,
    running,
    ticks,
)
from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QImage, QPainter, QPicture
from PySide6.QtWidgets import QAbstractButton, QLabel
from screens import Screens, settle, visible_texts
from status_messages import LOST, ON_BENCH, WELL
from texts_on_screen import faults

from app.ipc import messages as m
from app.window.canvas.force_view import HAND
from app.window.canvas.layers import OFF
from app.window.canvas.linkage_view import REACHABLE
from app.window.canvas.path_marks import paint_way_out
from app.window.canvas.plane import Plane
from app.window.main_window import SMALLEST
from app.window.participant.tone import END_HZ, GO_HZ, NO_SOUND, RATE_HZ, player, tone
from app.window.run.plan_bar import MARKS
from app.window.run.run_page import UNMEASURED, RunPage
from app.window.widgets import theme, words
from app.window.widgets.plots import NOTHING
from app.window.widgets.preflight import told
from app.window.widgets.theme import COLOURS
from core import tick_log
from experiments.analysis.trials_table import STATUSES
from experiments.language import ENGLISH_WORDS, FOLDER, language_text
from experiments.protocol_file import Cues

KEY = Qt.Key
NOTES = ("13:02 asked to move a little slower", "13:06 break, 2 min")


def test_nobody_is_told_that_the_next_trial_comes_while_its_start_is_blocked(screens: Screens) -> None:
    for over in (0, 12):
        promises = {ENGLISH_WORDS[key] for key in ("next_soon", "next_space", "first_space", "start_soon")}
        screens.hear(opened(), ready(over, checks=RED))
        assert screens.participant.view.shown.small == ENGLISH_WORDS["stopped_how"]
        assert screens.run.workspace.view.line == f"Participant reads: {' · '.join(screens.participant.view.shown)}"
        screens.hear(ready(over))
        assert screens.run.workspace.view.line == f"Participant reads: {' · '.join(screens.participant.view.shown)}"
        assert screens.participant.view.shown.small in promises and screens.run.large.text() in (
            "Ready · next: trial 1",
            "Trial 12 done in 2.4 s",
        )


def test_what_the_banner_says_is_not_said_again_in_the_panel(screens: Screens) -> None:
    screens.hear(opened(), ready(12, checks=RED))
    assert screens.run.strip.banner.isVisible() and not screens.run.notice.isVisible()
    waiting = (*GREEN[:4], m.Check("Recording", m.WAITING, "waiting"))
    screens.hear(ready(12, checks=waiting))
    assert not screens.run.strip.banner.isVisible() and "waiting" in screens.run.notice.text()
    assert screens.run.notice.isVisible()


@pytest.mark.parametrize("size", [SMALLEST, (1280, 720), (1920, 1080)])
def test_what_is_wrong_takes_the_room_of_the_strip(screens: Screens, size) -> None:
    folder = f"The folder {'/home/operator/laboratory' * 8} cannot be written to. "
    console, banner = screens.main, screens.run.strip.banner
    console.resize(*size)
    screens.hear(opened(), ready(3), pulse())
    settle(console)
    before, wide = (
        [widget.geometry() for widget in (console._stack, screens.run.workspace)],
        screens.run.strip.plan.width(),
    )
    many = tuple(check._replace(state=m.BAD, text=folder) for check in GREEN)
    for snapshot in (ready(3, checks=many), ready(3, stage=m.FAILED, notice=5 * folder, notice_bad=True)):
        screens.hear(snapshot)
        settle(console)
        assert banner.text().endswith("…") and 4 < banner.toolTip().count("cannot be written to") < 6
        assert banner.width() == wide and banner.isVisible()
        lines = banner.words.fontMetrics().boundingRect(banner.words.rect(), Qt.TextFlag.TextWordWrap, banner.text())
        assert lines.height() <= banner.words.height(), "both lines are seen whole"
    assert before == [widget.geometry() for widget in (console._stack, screens.run.workspace)], "nothing moves"


def test_a_failed_session_is_started_again_and_resumed_by_a_button(screens: Screens) -> None:
    asked = []
    screens.run.setup_asked.connect(lambda *about: asked.append(about))
    screens.hear(opened(), ready(9, stage=m.FAILED, notice="The loop cannot be started.", in_memory="run 4"))
    assert [button.text() for button in screens.run.cards.notice.buttons] == ["Open folder"], "run 4 would be lost"
    screens.hear(ready(9, stage=m.FAILED, notice="The loop cannot be started.", notice_bad=True))
    assert screens.run.large.text().startswith("Stopped") and "Please wait" in screens.run.workspace.view.line
    screens.press(KEY.Key_Space)
    assert asked == [], "it starts trials, nothing else"
    screens.main.blockSignals(True)  # no other server is started
    screens.run.cards.notice.buttons[0].click()
    screens.main.blockSignals(False)
    assert asked == [(None, m.Open("01", resume=True))]


@pytest.mark.parametrize("size", [SMALLEST, (1280, 720), (1920, 1080)])
def test_the_whole_plan_is_in_sight(screens: Screens, size) -> None:
    screens.main.resize(*size)
    console = screens.hear(opened(), ready(12, notes=NOTES))
    settle(console)
    plan = screens.run.strip.plan
    cells = list(plan.cells.values())
    assert len(cells) == len(PLAN) and all(QRectF(plan.rect()).contains(cell) for cell in cells)
    assert min(cell.height() for cell in cells) > 8.0 and min(cell.width() for cell in cells) > 6.0
    assert not any(a.intersects(b) for i, a in enumerate(cells) for b in cells[i + 1 :])


def test_a_card_that_has_room_shows_all_of_its_parts(screens: Screens) -> None:
    screens.hear(opened(), running())
    screens.tick(movement(PLAN[0].segment, "AEB", 1.5))
    screens.hear(ready(1))
    settle(screens.main)
    card = screens.run.card
    assert card.legend.isVisible() and all(part.isVisible() for part in card.measures)


def test_after_a_break_the_participant_sees_the_path_that_comes(screens: Screens) -> None:
    screens.hear(opened(), ready(22, stage=m.BREAK, card=LONG_BREAK))
    view = screens.participant.view
    assert view.path is None and view.tip is None
    screens.hear(ready(22))
    assert view.path == opened().protocol.paths[PLAN[22].segment] and view.tip is not None


def test_the_device_that_comes_has_no_numbers_of_the_trial_before_and_no_force_that_nobody_measures(screens) -> None:
    screens.hear(opened(), running(29))
    screens.tick(movement(PLAN[29].segment, "AEB", 1.0))
    view = screens.run.workspace.view
    assert "N" in view.force_texts["hand"]
    screens.hear(ready(30, stage=m.RERIG))
    assert PLAN[29].configuration != PLAN[30].configuration == view.instant.device.name
    assert view.title == "" and set(view.force_texts.values()) == {"–"}


def test_between_trials_the_curves_stay_and_no_value_beside_them_is_one_of_now(screens: Screens) -> None:
    screens.hear(opened(), running())
    screens.tick(movement(PLAN[0].segment, "AEB", 1.0))
    screens.hear(ready(1))
    force, speed = screens.run.live.force, screens.run.strip.speed
    assert (force.figures.text(), speed.figures.text(), len(force.t)) == ("– N", "– m/s", 1000)


def test_the_sign_says_that_a_trial_is_recorded_as_soon_as_the_trial_is_shown(screens: Screens) -> None:
    screens.hear(opened(), ready(), pulse(""))
    assert screens.run.recording.text() == "Not recording"
    screens.hear(pulse(), running())
    assert screens.run.recording.text() == "● Recording  0:00"
    screens.hear(pulse(""), ready(1))
    assert screens.run.recording.text() == "Not recording"


def test_nothing_of_a_trial_stays_on_run_after_its_session_is_closed(screens: Screens) -> None:
    screens.hear(opened(), running())
    screens.tick(movement(PLAN[0].segment, "AEB", 1.0))
    view = screens.run.workspace.view
    assert view.trail and len(screens.run.strip.timing.t)
    screens.hear(ready(1), opened(""), before())
    assert not view.trail and not len(view.outline) and view.tip is None
    live, strip = screens.run.live, screens.run.strip
    assert not any(len(trace.t) for trace in (live.error, live.force, strip.speed, strip.currents, strip.timing))
    assert not screens.run.strip.ledger.began


def test_energy_makes_no_claim_before_there_is_a_tick(screens: Screens) -> None:
    screens.hear(opened(), ready())
    assert (
        "no brake added energy" not in screens.run.strip.energy.text()
        and "no trial yet" in screens.run.strip.energy.text()
    )
    screens.hear(running())
    screens.tick(movement(PLAN[0].segment, "AEB", 0.5))
    assert (
        "no brake added energy" in screens.run.strip.energy.text() and "under 1 nJ" in screens.run.strip.energy.text()
    )


@pytest.mark.parametrize("moment", [False, True])
def test_on_the_bench_a_step_is_named_for_what_it_is_and_waits_while_it_is_done(screens: Screens, moment: bool) -> None:
    says = "A moment ..." if moment else "Hold the handle in its jig, then go on."
    rig = m.StepCard(f"Make {PLAN[0].configuration} ready", says, "" if moment else "Go on", device_page=True)
    screens.hear(opened(real_device=True), ready(stage=m.RERIG, card=rig))
    card = screens.run.cards.notice
    assert card is not None and card.title.text() == f"Make {PLAN[0].configuration} ready" and card.text.text() == says
    assert screens.press(KEY.Key_Space) == ([] if moment else [m.Confirm()])


def test_a_board_that_went_while_brakes_are_off_comes_before_them_and_the_place_is_not_shown_as_measured(screens):
    screens.hear(opened(**ON_BENCH), ready(9, brakes_off="Esc", checks=LOST))
    banner, line = screens.run.strip.banner.toolTip(), screens.run.workspace.view
    assert banner.startswith("Device: not connected. No sample for 200 ms.") and "llow" not in banner
    assert not screens.main.preflight.brakes.isEnabled(), "pressing it would help nothing yet"
    assert screens.press(KEY.Key_B, modifier=Qt.KeyboardModifier.ControlModifier) == []
    assert line.line == UNMEASURED and screens.run.large.text().startswith("Not ready")
    off = m.Check("Device", m.BAD, m.BRAKES_OFF, "Brakes off. Esc.")
    assert told(off) == "Brakes off. Esc." and told(RED[3]) == f"{RED[3].text}. {RED[3].advice}"
    screens.hear(ready(9, brakes_off="Esc", checks=(off, *WELL[1:])))
    assert screens.run.strip.banner.toolTip().count("Esc.") == 1 and line.line != UNMEASURED
    assert screens.main.preflight.brakes.isEnabled() and screens.run.large.text().startswith("Brakes off")


def test_the_key_on_a_button_is_legible_whatever_the_button_looks_like(screens: Screens) -> None:
    screens.hear(opened(), ready(9))

    def hint(button) -> str:
        label = button.findChild(QLabel)
        return label.palette().color(label.foregroundRole()).name()

    panel = screens.run.panel
    assert (hint(panel.start), hint(panel.pause), hint(panel.abort)) == (COLOURS.text, COLOURS.quiet, COLOURS.brake_off)
    screens.hear(ready(9, paused=True))
    assert (hint(panel.start), hint(panel.pause)) == (COLOURS.brake_off, COLOURS.text)


def test_all_numbers_in_one_picture_are_of_one_tick(screens: Screens) -> None:
    screens.hear(opened(), running())
    rows = movement(PLAN[0].segment, "AEB", 1.0)
    for begin in range(0, len(rows), 16):
        screens.client.rows, screens.client.taken = rows[begin : begin + 16], True
        screens.windows.frame()
        view, read = screens.run.workspace.view, screens.run.strip
        assert screens.run.live.force.figures.text().split()[0] in (NOTHING, view.force_texts[HAND].split()[0])
        for joint, doing in view.doing.items():
            current = read.currents.figures.text().split(joint + " ")[1].split()[0]
            assert (doing.state == OFF) == (current in ("0.00", "–"))


def pictures(screens: Screens, blind: bool) -> list[tuple[QImage, QImage]]:
    """Console with every layer on and participant's window after one movement of a hand through two controllers."""
    one, found = movement(PLAN[0].segment, "AEB", 0.6), []
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


@pytest.mark.parametrize("blind", [True, False])
def test_what_the_controller_does_is_seen_on_a_console_with_the_key_alone_and_never_by_the_participant(screens, blind):
    (console, participant), (other_console, other_participant) = pictures(screens, blind)
    assert (console == other_console) == blind and participant == other_participant
    assert screens.run.workspace.layers[REACHABLE].isVisible() != blind


def test_every_status_has_its_colour_and_all_but_done_a_mark() -> None:
    assert set(theme.STATUS) == set(STATUSES) and set(MARKS) == set(STATUSES) - {"done"}
    assert len(set(MARKS.values())) == len(MARKS)


def test_a_trial_that_was_cut_short_is_marked_counts_as_open_and_comes_next(screens: Screens) -> None:
    rows = (result(PLAN[0]), result(PLAN[1], "stopped"))
    again = PLAN[1]._replace(run=61)
    console = screens.hear(opened(), ready(2, rows=rows, coming=again, notice="Run 2: the board. It comes again."))
    grid = screens.run.strip.plan
    assert grid.statuses[2] == "stopped" and grid.marked == 2 and "1 of 60 done" in screens.run.strip.progress.text()
    assert screens.run.panel.start.isEnabled() and "comes again" in " ".join(visible_texts(console))
    assert screens.run.workspace.view.line.startswith("Participant reads: Stopped")


def test_the_end_of_the_plan_says_how_many_trials_have_no_result(screens: Screens) -> None:
    rows = [*map(result, PLAN)]
    screens.hear(opened(), ready(59))
    assert "min left" in screens.run.strip.progress.text()
    console = screens.hear(opened(), m.Snapshot(m.FINISHED, tuple(rows)))
    assert "no result" not in " ".join(visible_texts(console)) and "min left" not in screens.run.strip.progress.text()
    assert f"{len(PLAN)} runs are recorded and verified" in " ".join(visible_texts(console))
    screens.hear(opened(), ready(1))
    rows[3], rows[7] = result(PLAN[3], "aborted"), result(PLAN[7], "skipped")
    rows += [result(PLAN[7]._replace(run=61), "done")]  # it was done after all
    console = screens.hear(opened(), m.Snapshot(m.FINISHED, tuple(rows)))
    assert f"1 of {len(PLAN)} trials has no result" in " ".join(visible_texts(console))


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
    assert words.between(ready(0), opened(), own_start=True).small == ENGLISH_WORDS["first_space"]
    assert words.between(ready(5, newest=None), opened(), own_start=True).small == ENGLISH_WORDS["next_space"]
    assert words.between(ready(6), opened()).large == ENGLISH_WORDS["done"]


def test_after_practice_there_is_how_it_ended_and_no_second_welcome(screens: Screens) -> None:
    for status in ("done", "stopped", "timeout"):
        practised = result(PLAN[0]._replace(block=0), status)
        screens.hear(opened(), running(0, running=PLAN[0]._replace(block=0)), ready(0, newest=practised))
        assert ENGLISH_WORDS[status] in screens.run.workspace.view.line and not screens.run.card_shown


def test_the_participant_reads_the_language_of_the_protocol(screens: Screens) -> None:
    protocol = paper(language="de", language_text=language_text("de", FOLDER))
    german = protocol.sentences
    screens.hear(opened(protocol=protocol), ready(1))
    assert screens.participant.view.shown.large == "Gut gemacht" and "Gut gemacht" in screens.run.workspace.view.line
    screens.hear(ready(1, stage=m.QUESTIONS))
    assert german["effort"] in [label.text() for label in screens.participant.questions.findChildren(QLabel)]


def test_feedback_and_cue_are_said_whatever_comes_after_the_trial_or_keeps_the_next_from_starting(screens) -> None:
    for following in (
        {}, {"paused": True}, {"checks": RED}, {"stage": m.BREAK, "card": LONG_BREAK}, {"stage": m.RERIG},
        {"stage": m.FINISHED},
    ):  # fmt: skip
        screens.hear(GIVEN, running(2), ready(3, **following))
        for said in (screens.participant.view.shown.small, screens.run.workspace.view.line):
            assert ERROR in said and CUE in said, following
        screens.hear(opened(), ready(3, **following))
        assert ERROR not in screens.participant.view.shown.small, following
    said = words.between(ready(3), GIVEN, own_start=True).small  # who has the space bar is told of it beside them
    assert ERROR in said and CUE in said and ENGLISH_WORDS["next_space"] in said


def test_a_step_says_to_the_participant_what_its_card_has_for_them(screens: Screens) -> None:
    screens.hear(opened(), ready(3, stage="a text", card=m.StepCard("Text", "", participant="Think of a line")))
    assert screens.participant.view.shown.large == "Think of a line" == screens.run.workspace.view.line[-15:]


def test_feedback_is_on_the_page_of_questions_that_covers_everything_else(screens: Screens) -> None:
    console = screens.hear(GIVEN, running(2), ready(3, stage=m.QUESTIONS))
    for page in (screens.run.questions, screens.participant.questions):
        assert any(ERROR in label.text() for label in page.findChildren(QLabel))
    settle(console)
    assert any(ERROR in text for text in visible_texts(console)) and faults(console) == []
    screens.hear(opened(), ready(3, stage=m.QUESTIONS))
    assert not any(ERROR in text for text in visible_texts(console))


@pytest.mark.parametrize("frequency", [GO_HZ, END_HZ])
def test_a_tone_has_its_frequency_and_no_click_at_its_ends(frequency: float) -> None:
    with wave.open(io.BytesIO(tone(frequency))) as file:
        assert file.getframerate() == RATE_HZ and file.getnchannels() == 1
        samples = np.frombuffer(file.readframes(file.getnframes()), "<i2").astype(float)
    spectrum = np.abs(np.fft.rfft(samples))
    assert np.argmax(spectrum) * RATE_HZ / len(samples) == pytest.approx(frequency, abs=RATE_HZ / len(samples))
    assert abs(samples[[0, -1]]).max() < 0.02 * abs(samples).max()


@pytest.mark.parametrize("seen", [True, False])
@pytest.mark.parametrize("on", [True, False])
def test_tones_come_at_go_and_at_the_end_once_each_and_only_where_the_protocol_has_them(screens, monkeypatch, on, seen):
    played: list[str] = []
    monkeypatch.setattr(screens.participant.tones, "play", played.append)
    screens.hear(opened(protocol=paper(tones=on)), running())
    screens.participant.setVisible(seen)
    for phase in (tick_log.APPROACH, tick_log.HOLD, tick_log.MOVE, tick_log.MOVE, tick_log.END, tick_log.END):
        screens.tick(ticks(phase))
    assert played == (["go", "end"] if on else [])


@pytest.mark.skipif(sys.platform == "win32", reason="Windows plays itself")
def test_a_player_is_one_that_reaches_a_sound_device(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    for program, says, found in (
        ("paplay", "", None),
        ("pactl", ">&2", None),
        ("aplay", ">&2", None),
        ("aplay", "", "aplay"),
    ):
        (tmp_path / program).write_text(f"#!/bin/sh\necho a device {says}\n")
        (tmp_path / program).chmod(0o755)
        player.cache_clear()
        assert player() == (found and str(tmp_path / found)), (program, says)
    player.cache_clear()


def test_tones_that_cannot_be_heard_are_named_to_the_experimenter(screens: Screens, monkeypatch) -> None:
    monkeypatch.setattr("app.window.run.run_page.player", lambda: None)
    screens.hear(opened(protocol=paper(tones=True)), ready(0))
    assert screens.run.notice.text() == NO_SOUND
    for tones, over in ((False, 0), (True, 1)):  # once, before the first trial
        screens.hear(opened(protocol=paper(tones=tones)), ready(over))
        assert not screens.run.notice.isVisible()


def test_the_arrow_to_a_handle_out_of_sight_is_seen_whole_in_a_corner_too(screens: Screens) -> None:
    view, arrows = Plane(QRectF(-0.1, 0.3, 0.2, 0.2), follows_mouse=False), []
    view.resize(400, 300)
    for tip in ((0.9, -0.9), (-0.9, 0.9), (0.9, 0.4), (0.0, -0.9)):
        view.show_handle(tip)
        picture = QPicture()
        painter = QPainter(picture)
        paint_way_out(painter, QRectF(view.rect()), view.to_screen(tip))
        painter.end()
        arrows.append(picture.boundingRect())
    assert all(view.rect().contains(arrow) for arrow in arrows), arrows


def test_before_the_session_server_has_said_anything_run_says_so_and_nothing_can_be_pressed(qtbot) -> None:
    page = RunPage(lambda command: None)
    qtbot.addWidget(page)
    page.show()
    seen = [button for button in page.panel.findChildren(QAbstractButton) if button.isVisible()]
    assert seen and not any(button.isEnabled() for button in seen)
    assert (page.large.text(), page.small.text()) == words.PREPARING
