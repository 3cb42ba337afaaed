"""What the open session has to bring to the disk: its trials, its journal, the tables.

What the disk does not take is said, kept in mind and tried again: no trial starts meanwhile, and nothing is lost. A
recording that is whole but does not become a Parquet file stops nothing: it is converted later.
"""

import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from app.session_server.remedies import told
from app.session_server.session_progress import Sitting
from app.session_server.trial_run import TrialRun
from app.session_server.trial_runner import Runner
from core.errors import InputError
from experiments.analysis.trials_table import SETTLED
from experiments.recording.reader import STREAM_SUFFIX
from experiments.session.files import write_pooled_table

AGAIN_S = 5.0  # between two attempts


class Keeping:
    """The disk's part of the desk, for one session after the other."""

    def __init__(self, data_dir: Path, runner: Runner, say: Callable[..., None]) -> None:
        """say: to the experimenter."""
        self.sitting: Sitting | None = None  # the open session
        self.undone = ""  # what of it the disk has not taken yet, and why
        self.verified = ""  # what was recorded last
        self._data_dir, self._runner, self._say = data_dir, runner, say
        self._late: list[tuple[str, dict]] = []  # lines of the journal
        self._tried_s = time.monotonic()

    def take(self, sitting: Sitting | None) -> None:
        """A session to keep."""
        self.sitting, self.undone, self.verified, self._late = sitting, "", "", []

    def leave(self) -> None:
        """The session is closed. OSError, and it stays open: the disk does not take the journal's last lines.

        What else it lacks is made up for when it is opened again, or by `phd recover`.
        """
        self._write_late()
        self.let_go()

    def let_go(self) -> None:
        """The session is closed, whatever the disk says: lines that it does not take go to the log of the bench."""
        if self.sitting is None:
            return
        try:
            self._write_late()
        except OSError as error:
            for event, about in self._late:
                print(f"{self.sitting.session.folder}: not in the journal ({error}): {event} {about}", file=sys.stderr)
        self.sitting.session.close()
        self.take(None)

    @property
    def streams(self) -> int:
        """Trials whose recording is whole but no Parquet file yet."""
        rows = self.sitting.session.rows if self.sitting else []
        return sum(row.recording.endswith(STREAM_SUFFIX) for row in rows)

    def write(self, event: str, **about: object) -> None:
        """A line in the journal of the session, if there is one; never while the control loop waits for us."""
        if self.sitting is None:
            return
        session, at = self.sitting.session, datetime.now(UTC).isoformat(timespec="milliseconds")

        def put() -> None:
            try:
                session.journal(event, **about)
            except OSError:
                self._late.append((event, {"time": at, **about}))
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
            assert self.sitting is not None
            event, about = self._late[0]
            self.sitting.session.journal(event, **about)
            self._late.pop(0)

    def fail(self, what: str, error: Exception) -> None:
        """The disk took no more."""
        reason = (getattr(error, "strerror", None) or str(error)).rstrip(".")
        self.undone = f"{what}: {reason}. What was recorded is kept; it is tried again every {AGAIN_S:.0f} s"
        self._tried_s = time.monotonic()
        self._say(f"{self.undone}.", bad=True)

    def keep(self, run: TrialRun) -> None:
        """A trial has come to its end."""
        said = told(run.name, run.trial.outcome()["reason"])
        if self.sitting is None:
            self._say(said)
            return
        try:
            row = run.keep(self.sitting.session)
            self.verified = run.name.lower() if row.recording else self.verified
            if row.status == "aborted":  # somebody decided so: the reason alone would not say what became of it
                said = told(f"{run.name} was aborted", run.trial.outcome()["reason"])
            if row.status == "stopped":
                said += " It comes again: start it, or skip it." if row.block else " It comes again: start it."
            if row.recording.endswith(STREAM_SUFFIX):
                said += f" The disk did not take the Parquet file of {run.name.lower()}: its stream is whole."
            self.sitting.trial_ended()
            self.changed(said.strip())
        except (InputError, OSError) as error:
            run.let_go()
            self.fail(f"{run.name} is not complete", error)

    def rescue(self, run: TrialRun, why: str) -> None:
        """The control loop was lost with a trial."""
        said = told("", why)
        if self.sitting is None:
            run.let_go()
            self._say(said, bad=True)
            return
        try:
            run.rescue(self.sitting.session)
            self.write("control loop lost", run=run.planned.run, reason=why)
            self.sitting.last_end_s = None
            self.changed(f"{said} {run.name} is recovered and its trial comes again.", bad=True)
        except (InputError, OSError) as error:
            self.fail(f"{why}; {run.name.lower()} is not complete", error)

    def changed(self, said: str, bad: bool = False) -> None:
        """A row has been added or marked: what comes, the table of all participants, and what to say. OSError."""
        assert self.sitting is not None
        self.sitting.look_ahead()
        self._say(" ".join(filter(None, (said, self.sitting.without_valid_trial()))), bad=bad)
        try:
            write_pooled_table(self._data_dir)
        except InputError as error:  # another session's table cannot be read: this one goes on
            self._say(f"{said} The table of all participants was not rewritten: {error}.".strip(), bad=True)

    def catch_up(self) -> None:
        """What the disk has not taken is tried again, now and then; nothing may be running."""
        now = time.monotonic()
        if self.sitting is None or not (self.undone or self.streams) or now - self._tried_s < AGAIN_S:
            return
        self._tried_s = now
        session, streams = self.sitting.session, self.streams
        there = {row.run for row in session.rows}
        try:
            self._write_late()
            left = session.put_in_order()
            if self.undone or self.streams != streams:
                new = [row for row in session.rows if row.run not in there]
                runs = ", ".join(f"run {row.run} is {row.status}" for row in new)
                said = f"The disk has taken everything now{': ' if runs else ''}{runs}."
                if any(row.status not in SETTLED for row in new):
                    said += " What was cut off comes again."
                self.changed(" ".join([said, *(f"It cannot be rescued: {one}." for one in left)]), bad=bool(left))
        except (InputError, OSError) as error:
            self.fail(self.undone.partition(":")[0] or "Streams are still to be converted", error)
            return
        self.undone = ""
