"""The window, offscreen, without a loop: what it shows of what it is told, and what it sends of what is done to it."""

import gc
import os
import sys
from pathlib import Path

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLabel, QWidget

from app import theme, words
from app.labels import OneLine
from app.messages import Abort, Aim, Begun, Ended, Failed, Prepared, Proof, Refused, Start, Ticks
from app.traces import WINDOW_S
from app.window import Window
from app.workspace_view import TRAIL_MOST
from core import row
from core.device import load_device
from experiments.plan import SEGMENTS, PlannedTrial, make_plan
from experiments.session import Choices
from experiments.trials_table import TrialRow, read_table

DEVICES = [load_device("three-brake"), load_device("four-brake")]
PLAN = make_plan("01", 1, ("three-brake", "four-brake"))
TIP = (0.02, 0.39)


class FakeLoop:
    """A loop that says what the test wants and remembers what it was sent."""

    def __init__(self) -> None:
        self.alive, self.sent, self.inbox, self.stopped = True, [], [], ""

    def send(self, message: object) -> None:
        self.sent.append(message)

    def receive(self) -> list:
        messages, self.inbox = self.inbox, []
        return messages

    def stop(self, reason: str) -> None:
        self.stopped = reason


class Opened:
    """A window and its fake loop."""

    def __init__(self, qtbot, data: Path) -> None:
        theme.dress(QApplication.instance())
        self.loop, self.closing = FakeLoop(), True
        self.window = Window(self.loop, DEVICES, data, "01", Choices(), ask=lambda: self.closing)  # type: ignore[arg-type]
        qtbot.addWidget(self.window)
        self.window.resize(1280, 720)
        self.window.show()

    def hear(self, *messages: object) -> Window:
        self.loop.inbox += messages
        self.window._tick()
        return self.window

    def run(self, trial: PlannedTrial = PLAN[0]) -> Window:
        return self.hear(Prepared(), Begun(trial, TIP))


def ticks(phase: int, n: int = 16, taken: bool = True, **columns: float) -> Ticks:
    rows = np.zeros((n, row.WIDTH))
    rows[:, row.T] = 1e-3 * np.arange(n)
    rows[:, row.PHASE] = phase
    rows[:, row.TIP_X], rows[:, row.TIP_Y] = TIP
    for name, value in columns.items():
        rows[:, getattr(row, name)] = value
    return Ticks(rows, taken, Proof("run-001.arrows", 1234, 250_000, 0.1))


def ended(status: str = "done", trial: PlannedTrial = PLAN[0], reason: str = "", error: float = 0.002) -> Ended:
    result = TrialRow(
        "01", trial.run, trial.block, trial.configuration, trial.controller, trial.segment, trial.repetition, status,
        path_error_m=error, mean_tip_force_N=3.0, acceleration_dft_sum=40.0, recording="trials/run-001.parquet",
    )  # fmt: skip
    return Ended(result, reason, next(iter(PLAN[trial.run :]), None), TIP)


def drag(view: QWidget, place: QPointF) -> None:
    """A pointer that moves with its button down: its events reach the view from outside the window too."""
    left = Qt.MouseButton.LeftButton
    event = QMouseEvent(
        QEvent.Type.MouseMove, place, view.mapToGlobal(place), left, left, Qt.KeyboardModifier.NoModifier
    )
    QApplication.sendEvent(view, event)


@pytest.fixture
def opened(qtbot, tmp_path: Path):
    opened = Opened(qtbot, tmp_path)
    yield opened
    opened.closing = True
    opened.window.close()
    assert opened.loop.stopped


def test_start_waits_for_the_loop_and_then_names_the_participant(opened: Opened) -> None:
    window = opened.window
    QTest.keyClick(window, Qt.Key.Key_Space)
    assert not window.console.start.isEnabled() and opened.loop.sent == []
    opened.hear(Prepared())
    QTest.mouseClick(window.console.start, Qt.MouseButton.LeftButton)
    assert opened.loop.sent == [Start("01")]
    QTest.keyClick(window, Qt.Key.Key_Space)  # asked already
    assert opened.loop.sent == [Start("01")]


def test_the_participant_reads_one_word_at_each_phase(opened: Opened) -> None:
    window = opened.run()
    opened.hear(ticks(row.APPROACH, taken=False))
    assert window.view.said == "Move to the start" and window.view._small == words.TAKE_IT
    said = []
    for phase in (row.APPROACH, row.HOLD, row.MOVE, row.END):
        opened.hear(ticks(phase))
        said.append(window.view.said)
    assert said == ["Move to the start", "Hold", "Go", "Go"]
    assert opened.hear(ended()).view.said == "Well done"


def test_traces_handle_and_proof_follow_the_ticks(opened: Opened) -> None:
    window = opened.run(next(trial for trial in PLAN if trial.segment == 1))
    opened.hear(ticks(row.MOVE, TIP_X=0.03, TIP_Y=0.397, HAND_FX=3.0, HAND_FY=-4.0, LATENESS_US=50.0))
    assert window.figures.error.newest == pytest.approx(3.0)  # mm below the line y = 0.40 m
    assert window.figures.force.newest == pytest.approx(5.0)
    assert window.view.tip == (0.03, 0.397)
    assert "run-001.arrows" in window.status.recording.text() and "0.25 MB" in window.status.recording.text()
    assert "p50 50" in window.status.timing.text() and "0 missed" in window.status.timing.text()


def test_the_end_of_a_trial_reaches_grid_boxes_and_buttons(opened: Opened) -> None:
    window = opened.run()
    assert window.console.abort.isEnabled() and not window.console.participant.isEnabled()
    opened.hear(ended())
    assert window.console.grid.statuses == {1: "done"} and window.console.grid.next == 2
    assert window.figures.boxes[0].found[(PLAN[0].controller, "three-brake")].median == pytest.approx(2.0)
    assert window.console.start.isEnabled() and not window.console.abort.isEnabled()
    assert not window.console.participant.isEnabled()  # one session, one participant


def test_escape_aborts_with_the_reason_in_the_box_and_the_reason_is_shown(opened: Opened) -> None:
    window = opened.run()
    window.console.reason.setCurrentText("the chair broke")
    QTest.keyClick(window, Qt.Key.Key_Escape)
    assert opened.loop.sent == [Abort("the chair broke")]
    opened.hear(ended("aborted", reason="the chair broke"))
    assert "the chair broke" in window.console.notice.text()
    assert window.view.said == "Stopped" and window.console.grid.statuses == {1: "aborted"}


def test_the_pointer_is_sent_in_metres_and_stays_inside_what_is_drawn(opened: Opened) -> None:
    view = opened.window.view
    place = (0.05, 0.3)
    QTest.mouseMove(view, view.to_screen(place).toPoint())
    assert opened.loop.sent[-1] == pytest.approx(place, abs=0.002)
    low, high = view.to_workspace(QPointF(0, view.height())), view.to_workspace(QPointF(view.width(), 0))
    drag(view, QPointF(9000.0, -9000.0))
    assert opened.loop.sent[-1] == Aim(high[0], high[1])
    assert all(low[i] < high[i] < 1.0 for i in range(2))
    count = len(opened.loop.sent)
    QTest.mouseMove(opened.window.console, QPoint(20, 300))  # elsewhere in the window: the target stays
    assert len(opened.loop.sent) == count and view.pointer == high


def test_a_place_on_the_screen_is_a_place_in_the_workspace(opened: Opened) -> None:
    view = opened.window.view
    for place in ((-0.1, 0.4), (0.08, 0.42), (0.0, 0.0)):
        assert view.to_workspace(view.to_screen(place)) == pytest.approx(place, abs=1e-12)
    a, b, c = (view.to_screen(place) for place in ((0.0, 0.3), (0.1, 0.3), (0.0, 0.4)))
    assert b.x() - a.x() == pytest.approx(a.y() - c.y())  # true to scale, y away from the person


def test_a_typed_participant_with_a_session_is_refused_in_a_sentence(opened: Opened, tmp_path: Path) -> None:
    folder = tmp_path / "sub-02" / "ses-01"
    folder.mkdir(parents=True)
    (folder / "session.json").write_text("{}")
    window = opened.hear(Prepared())
    for typed, says in (("02", "exists already"), ("0 2", "letters and digits")):
        window.console.participant.setText(typed)
        assert says in window.console.notice.text() and not window.console.start.isEnabled()
    window.console.participant.setText("03")
    assert window.console.notice.text() == "" and window.console.start.isEnabled()
    opened.hear(Refused("data: cannot be written to"))
    assert "cannot be written to" in window.console.notice.text() and window.console.start.isEnabled()


def test_another_configuration_is_announced_and_start_goes_on(opened: Opened) -> None:
    last = PLAN[29]
    assert PLAN[30].configuration != last.configuration
    window = opened.run(last)
    opened.hear(ended(trial=last))
    assert "Configuration changes to four-brake" in window.console.notice.text()
    assert window.view._device.name == "four-brake" and window.console.start.isEnabled()


def test_after_the_last_trial_nothing_more_can_be_started(opened: Opened) -> None:
    window = opened.run(PLAN[-1])
    opened.hear(ended(trial=PLAN[-1]))
    assert not window.console.start.isEnabled() and window.view._small == words.ALL_DONE


@pytest.mark.parametrize("death", ["silent", "said"])
def test_the_end_of_the_loop_is_said_in_red_and_stops_everything(opened: Opened, death: str) -> None:
    window = opened.run()
    if death == "silent":
        opened.loop.alive = False
        opened.hear()
        assert window.banner.text() == words.LOOP_DIED
    else:
        opened.hear(Failed("the disk is full"))
        assert window.banner.text() == "The disk is full"
    assert window.banner.isVisible()
    assert not window.console.start.isEnabled() and not window.console.abort.isEnabled()


def test_closing_while_a_trial_is_recorded_asks_first(opened: Opened) -> None:
    window = opened.run()
    opened.closing = False
    assert not window.close() and window.isVisible() and not opened.loop.stopped
    opened.closing = True
    assert window.close() and opened.loop.stopped == "the window was closed"


def test_results_are_exported_into_a_new_folder_and_never_over_another(opened: Opened, tmp_path: Path, qtbot) -> None:
    window = opened.run()
    opened.hear(ended())
    folder = tmp_path / "results"
    for says in ("files written", "not empty"):
        window.export_to(folder)
        qtbot.waitUntil(lambda says=says: says in window.figures.note.text(), timeout=60_000)
    kinds = {path.suffix for path in folder.iterdir()}
    assert kinds == {".png", ".svg", ".pdf", ".csv"}
    (exported,) = read_table(folder / "trials.csv")
    assert (folder / exported.recording).resolve() == tmp_path / "sub-01" / "ses-01" / "trials" / "run-001.parquet"


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (1600, 900), (1920, 1080)])
def test_no_text_is_cut_at_any_size(opened: Opened, width: int, height: int) -> None:
    window = opened.run(PLAN[28])
    opened.hear(ticks(row.MOVE), ended("aborted", PLAN[29], "the participant was distracted by a long sentence"))
    window.resize(width, height)
    QTest.qWait(50)
    assert (window.width(), window.height()) == (width, height)  # nothing asks for more room
    for label in window.findChildren(QLabel):
        if not label.isVisible() or isinstance(label, OneLine):  # these shorten themselves and say so
            continue
        if label.wordWrap():
            assert label.height() >= label.heightForWidth(label.width()), label.text()
        else:
            assert label.width() >= label.sizeHint().width(), label.text()


def test_frames_do_not_use_up_references_to_none(opened: Opened) -> None:
    """With some versions of Qt's binding a live plot loses references to None until the process dies."""
    window = opened.run()

    def frames(n: int) -> None:
        for _ in range(n):
            opened.hear(ticks(row.MOVE))
            window.grab()

    frames(10)
    gc.collect()
    before = sys.getrefcount(None)
    frames(60)
    gc.collect()
    assert abs(sys.getrefcount(None) - before) < 60  # less than one a frame


def test_what_is_drawn_does_not_grow_with_the_length_of_a_trial(opened: Opened) -> None:
    window = opened.run()
    for second in range(0, 60, 2):
        message = ticks(row.MOVE)
        for part in range(100):
            message.rows[:, row.T] = second + 0.02 * part + 1e-3 * np.arange(16)
            window.view.show_ticks(message.rows, True)
            window.figures.add(message.rows, SEGMENTS[1])
    assert len(window.view._trail) <= TRAIL_MOST
    assert len(window.figures.force._times) <= 2 * WINDOW_S / 0.02 + 2
