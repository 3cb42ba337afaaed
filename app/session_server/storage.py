"""Writes the open session to the disk: its trials, its journal, its table.

What cannot be written (a full disk, a folder that is gone) stays in the memory of the session's database and is tried
again. The experimenter reads what is in memory, and no trial starts meanwhile.
"""

import contextlib
import time
from collections.abc import Callable
from typing import Any

from app.session_server.preflight import with_advice
from app.session_server.session_progress import SessionProgress
from app.session_server.trial_runner import TrialRun, TrialRunner
from core.faults import FAULTS, cause_of
from core.files import InputError
from experiments.analysis.trials_table import FINISHED
from experiments.plan import counted
from experiments.store.journal import LOOP_LOST, Event, now

RETRY_S = 5.0  # between two attempts to write, and between two checks of the folder
#: Status of a trial that did not go to its end -> words after its name; the reason alone does not say so.
HOW_ENDED = {"aborted": " was aborted", "stopped": " stopped"}


class Storage:
    """The open session as far as it concerns the disk; one session at a time."""

    def __init__(self, runner: TrialRunner, notify: Callable[..., None]) -> None:
        """notify: shows the experimenter a sentence."""
        self._runner, self._notify = runner, notify
        self.set_session(None)

    def set_session(self, progress: SessionProgress | None) -> None:
        """Set the open session; None: none is open."""
        self.progress = progress
        self.verified = ""  # name of the run whose recording was verified last
        self.not_written = ""  # why not everything is written, a sentence without its full stop; "": it is
        #: The trial that has ended and is not stored yet, and why its control loop was lost with it ("": it was not).
        self._ended: tuple[TrialRun, str] | None = None
        self._tried_s = time.perf_counter()

    @property
    def open(self) -> SessionProgress:
        """The open session, where there must be one."""
        assert self.progress is not None, "no session is open"
        return self.progress

    @property
    def in_memory(self) -> str:
        """What the disk has refused: "trial 5, 5,481 ticks"; "": nothing."""
        if self.progress is None or self.open.session.database.trouble is None:
            return ""
        database, parts = self.open.session.database, []
        if database.pending_ticks:
            run = self._runner.run or (self._ended[0] if self._ended else None)
            of = f"{self._name(run).lower()}, " if run is not None else ""
            parts.append(f"{of}{counted(database.pending_ticks, 'tick')}")
        if lines := database.pending_in("event"):
            parts.append(f"{counted(lines, 'line')} of the journal")
        return " and ".join(parts)

    def leave(self) -> None:
        """Close the session if everything in memory can be written; else OSError or InputError, and it stays open."""
        self._write_all()
        self.open.session.close()
        self.set_session(None)

    def end(self) -> str:
        """Close the session in any case: what is in another place or lost, a sentence without its full stop, or ""."""
        if self.progress is None:
            return ""
        with contextlib.suppress(InputError, OSError):
            self._write_all()
        left = self.open.session.end()
        self.set_session(None)
        return left

    def _write_all(self) -> None:
        """Write everything, and store the trial that has ended. OSError or InputError: it cannot be."""
        if self._ended is not None:
            run, lost = self._ended
            if lost:
                self._rescue_trial(run, lost)
            else:
                self._finish_trial(run)
            self._ended = None
        self.open.session.database.commit()

    def write(self, event: Event, **about: Any) -> None:
        """Write an event, if a session is open; during a trial the recorder brings it to the disk."""
        if self.progress is None:
            return
        self.open.apply_event(event, now(), about)
        self.open.session.add_event(event, **about)
        if self._runner.run is None:
            try:
                self.open.session.database.commit()
            except OSError as error:
                self.fail("The journal is not complete", error)

    def fail(self, trouble: str, error: Exception) -> None:
        """Show the experimenter that something could not be written: what is in memory, and what to do."""
        self._tried_s = time.perf_counter()
        gone = self.open.session.missing_files()
        parts = [trouble, gone or getattr(error, "strerror", None) or cause_of(error)]
        if gone or isinstance(error, OSError) or isinstance(error.__cause__, OSError):
            parts.append(FAULTS["folder-gone" if gone else "recording-failed"].advice)
        if self._runner.run is not None:
            parts.append("The trial goes on, and its ticks are kept in memory")
        elif self.in_memory:
            parts.append(f"In memory: {self.in_memory}. What is in memory is lost if this program ends before that")
        if self._runner.run is None:
            parts.append(f"It is tried again every {RETRY_S:.0f} s")
        self.not_written = ". ".join(part[0].upper() + part[1:].rstrip(".") for part in parts if part)
        self._notify(f"{self.not_written}.", bad=True)

    def check_folder(self) -> bool:
        """Whether the session's folder and database are there; if not, no trial starts. It waits for the disk."""
        if self.progress is None:
            return True
        gone = self.open.session.missing_files()
        if gone and gone not in self.not_written:
            self.fail("The session cannot be written", InputError(gone))
        return not gone

    def watch(self, run: TrialRun) -> None:
        """Report when the disk fails during a trial of the session, and when it is well again."""
        trouble = self.open.session.database.trouble
        if trouble is not None and not self.not_written:
            self.fail(f"The disk has failed under {self._name(run).lower()}", trouble)
        elif trouble is None and self.not_written:
            self.not_written = ""
            self._notify("The disk takes data again: all ticks so far are written.")

    def store_trial(self, run: TrialRun, lost: str = "") -> None:
        """Store a trial that has ended. lost: why its control loop was lost with it, so that it is recovered."""
        self._ended = run, lost
        self._store(
            f"{lost}; {self._name(run).lower()} is not complete" if lost else f"{self._name(run)} is not complete"
        )

    def _name(self, run: TrialRun) -> str:
        return self.open.name_of(run.planned)

    def _finish_trial(self, run: TrialRun) -> None:
        """Add the row of a trial and tell the experimenter. InputError or OSError: recording or row is not written."""
        reason = run.trial.outcome()["reason"]
        row = run.finish(self.open.session)
        notice = with_advice(f"{self.open.name_of(row)}{HOW_ENDED.get(row.status, '')}", reason)
        self.verified = self._name(run).lower() if row.recording else self.verified
        if row.status == "aborted" and run.again != "never" and row.block:
            self.open.session.redo(row.run, reason, at_end=run.again == "end")
            notice += " It is repeated next." if run.again == "now" else " It is repeated at the end."
        if row.status == "stopped":
            notice += " It is repeated next."
        self.open.trial_ended(row)
        self.update_next(notice.strip())

    def _rescue_trial(self, run: TrialRun, why: str) -> None:
        run.rescue(self.open.session)
        self.write(LOOP_LOST, run=run.planned.run, reason=why)
        self.open.last_end_s = None
        self.update_next(f"{with_advice('', why)} {self._name(run)} is recovered and repeated next.", bad=True)

    def update_next(self, notice: str, bad: bool = False) -> None:
        """After a row was added or marked: the next trial, and a notice."""
        self.open.update_next()
        self._notify(" ".join(filter(None, (notice, self.open.without_valid_trial()))), bad=bad)

    def retry(self) -> None:
        """Every `RETRY_S`, while no trial runs: check the folder and write what could not be written."""
        if self.progress is None or time.perf_counter() - self._tried_s < RETRY_S:
            return
        self._tried_s = time.perf_counter()
        if self.check_folder() and self.not_written:
            self._store(self.not_written.partition(". ")[0], again=True)

    def _store(self, trouble: str, again: bool = False) -> None:
        """Write everything, and say what could not be. again: the folder may have been gone meanwhile."""
        session, runs_before = self.open.session, {row.run for row in self.open.session.rows}
        try:
            if again:
                session.open_again()
            self._write_all()
        except (InputError, OSError) as error:
            self.fail(trouble, error)
            return
        if self.not_written:
            self.not_written = ""
            new = [row for row in session.rows if row.run not in runs_before]
            runs = ", ".join(f"{self.open.name_of(row).lower()} is {row.status}" for row in new)
            notice = f"All pending data are written{': ' if runs else ''}{runs}."
            if any(row.status not in FINISHED for row in new):
                notice += " What was cut off is repeated."
            self.update_next(notice)
