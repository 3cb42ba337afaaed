"""No text is cut and none lies over another: in the states that the tables of the pages do not have, on cards, and in
windows of two sizes. What the server says moves no button, field or curve that was there before."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from fake_client import (
    GREEN,
    PAPER,
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
)
from protocols import CURVES
from PySide6.QtCore import QRect, Qt
from PySide6.QtWidgets import QAbstractButton, QLineEdit, QWidget
from screens import Screens, settle
from sessions import session_of
from status_messages import NOT_ZEROED, ON_BENCH, status, told
from texts_on_screen import faults_by_size
from tried import INITIAL, ended, tried

from app.ipc import messages as m
from app.window.canvas.plane import Plane
from app.window.home.home_page import BOARD
from app.window.widgets.page import ANALYSE, HOME, TRY
from app.window.widgets.plots import Graph
from experiments.analysis.charts import PERSON, POOLED, SPEED
from experiments.analysis.trials_table import as_rows, as_table
from experiments.protocol_file import Consent
from experiments.store.overview import DataOverview, SessionOverview

GONE = (
    "Run 9 is not complete. /a/folder/that/is/gone/sub-01/ses-01/trials/run-009.parquet is gone. Bring it back "
    "(connect its disk, take it out of the wastebasket), and what is missing is written by itself. Or go on in "
    "another folder. All its 12 345 ticks are in memory. It is tried again every 5 s"
)
ALT, NONE = Qt.KeyboardModifier.AltModifier, Qt.KeyboardModifier.NoModifier
FLAGS = {name: f"The measure {name} needs a force, which this device does not have" for name in ("work", "share")}
FLAGGED = replace(result(PLAN[37], "timeout"), failed=FLAGS)
UNEVEN = {"clock": {"offset_s": 0.0, "drift": 1e-3, "residual_s": 1e-5, "blocks": 60}, "lost_links": 3, "begun_anew": 2}
NOT_HOMED = m.Check(
    "Device", m.DUE, "not homed yet", "Home the encoders: the session or the Device page (F3) guides you."
)
NOT_STORED = ready(9, not_written=GONE, checks=(*GREEN[:4], m.Check("Recording", m.BAD, "incomplete", GONE)))


def flagged_card(screens: Screens) -> None:
    screens.hear(opened(), running(37))
    screens.tick(movement(PLAN[37].path, "AEBC", 1.5))
    screens.hear(ready(38, rows=(*map(result, PLAN[:37]), FLAGGED)))


def asked(key: Qt.Key, modifier=ALT, over: int = 22) -> Callable[[Screens], None]:
    def show(screens: Screens) -> None:
        screens.hear(opened(), running(over - 1), ready(over) if key != Qt.Key.Key_A else running(over))
        screens.press(key, modifier=modifier)
        screens.hear()  # a frame

    return show


def page(name: str, *messages: object) -> Callable[[Screens], None]:
    def show(screens: Screens) -> None:
        screens.main.show_page(name)
        screens.hear(*messages)

    return show


def try_passes(screens: Screens) -> None:
    page(TRY, opened(""), tried(INITIAL, *(ended(n, 1 + n % 5, changed=n == 3) for n in range(1, 9))))(screens)
    screens.tick(movement(1, "AEB", 1.5))


def device(screens: Screens) -> None:
    screens.hear(opened(**ON_BENCH), m.Snapshot(m.NO_SESSION, checks=(NOT_HOMED, *NOT_ZEROED[1:])))
    screens.press(Qt.Key.Key_F3)
    screens.hear(told(status(UNEVEN)))


def card(name: str) -> Callable[[Screens], None]:
    def show(screens: Screens) -> None:
        screens.hear(opened(), ready(3))
        getattr(screens.main, f"show_{name}")()

    return show


def long_names(screens: Screens) -> None:
    long = PAPER.controllers[3]._replace(name="SDOF with a gap of five millimetres at either side, as it was piloted")
    screens.hear(opened(protocol=paper(controllers=PAPER.controllers | {3: long})), ready(3))
    screens.main.show_controllers()


def instructed(screens: Screens) -> None:
    screens.hear(opened(), ready(0))
    screens.run.participant_reads = True
    screens.run.show_snapshot(ready(0))


def editor(screens: Screens) -> None:
    page(HOME, opened(""), before())(screens)
    home = screens.main.pages[HOME]
    home.editor.open(str(CURVES))
    home.stack.setCurrentWidget(home.editor)


def sessions(screens: Screens) -> None:
    page(HOME, opened(""), before())(screens)
    one = SessionOverview(Path("sub-01/ses-01"), "01", "paper", 14, 60, 1.8e9, lacking=3)
    others = one._replace(participant="02", done=60), one._replace(participant="03", declined=True)
    broken = one._replace(participant="04", problem="session.db: gone")
    screens.main.pages[HOME].data.show_overview(DataOverview(Path("data"), (one, *others, broken)))


def ports(screens: Screens) -> None:
    page(HOME, opened(""), before())(screens)
    home = screens.main.pages[HOME]
    home.link.show_value(BOARD)
    home.link.changed.emit(BOARD)


def consent(screens: Screens) -> None:
    page(HOME, opened(""), before())(screens)
    home = screens.main.pages[HOME]
    home.consent.show_consent(Consent("You may stop at any time, without giving a reason."), "Consent of 01")
    home.stack.setCurrentWidget(home.asking)


STATES: dict[str, Callable[[Screens], None]] = {
    "run, card": flagged_card, "run, undone": lambda screens: screens.hear(opened(), NOT_STORED),
    "settings": card("settings"), "long names": long_names, "run, instructed": instructed,
    "home, sessions": sessions, "home, ports": ports, "editor": editor, "consent": consent, "device": device,
    "repeat": asked(Qt.Key.Key_R), "abort": asked(Qt.Key.Key_A), "keys": asked(Qt.Key.Key_F1, NONE), "try": try_passes,
}  # fmt: skip


@pytest.mark.parametrize("state", STATES)
def test_no_text_is_cut_in_a_session_and_on_try(screens: Screens, state: str) -> None:
    STATES[state](screens)
    assert faults_by_size(screens.main) == {}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """A data folder with a few recorded trials."""
    folder = tmp_path_factory.mktemp("data")
    with session_of(folder, 2):
        return folder


def test_no_text_is_cut_on_analyse(qtbot, screens: Screens, recorded: Path) -> None:
    screens.hear(opened(""), before())
    screens.main.show_page(ANALYSE, recorded)
    analyse = screens.main.pages[ANALYSE]
    qtbot.waitUntil(lambda: analyse.results is not None, timeout=60_000)
    first, *rest = as_rows(analyse.results.trials)
    late = replace(first, status="timeout")  # the notes below the charts are long then
    analyse.show_results(analyse.results._replace(trials=as_table([late, *rest])))
    for shown in (PERSON, POOLED, SPEED):
        analyse.show_page(shown)
        assert faults_by_size(screens.main) == {}, shown
    analyse.open_trial(rest[-1])
    qtbot.waitUntil(lambda: analyse.side.trial is not None, timeout=60_000)
    assert faults_by_size(screens.main) == {}
    analyse.close_trial()


NOTICE = "Run 9: the participant was distracted by a long sentence that goes on over several lines of the panel."
LATE = m.Check("Loop", m.CAUTION, "12 ticks missed", "Close other programs.")
OFF = {"brakes_off": "Esc was pressed in the main window"}


def places(window: QWidget) -> dict[QWidget, QRect]:
    """Where everything is that can be pressed, typed in or pointed at."""
    settle(window)
    seen = (one for kind in (QAbstractButton, QLineEdit, Plane, Graph) for one in window.findChildren(kind))
    return {one: QRect(one.mapTo(window, one.rect().topLeft()), one.size()) for one in seen if one.isVisible()}


def moved(screens: Screens, *messages: object) -> list[str]:
    """What has another place after the server has said this."""
    was = places(screens.main)
    screens.hear(*messages)
    now = places(screens.main)
    pills = screens.main.preflight
    return [
        f"{type(one).__name__} {getattr(one, 'text', str)()}: {was[one]} -> {now[one]}"
        for one in was.keys() & now.keys()
        if was[one] != now[one] and not pills.isAncestorOf(one)
    ]


def test_nothing_moves_under_the_pointer_on_run_between_trials_and_in_one(screens: Screens) -> None:
    screens.hear(opened(), ready(9), pulse(""))
    for said in (
        ready(9, checks=RED), ready(9), ready(9, notice=NOTICE, notice_bad=True), ready(9, **OFF),
        ready(9, paused=True), ready(9, notes=("13:02 slower",)),
    ):  # fmt: skip
        assert moved(screens, said) == [], said
    screens.hear(running(9))
    screens.tick(movement(PLAN[9].path, "AEB", 0.5))
    checks = (*GREEN[:2], LATE, *GREEN[3:])
    for said in (pulse(), running(9, checks=checks), running(9, notice=NOTICE)):
        assert moved(screens, said) == [], said


def test_nothing_moves_under_the_pointer_on_home(qtbot, screens: Screens) -> None:
    screens.main.show_page(HOME)
    screens.hear(opened(""), before())
    home = screens.main.pages[HOME]
    qtbot.waitUntil(lambda: home.plan.toPlainText() != "" and home.data.overview is not None, timeout=60_000)
    for said in (before(checks=RED), before(), before(notice=NOTICE, notice_bad=True), before(**OFF)):
        assert moved(screens, said) == [], said


def test_nothing_moves_under_the_pointer_on_try(screens: Screens) -> None:
    screens.main.show_page(TRY)
    screens.hear(opened(""), tried())
    first = ended(1)
    for said in (tried(INITIAL, first), tried(INITIAL, first)._replace(notice="No.", notice_bad=True), before(**OFF)):
        assert moved(screens, said) == [], said
