"""A recorded trial: its workspace, its curves with one cursor, its measures, and its hand through another controller.

A page of Analyse, or all of `trial_window`.
"""

import math
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QKeyEvent, QKeySequence

from app.window.analyse.trial_traces import BESIDE, TrialTraces
from app.window.canvas.force_view import RefreshClock
from app.window.canvas.linkage_view import Workspace
from app.window.widgets import theme
from app.window.widgets.cards import Cards
from app.window.widgets.own_code import ask_own_code
from app.window.widgets.parts import Choice, OneLine, Panel, button, column, row, text_label, wrapped_label
from app.window.widgets.plots import NOTHING, start_of_hold
from app.window.widgets.theme import COLOURS, colour_at
from app.window.widgets.words import in_colour
from app.window.widgets.work import BackgroundTask, VerbProcess
from core import tick_log
from core.files import InputError
from experiments.analysis.metrics import BY_NAME, DRAWN, METRICS
from experiments.analysis.trials_table import COUNTED, TrialRow
from experiments.study.playback import Comparison, Playback, read_comparison

FRAME_MS = 16
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
STEP_S = 0.1  # of an arrow key
NEAR_S = 0.12  # what brakes do, and the words on the workspace, are taken from the newest ticks
MEASURES = (*DRAWN, BY_NAME["duration_s"])
COMPARE = "Compare with …"
WHOLE_TIME = "The clock begins with the approach; Duration is the movement."
Values = Mapping[str, float | None]  # measure -> value


def measures_table(recorded: Values, beside: Values | None = None) -> str:
    """The measures of a trial, and below them those of its hand through another controller, which has a line anyway."""
    lines = [(COLOURS.quiet, ["", *(metric.title for metric in MEASURES)])]
    for colour, name, values in ((COLOURS.text, "recorded", recorded), (BESIDE, "compared", beside)):
        shown = [values.get(metric.name) for metric in MEASURES] if values is not None else []
        cells = [
            f"{metric.scale * value:.{metric.decimals}f} {metric.shown_unit}" if value is not None else NOTHING
            for metric, value in zip(MEASURES, shown, strict=False)
        ]
        lines.append((colour, [name, *cells] if values is not None else ["\u00a0"]))
    cells_of = ("".join(f"<td>{in_colour(cell, colour)}</td>" for cell in cells) for colour, cells in lines)
    return f"<table width=100% cellspacing=0 cellpadding=1><tr>{'</tr><tr>'.join(cells_of)}</tr></table>"


class TrialView(Panel):
    """One trial at one moment; time goes on while it plays. What was asked for and cannot be read is a sentence."""

    stepped = Signal(int)  # -1, 1: the trial before, the next one
    exclude_asked = Signal()

    def __init__(self, whole: bool = False) -> None:
        """whole: a window of its own, without the buttons of the page."""
        super().__init__()
        self.trial: Playback | None = None
        self._values: Values = {}  # the trial's measures
        self._other: Comparison | None = None  # its hand through another controller
        self.tick = 0  # the tick that is shown
        self._whole, self.played_s, self._clock_s, self._numbers = whole, 0.0, 0.0, RefreshClock()
        self._timer = QTimer(self)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self.frame)
        self.dot, self.title = text_label("●", size=theme.TITLE), OneLine("", "", theme.NORMAL, bold=True)
        self.about, self.measures = OneLine(""), wrapped_label("", size=theme.SMALL)
        self.measures.setTextFormat(Qt.TextFormat.RichText)
        self.note = OneLine("", "quiet")
        self.exclude = button(
            "Exclude …", self.exclude_asked.emit, "small", "For a reason; the recording is kept (Alt+X)"
        )
        self.workspace = Workspace()
        self.workspace.hide()  # until there is a trial
        self.traces = TrialTraces()
        self.traces.asked.connect(self.go_to)
        self.play_button, self.clock = button("", self.play_or_pause), text_label("")
        self.decision = OneLine("", "quiet")
        self.traces.currents.head.insertWidget(1, self.decision, 2)
        self.speed, self.beside = Choice(), Choice()
        self.speed.fill({speed: f"{speed:g} ×" for speed in SPEEDS}, 1.0)
        self.play_button.setToolTip("; ".join(f"{key}: {does}" for key, (does, _) in self.keys().items()))
        self.beside.setToolTip("The recorded hand, simulated through another controller")
        self.beside.activated.connect(lambda _: self.compare(self.beside.value()))
        self.cards = Cards(self)
        self.replay, self._reading = VerbProcess(self._replayed), BackgroundTask(self._show_beside)
        self._folder: tempfile.TemporaryDirectory | None = None  # of the replayed ticks, there as long as it is held
        self._table = Path()  # these
        self.steps = (
            button("‹", lambda: self.stepped.emit(-1), "small", "The trial before"),
            button("›", lambda: self.stepped.emit(1), "small", "The next trial"),
        )
        for widget in (self.play_button, self.speed, self.beside, self.exclude, *self.steps):
            widget.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setFocusPolicy(Qt.FocusPolicy.ClickFocus)
        self._lay_out()
        self._show_playing()
        theme.follow(self._show_measures)

    def _lay_out(self) -> None:
        middle = row((self.workspace, 5), (self.traces, 4))
        self.setLayout(column(
            row(self.dot, self.title, self.exclude, *self.steps), self.about, self.measures,
            (middle, 1), row(self.play_button, self.speed, self.clock, (self.beside, 1)),
            self.note, spacing=5, margins=(12, 8, 12, 10),
        ))  # fmt: skip
        for step in self.steps:
            step.setVisible(not self._whole)
        self.exclude.hide()

    # which trial

    def show_trial(self, trial: Playback | InputError) -> None:
        """Another trial, from its beginning; or why it cannot be shown."""
        self.end()
        self.exclude.hide()
        if isinstance(trial, InputError):
            self.note_that(str(trial), bad=True)
            return
        self.trial = trial
        row = trial.row
        theme.set_style(self.dot, colour_at(trial.colour))
        self.title.setText(f"P{trial.title[1:]}")
        status = (
            f"{row.status if row is not None else 'in no table'}{' · damaged: some ticks are missing' * trial.damaged}"
        )
        self.about.setText(f"{trial.controller} · {trial.about} · {status}")
        self._values = {m.name: row.value(m.name) for m in METRICS} if row is not None else {}
        lines = [
            f"{m.title}: {m.scale * v:.3g} {m.shown_unit}"
            for m in METRICS if (v := self._values.get(m.name)) is not None
        ]  # fmt: skip
        own = row.own if row is not None else {}  # by their names, which end in their units
        self.measures.setToolTip("\n".join([*lines, *(f"{name}: {value:.3g}" for name, value in own.items())]))
        self.note_that(
            f"This trial is excluded: {trial.excluded}." if trial.excluded else WHOLE_TIME, bad=bool(trial.excluded)
        )
        self.exclude.setVisible(not self._whole and row is not None and row.status in COUNTED)
        self._set_up_workspace(trial)
        self.traces.show_trial(trial)
        self._show_beside(None)
        self.beside.fill({0: COMPARE, **({} if trial.blind else trial.controllers)}, 0)
        self.beside.setEnabled(self.beside.count() > 1)
        self.go_to(float(trial.t[-1]))  # all of its way is seen

    def show_row(self, row: TrialRow, name: str, colour: str) -> None:
        """A trial is being read, or has no recording: row, name and colour of its controller are all there is."""
        theme.set_style(self.dot, colour)
        self.title.setText(f"Participant {row.participant}, {name}")
        self.exclude.hide()
        if not row.recording:
            self.note_that(f"This trial was {row.status}: there is no recording.", bad=True)

    def note_that(self, text: str, bad: bool = False) -> None:
        """Show a sentence under the trial."""
        theme.set_style(self.note, "caution" if bad else "quiet")
        self.note.setText(text)

    def _set_up_workspace(self, trial: Playback) -> None:
        self.workspace.view.show_places((trial.device,), {1: trial.way})
        self.workspace.set_blind(trial.blind)
        self.workspace.view.show_obstacles(trial.obstacles)
        self.workspace.show()

    # which moment

    @property
    def playing(self) -> bool:
        return self._timer.isActive()

    def play_or_pause(self) -> None:
        """Space; at the end it begins anew."""
        if self.playing or self.trial is None:
            self._stop()
            return
        if self._over:
            self.go_to(float(self.trial.t[start_of_hold(self.trial.ticks)]))
        self._clock_s = time.perf_counter()
        self._timer.start(FRAME_MS)
        self._show_playing()

    def frame(self) -> None:
        """Time goes on: show the ticks until now."""
        now = time.perf_counter()
        self.go_on(self.speed.value() * (now - self._clock_s))
        self._clock_s = now
        if self._over:
            self._stop()

    @property
    def _over(self) -> bool:
        return self.trial is None or self.tick >= len(self.trial.ticks) - 1

    def go_on(self, seconds: float) -> None:
        """Play so much further (s, > 0)."""
        if (trial := self.trial) is None:
            return
        self.played_s = min(self.played_s + seconds, float(trial.t[-1]))
        at = min(int(np.searchsorted(trial.t, self.played_s, side="right")), len(trial.ticks)) - 1
        if at > self.tick:
            self.workspace.view.add(trial.ticks[self.tick + 1 : at + 1])
            self._show_place(trial, at)

    def go_to(self, seconds: float) -> None:
        """Any moment (s since the first tick): as if the ticks until then had just been played."""
        if (trial := self.trial) is None:
            return
        ticks, t = trial.ticks, trial.t
        self.played_s = float(np.clip(seconds, 0.0, t[-1]))
        at = int(np.clip(np.searchsorted(t, self.played_s, side="right") - 1, 0, len(t) - 1))
        near = int(np.searchsorted(t, t[at] - NEAR_S))
        first = tuple(ticks[0, tick_log.TIP_X : tick_log.TIP_Y + 1].tolist())
        self.workspace.view.show_trial(trial.device, trial.way, first)
        self.workspace.view.add(ticks[: at + 1], read_from=near)
        self._numbers = RefreshClock()
        self._show_place(trial, at)

    def _show_place(self, trial: Playback, at: int) -> None:
        self.tick = at
        self.traces.show_cursor(at)
        now = trial.ticks[at]
        if self._numbers.due(float(now[tick_log.T])):
            self.workspace.view.refresh_text()
        self.clock.setText(f"{self.played_s:.2f} / {trial.t[-1]:.2f} s")
        word_of = trial.decisions[int(now[tick_log.DECISION])]
        speed = f"{np.hypot(now[tick_log.TIP_VX], now[tick_log.TIP_VY]):.2f} m/s"
        self.decision.setText(speed if trial.blind else f"{speed} · Controller: {word_of}")

    def _stop(self) -> None:
        self._timer.stop()
        self._show_playing()

    def _show_playing(self) -> None:
        self.play_button.setText("Pause" if self.playing else "Play")

    # the same hand through another controller

    def compare(self, controller: int) -> None:
        """Show the hand through this controller of the protocol beside the trial; 0: nothing."""
        self._forget_replay()
        self._show_beside(None)
        self.cards.leave()
        self.note_that("")
        if controller and self.trial is not None:
            session = self.trial.path.absolute().parent.parent
            ask_own_code(self.cards, self, session, lambda: self._begin_replay(controller))

    def _begin_replay(self, controller: int) -> None:
        self.note_that("The recorded hand is being simulated …")
        if self.trial is not None:
            self._folder = tempfile.TemporaryDirectory(prefix="phd-replay-")
            self._table = Path(self._folder.name) / "ticks.csv"
            asked = ("--controller", str(controller), "--out", str(self._table), "--json")
            self.replay.begin("replay", str(self.trial.path), *asked)

    def _replayed(self, summary: str | InputError) -> None:
        if isinstance(summary, InputError):
            self._show_beside(summary)
        else:
            self._reading.ask(read_comparison, self._table, summary)

    def _forget_replay(self) -> None:
        for work in (self.replay, self._reading):
            work.forget()
        self.replay.stop()

    def _show_beside(self, other: Comparison | InputError | None) -> None:
        if isinstance(other, InputError):
            self.note_that(str(other), bad=True)
            return
        self._other = other
        self.traces.show_beside(other)
        self._show_measures()
        tips = np.empty((0, 2))
        if other is not None:
            far = " What was recorded is measured as far as both went." if other.recorded else ""
            ended = f"It ended as {other.status}. " if other.status != "done" else ""
            self.note_that(f"{ended}{other.text}{far}")
            tips = other.ticks[:, (tick_log.TIP_X, tick_log.TIP_Y)]
        self.workspace.view.show_beside(tips, BESIDE)

    def _show_measures(self) -> None:
        if self.trial is not None:
            recorded = self._other.recorded if self._other is not None else None
            beside = self._other.metrics if self._other is not None else None
            self.measures.setText(measures_table(recorded or self._values, beside))

    # keys and the end

    def keys(self) -> dict[str, tuple[str, Callable[[], object]]]:
        """The keys of a player, while the focus is here: what each does, in words and in deed."""
        index = self.speed.currentIndex()
        return {
            "Space": ("play or pause", self.play_or_pause),
            "Left": (f"{STEP_S:g} s back", lambda: self.go_to(self.played_s - STEP_S)),
            "Right": (f"{STEP_S:g} s on", lambda: self.go_to(self.played_s + STEP_S)),
            "Home": ("to the beginning", lambda: self.go_to(0.0)),
            "End": ("to the end", lambda: self.go_to(math.inf)),
            "Up": ("faster", lambda: self.speed.setCurrentIndex(min(index + 1, len(SPEEDS) - 1))),
            "Down": ("slower", lambda: self.speed.setCurrentIndex(max(index - 1, 0))),
        }

    def keyPressEvent(self, event: QKeyEvent) -> None:
        _, act = self.keys().get(QKeySequence(event.key()).toString(), ("", None))
        if act is None:
            super().keyPressEvent(event)
        else:
            act()

    def end(self) -> None:
        """Stop playing, and the replay."""
        self._stop()
        self._forget_replay()
