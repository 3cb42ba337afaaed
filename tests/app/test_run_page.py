"""The Run page and the window around it: what they show and offer in each state of a session, and what a key sends."""

import pytest
from fake_client import (
    GREEN,
    LONG_BREAK,
    PLAN,
    PRESETS,
    RED,
    before,
    movement,
    opened,
    paper,
    pulse,
    ready,
    result,
    ticks,
)
from fake_client import running as runs
from page_table import Row, check, press, read
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton
from screens import Screens, settle
from sessions import session_of
from status_messages import LOST, ON_BENCH, WELL
from texts_on_screen import faults

from app.ipc import messages as m
from app.window.canvas.layers import OFF
from app.window.main_window import SMALLEST
from app.window.run.plan_bar import MARKS
from app.window.run.run_page import ENDED, UNMEASURED, RunPage
from app.window.run.session_cards import ABORT, REDO
from app.window.widgets import theme, words
from app.window.widgets.page import HOME, RUN
from core import tick_log
from experiments.analysis.trials_table import STATUSES
from experiments.language import ENGLISH_WORDS, FOLDER, language_text
from experiments.protocol_file import Cues

CTRL, ALT = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.AltModifier
PROMISES = " | ".join(ENGLISH_WORDS[key] for key in ("next_space", "first_space", "start_soon"))
SHORT_DISK = m.Check("Disk", m.BAD, "12 MB free", "Free some space.")
LATE = m.Check("Loop", m.CAUTION, "12 ticks missed", "Close other programs.")
OFF_BY_BOARD = m.Check("Device", m.BAD, m.BRAKES_OFF, "Brakes off. Esc.")
UNDONE = "/data is gone. Bring it back. All its 812 ticks are in memory. It is tried again every 5 s"
STUCK = (*GREEN[:4], m.Check("Recording", m.BAD, "incomplete", f"{UNDONE}."))
RIG = m.StepCard("Make three-brake ready", "Hold the handle in its jig, then go on.", device_page=True)
SECOND = PLAN[1]._replace(run=61)
CUES = Cues(too_fast_s=3.0, too_slow_s=6.0)  # the trials of the fake client take 2.4 s
GIVEN = opened(protocol=paper(feedback="error", cues=CUES))
FED_BACK = f"mm from the line on average | {ENGLISH_WORDS['slower']}"
GERMAN = opened(protocol=paper(language="de", language_text=language_text("de", FOLDER)))
ON_CARD = "More | Repeat | Exclude"
NOTHING_SENT = {"Space": [], "Alt+R": [], "Alt+S": [], "Alt+P": [], "Alt+A": []}


def with_check(check: m.Check, place: int) -> tuple[m.Check, ...]:
    return (*GREEN[:place], check, *GREEN[place + 1 :])


def after(*statuses: str, **changes) -> m.Snapshot:
    """Ready after as many trials of the plan, which ended so."""
    return ready(len(statuses), rows=tuple(map(result, PLAN, statuses)), **changes)


STATES = {
    # before and between trials
    "no session": Row((opened(""), before()), "Ready | No session is open", offers="", sends=NOTHING_SENT),
    "first": Row(
        (opened(), ready()), "Ready | next: trial 1 | Participant reads: Welcome · We start in a moment",
        offers="Start | Pause | Skip next trial | Close session", sends={"Space": [m.Start()]},
    ),
    "resumed": Row((opened(), ready(5, newest=None)), "Participant reads: Welcome back", "Thank you"),
    "paused": Row(
        (opened(), ready(paused=True)), "Paused | next: trial 1 | Resume | Participant reads: Take a break",
        sends={"Space": [], "Alt+P": [m.Pause(False)]},
    ),
    "notes": Row((opened(), ready(notes=("13:02 slower",))), "13:02 slower"),
    "repeated by itself": Row(
        (opened(), after("done", "stopped", coming=SECOND, notice="Trial 2 stopped. It comes again.")),
        "next: trial 2, second try | 59 of 60 trials to go | It comes again | Participant reads: Stopped",
        sends={"Space": [m.Start()]},
    ),
    # what keeps a trial from starting, or does not
    "red": Row(
        (opened(), ready(checks=with_check(SHORT_DISK, 3))), "Not ready | Disk: 12 MB free. Free some space.", PROMISES,
        sends={"Space": []},
    ),
    "amber": Row(
        (opened(), ready(checks=with_check(LATE, 2))), "Ready | 12 ticks missed. Close other programs.",
        sends={"Space": [m.Start()]},
    ),
    "brakes off": Row(
        (opened(), ready(brakes_off="Esc was pressed")),
        "Brakes off | Esc was pressed. Ctrl+B turns the brakes on. | Turn brakes on  Ctrl+B",
        sends={"Space": [], "Ctrl+B": [m.AllowBrakes()]},
    ),
    "stopping": Row(
        (opened(), runs(3, brakes_off="Esc was pressed")), "Stopping … | three-brake", "Trial 4 of 60", offers="",
        sends={"Alt+A": [], "Alt+P": []},
    ),
    "lost and off": Row(
        (opened(**ON_BENCH), ready(9, brakes_off="Esc", checks=LOST)),
        f"Not ready | Device: not connected. No sample for 200 ms. | {UNMEASURED}", sends={"Ctrl+B": []},
    ),
    "off by the board": Row(
        (opened(**ON_BENCH), ready(9, brakes_off="Esc", checks=(OFF_BY_BOARD, *WELL[1:]))),
        "Brakes off | Esc. Ctrl+B turns the brakes on.",
        UNMEASURED, sends={"Ctrl+B": [m.AllowBrakes()]},
    ),
    "in memory": Row(
        (opened(), ready(3, not_written=UNDONE, in_memory="trial 4", checks=STUCK, notice=f"{UNDONE}.",
                         notice_bad=True)),
        "Lost if this program ends: trial 4. | All its 812 ticks are in memory", sends={"Space": []},
    ),
    # a trial
    "running": Row(
        (opened(), runs(23)), "Trial 24 of 60 | path | Path error | Tip force", offers="Abort trial | "
        "Pause after this trial", sends={"Space": []},
    ),
    "recorded": Row((opened(), pulse(), runs()), "● Recording", "Not recording"),
    "second try": Row(
        (opened(), runs(2, running=SECOND, rows=(result(PLAN[0]), result(PLAN[1], "redone")))),
        "Trial 2 of 60, second try | three-brake", sends={"Space": []},
    ),
    "practice": Row(
        (opened(), runs(0, running=PLAN[0]._replace(block=0), practice=True)), "Practice | path", "Not recording",
        sends={"Space": []},
    ),
    # the card
    "card": Row(
        (opened(), runs(3), ready(4)), "Trial 4 done in 2.4 s | three-brake | Keep, start trial 5",
        offers=f"{ON_CARD} | Keep, start trial 5", sends={"Space": [m.Start()]},
    ),
    "card, paused": Row((opened(), runs(1), ready(2, paused=True)), "Keep", offers=f"{ON_CARD} | Keep",
                        sends={"Space": []}),
    "card, in a break": Row((opened(), runs(3), ready(4, stage=m.BREAK, card=LONG_BREAK)), "Break · 1:00 | Path error",
                            offers="More | Keep | Repeat | Exclude"),
    "practised": Row(
        (opened(), runs(0, running=PLAN[0]._replace(block=0)),
         ready(0, newest=result(PLAN[0]._replace(block=0), "timeout"))),
        "Participant reads: Time is up", "Keep | Welcome",
    ),
    # steps
    "re-rig": Row(
        (opened(), ready(30, stage=m.RERIG)), "Not ready | next: trial 31 | Mount the four-brake",
        sends={"Space": [m.Confirm()]},
    ),
    "on the bench": Row(
        (opened(real_device=True), ready(stage=m.RERIG, card=RIG)),
        "Make three-brake ready | Hold the handle in its jig | Device page  F3", sends={"Space": [m.Confirm()]},
    ),
    "break": Row((opened(), ready(12, stage=m.BREAK, card=LONG_BREAK)), "Break · 1:00", sends={"Space": []}),
    "questions": Row((opened(), ready(10, stage=m.QUESTIONS)), ENGLISH_WORDS["effort"], "Trial 11"),
    # the end
    "finished": Row(
        (opened(), ready(60, stage=m.FINISHED)), "Finished | Participant 01 | Session complete | Results  F2 | "
        f"{len(PLAN)} recordings are kept and verified", "min left | no result | Show the controllers",
        sends={"Space": [], "Alt+S": []},
    ),
    "finished, on a card": Row((opened(), runs(3), ready(60, stage=m.FINISHED)), "Path error | Repeat …", "Keep"),
    "finished, without a result": Row(
        (opened(), m.Snapshot(m.FINISHED, (*map(result, PLAN[:59]), result(PLAN[59], "aborted")))),
        "Trial 60 has no result: aborted. | All 60 trials are over · 1 without a result",
    ),
    "failed": Row(
        (opened(), ready(9, stage=m.FAILED, notice="The disk is full.", notice_bad=True)),
        "Stopped | The disk is full. | Brakes off | Participant reads: Please wait | Start again",
        sends=NOTHING_SENT,
    ),
    "failed with data in memory": Row(
        (opened(), ready(9, stage=m.FAILED, notice="No.", in_memory="trial 4")), "Open folder", "Start again",
    ),
    # what the participant is given back, whatever follows
    **{
        f"given back, {name}": Row((GIVEN, runs(2), ready(3, **following)), FED_BACK)
        for name, following in {
            "red": {"checks": RED}, "break": {"stage": m.BREAK, "card": LONG_BREAK}, "finished": {"stage": m.FINISHED},
        }.items()
    },
    "not given back": Row((opened(), runs(2), ready(3)), never=FED_BACK),
    "in German": Row((GERMAN, ready(1)), "Participant reads: Danke"),
}  # fmt: skip


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The last of these is the time, s."""
    times = [100.0]
    monkeypatch.setattr("time.perf_counter", lambda: times[-1])
    return times


@pytest.mark.parametrize("state", STATES)
def test_what_can_be_read_and_done_in_each_state_of_a_session(screens: Screens, clock: list[float], state: str) -> None:
    screens.main.resize(*SMALLEST)
    check(screens, STATES[state], lambda: clock.append(101.0))
    assert faults(screens.main) == []


#: rows of the session, the trial that comes -> statuses in the plan's bar, what is marked, how far it is
PLANS = {
    "each status": (runs(5, rows=tuple(map(result, PLAN[:5], ("done", "timeout", "aborted", "redone", "recovered")))),
                    ["done", "timeout", "aborted", "redone", "recovered"], 6, "57 of 60 trials to go · 1 without a"),
    "repeated": (ready(rows=(*map(result, PLAN[:3]), result(PLAN[3], "redone"), result(PLAN[3]._replace(run=61))),
                       coming=PLAN[4]), ["done"] * 4, 5, "56 of 60 trials"),
    "cut short": (after("done", "stopped", coming=SECOND), ["done", "stopped"], 2, "59 of 60 trials to go"),
}  # fmt: skip


@pytest.mark.parametrize("case", PLANS)
def test_the_plan_marks_each_trial_and_counts_them(screens: Screens, case: str) -> None:
    said, statuses, marked, progress = PLANS[case]
    screens.hear(opened(), said)
    plan = screens.run.strip.plan
    assert [plan.statuses[run] for run in range(1, len(statuses) + 1)] == statuses == [*plan.statuses.values()]
    assert plan.marked == marked and screens.run.strip.progress.text().startswith(progress)


def test_every_status_has_its_colour_and_all_but_done_a_mark_and_a_line_for_the_participant() -> None:
    assert set(theme.STATUS) == set(STATUSES) and set(MARKS) == set(STATUSES) - {"done"}
    assert len(set(MARKS.values())) == len(MARKS)
    for status in STATUSES:
        large = words.between(ready(1, rows=(result(PLAN[0], status),)), opened()).large
        assert large and (large == ENGLISH_WORDS["done"]) == (status == "done")


#: what is said, the key that asks -> words of the question, the answer (a key, or one's own words), what is sent
QUESTIONS = {
    "repeat": (ready(5), "Alt+R", "Repeat trial 5?", "Alt+2", m.Redo(5, REDO.reasons[1])),
    "skip": (ready(5), "Alt+S", "Skip trial 6?", "3 spare parts are missing, as p. 2 says",
             m.Skip("3 spare parts are missing, as p. 2 says")),
    "abort": (runs(), "Alt+A", "Abort this trial?", "Alt+1", m.Abort(ABORT.reasons[0], "now")),
}  # fmt: skip


@pytest.mark.parametrize("case", QUESTIONS)
def test_a_question_names_its_trial_and_takes_a_reason_and_never_none(screens: Screens, case: str) -> None:
    said, key, asks, answer, command = QUESTIONS[case]
    screens.hear(opened(), said)
    assert press(screens, key) == [] and asks in read(screens.main)
    field = screens.run.cards.question.own
    assert screens.press(Qt.Key.Key_Return, field) == []
    if answer.startswith("Alt+"):
        QTest.keyClicks(field, "half a rea")
        assert screens.press(Qt.Key(Qt.Key.Key_0 + int(answer[-1])), field, ALT) == [command]
    else:
        QTest.keyClicks(field, answer)
        assert screens.press(Qt.Key.Key_Return, field) == [command]
    assert screens.run.cards.question is None


@pytest.mark.parametrize("written", ["", "he sneezed"])
@pytest.mark.parametrize("stage", [m.READY, m.QUESTIONS])
def test_an_abort_question_goes_when_its_trial_has_ended_and_what_was_written_is_not_lost(screens, written, stage):
    screens.hear(opened(), runs(3))
    press(screens, "Alt+A")
    QTest.keyClicks(screens.run.cards.question.own, written)
    screens.hear(ready(4, rows=(*ready(3).rows, result(PLAN[3], "timeout")), stage=stage))
    question, note = screens.run.cards.question, screens.run.panel.note
    if written and stage == m.READY:
        assert ENDED in read(screens.main) and question.own.text() == written
        assert screens.press(Qt.Key.Key_Return, question.own) == [m.Redo(PLAN[3].run, written)]
    else:
        assert question is None and note.text() == written
        note.clear()


def test_a_session_is_closed_between_trials_and_what_was_asked_of_it_goes_with_it(screens: Screens) -> None:
    screens.hear(opened(), ready(3))
    screens.run.panel.note.setText("not sent")
    QTest.mouseClick(screens.run.panel.leave, Qt.MouseButton.LeftButton)
    asked = read(screens.main)
    assert "What is recorded stays" in asked and "lost then: the note." in asked
    QTest.keyClick(screens.run.cards.question.buttons[0], Qt.Key.Key_Return)
    assert screens.client.sent[-1] == m.Leave()
    screens.hear(opened(""), before())
    assert screens.run.cards.question is None and screens.run.panel.note.text() == "", "another participant comes next"


def test_the_end_of_the_plan_leads_to_the_next_participant_and_a_blind_session_is_opened_by_somebody_with_a_name(
    screens: Screens,
) -> None:
    screens.hear(opened(), ready(60, stage=m.FINISHED))
    screens.run.panel.note.setText("a last no")
    sent = len(screens.client.sent)
    screens.run.cards.notice.buttons[1].click()
    assert "Not saved" in read(screens.main) and len(screens.client.sent) == sent
    screens.run.cards.leave()
    screens.run.panel.note.clear()
    screens.run.cards.notice.buttons[1].click()
    assert screens.client.sent[sent:] == [m.Leave()]
    screens.hear(opened(), ready(60, stage=m.FINISHED, blind=True))
    QTest.mouseClick(screens.run.cards.notice.buttons[1], Qt.MouseButton.LeftButton)
    question = screens.run.cards.question
    assert screens.press(Qt.Key.Key_Return, question.own) == []
    QTest.keyClicks(question.own, "R. Book")
    assert screens.press(Qt.Key.Key_Return, question.own) == [m.Unblind("R. Book")]


def test_space_right_after_a_trial_may_be_meant_for_it_and_a_break_cannot_be_ended_before_its_time(screens, clock):
    screens.hear(opened(), runs(3))
    screens.hear(ready(4))
    clock.append(100.4)
    assert press(screens, "Space") == []
    screens.hear(ready(12, stage=m.BREAK, card=LONG_BREAK))
    for passed_s, says, sent in ((30.0, "Break · 0:30", []), (30.1, "The break is over", [m.Confirm()])):
        clock.append(clock[-1] + passed_s)
        screens.hear()
        assert says in read(screens.main) and press(screens, "Space") == sent


def test_the_card_judges_the_whole_trial_also_where_another_page_was_at_the_front_meanwhile(screens: Screens) -> None:
    rows = movement(PLAN[0].path, "AEB", 1.5)
    rows[200, tick_log.LATENESS_US] = 2.0 * tick_log.MISSED_US
    rows[0, (tick_log.PHASE, tick_log.LATENESS_US)] = tick_log.APPROACH, 1e6  # of no consequence
    screens.hear(opened(), runs(0))
    screens.main.show_page(HOME)
    screens.tick(rows[:500])
    screens.main.show_page(RUN)
    screens.tick(rows[500:])
    screens.hear(ready(1))
    settle(screens.main)
    card = screens.run.card
    strip = screens.run.strip
    assert card.flags.text() == strip.late.words == "1 tick missed of 1\u202f499, up to 2 ms late: usable"
    assert card.legend.isVisible() and all(part.isVisible() for part in card.measures), "it has room for all"


def click_trial(screens: Screens, run: int) -> None:
    settle(screens.main)
    plan = screens.run.strip.plan
    QTest.mouseClick(plan, Qt.MouseButton.LeftButton, pos=plan.cells[run].center().toPoint())


def test_a_trial_is_called_usable_only_where_its_ticks_were_looked_at_and_it_counts(screens: Screens) -> None:
    screens.hear(opened(), ready(1))
    card, rows = screens.run.card, ticks(tick_log.MOVE, 16)
    for status, given, said in (
        ("done", rows, "Usable: nothing"), ("excluded", rows, "Nothing was late"), ("done", rows[:0], "is not known"),
        ("done", None, "is not known"),
    ):  # fmt: skip
        card.show_row(result(PLAN[0], status), [], given, opened(), ready(1))
        assert said in card.flags.text() and ("Usable" in card.flags.text()) == said.startswith("Usable")


def test_a_cell_of_the_plan_opens_the_card_of_its_trial_with_its_own_flags_and_space_closes_it(
    qtbot, screens: Screens, tmp_path
) -> None:
    with session_of(tmp_path, 2) as session:
        rows, folder = tuple(session.rows), str(session.folder)
    screens.hear(opened(folder=folder), ready(1, rows=rows[:1]), runs())
    late = movement(PLAN[1].path, "AEB", 1.4)
    late[7, tick_log.LATENESS_US] = tick_log.MISSED_US
    screens.tick(late)
    screens.hear(ready(2, rows=rows))
    card = screens.run.card
    assert screens.run.card_shown and card.row == rows[1] and "1 tick missed" in card.flags.text()
    click_trial(screens, rows[0].run)
    screens.hear(ready(2, rows=rows))  # while the recording is read
    qtbot.waitUntil(lambda: card.row == rows[0], timeout=60_000)
    assert "1 tick missed" not in card.flags.text() and press(screens, "Alt+X") == []
    QTest.keyClicks(screens.run.cards.question.own, "he sneezed")
    assert screens.press(Qt.Key.Key_Return, screens.run.cards.question.own) == [m.Exclude(rows[0].run, "he sneezed")]
    screens.hear(ready(2, rows=rows))
    click_trial(screens, rows[0].run)
    qtbot.waitUntil(lambda: card.row == rows[0] and card.ready, timeout=60_000)
    assert press(screens, "Space") == [] and card.row == rows[1] and "1 tick missed" in card.flags.text()
    qtbot.waitUntil(lambda: card.ready, timeout=60_000)
    assert press(screens, "Space") == [m.Start()]


def test_ticks_reach_workspace_participant_and_traces_all_of_one_tick_and_nothing_of_them_stays(screens) -> None:
    over = next(i for i, trial in enumerate(PLAN) if trial.path == 1)
    screens.participant.show()
    screens.hear(opened(), runs(over))
    rows, run = movement(1, "AEB", 1.0), screens.run
    rows[:100, tick_log.PHASE] = tick_log.HOLD  # "go" is at 0.1 s
    rows[:100, tick_log.CURRENT : tick_log.CURRENT + 4] = rows[:100, tick_log.TORQUE : tick_log.TORQUE + 4] = 0.0
    rows[:100, tick_log.STUCK] = 0.0
    view, live, strip = run.workspace.view, run.live, run.strip
    strip.open.click()
    for begin in range(0, len(rows), 16):
        screens.client.rows, screens.client.taken = rows[begin : begin + 16], True
        screens.windows.frame()
        assert strip.currents.figures.text() not in strip.figures.text(), "the curve has them"
        for joint, doing in view.doing.items():
            current = strip.currents.figures.text().split(joint + " ")[1].split()[0]
            assert (doing.state == OFF) == (current in ("0.00", "–"))
    screens.run.show_panels()
    last = rows[-1]
    assert live.error.newest == pytest.approx((1e3 * abs(last[tick_log.PATH_DISTANCE]),))
    assert live.force.newest == pytest.approx(
        (float((last[tick_log.HAND_FX] ** 2 + last[tick_log.HAND_FY] ** 2) ** 0.5),)
    )
    assert live.error.t[0] == strip.speed.t[0] == 0.0 and live.error.t[-1] == pytest.approx(0.899)
    assert view.tip == screens.participant.view.tip == tuple(last[tick_log.TIP_X : tick_log.TIP_Y + 1])
    assert view.line.startswith("Participant reads: Go") and "no brake added energy" in strip.figures.text()
    assert "Loop in time since go" in strip.figures.text(), "the light beside it is of the ticks before, too"
    screens.hear(ready(over + 1))
    assert (live.force.figures.text(), strip.speed.figures.text(), len(live.force.t)) == ("– N", "– m/s", 900)
    screens.hear(opened(""), before())
    assert not view.trail and not len(view.outline) and view.tip is None and not strip.ledger.began
    assert not any(len(trace.t) for trace in (live.error, live.force, strip.speed, strip.currents, strip.timing))


def test_a_blind_console_tells_no_controllers_apart(screens: Screens) -> None:
    names = " | ".join(preset.name for preset in PRESETS.values() if preset.name != "No control")
    for over in range(5):
        row = Row((opened(), runs(over, blind=True)), f"path {PLAN[over].path}", f"{names} | Currents | Energy")
        check(screens, row)
        screens.tick(movement(PLAN[over].path, "AEB", 0.2))
        check(screens, row._replace(said=()))
    assert PRESETS[PLAN[4].controller].name in read(screens.hear(runs(4)))


def test_before_the_session_server_has_said_anything_run_says_so_and_nothing_can_be_pressed(qtbot) -> None:
    page = RunPage(lambda command: None)
    qtbot.addWidget(page)
    page.show()
    seen = [button for button in page.panel.findChildren(QAbstractButton) if button.isVisible()]
    assert seen and not any(button.isEnabled() for button in seen)
    assert (page.large.text(), page.small.text()) == words.PREPARING


def test_ticks_that_still_waited_are_not_shown_in_the_next_trial(screens: Screens) -> None:
    screens.hear(opened(), runs(0))
    screens.client.rows = movement(PLAN[0].path, "AEB", 1.0)[:16]
    screens.windows.frame()
    screens.hear(runs(1))
    screens.run.show_panels()
    assert screens.run.strip.speed.newest == () and not screens.run.strip.ledger.began
