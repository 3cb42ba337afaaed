"""The Try page: one handle, one path, and everything that can be set acts at once; a table compares the passes."""

import math
from collections.abc import Callable

import numpy as np
from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QGridLayout, QWidget

from app.ipc import messages as m
from app.window.canvas.force_view import Layered, RefreshClock
from app.window.sandbox.controls import RIGHT_PX, Controls
from app.window.sandbox.pass_table import PassTable
from app.window.sandbox.pass_view import GAP, LAYERS, PassView
from app.window.widgets import theme, words
from app.window.widgets.keys import add_key
from app.window.widgets.page import Page
from app.window.widgets.parts import (
    NO_FOCUS,
    Figures,
    OneLine,
    Panel,
    button,
    column,
    row,
    text_label,
    wrapped_label,
)
from app.window.widgets.theme import COLOURS
from app.window.widgets.words import PREPARING, Shown
from core import tick_log
from experiments.protocol import Protocol

FIGURE, WIDEST_FIGURE = 22, "888.8 mm"  # px, of a figure; a longer one is written smaller
BESIDE_PX = 130  # of the page, beside and between head, figures and controls
SEND_MS = 40  # a slider that is dragged sends its newest value so often
BACK = Shown("Pass over", "The next one begins in the green circle")
GRASP = " (the grey disc)"  # behind what is to be touched
AWAY = Shown("Out of sight", "The arrow points to the handle; B brings it back to the start")
NO_PASS = "Each setting gets a row, its devices side by side"
JERK = "With a mouse, the pointer's own jerks are part of every DFT of acceleration, without control too"
READY = Shown("Ready", "Space starts a pass")
IN_SESSION = Shown("A session is open", "Close it on the Run page, then try things out here")


def choices_key(protocol: Protocol) -> tuple:
    """What the choices on the page depend on: with another one they are made anew."""
    devices = [(device.name, device.text) for device in protocol.devices]
    return devices, protocol.controllers, protocol.paths, protocol.obstacle, protocol.trial


class TryPage(Page):
    """Canvas and passes at the left, what can be set at the right."""

    def __init__(self, send: Callable[[object], None]) -> None:
        super().__init__(send)
        self._front = False
        self._reading = RefreshClock()
        self.canvas, self.table, self.controls = PassView(), PassTable(), Controls()
        self._timer = QTimer(self, singleShot=True, interval=SEND_MS)
        self._timer.timeout.connect(lambda: self.send(m.SetSandbox(self.controls.settings)))
        self.large, self.small = Figures(theme.LARGE, bold=True), wrapped_label("", "quiet", theme.TITLE)
        self.error, self.force, self.time = (Figures(FIGURE, bold=True) for _ in range(3))
        self.notice = OneLine("", "quiet", theme.NORMAL)
        self.start = button("Start a pass  Space", self._start, "main")
        back = "From wherever it is"
        self.bring = button("Handle to the start  B", lambda: send(m.BringBack()), "small", back)
        self.bring.setFocusPolicy(NO_FOCUS)
        add_key("B", self, self.bring.click)
        self._lay_out()
        self.controls.changed.connect(self._set)
        self.canvas.pointer_moved.connect(self.pointer_moved)
        self.canvas.pointer_left.connect(self.pointer_left)

    def _lay_out(self) -> None:
        over = QGridLayout(self.canvas)
        over.setContentsMargins(20, 10, 16, 4)
        over.setHorizontalSpacing(16)
        over.setVerticalSpacing(0)
        figures = {self.error: "path error", self.force: "tip force", self.time: "time"}  # in the order of the screen
        labels = {figure: text_label(name, "quiet", theme.SMALL) for figure, name in figures.items()}
        self.figures = [*labels, *labels.values()]
        for across, pair in enumerate(((self.large, self.small), *labels.items())):
            for part, down, to_its_line in zip(
                pair, (0, 1), (Qt.AlignmentFlag.AlignBottom, Qt.AlignmentFlag.AlignTop), strict=True
            ):
                over.addWidget(part, down, across, to_its_line)
        widest = math.ceil(theme.text_width(WIDEST_FIGURE, FIGURE, bold=True))
        for across, figure in enumerate(figures, start=1):
            figure.setFixedWidth(widest)
            over.setColumnMinimumWidth(across, widest)
        for label in self.canvas.findChildren(QWidget):
            label.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        over.setColumnStretch(0, 1)
        over.setRowStretch(2, 1)
        self.workspace, passes = Layered(self.canvas, LAYERS, over=False), Panel()
        self.workspace.foot.addWidget(self.bring)
        self.workspace.foot.addWidget(self.start)
        head = row(text_label("Passes", size=theme.TITLE, bold=True), self.notice)
        passes.setLayout(column(head, self.table, spacing=0, margins=(12, 2, 8, 6)))
        left = column((self.workspace, 1), passes, spacing=theme.GAP)
        self.setLayout(row((left, 1), self.controls, spacing=theme.GAP))
        self.start.hide()
        self.bring.setEnabled(False)  # until the server has answered
        self._show_status(PREPARING)
        self._clear_figures()

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._fit_head()
        super().resizeEvent(event)

    def _fit_head(self) -> None:
        """The figures give way where they would leave too little room for the line that says what to do."""
        beside = RIGHT_PX + BESIDE_PX + 3 * self.error.width()
        fits = self.width() - beside >= theme.text_width(BACK.large, theme.LARGE, bold=True)
        for label in self.figures:
            label.setVisible(fits)

    # ------------------------------------------------------------------------------------------- user actions

    def begin(self, what: object = None) -> None:
        self._front = True
        self.canvas.setFocus()
        self._ask()

    def end(self) -> None:
        self._front = False
        self._timer.stop()
        self.send(m.EndSandbox())

    def keys(self) -> dict[str, Callable[[], object]]:
        return {"start": self._start}

    def own_keys(self) -> dict[str, str]:
        guides = self.controls.guides.values()
        return {guide.key: f"{guide.accessibleName()}: {guide.feel.text()}" for guide in guides if guide.key} | {
            "B": "bring the handle back to the start",
            **self.workspace.keys,
        }

    def _ask(self) -> None:
        """Open Try on the server, unless a session is open."""
        if self._front and self.opened is not None and not self.opened.participant:
            self.send(m.SetSandbox(self.controls.settings))

    def _start(self) -> None:
        if self.start.isEnabled() and self.start.isVisible():
            self.send(m.Start())

    def _set(self) -> None:
        """Send a changed setting, a little later, and show the gap at once."""
        if not self._timer.isActive():
            self._timer.start()
        self._show_gap()

    def _show_gap(self) -> None:
        self.canvas.show_gap(self.controls.gap_m)
        self.workspace.layers[GAP].setEnabled(self.canvas.gap_m > 0.0)

    # ------------------------------------------------------------------------------------------- what the server sends

    def show_opened(self, opened: m.Opened) -> None:
        before, protocol = self.opened, opened.protocol
        super().show_opened(opened)
        if before is None or choices_key(before.protocol) != choices_key(protocol):
            self.controls.show_protocol(protocol)
            self.canvas.show_obstacles(protocol.obstacle)
            self.canvas.radii_m = (protocol.trial.start_radius_m, protocol.trial.end_radius_m)
            self.table.show_passes([], protocol)
        if before is None or before.participant:
            self._ask()

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        before = self.snapshot
        super().show_snapshot(snapshot)
        if self.opened is None:
            return
        now = snapshot.sandbox
        elsewhere = self.opened.participant or snapshot.brakes_off  # Run or the banner says it
        about = (JERK if words.hand_is_mouse(self.opened) else "") if now and now.passes else NO_PASS if now else ""
        self.notice.setText("" if elsewhere else snapshot.notice or about)
        theme.set_style(self.notice, "bad" if snapshot.notice_bad else "quiet")
        self.start.setVisible(now is not None and now.by_start)
        self.start.setEnabled(snapshot.running is None and not snapshot.brakes_off)
        self.bring.setVisible(not self.opened.real_device and words.hand_is_mouse(self.opened))
        self.bring.setEnabled(now is not None)
        if now is None:
            self.controls.show_settings(self.controls.settings, None)
            self.canvas.show_handle(None)
        else:
            self._show_settings(now, before)
            self._show_place(self.opened, now.settings, snapshot.tip, anew=before.sandbox is None)
            self._show_handle(before)
        if now is None or snapshot.running is None:
            self._show_status(self._status())
        if before.sandbox is None or now is None or before.sandbox.passes != now.passes:
            self.table.show_passes(now.passes if now is not None else [], self.opened.protocol)

    def _status(self) -> Shown:
        """The lines while no pass is running."""
        snapshot = self.snapshot
        if self.opened is not None and self.opened.participant:
            return IN_SESSION
        if snapshot.brakes_off:
            return Shown("Brakes off", "Ctrl+B turns them on")
        if snapshot.sandbox is None:
            return PREPARING._replace(small=snapshot.trial_blocker or PREPARING.small)
        return READY if snapshot.sandbox.by_start else Shown("One moment", snapshot.trial_blocker)

    def _show_settings(self, now: m.SandboxState, before: m.Snapshot) -> None:
        """The server's settings where they are new, or a setting was refused; else those that it has in a moment."""
        refused = self.snapshot.notice_bad and not before.notice_bad
        new = before.sandbox is None or before.sandbox.settings != now.settings or self.controls.settings is None
        theirs = not self._timer.isActive() and (new or refused)
        self.controls.show_settings(now.settings if theirs else self.controls.settings or now.settings, now)
        self._show_gap()

    def _show_handle(self, before: m.Snapshot) -> None:
        snapshot = self.snapshot
        if snapshot.running is not None:
            if before.running != snapshot.running:
                self.canvas.begin()
        elif snapshot.stage == m.PREPARING:  # nobody knows yet where it is
            self.canvas.show_handle(None)
        elif snapshot.brakes_off or (snapshot.sandbox is not None and snapshot.sandbox.by_start):
            self.canvas.rest(snapshot.tip)  # else the next pass begins at once

    def _show_place(self, opened: m.Opened, s: m.SandboxSettings, tip: m.Point, anew: bool) -> None:
        device, path, now = opened.protocol.device(s.device), opened.protocol.paths[s.path], self.canvas.instant
        if anew or now is None or now.device is not device or self.canvas.path is not path:
            self._clear_figures()
            self.canvas.show_trial(device, path, tip)

    def show_ticks(self, rows: np.ndarray, taken: bool) -> None:
        if self.snapshot.running is None or self.snapshot.sandbox is None:
            return
        now, phase = rows[-1], int(rows[-1, tick_log.PHASE])
        by_pointer = words.hand_is_mouse(self.opened)
        self.canvas.add(rows, taken if by_pointer else None)
        held = taken or not by_pointer
        said = BACK if phase == tick_log.END else words.moving(phase, held, words.language_of(self.opened))
        if not held:
            said = said._replace(small=f"{said.small}{GRASP}") if self.canvas.handle_seen else AWAY
        self._show_status(said)
        if not self._reading.due(float(now[tick_log.T])):
            return
        self.canvas.refresh_text()
        force_N = math.hypot(now[tick_log.HAND_FX], now[tick_log.HAND_FY])
        self.force.show_parts((f"{force_N:.1f} N", COLOURS.text))
        if phase in (tick_log.APPROACH, tick_log.HOLD):
            self._clear_figures(self.error, self.time)  # of the pass before
        elif phase == tick_log.MOVE:
            self.time.show_parts((f"{now[tick_log.T] - self.canvas.began_s:.1f} s", COLOURS.text))
            if math.isfinite(now[tick_log.PATH_DISTANCE]):
                self.error.show_parts((f"{1e3 * abs(now[tick_log.PATH_DISTANCE]):.1f} mm", COLOURS.text))

    def show_time(self, now_s: float) -> None:
        self.canvas.follow_pointer()

    def _show_status(self, shown: Shown) -> None:
        self.large.show_parts((shown.large, COLOURS.text))
        self.small.setText(shown.small)

    def _clear_figures(self, *figures: Figures) -> None:
        for figure in figures or (self.error, self.force, self.time):
            figure.show_parts(("–", COLOURS.text))
