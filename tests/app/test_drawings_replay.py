"""The replay window: a recording plays as it was recorded, and any moment of it looks as if it had been played."""

import os
from pathlib import Path

import numpy as np
import pytest
from fake_ticks import ALONG, trial

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from app.window.painting import theme
from app.window.replay_window import SPEEDS, ReplayWindow, device_of, ticks_of
from core import tick_log
from core.device import load_device
from core.files import InputError
from experiments.recording.reader import read_recording
from experiments.recording.writer import RecordingWriter

THREE = load_device("three-brake")
ABOUT = {
    "participant": "03", "run": 7, "configuration": "three-brake", "controller": 3, "segment": 1, "rules": "settled",
    "preset": {"name": "SDOF with gap"},
    "start_m": ALONG.start_m, "end_m": ALONG.end_m,
}  # fmt: skip


def recorded(path: Path, rows: np.ndarray, **about) -> Path:
    with RecordingWriter(path, "AEB", {**ABOUT, **about}, sync=False) as writer:
        writer.write(rows)
        writer.close({"status": "done"})
    return path


@pytest.fixture
def rows() -> np.ndarray:
    return trial(THREE, ALONG, 3.0)


@pytest.fixture
def window(qtbot, tmp_path: Path, rows: np.ndarray) -> ReplayWindow:
    theme.dress(QApplication.instance())
    window = ReplayWindow(recorded(tmp_path / "run-007.arrows", rows))
    qtbot.addWidget(window)
    window.show()
    return window


def test_the_ticks_of_a_recording_are_those_that_were_recorded(tmp_path: Path, rows: np.ndarray) -> None:
    rows[:, tick_log.STUCK] = np.arange(len(rows)) % 8  # three brakes
    back = ticks_of(read_recording(recorded(tmp_path / "run-001.arrows", rows)), ALONG)
    unbraked = [tick_log.CURRENT + 3, tick_log.TORQUE + 3]
    kept = [i for i in range(tick_log.WIDTH) if i not in unbraked]
    assert np.array_equal(back[:, kept], rows[:, kept], equal_nan=True)


def test_it_says_which_trial_it_is(window: ReplayWindow) -> None:
    says = window.head.text()
    for part in ("Participant 03", "run 7", "three-brake", "SDOF with gap", "path 1", "done"):
        assert part in says


def test_space_and_the_button_play_and_pause(qtbot, window: ReplayWindow) -> None:
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow, timeout=60_000)
    QTest.keyClick(window, Qt.Key.Key_Space)
    assert window.playing and window.play_button.text().startswith("Pause")
    qtbot.waitUntil(lambda: window.at > 50, timeout=60_000)
    QTest.mouseClick(window.play_button, Qt.MouseButton.LeftButton)
    assert not window.playing
    at = window.at
    QTest.qWait(50)
    assert window.at == at and window.slider.value() == at


def test_it_stops_at_the_end_and_begins_anew(window: ReplayWindow) -> None:
    window.seek(len(window.rows) - 1)
    window.play_or_pause()
    window.go_on(1.0)
    window.frame()
    assert window.at == len(window.rows) and not window.playing
    window.play_or_pause()
    assert window.at <= 1 and window.playing
    window.play_or_pause()


def test_any_moment_looks_as_if_it_had_been_played(window: ReplayWindow, rows: np.ndarray) -> None:
    for _ in range(125):
        window.go_on(0.016)
    played, at = window.workspace.view, window.at
    tip, ledger, sense = played.tip, window.energy.ledger, played.sense
    traced = (window.traces.error.newest, window.traces.force.newest, window.traces.currents.newest)
    window.seek(0)
    assert window.energy.ledger.hand == 0.0 and played.tip == tuple(rows[0, 2:4])
    window.slider.setValue(at)  # as a drag of the handle does
    assert window.at == at and played.tip == tip == tuple(rows[at - 1, 2:4])
    found = window.energy.ledger
    assert (found.hand, found.brakes, found.kinetic) == pytest.approx((ledger.hand, ledger.brakes, ledger.kinetic))
    assert (window.traces.error.newest, window.traces.force.newest, window.traces.currents.newest) == traced
    assert played.sense == sense and len(played.trail) > 20


def test_arrows_step_home_and_end_jump_and_up_is_faster(qtbot, window: ReplayWindow) -> None:
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow, timeout=60_000)
    for key, at in ((Qt.Key.Key_End, len(window.rows)), (Qt.Key.Key_Home, 0)):
        QTest.keyClick(window, key)
        assert window.at == at
    QTest.keyClick(window, Qt.Key.Key_Right)
    assert window.at == pytest.approx(100, abs=2)
    speed = window.speed.currentData()
    QTest.keyClick(window, Qt.Key.Key_Up)
    assert window.speed.currentData() == SPEEDS[SPEEDS.index(speed) + 1]


def test_a_recording_by_itself_plays_on_the_shipped_device_of_its_name(tmp_path: Path, rows: np.ndarray) -> None:
    assert device_of(read_recording(recorded(tmp_path / "a.arrows", rows))).name == "three-brake"
    with pytest.raises(InputError, match="unknown device"):
        device_of(read_recording(recorded(tmp_path / "b.arrows", rows, configuration="nobody-knows")))


def test_nothing_to_play_is_one_sentence(qtbot, tmp_path: Path, rows: np.ndarray) -> None:
    with pytest.raises(InputError, match="no ticks"):
        ReplayWindow(recorded(tmp_path / "empty.arrows", rows[:0]))
    with pytest.raises(InputError):
        ReplayWindow(tmp_path / "missing.parquet")
