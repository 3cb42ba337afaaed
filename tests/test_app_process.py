"""The window and the loop as two processes: a whole mouse trial, and either of them killed in the middle of one."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from synthetic_hand import SyntheticHand

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
from PySide6.QtCore import QEvent, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QWidget

from app import words
from app.cli import main
from app.loop import WINDOW_DIED
from app.loop_process import LoopProcess
from app.messages import Ticks
from app.window import Window
from core import row
from core.device import load_device
from experiments.metrics import trial_metrics
from experiments.plan import SEGMENTS
from experiments.recording import read_recording
from experiments.session import Choices
from experiments.trials_table import read_table

ROOT = Path(__file__).resolve().parent.parent


def wait_until(what, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "waited in vain"
        QTest.qWait(10)


def gone(pid: int) -> bool:
    """Whether a process has ended (one that nobody has waited for yet counts as ended)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] in "ZX"
    except FileNotFoundError:
        return True


@pytest.fixture
def opened(qtbot, tmp_path: Path):
    """A window with its real loop, and the newest tick it has shown."""
    devices = [load_device("three-brake"), load_device("four-brake")]
    loop = LoopProcess(devices, tmp_path, Choices())
    window = Window(loop, devices, tmp_path, "01", Choices(), ask=lambda: True)
    qtbot.addWidget(window)
    window.resize(1280, 720)
    window.show()
    wait_until(window.console.start.isEnabled)
    yield window, loop
    window.close()
    assert not loop.alive and gone(loop.pid)


def point(window: Window, place: tuple[float, float]) -> None:
    QTest.mouseMove(window.view, window.view.to_screen(place).toPoint())


def drag(view: QWidget, place: QPointF) -> None:
    """A pointer that moves with its button down: its events reach the view from outside the window too."""
    left = Qt.MouseButton.LeftButton
    event = QMouseEvent(
        QEvent.Type.MouseMove, place, view.mapToGlobal(place), left, left, Qt.KeyboardModifier.NoModifier
    )
    QApplication.sendEvent(view, event)


def watch(window: Window, monkeypatch) -> list[np.ndarray]:
    """The newest tick that the window has shown, as the only element of a list."""
    newest: list[np.ndarray] = []
    show = window._show_ticks

    def showing(messages: list[Ticks]) -> None:
        show(messages)
        if messages:
            newest[:] = [messages[-1].rows[-1]]

    monkeypatch.setattr(window, "_show_ticks", showing)
    return newest


def test_a_whole_mouse_trial_is_recorded_measured_and_done(opened, monkeypatch, tmp_path: Path) -> None:
    window, _ = opened
    newest = watch(window, monkeypatch)
    planned = window._coming
    hand = SyntheticHand(planned.segment, window.view.tip)
    said = []
    point(window, window.view.tip)
    QTest.keyClick(window, Qt.Key.Key_Space)
    last, jumped = time.monotonic(), False
    while not window.rows:
        QTest.qWait(15)
        now, dt = time.monotonic(), time.monotonic() - last
        last = now
        if window.view.said and window.view.said not in said and not window.rows:
            said.append(window.view.said)
        if newest:
            tick = newest[0]
            if tick[row.PHASE] == row.MOVE and not jumped:  # out of the window in one jump, dragging, and back
                jumped = True
                drag(window.view, QPointF(5000.0, -5000.0))
                QTest.qWait(60)
                last = time.monotonic()
            point(window, hand((tick[row.TIP_X], tick[row.TIP_Y]), int(tick[row.PHASE]), dt))
    said.append(window.view.said)
    assert said == ["Move to the start", "Hold", "Go", "Well done"]

    result = window.rows[0]
    assert result.status == "done" and result.controller == planned.controller
    assert read_table(tmp_path / "sub-01" / "ses-01" / "trials.csv") == [result]
    assert read_table(tmp_path / "trials.csv") == [result.seen_from("sub-01/ses-01")]
    recording = read_recording(tmp_path / "sub-01" / "ses-01" / result.recording)
    assert recording.whole and recording.outcome["status"] == "done"
    order = [recording.words["phase"][code] for code in dict.fromkeys(recording.column("phase"))]
    assert order == ["approach", "hold", "move", "end"]
    tip = np.column_stack([recording.column("tip_x_m"), recording.column("tip_y_m")])
    segment = SEGMENTS[planned.segment]
    moving = recording.in_phase("move")
    assert np.hypot(*(tip[moving][0] - segment.start)) <= 0.003
    assert np.hypot(*(tip[recording.in_phase("end")][0] - segment.end)) <= 0.010
    force = np.hypot(recording.column("hand_fx_N"), recording.column("hand_fy_N"))
    assert 20.0 < force.max() <= 40.0 + 1e-9  # the jump was felt, as far as the cap lets it
    metrics = trial_metrics(recording, segment.start, segment.end, planned.controller)
    assert metrics.path_error_m == result.path_error_m
    assert result.duration_s == pytest.approx(1e-3 * np.count_nonzero(moving), abs=2e-3)
    shown = window.figures.boxes[0].found[(planned.controller, planned.configuration)]
    assert shown.median == pytest.approx(1e3 * result.path_error_m)


def test_a_loop_that_is_killed_is_said_in_red_at_once_and_what_it_wrote_is_kept(opened, tmp_path: Path) -> None:
    window, loop = opened
    QTest.keyClick(window, Qt.Key.Key_Space)
    wait_until(lambda: window.status.recording.text().startswith("Recording run-001"))
    QTest.qWait(600)
    os.kill(loop.pid, signal.SIGKILL)
    began = time.monotonic()
    wait_until(window.banner.isVisible, 5.0)
    assert time.monotonic() - began < 1.0
    assert window.banner.text() == words.LOOP_DIED
    assert not window.console.start.isEnabled() and not window.console.abort.isEnabled()
    stream = read_recording(tmp_path / "sub-01" / "ses-01" / "trials" / "run-001.arrows")
    assert stream.rows >= 300 and not stream.complete and not stream.damaged


WINDOW_WITHOUT_EYES = """
import sys, time
from pathlib import Path
from app.loop_process import LoopProcess
from app.messages import Prepared, Start, Ticks
from core.device import load_device
from experiments.session import Choices

if __name__ == "__main__":
    loop = LoopProcess([load_device("three-brake")], Path(sys.argv[1]), Choices())
    ticks = 0
    while ticks < 600:
        for message in loop.receive():
            if isinstance(message, Prepared):
                loop.send(Start("01"))
            if isinstance(message, Ticks):
                ticks += len(message.rows)
        time.sleep(0.01)
    print(loop.pid, flush=True)
    time.sleep(60)
"""


def test_a_window_that_is_killed_in_mid_trial_leaves_a_whole_recording_and_no_process(tmp_path: Path) -> None:
    script = tmp_path / "window.py"
    script.write_text(WINDOW_WITHOUT_EYES)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    window = subprocess.Popen(
        [sys.executable, script, tmp_path / "data"], env=environment, stdout=subprocess.PIPE, text=True
    )
    with window:
        pid = int(window.stdout.readline())
        window.kill()
    wait_until(lambda: gone(pid), 20.0)
    recording = read_recording(tmp_path / "data" / "sub-01" / "ses-01" / "trials" / "run-001.parquet")
    assert recording.whole and recording.rows >= 600
    assert recording.outcome["status"] == "aborted" and recording.outcome["reason"] == WINDOW_DIED
    assert [r.status for r in read_table(tmp_path / "data" / "trials.csv")] == ["aborted"]


def phd(*arguments: object, **kwargs) -> subprocess.Popen:
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "app.cli", "run", *map(str, arguments)]
    return subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, **kwargs)


def children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def test_ctrl_c_closes_window_and_loop_and_leaves_nothing(tmp_path: Path) -> None:
    with phd("--data-dir", tmp_path / "data") as window:
        wait_until(lambda: len(children(window.pid)) > 1)  # the loop, and Python's own tracker of resources
        below = children(window.pid)
        time.sleep(1.0)
        window.send_signal(signal.SIGINT)
        assert window.wait(20.0) == 130, window.stderr.read()
    wait_until(lambda: all(map(gone, below)), 10.0)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("make", "arguments", "says"),
    [
        ("data/sub-07/ses-01/session.json", ["--participant", "07"], "exists already"),
        ("data", [], "data: cannot be written to"),
    ],
)
def test_what_cannot_be_recorded_is_refused_before_any_window(
    tmp_path: Path, monkeypatch, capsys, make, arguments, says
) -> None:
    monkeypatch.setattr("app.window.run", lambda args: pytest.fail("a window was opened"))
    place = tmp_path / make
    place.parent.mkdir(parents=True, exist_ok=True)
    place.touch()
    assert main(["run", "--data-dir", str(tmp_path / "data"), *arguments]) == 2
    said = capsys.readouterr().err
    assert says in said and said.startswith("phd: ") and said.count("\n") == 1
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [place]


def test_a_screen_that_does_not_answer_is_one_sentence_and_exit_2(tmp_path):
    environment = {**os.environ, "DISPLAY": ":7763", "QT_QPA_PLATFORM": "xcb"}
    command = [sys.executable, "-m", "app.cli", "run", "--data-dir", str(tmp_path / "data")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and done.stdout == "" and done.stderr.count("\n") == 1
    assert "no usable screen (DISPLAY=:7763" in done.stderr and not (tmp_path / "data").exists()
