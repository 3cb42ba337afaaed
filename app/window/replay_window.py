"""A recorded trial on the screen, as the console showed it: play, pause, faster, slower, any moment of it."""

import gc
import sys
import time
from pathlib import Path

import numpy as np
from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QCloseEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QApplication,
    QHBoxLayout,
    QPushButton,
    QSizePolicy,
    QSlider,
    QVBoxLayout,
    QWidget,
)

from app.window.energy_panel import EnergyPanel
from app.window.painting import theme
from app.window.painting.labels import Choice, OneLine, word
from app.window.painting.layers import fill_field
from app.window.painting.linkage_view import Workspace
from app.window.painting.theme import show_whole
from app.window.plots import WINDOW_S, Traces
from core import tick_log
from core.device import Device, load_device
from core.files import InputError
from core.path import PathFile, Segment, build_path, path_from
from experiments.recording.reader import read_recording
from experiments.recording.schema import Recording, recording_columns
from experiments.session.files import STORED, read_stored

FRAME_MS = 16
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
STEP_S = 0.1  # of an arrow key
LARGEST = (1280, 720)  # px, as it opens
STRIDE = 8  # of the ticks that a jump takes in: all of them would take too long
SLIDER = f"""
QSlider {{ background: transparent; }}
QSlider::groove:horizontal {{ height: 4px; background: {theme.LINE}; border-radius: 2px; }}
QSlider::sub-page:horizontal {{ background: {theme.ACCENT}; border-radius: 2px; }}
QSlider::handle:horizontal {{ width: 14px; height: 14px; margin: -5px 0; border-radius: 7px;
    background: {theme.TEXT}; }}
"""


def ticks_of(recording: Recording, path: PathFile) -> np.ndarray:
    """The tick log (n, tick_log.WIDTH) of a recording of this path; text columns with the codes of this program."""
    rows = np.zeros((recording.rows, tick_log.WIDTH))
    for name, place in recording_columns(recording.braked):
        if name in recording.columns:  # earlier versions recorded fewer
            rows[:, place] = recording.column(name)
    for name, place, words in (
        ("phase", tick_log.PHASE, tick_log.PHASES),
        ("stuck", tick_log.STUCK, tick_log.STUCK_LETTERS),
    ):
        codes = np.array([words.index(text) for text in recording.words[name]], dtype=float)
        rows[:, place] = codes[recording.column(name)]
    if "travel_sense" not in recording.columns:
        fill_field(build_path(path, "path"), rows)
    return rows


def device_of(recording: Recording) -> Device:
    """The device as its session stored it; a recording by itself: the shipped device of that name."""
    name = str(recording.metadata.get("configuration", ""))
    session = recording.path.resolve().parent.parent
    if (session / STORED).exists():
        for device in read_stored(session).protocol.devices:
            if device.name == name:
                return device
    return load_device(name)


def path_of(recording: Recording) -> PathFile:
    """The path of the trial."""
    about = recording.metadata
    if "path" in about:
        return path_from(about["path"], f"{recording.path}: path")
    if "start_m" not in about or "end_m" not in about:
        raise InputError(f"{recording.path}: the metadata lack the path")
    return Segment(tuple(about["start_m"]), tuple(about["end_m"]))


class ReplayWindow(QWidget):
    """One recording, from its first tick to its last."""

    def __init__(self, path: Path, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.recording = read_recording(path)
        if not self.recording.rows:
            raise InputError(f"{path}: there are no ticks to play")
        self.device, self._path = device_of(self.recording), path_of(self.recording)
        self.rows = ticks_of(self.recording, self._path)
        self._times = self.rows[:, tick_log.T] - self.rows[0, tick_log.T]
        self.at = 0  # ticks shown so far
        self._clock_s, self._played_s = 0.0, 0.0  # when the last frame was; how far in the trial, s
        self.setWindowTitle(f"phd: {path.name}")
        self.workspace = Workspace((self.device,), {1: self._path})
        self.traces, self.energy = Traces(), EnergyPanel()
        self.head = OneLine(self._says(), "", theme.NORMAL, dots=Qt.TextElideMode.ElideRight)
        self.play_button = QPushButton()
        self.play_button.setFixedWidth(120)
        self.play_button.clicked.connect(self.play_or_pause)
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setStyleSheet(SLIDER)
        self.slider.setRange(0, len(self.rows))
        self.slider.valueChanged.connect(self._scrubbed)
        self.clock, self.decision = word(""), OneLine("", "quiet")
        self.speed = Choice()
        for speed in SPEEDS:
            self.speed.addItem(f"{speed:g} ×", speed)
        self.speed.setCurrentIndex(SPEEDS.index(1.0))
        for widget in (self.play_button, self.slider, self.speed):
            widget.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self._timer = QTimer(self)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self.frame)
        self._lay_out()
        self._bind()
        self.resize(*LARGEST)
        self.seek(0)
        self._show_playing()

    def _lay_out(self) -> None:
        right, middle, foot = QVBoxLayout(), QHBoxLayout(), QHBoxLayout()
        right.setSpacing(theme.GAP)
        right.addWidget(self.traces, 1)
        right.addWidget(self.energy)
        middle.setSpacing(theme.GAP)
        middle.addWidget(self.workspace, 17)
        middle.addLayout(right, 10)
        foot.setSpacing(theme.GAP)
        self.clock.setFixedWidth(120)
        self.decision.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Preferred)
        self.decision.setFixedWidth(240)
        foot.addWidget(self.play_button)
        foot.addWidget(self.slider, 1)
        for widget in (self.clock, self.decision, self.speed):
            foot.addWidget(widget)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(16, 12, 16, 12)
        layout.setSpacing(theme.GAP)
        layout.addWidget(self.head)
        layout.addLayout(middle, 1)
        layout.addLayout(foot)

    def _bind(self) -> None:
        key = Qt.Key
        for pressed, do in (
            (key.Key_Space, self.play_or_pause),
            (key.Key_Left, lambda: self.step(-STEP_S)),
            (key.Key_Right, lambda: self.step(STEP_S)),
            (key.Key_Home, lambda: self.seek(0)),
            (key.Key_End, lambda: self.seek(len(self.rows))),
            (key.Key_Up, lambda: self.speed.setCurrentIndex(min(self.speed.currentIndex() + 1, len(SPEEDS) - 1))),
            (key.Key_Down, lambda: self.speed.setCurrentIndex(max(self.speed.currentIndex() - 1, 0))),
            (key.Key_Escape, self.close),
        ):
            QShortcut(QKeySequence(pressed), self, do)

    def _says(self) -> str:
        """Which trial this is."""
        about = self.recording.metadata
        parts = [
            f"Participant {about.get('participant', '?')}",
            f"run {about.get('run', '?')}",
            self.device.name,
            about.get("preset", {}).get("name") or f"controller {about.get('controller', '?')}",
            f"path {about.get('segment', '?')}",
            str(self.recording.outcome.get("status", "no end record")),
        ]
        if self.recording.damaged:
            parts.append("damaged: some ticks are missing")
        return " · ".join(parts)

    # playing

    @property
    def playing(self) -> bool:
        """Whether time goes on by itself."""
        return self._timer.isActive()

    def play_or_pause(self) -> None:
        """Space; at the end it begins anew."""
        if self.playing:
            self._timer.stop()
        else:
            if self.at >= len(self.rows):
                self.seek(0)
            self._clock_s = time.perf_counter()
            self._timer.start(FRAME_MS)
        self._show_playing()

    def frame(self) -> None:
        """Time goes on: show the ticks until now."""
        now = time.perf_counter()
        self.go_on(self.speed.currentData() * (now - self._clock_s))
        self._clock_s = now
        if self.at >= len(self.rows) and self.playing:
            self.play_or_pause()

    def go_on(self, seconds: float) -> None:
        """So much further in the trial (s, > 0)."""
        self._played_s += seconds
        until = int(np.searchsorted(self._times, self._played_s, side="right"))
        if until > self.at:
            new = self.rows[self.at : until]
            for part in (self.workspace, self.traces, self.energy):
                part.add(new)
            self._show_place(until)

    def step(self, seconds: float) -> None:
        """A little forwards or back."""
        at = float(np.clip(self._played_s + seconds, 0.0, self._times[-1]))
        self.seek(int(np.searchsorted(self._times, at)))

    def seek(self, until: int) -> None:
        """Any moment: as if the first `until` ticks had just been played."""
        seen = self.rows[: max(until, 1)]
        tips = seen[:, (tick_log.TIP_X, tick_log.TIP_Y)]
        self.workspace.show_trial(self.device, self._path, (float(tips[0, 0]), float(tips[0, 1])))
        self.workspace.view.show_way(tips[seen[:, tick_log.PHASE] == tick_log.MOVE][::STRIDE])
        self.traces.show_trial(self.device)
        self.energy.clear()
        self.workspace.add(np.concatenate((seen[:-1:STRIDE], seen[-1:])))
        self.traces.add(seen[seen[:, tick_log.T] > seen[-1, tick_log.T] - WINDOW_S])
        self.energy.add(seen)
        self._played_s = float(self._times[len(seen) - 1])
        self._show_place(until)

    def _scrubbed(self, until: int) -> None:
        if until != self.at:
            self.seek(until)

    def _show_place(self, until: int) -> None:
        self.at = until
        self.slider.setValue(until)
        self.clock.setText(f"{self._played_s:.2f} / {self._times[-1]:.2f} s")
        code = int(self.rows[max(until - 1, 0), tick_log.DECISION])
        self.decision.setText(f"decision: {self.recording.words['decision'][code]}")

    def _show_playing(self) -> None:
        self.play_button.setText("Pause  Space" if self.playing else "Play  Space")

    def closeEvent(self, event: QCloseEvent) -> None:
        self._timer.stop()
        super().closeEvent(event)


def run(path: Path) -> int:
    """Play a recording in a window of its own until it is closed. InputError if there is nothing to play."""
    application = QApplication(sys.argv[:1])
    theme.dress(application)
    window = ReplayWindow(path)
    show_whole(window, *LARGEST)
    gc.collect()
    gc.freeze()  # else looking through all that was imported costs 50 ms now and then
    return application.exec()
