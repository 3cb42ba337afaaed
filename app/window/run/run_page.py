"""The Run page: the workspace, under it the strip, and at the right the running trial or the card of the last one, with
what can be asked for."""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PySide6.QtGui import QResizeEvent

from app.ipc import messages as m
from app.window.canvas.force_view import RefreshClock
from app.window.canvas.linkage_view import Workspace
from app.window.participant.questionnaire import Instructions, Questionnaire
from app.window.participant.tone import NO_SOUND, player
from app.window.run.actions import Actions, possible
from app.window.run.commands import Commands
from app.window.run.live import Live
from app.window.run.session_cards import ABORT, REDO, SKIP, SessionCards
from app.window.run.strip import Strip
from app.window.run.trial_card import TrialCard
from app.window.widgets import theme, words
from app.window.widgets.cards import EXCLUDE, Ask
from app.window.widgets.page import Page
from app.window.widgets.parts import (
    PART,
    FittedLabel,
    KeyButton,
    OneLine,
    Panel,
    column,
    holder,
    keep_room,
    row,
    stack,
    text_label,
    wrapped_label,
)
from app.window.widgets.preflight import advice
from app.window.widgets.words import as_sentence, cell, describe, feedback, hand_is_mouse
from app.window.widgets.work import BackgroundTask
from core import tick_log
from core.files import InputError
from experiments.analysis.trials_table import TrialRow
from experiments.plan import PlannedTrial
from experiments.protocol import Protocol
from experiments.store.cells import trial_name

#: px: the right column takes this share of the page, within these bounds
RIGHT_SHARE, RIGHT_LEAST, RIGHT_MOST = 0.27, 290, 440
SIGN_PX, HEAD_PX, FOOT_PX = 40, 52, 12  # high: the sign of recording, the head, what is free below
#: Our choice: curves and energies go on with every third frame, twenty times a second and by two or three pixels,
#: which is as smooth as they can be read; only what follows the hand goes on with every frame.
PANELS_EVERY = 3
KEEP, CLOSE = "Keep", "Close"  # what Space does with the card
WRITING = "One moment …"
#: action -> its question, what its button says while it is done, the command for a trial and the answer
ASKED: dict[str, tuple[Ask, str, Callable[..., object]]] = {
    "redo": (REDO, WRITING, lambda row, why: m.Redo(row.run, why)),
    "exclude": (EXCLUDE, WRITING, lambda row, why: m.Exclude(row.run, why)),
    "skip": (SKIP, WRITING, lambda _, why: m.Skip(why)),
    "abort": (ABORT, "Aborting …", lambda _, why, again: m.Abort(why, again)),
}
BEFORE = "While a trial runs you see its path error and tip force here; after it, its card: keep, repeat or exclude it."
AFTER = "Click a trial of the plan to see its card again."
NO_SESSION = "No session is open"
READS = "The participant reads the instructions; after the last page the first trial can be started."
INSTRUCTED = words.Shown("Instructions", "Participant reads them. Space: next page")
ENDED = "The trial ended while you were asked. What you wrote is here; or keep the trial: Esc."
TURN_ON = "Ctrl+B turns the brakes on."
UNMEASURED = "Place not measured: drawn at its jig, or where it was"


class Waiting(NamedTuple):
    """A command that the server has not answered yet."""

    button: KeyButton  # that asked for it
    text: str  # what it says meanwhile


class Earlier(NamedTuple):
    """An earlier trial whose cell of the plan was clicked."""

    run: int
    ticks: np.ndarray  # (n, tick_log.WIDTH)


class RunPage(Page):
    """A session, as its experimenter sees it."""

    def __init__(self, send: Callable[[object], None]) -> None:
        super().__init__(send)
        self.panel, self.strip, self.live, self.card = Commands(), Strip(), Live(), TrialCard()
        self.questions, self.instructions = Questionnaire(), Instructions()
        self.large, self.small = OneLine("", "", theme.HEAD, bold=True), OneLine("", "quiet", theme.NORMAL)
        self.notice = FittedLabel(3, theme.SMALL)
        self.recording = text_label("", "sign", theme.TITLE, bold=True)
        self.recording.setFixedHeight(SIGN_PX)
        self.workspace = Workspace()
        keep_room(self.workspace)
        self.workspace.hide()  # until a protocol decides its scale
        self.workspace.view.setMouseTracking(True)  # the pointer over it is the hand
        self.about, self.notes = wrapped_label(BEFORE, "quiet"), wrapped_label("", "quiet", theme.SMALL)
        self.can = Actions()  # what can be done now
        self._waiting: Waiting | None = None
        self._earlier: Earlier | None = None
        self._reading = BackgroundTask(self._show_earlier)  # its recording
        self._judged: set[int] = set()  # runs whose card was answered
        self._shown: PlannedTrial | None = None  # the trial that the workspace is set up for
        self._ticks: list[np.ndarray] = []  # of the running trial, for its card
        self._new, self._go_s = 0, math.inf  # pieces of them that the panels have not had yet; time of "go"
        self._proof: m.Proof | None = None  # the newest: of the running recording
        self._numbers = RefreshClock()
        self._lay_out()
        self.cards = SessionCards(self._centre)
        self._connect()
        self._write(*words.PREPARING)

    def _lay_out(self) -> None:
        said = holder(column(self.large, self.small, 1, spacing=2))
        head = holder(row((said, 3), (self.notice, 2), spacing=theme.GAP))
        head.setFixedHeight(HEAD_PX)
        self._centre = holder(column(head, (self.workspace, 1), spacing=8))
        nothing = holder(column(self.about, self.notes, 1, spacing=12))
        self._right, right = stack(self.live.panel, self.card, nothing), Panel()
        right.setLayout(column((self._right, 1), self.panel, spacing=10, margins=(16, 12, 16, 14)))
        self._column = holder(column(self.recording, (right, 1), spacing=theme.GAP))
        left = column((self._centre, 1), self.strip, spacing=theme.GAP)
        whole = holder(row((holder(left), 1), self._column, spacing=theme.GAP, margins=(0, 0, 0, FOOT_PX)))
        self._stack = stack(whole, self.questions, self.instructions)
        self.setLayout(row(self._stack))

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._column.setFixedWidth(min(max(round(RIGHT_SHARE * self.width()), RIGHT_LEAST), RIGHT_MOST))

    def _connect(self) -> None:
        for signal, do in (
            (self.panel.start.clicked, self.start),
            (self.panel.pause.clicked, self.pause),
            (self.panel.leave.clicked, self._leave),
            (self.panel.noted, self._note),
            (self.strip.plan.clicked, self._show_cell),
            (self.card.keep.clicked, self._go_on),
            (self.questions.changed, self.answers_changed),
            (self.instructions.turned, self.turn_asked),
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

    @property
    def says_what_is_wrong(self) -> bool:
        """The strip does, unless the questions stand in its place."""
        return self._stack.currentIndex() == 0

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
        self._waiting = Waiting(button, waits)
        self._refresh()

    def pause(self) -> None:
        """No trial starts after this one; or trials may start again."""
        if self.can.pause:
            paused = self.snapshot.paused
            self._command(m.Pause(not paused), self.panel.pause, "Resuming …" if paused else "Pausing …")

    def ask(self, action: str, written: str = "") -> None:
        """Ask why, then repeat, exclude, skip or abort the trial that `Actions` names for it.

        written: a reason that was written already; the question says so.
        """
        question, waits, command = ASKED[action]
        trial, opened = self.can.of(action), self.opened
        if trial is None or opened is None:
            return
        pressed = (self.panel.asks | self.card.asks if self.card_shown else self.panel.asks)[action]

        def answered(*why: str) -> None:
            self._earlier = None
            self._command(command(trial, *why), pressed, waits)

        about = describe(trial, opened, self.snapshot.blind)
        question = question.of_trial(trial_name(trial, opened.plan, self.snapshot.rows), about)
        self.cards.ask(question._replace(text=ENDED) if written else question, answered, written)

    def _leave(self) -> None:
        self.cards.ask_to_leave(lambda: self._command(m.Leave(), self.panel.leave, "Closing …"), self.unsaved())

    def _note(self, text: str) -> None:
        self.send(m.Note(text))
        self.cards.take_focus()

    def to_close(self) -> Callable[[], object] | None:
        return self.cards.to_close()

    def show_instructions(self, at: int) -> None:
        self.instructions.show_page(at)

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

    def _show_earlier(self, trial: Earlier | InputError) -> None:
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
            self.instructions.show_pages(opened.protocol.pages, opened.protocol.sentences)
            self._reading.forget()
        self._shown = None
        if before is None or not same_places(before.protocol, opened.protocol):
            self.workspace.view.show_places(opened.protocol.devices, opened.protocol.paths)
            self.workspace.show()
        trial = opened.protocol.trial
        self.workspace.view.radii_m = (trial.start_radius_m, trial.end_radius_m)
        self.workspace.view.show_obstacles(opened.protocol.obstacle)
        self.questions.show_language(opened.protocol.sentences)
        self._refresh()

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        before = self.snapshot
        super().show_snapshot(snapshot)
        if not snapshot.notice.startswith(m.DISK_WAIT):
            self._waiting = None  # this is the answer
        if before.stage in (m.PREPARING, m.NO_SESSION):
            self._judged = {row.run for row in snapshot.rows}  # of an earlier day
        written = self.cards.written("abort") if snapshot.stage != m.RUNNING else ""
        if snapshot.stage == m.NO_SESSION:
            self.cards.leave()  # what it asks is of a session that is closed, and so is the note
            self.panel.note.clear()
            if before.stage != m.NO_SESSION:
                self._clear_session()
        elif before.stage != snapshot.stage:
            self.cards.withdraw({"abort"} if snapshot.stage != m.RUNNING else {"redo", "exclude", "skip", "leave"})
        self._refresh()
        self._show_trial(before)
        self._show_recording()
        if written:
            self._keep_what_was_written(written)

    def _keep_what_was_written(self, reason: str) -> None:
        """The trial ended by itself while it was asked why to abort it: the reason is asked for what can be done now,
        or becomes a note that is not sent yet."""
        if self.can.redo is not None:
            self.ask("redo", reason)
        else:
            self.panel.write_note()
            self.panel.note.setText(reason)

    def _clear_session(self) -> None:
        """Nothing of the session that was closed stays."""
        self._clear_trial()
        self.card.row = None
        if self.opened is not None:
            self.workspace.view.show_places(self.opened.protocol.devices, self.opened.protocol.paths)
            self.workspace.view.show_line("")

    def _clear_trial(self) -> None:
        """Nothing of the last trial stays."""
        self._ticks.clear()
        self._new, self._go_s = 0, math.inf
        for part in (self.live, self.strip):
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
            self.workspace.view.show_trial(device, opened.protocol.paths[now.path], snapshot.tip)
            self.strip.show_trial(device)
            if snapshot.running is not None:
                self._write_phase(tick_log.APPROACH, taken=False)
        elif snapshot.running is None:
            self.show_panels()
            self.live.rest()
            self.strip.rest()
            last = self.workspace.view.tip if snapshot.stage == m.FAILED else None  # nobody says where it is now
            self.workspace.view.rest(last or snapshot.tip)
        if snapshot.running is None:
            self._write_between()

    def show_pulse(self, pulse: m.Pulse) -> None:
        self._proof = pulse.proof
        self._show_recording()

    def _show_recording(self) -> None:
        """What the newest proof says, which comes before its snapshot."""
        snapshot, proof = self.snapshot, self._proof
        runs = snapshot.running is not None and snapshot.sandbox is None
        saved = snapshot.newest is not None and snapshot.newest.recording and not snapshot.not_written
        look, text = "sign", f"Not recording{f'{PART}saved' * bool(saved)}"
        if snapshot.practice and runs:
            text = "Practice"
        if proof is not None and runs:
            late = "sign-late", f"▲ Last write {proof.age_s:.0f} s ago"
            look, text = late if proof.late else ("sign-on", "● Recording")
        if runs and self._ticks and self._ticks[-1][-1, tick_log.PHASE] == tick_log.END:
            look, text = "sign", "Writing"
        theme.set_style(self.recording, look)
        self.recording.setText(text)

    def show_ticks(self, rows: np.ndarray, taken: bool) -> None:
        if self.snapshot.running is None or self.snapshot.sandbox is not None:
            return
        view = self.workspace.view
        view.add(rows, taken if hand_is_mouse(self.opened) else None)
        self._write_phase(view.phase, taken, float(rows[-1, tick_log.T]) - view.began_s)
        self._ticks.append(rows)
        self._new += 1
        if self._new >= PANELS_EVERY:
            self.show_panels()

    def show_panels(self) -> None:
        """Draw the waiting ticks in the panels; at a trial's end up to its last."""
        if self._new:
            rows = np.concatenate(self._ticks[-self._new :])
            self._new = 0
            self.strip.balance(rows)
            moves = rows[rows[:, tick_log.PHASE] == tick_log.MOVE]
            if len(moves):
                self._go_s = min(self._go_s, float(moves[0, tick_log.T]))
                for part in (self.live, self.strip):
                    part.add(moves[:, tick_log.T] - self._go_s, moves)
            now = float(rows[-1, tick_log.T])
            if self._numbers.due(now) or self.snapshot.running is None:
                # one tick for all numbers: the same force beside its arrow and its curve
                for part in (self.live, self.strip):
                    part.refresh_text()
                self.workspace.view.refresh_text()

    # ------------------------------------------------------------------------------------------- words

    def _write_phase(self, phase: int, taken: bool, since_s: float = 0.0) -> None:
        """What the participant reads in a phase of a trial, which has lasted so long."""
        held, seen = taken or not hand_is_mouse(self.opened), self.workspace.view.handle_seen
        shown = words.moving(phase, held, words.language_of(self.opened), seen=seen, since_s=since_s)
        self.workspace.view.show_line(reads(shown))

    def _write_between(self) -> None:
        """What the participant reads while no trial runs, who is told less; and whether the place is measured."""
        snapshot, opened = self.snapshot, self.opened
        instructed = self.participant_reads and not advice(snapshot) and snapshot.stage != m.FAILED
        line = INSTRUCTED.small if instructed else reads(words.between(snapshot, opened))
        unmeasured = opened is not None and opened.real_device and not snapshot.place_known
        self.workspace.view.show_line(UNMEASURED if unmeasured else line)

    def _write(self, large: str, small: str) -> None:
        self.large.setText(large)
        self.small.setText(small)

    def _write_head(self, opened: m.Opened) -> None:
        """Where the session stands: the running trial, the one on the card, or what is waited for."""
        snapshot, plan = self.snapshot, opened.plan
        who = f"Participant {opened.participant}" if opened.participant else NO_SESSION
        trial: PlannedTrial | TrialRow | None = snapshot.running
        if trial is not None:
            name = trial_name(trial, plan, snapshot.rows)
            number, comma, tries = name.partition(",")
            of = f" of {len(plan)}" if trial.block and plan else ""
            large = "Stopping …" if snapshot.brakes_off else f"{number.capitalize()}{of}{comma}{tries}"
            self._write(large, told(who, trial, opened, snapshot.blind))
            return
        large, coming = words.head_of(snapshot, bool(advice(snapshot))), snapshot.coming
        if self.participant_reads and large == "Ready":
            large = INSTRUCTED.large
        on_card = self.card.row if self.card_shown else None
        if on_card is not None and large in ("Ready", "Paused"):
            ended = words.ended(on_card)
            name = trial_name(on_card, plan, snapshot.rows).capitalize()
            self._write(f"{name} {ended}", told(who, on_card, opened, snapshot.blind))
        elif coming is not None and opened.participant:
            following = f"next: {trial_name(coming, plan, snapshot.rows)}"
            self._write(PART.join((large, following)), told(who, coming, opened, snapshot.blind))
        else:
            self._write(large, who)

    def _write_notice(self, opened: m.Opened) -> None:
        """What happened, and else why no trial can be started, unless the strip says it already."""
        snapshot = self.snapshot
        notice, bad = snapshot.notice, snapshot.notice_bad
        if snapshot.not_written and notice == f"{snapshot.not_written}.":  # the strip says it, as far as it has room
            notice = f"Lost if this program ends: {snapshot.in_memory}." if snapshot.in_memory else ""
        if snapshot.can_allow and snapshot.running is None and not advice(snapshot):
            notice = f"{notice or as_sentence(snapshot.brakes_off)} {TURN_ON}"
        if not notice and snapshot.stage == m.READY and not advice(snapshot):
            silent = opened.protocol.tones and not snapshot.rows and player() is None  # once, before the first trial
            notice = snapshot.trial_blocker or (READS if self.participant_reads else NO_SOUND if silent else "")
        mild = snapshot.notice and not snapshot.brakes_off
        theme.set_style(self.notice, "bad" if bad else "hint" if mild else "caution")
        self.notice.show_text("" if snapshot.stage == m.FAILED else notice)  # there the strip says it
        self.notice.setVisible(bool(self.notice.text()))

    # ------------------------------------------------------------------------------------------- all of it

    def show_time(self, now_s: float) -> None:
        """What only the clock changes: the countdown of a break."""
        self.cards.show_time(now_s)

    def begin(self, what: object = None) -> None:
        """what: m.Leave: ask whether to close the session."""
        self._refresh()
        if isinstance(what, m.Leave):
            self._leave()

    def _refresh(self) -> None:
        snapshot, opened = self.snapshot, self.opened
        if opened is None:
            return
        asked = 1 if snapshot.stage == m.QUESTIONS else 2 if self.participant_reads else 0
        self._stack.setCurrentIndex(0 if self.participant_answers else asked)  # there they are on their own screen
        self.questions.show_feedback(feedback(snapshot, opened))
        self._show_card(opened)
        on_card = self.card_shown
        self.can = possible(snapshot, self.card.row if on_card else None, self._waiting is not None)
        self.panel.offer(snapshot, self.can, on_card, self.participant_reads)
        self.strip.show_session(opened, snapshot)
        self.cards.show_session(opened, snapshot, self)
        keep = CLOSE if self._earlier is not None else KEEP
        if keep == KEEP and self.can.start and snapshot.coming is not None:
            keep = f"Keep, start {trial_name(snapshot.coming, opened.plan, snapshot.rows)}"
        if keep == KEEP and snapshot.stage == m.FINISHED:
            keep = ""  # nothing comes after it
        self.card.offer(self.can, keep, has_space=self.cards.notice is None)
        if self._waiting is not None:
            self._waiting.button.setText(self._waiting.text)
        self.workspace.set_blind(snapshot.blind)
        self.strip.set_blind(snapshot.blind)
        self.about.setText(AFTER if snapshot.stage in (m.FINISHED, m.FAILED) else BEFORE)
        self.notes.setText("\n".join(snapshot.notes))
        self._write_head(opened)
        self._write_notice(opened)
        if snapshot.running is None:
            self._write_between()

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
        live = snapshot.running is not None or self.strip.ledger.began
        self._right.setCurrentIndex(1 if wanted else 0 if live else 2)


def reads(shown: words.Shown) -> str:
    """What the participant reads, for the experimenter."""
    return f"Participant reads: {PART.join(filter(None, shown))}"


def told(about: str, trial: PlannedTrial | TrialRow, opened: m.Opened, blind: bool) -> str:
    """The line under the head: about, then controller, device and path of a trial."""
    *controller, path = cell(trial, opened, blind).split(PART)
    return PART.join((about, *controller, trial.configuration, path))


def read_ticks(run: int, recording: Path) -> Earlier:
    """A run, and its ticks."""
    from experiments.study.playback import read_playback  # takes a second, which the start of the app has not

    return Earlier(run, read_playback(recording).ticks)


def same_places(a: Protocol, b: Protocol) -> bool:
    return [device.text for device in a.devices] == [device.text for device in b.devices] and a.paths == b.paths
