"""A recorded trial on the screen: any moment of it looks as if it had been played; a click goes where it was made."""

import re
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from drawn_ways import frames, is_painted, trail_of, way_of
from fake_ticks import ALONG, trial
from own_files import put_code
from protocols import short
from PySide6.QtCore import QPointF, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication
from recorded import record
from sessions import closed_session, new_session

from app.window.analyse.trial_traces import TrialTraces
from app.window.analyse.trial_view import SPEEDS, TrialView
from app.window.analyse.trial_window import TrialWindow
from app.window.widgets.plots import start_of_hold
from core import tick_log
from core.device import load_device
from core.files import InputError
from core.mechanism import JOINTS
from experiments.study.playback import read_playback

THREE = load_device("three-brake")
ABOUT = {
    "participant": "03", "run": 7, "configuration": "three-brake", "controller": 3, "path": 1, "rules": "settled",
    "preset": {"name": "SDOF with gap"}, "start_m": ALONG.start_m, "end_m": ALONG.end_m, "block": 2,
}  # fmt: skip
ROWS = trial(THREE, ALONG, 3.0)
T, LAST = ROWS[:, tick_log.T], len(ROWS) - 1


def recorded(data: Path, rows: np.ndarray, **about) -> Path:
    """A recording of these ticks, in the session of a participant."""
    session = new_session(data, "03")
    session.close()
    return record(session.folder, rows, metadata={**ABOUT, **about}, run=7)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("trial"), ROWS)


@pytest.fixture(scope="module")
def view(recording: Path) -> Iterator[TrialView]:
    """One for all tests."""
    window = TrialWindow(recording)
    window.show()
    yield window.view
    window.close()


def test_what_cannot_be_played_is_one_sentence(tmp_path: Path, recording: Path, qtbot) -> None:
    assert read_playback(recording).device.name == "three-brake"
    with pytest.raises(InputError, match="no device"):
        read_playback(recorded(tmp_path / "b", ROWS, configuration="nobody-knows"))
    with pytest.raises(InputError, match="no ticks"):
        TrialWindow(recorded(tmp_path / "empty", ROWS[:0]))
    with pytest.raises(InputError):
        TrialWindow(tmp_path / "missing.parquet")


def test_it_says_which_trial_it_is_and_the_pointer_reads_each_curve(view: TrialView) -> None:
    text = " · ".join(label.text() for label in (view.title, view.about))
    for part in ("Participant 03, trial 7", "SDOF with gap", "three-brake", "path 1", "block 2", "in no table"):
        assert part in text
    at, row = QPointF(float(T[2000]), 0.0), ROWS[2000]
    assert view.traces.force.read_at(at) == f"2.000 s: {np.hypot(row[tick_log.HAND_FX], row[tick_log.HAND_FY]):.1f} N"
    currents = [f"{joint} {row[tick_log.CURRENT + i]:.2f} A" for i, joint in enumerate("AEB")]
    assert view.traces.currents.read_at(at) == f"2.000 s: {', '.join(currents)}"


def test_a_click_or_a_key_goes_to_its_moment_and_zooming_one_curve_zooms_all(view: TrialView) -> None:
    QApplication.processEvents()
    for trace, share in product(view.traces.all, (0.1, 0.93)):
        wanted = share * T[-1]
        height = 0.4 * trace.item.viewRange()[1][1]
        place = trace.graph.mapFromScene(trace.item.vb.mapViewToScene(QPointF(wanted, height)))
        view.go_to(0.0)
        QTest.mouseClick(trace.graph.viewport(), Qt.MouseButton.LeftButton, pos=place)
        assert T[view.tick] == pytest.approx(wanted, abs=2.0 * T[-1] / trace.item.vb.width())
        assert {line.marker.value() for line in view.traces.all} == {T[view.tick]}  # one cursor in all
    for key, at in ((Qt.Key.Key_End, LAST), (Qt.Key.Key_Home, 0), (Qt.Key.Key_Right, 100), (Qt.Key.Key_Left, 0)):
        QTest.keyClick(view, key)
        assert view.tick == pytest.approx(at, abs=2)
    assert all(f"{key}: {does}" in view.play_button.toolTip() for key, (does, _) in view.keys().items())
    speed = view.speed.value()
    QTest.keyClick(view, Qt.Key.Key_Up)
    assert view.speed.value() == SPEEDS[SPEEDS.index(speed) + 1]
    view.traces.force.item.setXRange(1.0, 1.05, padding=0.0)
    for trace in view.traces.all:
        assert trace.item.viewRange()[0] == pytest.approx([1.0, 1.05])
    seen = view.traces.force.curves[0].getData()[0]
    assert len(seen) >= 50 and np.diff(seen).max() == pytest.approx(0.001), "every tick is shown"


def test_space_and_the_button_play_and_pause_it_stops_at_the_end_and_begins_anew(qtbot, view: TrialView) -> None:
    view.speed.setCurrentIndex(SPEEDS.index(min(SPEEDS)))  # it must not come to its end
    QTest.keyClick(view, Qt.Key.Key_Space)
    assert view.playing and view.play_button.text() == "Pause"
    qtbot.waitUntil(lambda: view.tick > 20, timeout=60_000)
    QTest.mouseClick(view.play_button, Qt.MouseButton.LeftButton)
    at = view.tick
    QTest.qWait(50)
    assert not view.playing and view.tick == at and view.traces.error.marker.value() == T[at]
    view.go_to(T[-2])
    view.play_or_pause()
    view.go_on(1.0)
    view.frame()
    assert view.tick == LAST and not view.playing
    now, end = view.clock.text().removesuffix(" s").split(" / ")
    assert now == end, "no time is shown that the trial does not have"
    view.play_or_pause()
    assert view.tick <= start_of_hold(ROWS) + 1 and view.playing
    view.play_or_pause()


def test_it_shows_the_recording_however_its_frames_come_and_wherever_it_is_sent(view: TrialView) -> None:
    generator, shown = np.random.default_rng(3), view.workspace.view

    def is_shown() -> bool:
        return np.array_equal(trail_of(shown), way_of(ROWS[: view.tick + 1])) and is_painted(shown)

    view.go_to(0.0)
    for _, until in frames(ROWS, generator):
        view.go_on(float(T[until - 1]) - view.played_s + 1e-6)
        shown.grab()
    assert view.tick == LAST and is_shown()
    for at in generator.integers(len(ROWS) // 2, len(ROWS), 2):
        view.go_to(float(T[at]))
        assert is_shown() and shown.tip == tuple(ROWS[at, 2:4])
        view.go_on(0.05)
        assert is_shown()


def test_a_current_that_chatters_is_a_band_about_its_mean_and_no_solid_block(qtbot) -> None:
    t, currents = 0.001 * np.arange(3000), np.zeros((4, 3000))
    currents[3] = np.nan  # C has no brake
    currents[0, ::4] = 0.8  # on in one tick of four
    traces = TrialTraces()
    qtbot.addWidget(traces)
    traces.show()
    trace = traces.currents
    trace.names = dict(zip(JOINTS, JOINTS, strict=True))
    trace.show_trial(t, currents)
    x, mean = trace.means[0].getData()
    assert len(x) <= trace.graph.width() and mean == pytest.approx(0.2, abs=0.07)
    assert set(trace.curves[0].getData()[1]) == {0.0, 0.8}, "from the lowest to the highest"
    trace.show_cursor(1500)
    assert "A 0.80 on 2" in trace.figures.text()  # 25 % of the time, within a tick
    assert trace.figures.text().endswith("E 0.00 B 0.00")  # C has no brake
    trace.hidden = True
    trace.show_trial(t, currents)
    trace.show_cursor(1500)
    assert "blind" in trace.figures.text() and not any(curve.isVisible() for curve in (*trace.curves, *trace.means))


def test_the_same_hand_through_another_controller_stands_beside_once_the_folders_code_may_run(qtbot, tmp_path) -> None:
    session = closed_session(tmp_path / "data", 1, protocol=short())
    put_code(session.folder, "of a replay")
    window = TrialWindow(session.folder / session.rows[0].recording)
    qtbot.addWidget(window)
    window.show()
    view = window.view
    other = 4 if session.rows[0].controller != 4 else 2  # with the low gain it would come out as without
    for place in (0, 1):
        view.beside.setCurrentIndex(view.beside.findText(view.trial.controllers[other]))
        view.beside.activated.emit(view.beside.currentIndex())
        assert "odd.py" in view.cards.question.text.text() and "simulated" not in view.note.text()
        view.cards.question.buttons[place].click()
    assert "is being simulated" in view.note.text()
    qtbot.waitUntil(lambda: "compared" in view.measures.text(), timeout=120_000)
    assert "would feel the difference" in view.note.text()
    _, here, beside = (re.findall(r"([\d.]+) ", line) for line in view.measures.text().split("<tr>")[1:])
    assert len(here) == len(beside) == 4 and here[:3] != beside[:3]
    assert np.nanmax(view.traces.error.beside.getData()[1]) > 0.0
    view.compare(0)
    assert "compared" not in view.measures.text() and not len(view.traces.error.beside.getData()[1] or [])
