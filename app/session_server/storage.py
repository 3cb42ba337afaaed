"""Brings the open session to the disk: its trials, its journal, the tables.

What the disk does not take is kept in mind and tried again, and the experimenter reads so: no trial starts meanwhile,
and nothing is lost. A recording that is whole but does not become a Parquet file stops nothing: it is converted later.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from app.session_server.preflight import with_advice
from app.session_server.session_progress import SessionProgress
from app.session_server.trial_runner import TrialRun, TrialRunner
from core.faults import FAULTS, cause_of
from core.files import InputError
from experiments.analysis.trials_table import SETTLED
from experiments.recording import STREAM_SUFFIX
from experiments.session.files import write_pooled_table
from experiments.session.journal import LOOP_LOST, Event, now

AGAIN_S = 5.0  # between two attempts


class Storage:
    """One session after the other."""

    def __init__(self, data_dir: Path, runner: TrialRunner, notify: Callable[..., None]) -> None:
        """notify: to the experimenter."""
        self._data_dir, self._runner, self._notify = data_dir, runner, notify
        self.take(None)

    def take(self, progress: SessionProgress | None) -> None:
        """A session to keep; None: there is none."""
        self.progress = progress
        self.verified = ""  # what was recorded last
        self._failed = ""  # what the disk has not taken yet ..
        self.undone = ""  # .. and why, one sentence without its full stop
        self._late: list[tuple[Event, str, dict]] = []  # lines of the journal that it has not taken
        self._tried_s = time.perf_counter()

    @property
    def streams(self) -> int:
        """Trials whose recording is whole but no Parquet file yet."""
        rows = self.progress.session.rows if self.progress else []
        return sum(row.recording.endswith(STREAM_SUFFIX) for row in rows)

    def leave(self) -> None:
        """The session is closed. OSError, and it stays open: the disk does not take the journal's last lines.

        What else it lacks is made up for when it is opened again, or by `phd recover`.
        """
        self._write_late()
        self.let_go()

    def let_go(self) -> None:
        """The session is closed, whatever the disk does: lines that it does not take go to the log."""
        if self.progress is None:
            return
        session = self.progress.session
        try:
            self._write_late()
        except OSError as error:
            for event, at, about in self._late:
                print(f"{session.folder}: not in the journal ({error}): {at} {event.name} {about}", file=sys.stderr)
        session.close()
        self.take(None)

    def write(self, event: Event, **about: Any) -> None:
        """A line in the journal of the session, if there is one; never while the control loop waits for us."""
        if self.progress is None:
            return
        session, at = self.progress.session, now()
        self.progress.take_in(event, at, about)

        def put() -> None:
            try:
                session.journal(event, time=at, **about)
            except OSError:
                self._late.append((event, at, about))
                raise

        try:
            if self._runner.run is not None:
                self._runner.run.recorder.beside(put)
            else:
                put()
        except OSError as error:
            self.fail("The journal is not complete", error)

    def _write_late(self) -> None:
        """Lines of the journal that the disk has not taken, with their own times. OSError."""
        while self._late:
            event, at, about = self._late[0]
            assert self.progress is not None
            self.progress.session.journal(event, time=at, **about)
            self._late.pop(0)

    def fail(self, what: str, error: Exception) -> None:
        """The disk took no more."""
        reason = getattr(error, "strerror", None) or cause_of(error)
        self._failed, self._tried_s = what, time.perf_counter()
        self.undone = (
            f"{what}: {reason.rstrip('.')}. What was recorded is kept; it is tried again every {AGAIN_S:.0f} s. "
            f"{FAULTS['recording-failed'].advice if isinstance(error, OSError) else ''}"
        ).rstrip(". ")
        self._notify(f"{self.undone}.", bad=True)

    def keep(self, run: TrialRun) -> None:
        """A trial has come to its end."""
        reason = run.trial.outcome()["reason"]
        notice = with_advice(run.name, reason)
        assert self.progress is not None
        try:
            row = run.keep(self.progress.session)
            self.verified = run.name.lower() if row.recording else self.verified
            if row.status == "aborted":  # the experimenter decided so: their reason alone does not show that
                notice = with_advice(f"{run.name} was aborted", reason)
                if run.again != "never" and row.block:
                    self.progress.session.redo(row.run, reason, at_end=run.again == "end")
                    notice += " It is repeated next." if run.again == "now" else " It is repeated at the end."
            if row.status == "stopped":
                notice += " It is repeated next; it can be skipped." if row.block else " It is repeated next."
            if row.recording.endswith(STREAM_SUFFIX):
                notice += f" The disk did not take the Parquet file of {run.name.lower()}: its stream is whole."
            self.progress.trial_ended(row)
            self.changed(notice.strip())
        except (InputError, OSError) as error:
            run.let_go()
            self.fail(f"{run.name} is not complete", error)

    def rescue(self, run: TrialRun, why: str) -> None:
        """The control loop was lost with a trial."""
        notice = with_advice("", why)
        assert self.progress is not None
        try:
            run.rescue(self.progress.session)
            self.write(LOOP_LOST, run=run.planned.run, reason=why)
            self.progress.last_end_s = None
            self.changed(f"{notice} {run.name} is recovered and its trial is repeated next.", bad=True)
        except (InputError, OSError) as error:
            self.fail(f"{why}; {run.name.lower()} is not complete", error)

    def changed(self, notice: str, bad: bool = False) -> None:
        """A row has been added or marked: what comes, the table of all participants, and what to say. OSError."""
        assert self.progress is not None
        self.progress.look_ahead()
        self._notify(" ".join(filter(None, (notice, self.progress.without_valid_trial()))), bad=bad)
        try:
            write_pooled_table(self._data_dir)
        except InputError as error:  # another session's table cannot be read: this one goes on
            self._notify(f"{notice} The table of all participants was not rewritten: {error}.".strip(), bad=True)

    def catch_up(self) -> None:
        """What the disk has not taken is tried again, now and then; nothing may be running."""
        waited_s = time.perf_counter() - self._tried_s
        if self.progress is None or not (self.undone or self.streams) or waited_s < AGAIN_S:
            return
        self._tried_s = time.perf_counter()
        session, streams = self.progress.session, self.streams
        there = {row.run for row in session.rows}
        try:
            self._write_late()
            left = session.put_in_order()
            if self.undone or self.streams != streams:
                new = [row for row in session.rows if row.run not in there]
                runs = ", ".join(f"run {row.run} is {row.status}" for row in new)
                notice = f"The disk has taken everything now{': ' if runs else ''}{runs}."
                if any(row.status not in SETTLED for row in new):
                    notice += " What was cut off is repeated."
                self.changed(" ".join([notice, *(f"It cannot be rescued: {one}." for one in left)]), bad=bool(left))
        except (InputError, OSError) as error:
            self.fail(self._failed or "Streams are still to be converted", error)
            return
        self.undone = self._failed = ""
