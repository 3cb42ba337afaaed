"""The Try page: one handle, one path, and everything that can be set acts at once; a table compares the passes."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QFileDialog, QGridLayout, QWidget

from app.ipc import messages as m
from app.window.canvas.force_view import BRAKES, FORCE_COLOUR, FORCES, HAND, INSET_PX, Layered, RefreshClock
from app.window.sandbox.controls import RIGHT_PX, Controls
from app.window.sandbox.pass_table import PassTable
from app.window.sandbox.pass_view import GAP, LAYERS, PassView
from app.window.widgets import theme, words
from app.window.widgets.keys import add_key
from app.window.widgets.page import Page
from app.window.widgets.parts import NO_FOCUS, Figures, OneLine, Panel, button, column, row, text_label, wrapped_label
from app.window.widgets.theme import COLOURS
from app.window.widgets.words import PREPARING, Shown
from core import tick_log
from experiments.protocol import Protocol

FIGURE, WIDEST_FIGURE = 22, "88.8 mm"  # px, of a figure; a longer one is written smaller
BESIDE_PX = 120  # of the page, between and beside head, figures, inset and controls
NAMES, FORCE_PX = {HAND: "your hand", BRAKES: "brakes"}, 170  # of the forces; wide, each of their read-outs at most
SEND_MS = 40  # a slider that is dragged sends its newest value so often
BACK = Shown("Back to the start", "The next pass begins in the green circle")
AWAY = Shown("Out of sight", "The arrow points to the handle; B brings it back to the start")
NO_PASS = "No pass yet · each gets a row here, to compare"
COMPARED = "Bars compare · passes with the same settings"
READY = Shown("Ready", "Space starts a pass")
IN_SESSION = Shown("A session is open", "Close it on the Run page, then try things out here")


def choices_key(protocol: Protocol) -> tuple:
    """What the choices on the page depend on: with another one they are made anew."""
    devices = [(device.name, device.text) for device in protocol.devices]
    return devices, protocol.controllers, protocol.paths, protocol.obstacle, protocol.trial


class TryPage(Page):
    """Canvas and passes at the left, everything that can be set at the right."""

    def __init__(self, send: Callable[[object], None]) -> None:
        super().__init__(send)
        self._theirs: m.SandboxSettings | None = None  # the server's newest; it has what is set SEND_MS later
        self._front, self._cleared = False, 0  # cleared: number of the last pass that is not shown
        self._place: tuple[str, int] | None = None  # device and path on the canvas
        self._reading = RefreshClock()
        self.canvas, self.table, self.controls = PassView(), PassTable(), Controls()
        self._timer = QTimer(self, singleShot=True, interval=SEND_MS)
        self._timer.timeout.connect(lambda: self.send(m.SetSandbox(self.controls.settings)))
        self.large, self.small = Figures(theme.LARGE, bold=True), wrapped_label("", "quiet", theme.TITLE)
        self.error, self.time = Figures(FIGURE, bold=True), Figures(FIGURE, bold=True)
        self.forces = {whose: Figures(theme.TITLE, bold=True) for whose in NAMES}
        self.notice = OneLine("", "quiet", theme.NORMAL)
        self.start = button("Start a pass  Space", self._start, "main")
        back = "The handle to the start, from wherever it is"
        self.bring = button("Bring it back  B", lambda: send(m.BringBack()), "small", back)
        self.bring.setFocusPolicy(NO_FOCUS)
        add_key("B", self, self.bring.click)
        self.clear = button("Clear", self._clear, "small")
        self.save = button("Save as protocol …", self._save, "small")
        self._lay_out()
        self.controls.changed.connect(self._set)
        self.canvas.pointer_moved.connect(self.pointer_moved)
        self.canvas.pointer_left.connect(self.pointer_left)

    def _lay_out(self) -> None:
        over = QGridLayout(self.canvas)
        over.setContentsMargins(20, 10, INSET_PX + 30, 4)
        over.setHorizontalSpacing(26)
        figures = (self.error, text_label("from the line", "quiet")), (self.time, text_label("this pass", "quiet"))
        to_its_line = Qt.AlignmentFlag.AlignBottom, Qt.AlignmentFlag.AlignTop
        self.figures = [label for labels in figures for label in labels]
        for across, labels in enumerate(((self.large, self.small), *figures)):
            for down, label in enumerate(labels):
                over.addWidget(label, down, across, to_its_line[down])
        over.addLayout(row(*self.forces.values(), 0), 3, 0, 1, 3)
        for label in self.canvas.findChildren(QWidget):
            label.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        over.setVerticalSpacing(0)
        over.setColumnStretch(0, 1)
        over.setRowStretch(2, 1)
        self.workspace, passes = Layered(self.canvas, LAYERS, over=False), Panel()
        self.workspace.layers[FORCES].toggled.connect(lambda _: self._show_forces())
        self.workspace.foot.addWidget(self.bring)
        self.workspace.foot.addWidget(self.start)
        head = row(text_label("Passes", size=theme.TITLE, bold=True), self.notice, self.clear, self.save)
        passes.setLayout(column(head, self.table, margins=(14, 8, 10, 8)))
        left = column((self.workspace, 2), (passes, 1), spacing=theme.GAP)
        self.setLayout(row((left, 1), self.controls, spacing=theme.GAP))
        self.start.hide()
        for pressed in (self.bring, self.clear, self.save):  # until the server has answered
            pressed.setEnabled(False)
        self._show_status(PREPARING)
        self._clear_figures()
        for figure in (self.error, self.time):
            figure.setFixedWidth(math.ceil(theme.text_width(WIDEST_FIGURE, FIGURE, bold=True)))
        for force in self.forces.values():
            force.setMaximumWidth(FORCE_PX)

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._fit_head()
        super().resizeEvent(event)

    def _fit_head(self) -> None:
        """The figures give way where they would leave too little room for the line that says what to do."""
        beside = RIGHT_PX + INSET_PX + BESIDE_PX + self.error.width() + self.time.width()
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
        return {guide.key: f"{guide.feel.text()}: {guide.accessibleName()}" for guide in guides if guide.key} | {
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

    def _clear(self) -> None:
        if self.snapshot.sandbox is not None and self.snapshot.sandbox.passes:
            self._cleared = self.snapshot.sandbox.passes[-1].number
            self._show_passes()

    def _save(self) -> None:
        plain = QFileDialog.Option.DontConfirmOverwrite  # the server overwrites nothing
        path, _ = QFileDialog.getSaveFileName(
            self, "Save as protocol", str(Path.home() / "tried.toml"), "TOML (*.toml)", options=plain
        )
        if path:
            self.send(m.SaveAsProtocol(path if path.endswith(".toml") else f"{path}.toml"))

    # ------------------------------------------------------------------------------------------- what the server sends

    def show_opened(self, opened: m.Opened) -> None:
        before, protocol = self.opened, opened.protocol
        super().show_opened(opened)
        if before is None or choices_key(before.protocol) != choices_key(protocol):
            self._theirs = self._place = None
            self.controls.show_protocol(protocol)
            self.canvas.show_obstacles(protocol.obstacle)
            self.canvas.radii_m = (protocol.trial.start_radius_m, protocol.trial.end_radius_m)
        if before is None or before.participant:
            self._ask()

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        before = self.snapshot
        super().show_snapshot(snapshot)
        if self.opened is None:
            return
        now, settings = snapshot.sandbox, self.controls.settings
        off = Shown("Brakes off", "Press Ctrl+B to allow them") if snapshot.brakes_off else None
        elsewhere = self.opened.participant or snapshot.brakes_off  # Run or the banner says it
        about = "" if now is None else COMPARED if now.passes else NO_PASS
        self.notice.setText("" if elsewhere else snapshot.notice or about)
        theme.set_style(self.notice, "bad" if snapshot.notice_bad else "quiet")
        self.save.setEnabled(now is not None)
        self.start.setVisible(now is not None and now.by_start)
        self.start.setEnabled(snapshot.running is None and not snapshot.brakes_off)
        self.bring.setVisible(not self.opened.real_device and words.hand_is_mouse(self.opened))
        self.bring.setEnabled(now is not None)
        if now is None:
            self.controls.show_settings(settings, None)
            self.canvas.show_handle(None)
            self._place = None
            wait = PREPARING._replace(small=snapshot.trial_blocker or PREPARING.small)
            self._show_status(IN_SESSION if self.opened.participant else off or wait)
        else:
            refused = snapshot.notice_bad and not before.notice_bad
            if not self._timer.isActive() and (settings is None or now.settings != self._theirs or refused):
                settings = now.settings
            self._theirs = now.settings
            self._show_place(self.opened, now.settings, snapshot.tip)
            self.controls.show_settings(settings, now)
            self._show_gap()
            if snapshot.running is None:
                self._show_status(off or (READY if now.by_start else Shown("One moment", snapshot.trial_blocker)))
                if snapshot.stage == m.PREPARING:  # nobody knows yet where it is
                    self.canvas.show_handle(None)
                elif off or now.by_start:  # else the next pass begins at once
                    self.canvas.rest(snapshot.tip)
            elif before.running != snapshot.running:
                self.canvas.begin()
        self._show_forces()
        if before.sandbox is None or now is None or before.sandbox.passes != now.passes:
            self._show_passes()

    def show_ticks(self, rows: np.ndarray, taken: bool) -> None:
        if self.snapshot.running is None or self._place is None:
            return
        now, phase = rows[-1], int(rows[-1, tick_log.PHASE])
        by_pointer = words.hand_is_mouse(self.opened)
        self.canvas.add(rows, taken if by_pointer else None)
        held = taken or not by_pointer
        said = words.moving(phase, held, words.language_of(self.opened)) or BACK
        self._show_status(said if held or self.canvas.handle_seen else AWAY)
        if not self._reading.due(float(now[tick_log.T])):
            return
        self.canvas.refresh_text()
        self._show_forces()
        if phase == tick_log.MOVE:
            self.time.show_parts((f"{now[tick_log.T] - self.canvas.began_s:.1f} s", COLOURS.text))
            if math.isfinite(now[tick_log.PATH_DISTANCE]):
                self.error.show_parts((f"{1e3 * abs(now[tick_log.PATH_DISTANCE]):.1f} mm", COLOURS.text))

    def show_time(self, now_s: float) -> None:
        self.canvas.follow_pointer()

    def _show_status(self, shown: Shown) -> None:
        self.large.show_parts((shown.large, COLOURS.text))
        self.small.setText(shown.small)

    def _show_forces(self) -> None:
        shown = FORCES in self.canvas.shown and self.canvas.tip is not None
        for whose, force in self.forces.items():
            text = f"{NAMES[whose]} {self.canvas.force_texts[whose]}" if shown else ""
            force.show_parts((text, FORCE_COLOUR[whose]))

    def _clear_figures(self) -> None:
        for figure in (self.error, self.time):
            figure.show_parts(("–", COLOURS.text))

    def _show_place(self, opened: m.Opened, s: m.SandboxSettings, tip: m.Point) -> None:
        if self._place != (s.device, s.path):
            self._place = s.device, s.path
            self._clear_figures()
            self.canvas.show_trial(opened.protocol.device(s.device), opened.protocol.paths[s.path], tip)

    def _show_passes(self) -> None:
        now = self.snapshot.sandbox
        if now is not None and self.opened is not None:
            shown = [ended for ended in now.passes if ended.number > self._cleared]
            self.table.show_passes(shown, self.opened.protocol)
            self.clear.setEnabled(bool(shown))
        else:
            self.clear.setEnabled(False)
