"""The Run page: plan and commands at the left, the workspace, and at the right the running trial's curves or the card
of the trial that has just ended."""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from PySide6.QtGui import QResizeEvent

from app.ipc import messages as m
from app.window.canvas.force_view import RefreshClock
from app.window.canvas.linkage_view import Workspace
from app.window.participant.questionnaire import Questionnaire
from app.window.run.actions import Actions, possible
from app.window.run.energy_panel import EnergyPanel
from app.window.run.session_cards import ABORT, REDO, SKIP, SessionCards
from app.window.run.session_panel import SessionPanel
from app.window.run.trial_card import TrialCard
from app.window.widgets import theme, words
from app.window.widgets.cards import EXCLUDE, Ask
from app.window.widgets.page import Page
from app.window.widgets.parts import (
    PART,
    Figures,
    KeyButton,
    column,
    holder,
    keep_room,
    panel,
    row,
    stack,
    text_label,
    wrapped_label,
)
from app.window.widgets.plots import TimingStrip, Traces
from app.window.widgets.preflight import advice
from app.window.widgets.theme import COLOURS
from app.window.widgets.words import describe, feedback, hand_is_mouse
from app.window.widgets.work import BackgroundTask
from core import tick_log
from core.files import InputError
from experiments.analysis.trials_table import TrialRow
from experiments.plan import PlannedTrial
from experiments.protocol import Protocol
from experiments.store.cells import place

#: px: the right column takes this share of the page, within these bounds; below this height one curve less is shown
RIGHT_SHARE, RIGHT_LEAST, RIGHT_MOST, LOW_PX = 0.29, 290, 440, 560
#: Our choice: curves and energies go on with every third frame, twenty times a second and by two or three pixels,
#: which is as smooth as they can be read; only what follows the hand goes on with every frame.
PANELS_EVERY = 3
KEEP, KEEP_AND_START, CLOSE = "Keep", "Keep and start", "Close"  # what Space does with the card
WRITING = "One moment …"
#: action -> its question, what its button says while it is done, the command for a trial and the answer
ASKED: dict[str, tuple[Ask, str, Callable[..., object]]] = {
    "redo": (REDO, WRITING, lambda row, why: m.Redo(row.run, why)),
    "exclude": (EXCLUDE, WRITING, lambda row, why: m.Exclude(row.run, why)),
    "skip": (SKIP, WRITING, lambda _, why: m.Skip(why)),
    "abort": (ABORT, "Aborting …", lambda _, why, again: m.Abort(why, again)),
}
BEFORE = (
    "While it runs: path error, force of the hand, currents of the brakes, speed, energy, and how late the loop is. "
    "After it: its card, to keep, repeat or exclude it."
)
AFTER = "Click a trial of the plan to see its card again."
INSTRUCTED = words.Shown("Instructions", "Participant reads them. Space: next page")
UNMEASURED = "Place not measured: drawn at its jig, or where it was"


class RunPage(Page):
    """A session, as its experimenter sees it."""

    def __init__(self, send: Callable[[object], None]) -> None:
        super().__init__(send)
        self.panel = SessionPanel()
        #: where the session stands and what the participant reads, and the workspace under it
        self.large, self.small = Figures(theme.LARGE, bold=True), Figures(theme.TITLE)
        self.workspace = Workspace()
        keep_room(self.workspace)
        self.workspace.hide()  # until a protocol decides its scale
        self.workspace.view.setMouseTracking(True)  # the pointer over it is the hand
        self.traces, self.energy, self.timing = Traces(), EnergyPanel(), TimingStrip()
        self.card, self.questions = TrialCard(), Questionnaire()
        self._shown: PlannedTrial | None = None  # the trial that the workspace is set up for
        self._waiting: list[np.ndarray] = []  # ticks that the panels have not had yet
        self._ticks: list[np.ndarray] = []  # of the running trial, for its card
        self._judged: set[int] = set()  # runs whose card was answered
        #: run and ticks (n, tick_log.WIDTH) of an earlier trial whose cell of the plan was clicked; None: no such trial
        self._earlier: tuple[int, np.ndarray] | None = None
        self._reading = BackgroundTask(self._show_earlier)  # its recording
        self._numbers = RefreshClock()
        self.can = Actions()  # what can be done now
        self._asked_by: tuple[KeyButton, str] | None = None  # the button of the command that is being done, its text
        self.recording = text_label("Not recording", "sign", theme.TITLE, bold=True)  # its place stays
        self._proof: m.Proof | None = None  # the newest: of the running recording
        self._opened_s = time.perf_counter()  # when the session was opened here
        self._centre = holder(column(row(self.large, self.recording), self.small, (self.workspace, 1)))
        live = holder(column((self.traces, 4), (self.timing, 1), self.energy, spacing=8))
        self.about = wrapped_label(BEFORE, "quiet")
        self._right = stack(live, self.card, panel("The trial", self.about, 1))
        whole = holder(row(self.panel, (self._centre, 1), self._right, spacing=theme.GAP))
        self._stack = stack(whole, self.questions)
        self.setLayout(row(self._stack))
        self.cards = SessionCards(self._centre)
        self._connect()
        self._write(words.PREPARING)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._right.setFixedWidth(min(max(round(RIGHT_SHARE * self.width()), RIGHT_LEAST), RIGHT_MOST))
        self.traces.show_speed(self.height() > LOW_PX)

    def _connect(self) -> None:
        for signal, do in (
            (self.panel.start.clicked, self.start),
            (self.panel.pause.clicked, self.pause),
            (self.panel.leave.clicked, self._leave),
            (self.panel.noted, self._note),
            (self.panel.grid.clicked, self._show_cell),
            (self.card.keep.clicked, self._go_on),
            (self.questions.changed, self.answers_changed),
            (self.questions.answered, lambda values: self.send(m.Answers(dict(values)))),
            (self.workspace.view.pointer_moved, self.pointer_moved),
            (self.workspace.view.pointer_left, self.pointer_left),
        ):
            signal.connect(do)
        for action, pressed in (*self.panel.asks.items(), *self.card.asks.items()):
            pressed.clicked.connect(lambda _=False, action=action: self.ask(action))

    def keys(self) -> dict[str, Callable[[], object]]:
        asked = {action: partial(self.ask, action) for action in ASKED}
        return {"start": self.start, "pause": self.pause, "note": self.panel.write_note, **asked}

    def own_keys(self) -> dict[str, str]:
        return self.workspace.keys

    # ------------------------------------------------------------------------------------------- user actions

    def start(self) -> None:
        """Press the first button of what is asked; else keep the trial on the card and start the next one."""
        if self.cards.press_main():
            return
        if self.card_shown and not self.card.ready:
            return
        self._go_on()

    def _go_on(self) -> None:
        """Keep the trial on the card, and start the next one unless an earlier trial was looked at."""
        earlier = self._earlier is not None
        self._keep()
        if self.can.start and not earlier:
            if self.participant_reads:
                self.turn_asked.emit()
                return
            self._command(m.Start(), self.panel.start, "Starting …")
            self._centre.setFocus()

    def _command(self, command: object, button: KeyButton, waits: str) -> None:
        """Send a command; until the server has answered, its button says so and no other can be sent."""
        self.send(command)
        self._asked_by = button, waits
        self._refresh()

    def pause(self) -> None:
        """No trial starts after this one; or trials may start again."""
        if self.can.pause:
            paused = self.snapshot.paused
            self._command(m.Pause(not paused), self.panel.pause, "Resuming …" if paused else "Pausing …")

    def ask(self, action: str) -> None:
        """Ask why, then repeat, exclude, skip or abort the trial that `Actions` names for it."""
        question, waits, command = ASKED[action]
        trial, opened = self.can.of(action), self.opened
        if trial is None or opened is None:
            return
        pressed = (self.panel.asks | self.card.asks if self.card_shown else self.panel.asks)[action]

        def answered(*why: str) -> None:
            self._earlier = None
            self._command(command(trial, *why), pressed, waits)

        about = describe(trial, opened, self.snapshot.blind)
        self.cards.ask(question.of_trial(place(trial, opened.plan), about), answered)

    def _leave(self) -> None:
        self.cards.ask_to_leave(lambda: self._command(m.Leave(), self.panel.leave, "Closing …"), self.unsaved())

    def _note(self, text: str) -> None:
        self.send(m.Note(text))
        self.cards.take_focus()

    def to_close(self) -> Callable[[], object] | None:
        return self.cards.to_close()

    def show_answers(self, values: dict[str, int | None]) -> None:
        self.questions.show_values(values)

    def unsaved(self) -> str:
        answered = self.snapshot.stage == m.QUESTIONS and any(v is not None for v in self.questions.values.values())
        questions = "the questionnaire that is answered in part" if answered else ""
        return " and ".join(filter(None, (questions, "the note" if self.panel.note.text() else "")))

    def _keep(self) -> None:
        if self.card_shown and self.card.row is not None:
            if self._earlier is None:
                self._judged.add(self.card.row.run)
            self._earlier = None
            self._refresh()

    def _show_cell(self, row: TrialRow) -> None:
        """The card of an earlier trial, once its recording is read."""
        if self.opened is not None and self.snapshot.running is None:
            self._reading.ask(read_ticks, row.run, Path(self.opened.folder) / row.recording)

    def _show_earlier(self, trial: tuple[int, np.ndarray] | InputError) -> None:
        if isinstance(trial, InputError):
            self.cards.show_message("The recording cannot be read", str(trial))
        elif self.snapshot.running is None:
            self._earlier = trial
            self._refresh()

    @property
    def card_shown(self) -> bool:
        return self._right.currentWidget() is self.card

    # ------------------------------------------------------------------------------------------- what the server sends

    def show_opened(self, opened: m.Opened) -> None:
        before = self.opened
        super().show_opened(opened)
        if before is None or before.folder != opened.folder:
            self._judged = {row.run for row in self.snapshot.rows}
            self._reading.forget()
            self._opened_s = time.perf_counter()
        self._shown = None
        if before is None or not same_places(before.protocol, opened.protocol):
            self.workspace.view.show_places(opened.protocol.devices, opened.protocol.paths)
            self.workspace.show()
        self.workspace.view.show_obstacles(opened.protocol.obstacle)
        self._refresh()

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        before = self.snapshot
        super().show_snapshot(snapshot)
        if not snapshot.notice.startswith(m.DISK_WAIT):
            self._asked_by = None  # this is the answer
        if before.stage in (m.PREPARING, m.NO_SESSION):
            self._judged = {row.run for row in snapshot.rows}  # of an earlier day
        if snapshot.stage == m.NO_SESSION:
            self.cards.leave()  # what it asks is of a session that is closed, and so is the note
            self.panel.note.clear()
            if before.stage != m.NO_SESSION:
                self._clear_trial()
                if self.opened is not None:
                    self.workspace.view.show_places(self.opened.protocol.devices, self.opened.protocol.paths)
                    self.workspace.view.show_text("", "")
        elif before.stage != snapshot.stage:
            self.cards.withdraw({"abort"} if snapshot.stage != m.RUNNING else {"redo", "exclude", "skip", "leave"})
        self._refresh()
        self._show_trial(before)
        self._show_recording()

    def _clear_trial(self) -> None:
        """Nothing of the last trial stays."""
        for part in (self._waiting, self._ticks, self.traces, self.energy, self.timing):
            part.clear()

    def _show_trial(self, before: m.Snapshot) -> None:
        """The workspace: the running trial, else the coming one unless there is a trail to look at."""
        snapshot, opened = self.snapshot, self.opened
        if opened is None or snapshot.sandbox is not None:
            return
        now, coming = snapshot.running, snapshot.coming
        begins = now is not None and (before.running != now or before.stage != m.RUNNING)
        other_device = self._shown is None or coming is None or self._shown.configuration != coming.configuration
        if now is None and coming is not None and other_device:
            now, begins = coming, True
        if begins and now is not None:
            self._shown, self._earlier = now, None
            self._clear_trial()
            device = opened.protocol.device(now.configuration)
            self.workspace.view.show_trial(device, opened.protocol.paths[now.segment], snapshot.tip)
            if snapshot.running is not None:
                self._write_phase(tick_log.APPROACH, taken=False)
            self.traces.show_trial(device)
        elif snapshot.running is None:
            self.show_panels()
            self.traces.rest()
            last = self.workspace.view.tip if snapshot.stage == m.FAILED else None  # nobody says where it is now
            self.workspace.view.rest(last or snapshot.tip)
        if snapshot.running is None and opened.real_device and not snapshot.place_known:
            self.workspace.view.show_text("", UNMEASURED)

    def show_pulse(self, pulse: m.Pulse) -> None:
        self.timing.show_timing(pulse.timing, runs=pulse.proof is not None)
        self._proof = pulse.proof
        self._show_recording()

    def _show_recording(self) -> None:
        """What the newest proof says, which comes before its snapshot, and for how long the trial has run."""
        snapshot, proof = self.snapshot, self._proof
        runs = snapshot.running is not None and snapshot.sandbox is None
        look, text = "sign", "Practice" if snapshot.practice and runs else "Not recording"
        if proof is not None and runs:
            late = "sign-late", f"▲ Last write {proof.age_s:.0f} s ago"
            look, text = late if proof.late else ("sign-on", "● Recording")
        trial_s = int(self._ticks[-1][-1, tick_log.T]) if self._ticks else 0
        theme.set_style(self.recording, look)
        self.recording.setText(f"{text}  {trial_s // 60}:{trial_s % 60:02d}" if runs else text)

    def show_ticks(self, rows: np.ndarray, taken: bool) -> None:
        if self.snapshot.running is None or self.snapshot.sandbox is not None:
            return
        self.workspace.view.add(rows, taken if hand_is_mouse(self.opened) else None)
        self._write_phase(int(rows[-1, tick_log.PHASE]), taken)
        self._ticks.append(rows)
        self._waiting.append(rows)
        if len(self._waiting) >= PANELS_EVERY:
            self.show_panels()

    def show_panels(self) -> None:
        """Draw the waiting ticks in the panels; at a trial's end up to its last."""
        if self._waiting:
            rows = np.concatenate(self._waiting)
            self._waiting.clear()
            for add in (self.traces.add, self.energy.add, self.timing.add_ticks):
                add(rows)
            now = rows[-1, tick_log.T]
            if self._numbers.due(float(now)) or self.snapshot.running is None:
                # one tick for all numbers: the same force beside its arrow and its curve
                self.traces.refresh_text()
                self.energy.refresh_text()
                if self.snapshot.running is not None:
                    self.workspace.view.show_numbers(rows[-1])

    def _write_phase(self, phase: int, taken: bool) -> None:
        """What the participant reads in a phase of a trial."""
        held, seen = taken or not hand_is_mouse(self.opened), self.workspace.view.handle_seen
        shown = words.moving(phase, held, words.language_of(self.opened), seen=seen)
        if shown is not None:
            self._write(shown)

    def _write(self, shown: words.Shown) -> None:
        self.large.show_parts((shown.large, COLOURS.text))
        self.small.show_parts((shown.small, COLOURS.quiet))

    def show_time(self, now_s: float) -> None:
        """What only the clock changes: the countdown of a break, the minutes that have passed."""
        self.cards.show_time(now_s)
        in_session = self.opened is not None and self.opened.participant
        so_far, over = int((now_s - self._opened_s) / 60.0), self.snapshot.stage == m.FINISHED
        left = "" if over else words.minutes(self.snapshot.seconds_left)
        parts = (left, f"{so_far} min so far" if so_far and in_session else "")
        self.panel.time.setText(PART.join(filter(None, parts)))

    def begin(self, what: object = None) -> None:
        """what: m.Leave: ask whether to close the session."""
        self._refresh()
        if isinstance(what, m.Leave):
            self._leave()

    def _refresh(self) -> None:
        snapshot, opened = self.snapshot, self.opened
        if opened is None:
            return
        asks = snapshot.stage == m.QUESTIONS and not self.participant_answers
        self._stack.setCurrentIndex(1 if asks else 0)
        self.questions.show_feedback(feedback(snapshot, opened))
        self._show_card(opened)
        self.can = can = possible(snapshot, self.card.row if self.card_shown else None, self._asked_by is not None)
        self.panel.show_session(opened, snapshot, can, self.participant_reads)
        for pressed, possible_now in ((self.panel.start, can.start), (self.panel.redo, can.redo is not None)):
            pressed.setEnabled(possible_now and not self.card_shown)  # one button for a key
            pressed.key.setVisible(not self.card_shown)
        self.cards.show_session(opened, snapshot, self)
        keep = CLOSE if self._earlier is not None else KEEP_AND_START if can.start else KEEP
        self.card.offer(can, keep, has_space=self.cards.notice is None)
        if self._asked_by is not None:
            button, waits = self._asked_by
            button.setText(waits)
        self.workspace.set_blind(snapshot.blind)
        self.about.setText(AFTER if snapshot.stage in (m.FINISHED, m.FAILED) else BEFORE)
        if snapshot.running is None:
            read, wrong = words.between(snapshot, opened), bool(advice(snapshot))
            instructed = self.participant_reads and not wrong and snapshot.stage != m.FAILED
            self._write(INSTRUCTED if instructed else words.to_experimenter(snapshot, read, wrong))
        self.traces.set_blind(snapshot.blind)
        self.energy.setVisible(not snapshot.blind)  # what the brakes took would tell the controllers apart

    def _show_card(self, opened: m.Opened) -> None:
        """The card of the trial that was clicked, or of the newest until it is judged; else the live curves."""
        snapshot = self.snapshot
        rows = [row for row in snapshot.rows if row.block > 0]
        run, ticks = self._earlier or (0, None)
        earlier = next((row for row in rows if row.run == run), None)
        row = earlier or (rows[-1] if rows else None)
        judged = row is None or row.run in self._judged or row.status not in ("done", "timeout", "aborted")
        wanted = snapshot.running is None and (earlier is not None or not judged)
        if wanted and row is not None and (row != self.card.row or not self.card_shown):
            if earlier is None and self._ticks:
                ticks = np.concatenate(self._ticks)
            self.card.show_row(row, rows, ticks, opened, snapshot)
        live = snapshot.running is not None or self.energy.ledger.began
        self._right.setCurrentIndex(1 if wanted else 0 if live else 2)


def read_ticks(run: int, recording: Path) -> tuple[int, np.ndarray]:
    """A run, and its ticks (n, tick_log.WIDTH)."""
    from experiments.store.playback import read_playback  # takes a second, which the start of the app has not

    return run, read_playback(recording).ticks


def same_places(a: Protocol, b: Protocol) -> bool:
    return [device.text for device in a.devices] == [device.text for device in b.devices] and a.paths == b.paths
