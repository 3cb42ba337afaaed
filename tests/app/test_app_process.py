"""The app as its processes: a whole mouse trial through the windows, the end by Ctrl-C, refusals."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import waiting
from processes import children, gone
from protocols import PAPER, changed
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication
from refusals import refusal
from screens import point
from synthetic_hand import SyntheticHand

from app.ipc import messages as m
from app.ipc.client import Client
from app.ipc.messages import Setup
from app.window.widgets.page import RUN
from app.window.windows import Windows
from core import tick_log
from experiments.store.recording import read_recording
from tests.support.rows import read_rows

wait_until = partial(waiting.wait_until, pause=lambda: QTest.qWait(10))

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def windows(qtbot, tmp_path: Path):
    """Both windows on a real bench, a session open, ready."""
    protocol = tmp_path / "patient.toml"  # as the paper's, for a hand whose machine shows it few pictures
    protocol.write_text(changed(PAPER.text, time_out_s="200.0", hold_s="0.2", end_radius_m="0.08"), encoding="utf-8")
    windows = Windows(Client(Setup(tmp_path / "data", str(protocol), sync=False)))
    windows.show()
    wait_until(lambda: windows.main.snapshot.stage == m.NO_SESSION and not windows.main.snapshot.trial_blocker)
    pids = [windows.client.pid, *children(windows.client.pid)]
    windows.client.send(m.Open("01"))
    wait_until(lambda: windows.main.snapshot.stage == m.READY and windows.main.shown == RUN)
    windows.show_or_hide_participant()
    wait_until(windows.participant.isVisible)
    yield windows
    windows.close()
    wait_until(lambda: all(map(gone, pids)))


def test_a_mouse_trial_is_measured_and_shown_and_escape_ends_the_next(windows: Windows, tmp_path, monkeypatch) -> None:
    main, run, view = windows.main, windows.main.page(RUN), windows.participant.view
    planned = main.snapshot.coming
    newest: list[np.ndarray] = []
    said: dict[int, set[str]] = {}  # phase of the newest tick in a picture -> what that says
    show = windows.participant.show_ticks

    def look(rows: np.ndarray, taken: bool) -> None:
        newest.append(rows[-1])
        show(rows, taken)
        if main.snapshot.running:
            said.setdefault(int(rows[-1, tick_log.PHASE]), set()).add(view.shown.large)

    monkeypatch.setattr(windows.participant, "show_ticks", look)
    hand = SyntheticHand(planned.path, view.tip)
    point(view, view.to_screen(view.tip))
    QTest.keyClick(windows.participant, Qt.Key.Key_Space)
    last, end = time.perf_counter(), time.perf_counter() + waiting.LONG_S
    while not main.snapshot.rows:
        QTest.qWait(15)
        now, dt = time.perf_counter(), time.perf_counter() - last
        last = now
        assert now < end, f"the trial does not end; said {said}"
        if newest:
            tick = newest[-1]
            point(
                view, view.to_screen(hand((tick[tick_log.TIP_X], tick[tick_log.TIP_Y]), int(tick[tick_log.PHASE]), dt))
            )
    words = {tick_log.APPROACH: {"Move to the start"}, tick_log.HOLD: {"Hold"}, tick_log.MOVE: {"Go", ""}}  # for 1 s
    assert {tick_log.APPROACH, tick_log.MOVE} <= set(said)  # a hold of half a second may come between two pictures
    assert all(said[phase] <= words[phase] for phase in said if phase in words), said
    assert view.shown.large == "Thank you"
    (result,) = main.snapshot.rows
    assert result.status == "done" and (result.path, result.controller) == (planned.path, planned.controller)
    session = tmp_path / "data" / "sub-01" / "ses-01"
    assert read_rows(session / "trials.csv") == [result]
    recording = read_recording(session / result.recording)
    order = [recording.words["phase"][code] for code in dict.fromkeys(recording.column("phase"))]
    assert recording.whole and order == ["approach", "hold", "move", "end"]
    assert run.strip.plan.statuses == {1: "done"} and run.card_shown
    flags = run.card.flags.text()  # on a busy machine ticks come late
    assert flags == "Usable: nothing was late or flagged" or "missed of" in flags
    wait_until(lambda: "1 recording verified" in main.footer.recording.text())

    windows.client.send(m.Start())
    wait_until(lambda: main.snapshot.stage == m.RUNNING)
    QTest.keyClick(windows.participant.windowHandle(), Qt.Key.Key_Escape)
    wait_until(lambda: len(main.snapshot.rows) == 2 and main.snapshot.brakes_off)
    assert main.snapshot.rows[1].status == "stopped"
    assert main.snapshot.brakes_off.startswith("Esc was pressed on the participant's screen")
    start = main.page(RUN).panel.start
    assert not start.isEnabled()
    QTest.keyClick(windows.participant, Qt.Key.Key_B, Qt.KeyboardModifier.ControlModifier)
    wait_until(start.isEnabled)
    assert not run.strip.banner.isVisible()


#: the app, that says when its windows are open
APP = """
import sys
from PySide6.QtCore import QTimer
from app.cli import main
from app.window.windows import Windows
show = Windows.show
Windows.show = lambda self: (show(self), QTimer.singleShot(0, lambda: print("open", flush=True)))
sys.exit(main(["run", *sys.argv[1:]]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C goes to all processes of a console, also to the tests")
def test_ctrl_c_closes_windows_and_bench_and_leaves_nothing(tmp_path: Path) -> None:
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", APP, "--data-dir", str(tmp_path / "data")]
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as window:
        assert window.stdout.readline() == "open\n", window.stderr.read()
        below = children(window.pid)
        below += [child for pid in below for child in children(pid)]
        window.send_signal(signal.SIGINT)
        assert window.wait(waiting.LONG_S) == 130, window.stderr.read()
    wait_until(lambda: all(map(gone, below)))
    assert below and not list(tmp_path.iterdir())


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch, qapp: QApplication) -> None:
    """`phd run` in the process of the tests, which has an application already."""
    monkeypatch.setattr(QApplication, "exec", lambda _: pytest.fail("a window stays"))
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setattr("app.window.program.make_ready", lambda: qapp)


def test_what_cannot_be_recorded_is_refused_and_no_window_stays(in_this_process, tmp_path: Path, capsys, qapp) -> None:
    (tmp_path / "data").touch()
    assert "data: is a file" in refusal(capsys, "run", "--data-dir", tmp_path / "data")
    assert [path.name for path in tmp_path.rglob("*")] == ["data"]
    assert not any(window.isVisible() for window in qapp.topLevelWidgets())


def test_a_screen_that_does_not_answer_is_one_sentence(in_this_process, tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setenv("DISPLAY", ":7763")
    monkeypatch.setenv("QT_QPA_PLATFORM", "xcb")
    said = refusal(capsys, "run", "--data-dir", tmp_path / "data")
    assert "no usable screen (DISPLAY=:7763" in said and not (tmp_path / "data").exists()
