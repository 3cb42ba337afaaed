"""Nothing moves under the pointer: what the server says moves no button, field or curve that was there before."""

from fake_client import GREEN, PLAN, RED, before, movement, opened, pulse, ready, running
from PySide6.QtCore import QRect
from PySide6.QtWidgets import QAbstractButton, QLineEdit, QWidget
from screens import Screens, settle
from tried import INITIAL, ended, tried

from app.ipc import messages as m
from app.window.canvas.plane import Plane
from app.window.widgets.page import HOME, TRY
from app.window.widgets.plots import Graph

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


def test_on_run_between_trials_and_in_one(screens: Screens) -> None:
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


def test_on_home(qtbot, screens: Screens) -> None:
    screens.main.show_page(HOME)
    screens.hear(opened(""), before())
    home = screens.main.pages[HOME]
    qtbot.waitUntil(lambda: home.plan.toPlainText() != "" and home.data.overview is not None, timeout=60_000)
    for said in (before(checks=RED), before(), before(notice=NOTICE, notice_bad=True), before(**OFF)):
        assert moved(screens, said) == [], said


def test_on_try(screens: Screens) -> None:
    screens.main.show_page(TRY)
    screens.hear(opened(""), tried())
    first = ended(1)
    for said in (tried(INITIAL, first), tried(INITIAL, first)._replace(notice="No.", notice_bad=True), before(**OFF)):
        assert moved(screens, said) == [], said
