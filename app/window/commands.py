"""What the experimenter asks for, by key or button: commands to the server, and the question before some of them."""

from typing import TYPE_CHECKING

from app.ipc import messages as m
from app.window.cards import ABORT_REASONS, REDO_REASONS, SKIP_REASONS
from app.window.painting.theme import show_whole
from app.window.session_panel import can_be_redone
from app.window.words import describe, place

if TYPE_CHECKING:
    from app.window.console_window import ConsoleWindow

NO_ESCAPE = (m.PREPARING, m.NO_SESSION)  # nothing flows there: Esc only leaves what is open


class Commands:
    """The intents of one console window."""

    def __init__(self, window: "ConsoleWindow") -> None:
        self._window = window
        self._client = window.client
        self._results = None

    @property
    def _snapshot(self) -> m.Snapshot:
        return self._window.snapshot

    def _running(self) -> bool:
        return self._snapshot.stage == m.RUNNING

    # trials

    def start(self) -> None:
        """The next trial; or go on, where something waits for that."""
        window = self._window
        if window.device_shown or window.cards.press_main():
            return
        if window.trying:
            self.practice()
        elif window.panel.start.isEnabled() and window.panel.isVisible():
            self._client.send(m.Start())
            window.centre.setFocus()

    def practice(self) -> None:
        """A trial that counts nowhere."""
        window = self._window
        if self._snapshot.stage == m.NO_SESSION and window.start_page.practice.isEnabled():
            window.trying = True
            self._client.send(m.Practice())
            window.centre.setFocus()

    def back(self) -> None:
        """From practice to the start page."""
        if self._window.trying and not self._running():
            self._window.trying = False
            self._window.show_snapshot(self._snapshot)

    def open_session(self, participant: str, resume: bool, blind: bool) -> None:
        """Take up a session."""
        self._client.send(m.Open(participant, resume, blind))

    def leave(self) -> None:
        """Close the session: the next participant's may be opened."""
        self.close_results()
        self._client.send(m.Leave())

    def pause(self) -> None:
        """No trial starts after this one; or trials may start again."""
        if self._window.panel.pause.isEnabled() and self._window.panel.isVisible():
            self._client.send(m.Pause(not self._snapshot.paused))

    def redo(self) -> None:
        """Ask why, then run the last trial's cell again."""
        window = self._window
        if not window.panel.redo.isEnabled() or not window.panel.isVisible() or window.opened is None:
            return
        last = next(row for row in reversed(self._snapshot.rows) if can_be_redone(row))
        window.cards.ask(
            "redo",
            f"Redo run {last.run}?",
            "Its trial comes again next. What was recorded is kept and marked as redone.",
            REDO_REASONS,
            "Redo",
            lambda reason: self._client.send(m.Redo(last.run, reason)),
        )

    def skip(self) -> None:
        """Ask why, then leave the coming trial out."""
        window, coming = self._window, self._snapshot.coming
        if not window.panel.skip.isEnabled() or not window.panel.isVisible() or window.opened is None or coming is None:
            return
        window.cards.ask(
            "skip",
            f"Skip trial {place(coming, window.opened.plan)}?",
            f"{describe(coming, window.opened, self._snapshot.blind)}. It is marked and does not come again.",
            SKIP_REASONS,
            "Skip",
            lambda reason: self._client.send(m.Skip(reason)),
        )

    def abort(self) -> None:
        """Ask why, then end the running trial. (Esc ends it at once.)"""
        if self._running():
            self._window.cards.ask(
                "abort",
                "Abort this trial?",
                "It goes on until you answer. Its recording is kept and marked as aborted; it does not come again by "
                "itself. (Esc ends it at once, and it comes again.)",
                ABORT_REASONS,
                "Abort",
                lambda reason: self._client.send(m.Abort(reason)),
            )

    # brakes

    def brakes_off(self, cause: str) -> None:
        """Zero current at once; it goes straight to the control loop, even when the session server is gone."""
        self._client.brakes_off(cause)

    def allow_brakes(self) -> None:
        """Currents may flow again."""
        if self._snapshot.brakes_off:
            self._client.send(m.AllowBrakes())

    def escape(self, cause: str) -> None:
        """Brakes off while a trial runs; else leave what is open, and with nothing open brakes off."""
        window = self._window
        if window.device_shown and not self._running():
            if not window.device.leave():
                window.show_device(False)
            return
        left = window.cards.leave()
        if not self._running():
            if left or window.panel.note.hasFocus():
                window.panel.note.clearFocus()
                window.cards.take_focus()
                return
            if window.trying:
                self.back()
                return
            if self._snapshot.stage in NO_ESCAPE:
                return
        if not self._snapshot.brakes_off:
            self.brakes_off(cause)

    # notes, results, the rest

    def write_note(self) -> None:
        """Into the line for notes."""
        if self._window.panel.note.isEnabled() and self._window.panel.isVisible():
            self._window.panel.note.setFocus()

    def note(self, text: str) -> None:
        """Keep a note."""
        self._client.send(m.Note(text))
        self._window.cards.take_focus()

    def confirm(self) -> None:
        """The re-rig is done, the break is over."""
        self._client.send(m.Confirm())

    def device(self) -> None:
        """The device page, or away from it."""
        self._window.show_device(not self._window.device_shown)

    def rig(self, step: str) -> None:
        """A step that makes the device on the bench ready."""
        self._client.send(m.Rig(step))

    def unblind(self, who: str) -> None:
        """Open the key of a blind session."""
        self._client.send(m.Unblind(who))

    def answer(self, values: dict[str, float]) -> None:
        """The participant's answers."""
        self._client.send(m.Answers(dict(values)))

    def results(self) -> None:
        """The box plots so far, in a window of their own."""
        window = self._window
        if window.opened is None or not window.opened.participant or self._running():
            return
        from app.window.results_window import LARGEST, ResultsWindow

        self.close_results()
        self._results = ResultsWindow(window.opened, self._snapshot)
        self._results.escaped.connect(self._escape_results)
        show_whole(self._results, *LARGEST)

    def _escape_results(self) -> None:
        """In any window: brakes off while a trial runs; with nothing to stop the results go."""
        if self._running():
            self.escape("Esc on the results")
        else:
            self.close_results()

    def close_results(self) -> None:
        """With the console goes its results window."""
        if self._results is not None:
            self._results.close()
            self._results.deleteLater()
            self._results = None

    def follow(self, before: m.Snapshot, now: m.Snapshot) -> None:
        """What is asked is asked no more when its time is past."""
        if self._results is not None and self._results.isVisible():
            self._results.show_snapshot(now)
        if before.stage != now.stage:
            self._window.cards.withdraw({"abort"} if now.stage != m.RUNNING else {"redo", "skip"})
