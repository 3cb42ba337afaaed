"""Brings the open session to the disk: its trials, its journal, the tables.

What the disk does not take, or a folder that is gone has taken along, is kept in memory and tried again, and the
experimenter reads what is in memory and what is lost: no trial starts meanwhile. When the folder is back it is written;
or the session goes on in another one (`move_to`). A recording that is whole but does not become a Parquet file stops
nothing: it is converted later.
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
from experiments.analysis.trials_table import FINISHED, TrialRow
from experiments.plan import counted, grouped
from experiments.recording import STREAM_SUFFIX
from experiments.recording.atomic_files import refusing
from experiments.recording.writer import RecordingWriter
from experiments.session.files import hold_lock, write_pooled_table
from experiments.session.in_memory import refuse_place
from experiments.session.journal import LOOP_LOST, Event, now

AGAIN_S = 5.0  # between two attempts, and between two looks at the folder


class Storage:
    """One session after the other."""

    def __init__(self, data_dir: Path, runner: TrialRunner, notify: Callable[..., None]) -> None:
        """notify: to the experimenter."""
        self._data_dir, self._runner, self._notify = data_dir, runner, notify
        self.moved: tuple[str, str] | None = None  # of a session that was brought elsewhere: data folder, participant
        self.take(None)

    def take(self, progress: SessionProgress | None) -> None:
        """A session to keep; None: there is none."""
        self.progress = progress
        self.moved = None if progress is not None else self.moved
        self.verified = ""  # what was recorded last
        self._failed = ""  # what the disk has not taken yet ..
        self.undone = ""  # .. and why, one sentence without its full stop
        self._late: list[tuple[Event, str, dict]] = []  # lines of the journal that it has not taken
        self._held: TrialRun | None = None  # a trial that has ended, whose recording is in memory
        self._gone = False  # the folder was, since everything was last on the disk: its lock went with it
        self._told: TrialRun | None = None  # the running trial of whose trouble the experimenter knows
        self._tried_s = time.perf_counter()

    @property
    def open(self) -> SessionProgress:
        """The open session, where there must be one."""
        assert self.progress is not None, "no session is open"
        return self.progress

    @property
    def streams(self) -> int:
        """Trials whose recording is whole but no Parquet file yet."""
        rows = self.progress.session.rows if self.progress else []
        return sum(row.recording.endswith(STREAM_SUFFIX) for row in rows)

    @property
    def in_memory(self) -> str:
        """What is in no file: "run 5, 5,481 ticks"; "": nothing."""
        parts = []
        if self._held is not None and (writer := self._held.unsaved) is not None:
            parts.append(f"{self._held.name.lower()}, {counted(writer.rows - writer.lost, 'tick')}")
        elif self._runner.run is not None and self._told is self._runner.run:
            parts.append(f"the ticks of {self._told.name.lower()}")
        if self._late:
            parts.append(f"{counted(len(self._late), 'line')} of the journal")
        return " and ".join(parts)

    def leave(self) -> None:
        """The session is closed. OSError or InputError, and it stays open: the disk does not take what is in memory.

        What else it lacks is made up for when it is opened again, or by `phd recover`.
        """
        self._write_late()
        if self._held is not None:
            self._store_held()
        self.let_go()

    def let_go(self) -> str:
        """The session is closed, whatever the disk does. What is lost with it, "" for nothing; lines of the journal
        that it does not take go to the log.
        """
        if self.progress is None:
            return ""
        session = self.open.session
        try:
            if self._held is not None:
                self._store_held()
            self._write_late()
        except (InputError, OSError) as error:
            for event, at, about in self._late:
                print(f"{session.folder}: not in the journal ({error}): {at} {event.name} {about}", file=sys.stderr)
        lost = self.in_memory
        session.close()
        self.take(None)
        return lost

    def write(self, event: Event, **about: Any) -> None:
        """A line in the journal of the session, if there is one; never while the control loop waits for us."""
        if self.progress is None:
            return
        session, at = self.open.session, now()
        self.open.take_in(event, at, about)

        def put() -> None:
            try:
                session.refuse_other_folder()
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
            self.open.session.refuse_other_folder()
            self.open.session.journal(event, time=at, **about)
            self._late.pop(0)

    def fail(self, what: str, error: Exception) -> None:
        """The disk took no more: say what is in memory, what is lost, and what to do."""
        gone = self.open.session.lacks()
        self._failed, self._tried_s, self._gone = what, time.perf_counter(), self._gone or bool(gone)
        reason = gone or getattr(error, "strerror", None) or cause_of(error)
        parts = [f"{what}: {reason.rstrip('.')}" if what else reason, *self._truth()]
        if self._runner.run is None:
            parts.append(f"It is tried again every {AGAIN_S:.0f} s")
        if gone or isinstance(error, OSError):
            code = "folder-gone" if gone else "recording-failed"
            parts.append(f"{FAULTS[code].advice} Or go on in another folder")
        self.undone = ". ".join(parts).rstrip(". ")
        self._notify(f"{self.undone}.", bad=True)

    def _truth(self) -> list[str]:
        """What is in memory and what is lost, in sentences without their full stops."""
        running = self._runner.run if self._told is self._runner.run else None
        run, said = self._held or running, []
        if run is not None and (writer := run.recorder.writer) is not None and writer.trouble is not None:
            if run is running:
                said.append("The trial goes on, and its ticks are kept in memory" if not writer.lost else "It is ended")
            else:
                said.append(_ticks_of(writer))
        if self._late:
            said.append(f"{counted(len(self._late), 'line')} of the journal {'is' if len(self._late) == 1 else 'are'} "
                        "in memory")  # fmt: skip
        if said and not (running and running is run):
            said.append("What is in memory is lost if this program ends before it is written")
        return said

    def look(self) -> bool:
        """Whether the folder of the session is there as it was left; where it is not, no trial starts. Waits for the
        disk.
        """
        if self.progress is None:
            return True
        gone = self.open.session.lacks()
        if gone and gone not in self.undone:
            self.fail(self._failed, InputError(gone))
        return not gone

    def watch(self, run: TrialRun) -> None:
        """A trial of the session runs: say when the disk fails under it."""
        if (trouble := run.recorder.trouble) is not None and self._told is not run:
            self._told = run
            self.fail(f"The disk has failed under {run.name.lower()}", trouble)

    def store_trial(self, run: TrialRun) -> None:
        """A trial has come to its end."""
        try:
            self._take_in(run)
            if self.undone:
                self._store()
        except (InputError, OSError) as error:
            run.let_go()
            self._hold(run, f"{run.name} is not complete", error)

    def _hold(self, run: TrialRun, what: str, error: Exception) -> None:
        """Its recording stays in memory if the disk does not have it."""
        self._held = run if run.unsaved is not None else None
        writer, said = run.recorder.writer, what
        if self._held is None and writer is not None and writer.lost:
            said = f"{what} ({_ticks_of(writer)})"
        self.fail(said, error)

    def _take_in(self, run: TrialRun) -> None:
        """Its row, and what follows. InputError or OSError: the disk does not take what is needed."""
        reason = run.trial.outcome()["reason"]
        notice = with_advice(run.name, reason)
        row = run.finish(self.open.session)
        self.verified = run.name.lower() if row.recording else self.verified
        if row.status == "aborted":  # the experimenter decided so: their reason alone does not show that
            notice = with_advice(f"{run.name} was aborted", reason)
            if run.again != "never" and row.block:
                self.open.session.redo(row.run, reason, at_end=run.again == "end")
                notice += " It is repeated next." if run.again == "now" else " It is repeated at the end."
        if row.status == "stopped":
            notice += " It is repeated next; it can be skipped." if row.block else " It is repeated next."
        if row.recording.endswith(STREAM_SUFFIX):
            notice += f" The disk did not take the Parquet file of {run.name.lower()}: its stream is whole."
        self.open.trial_ended(row)
        self.changed(notice.strip())

    def rescue(self, run: TrialRun, why: str) -> None:
        """The control loop was lost with a trial."""
        notice = with_advice("", why)
        try:
            run.rescue(self.open.session)
            self.write(LOOP_LOST, run=run.planned.run, reason=why)
            self.open.last_end_s = None
            self.changed(f"{notice} {run.name} is recovered and its trial is repeated next.", bad=True)
        except (InputError, OSError) as error:
            self._hold(run, f"{why}; {run.name.lower()} is not complete", error)

    def changed(self, notice: str, bad: bool = False) -> None:
        """A row has been added or marked: what comes, the table of all participants, and what to say. OSError."""
        self.open.look_ahead()
        self._notify(" ".join(filter(None, (notice, self.open.without_valid_trial()))), bad=bad)
        try:
            write_pooled_table(self._data_dir)
        except InputError as error:  # another session's table cannot be read: this one goes on
            self._notify(f"{notice} The table of all participants was not rewritten: {error}.".strip(), bad=True)

    def catch_up(self) -> None:
        """Now and then: whether the folder is there; what the disk has not taken is tried again. Nothing may run."""
        if self.progress is None or time.perf_counter() - self._tried_s < AGAIN_S:
            return
        self._tried_s = time.perf_counter()
        if self.look() and (self.undone or self.streams or self._late):
            self._store()

    def _store(self) -> None:
        """What the disk has not taken is tried again."""
        session, streams = self.open.session, self.streams
        there: dict[int, TrialRow] = {row.run: row for row in session.rows}
        try:
            if self._gone:
                session.hold_again()
            self._write_late()
            if self._held is not None:
                self._store_held()
            left = session.recover_interrupted()
            if self.undone or self.streams != streams:
                new = [row for row in session.rows if row.run not in there]
                runs = ", ".join(f"run {row.run} is {row.status}" for row in new)
                notice = f"The disk has taken everything now{': ' if runs else ''}{runs}."
                if any(row.status not in FINISHED for row in new):
                    notice += " What was cut off is repeated."
                self.changed(" ".join([notice, *(f"It cannot be rescued: {one}." for one in left)]), bad=bool(left))
        except (InputError, OSError) as error:
            what = "The session is not complete" if self.undone else "Streams are still to be converted"
            self.fail(self._failed or what, error)
            return
        self.undone, self._failed, self._gone, self._told = "", "", False, None

    def _store_held(self) -> None:
        """The trial in memory goes to its file; cut off, it is recovered from there like any other.

        InputError or OSError: the disk does not take it, or what follows from it.
        """
        held = self._held
        assert held is not None
        self.open.session.refuse_other_folder()
        if (writer := held.unsaved) is not None:
            writer.save()
        try:
            if held.recorder.writer is not None and held.recorder.writer.ended:
                self._take_in(held)
        finally:
            if held.unsaved is None:  # its file is there: what else is missing is made from it
                self._held = None

    def move_to(self, data_dir: Path) -> None:
        """Bring the session to another data folder and close it here, to be gone on with there (`moved`).

        InputError or OSError: the other folder does not take it, and it stays open here.
        """
        session, before = self.open.session, self.open.session.folder
        if data_dir.resolve() == self._data_dir.resolve():
            raise InputError(f"{data_dir}: is the data folder of this session already; choose another")
        refuse_place(data_dir, session.participant)
        with refusing(data_dir, "cannot be used"):
            data_dir.mkdir(parents=True, exist_ok=True)
        with hold_lock(data_dir):
            behind = session.move_to(data_dir, self._held.unsaved if self._held is not None else None)
            self._data_dir, self._gone = data_dir, False
            self._store()
        if self.undone:  # it is in the other folder, which is full by now
            return
        moved, notice = (str(data_dir), session.participant), f"The session goes on in {session.folder}."
        if behind:
            notice += (
                f" {counted(behind, 'recording')} stayed in {before}, if that is anywhere: bring them into the new "
                "folder; phd verify names each. Their measures are in the table."
            )
        self.let_go()
        self.moved = moved
        self._notify(notice, bad=bool(behind))


def _ticks_of(writer: RecordingWriter) -> str:
    """Where the ticks of a recording are that its file does not have."""
    if not writer.lost:
        return f"All its {counted(writer.rows, 'tick')} are in memory"
    kept = f"{grouped(writer.rows - writer.lost)} are {'in memory' if writer.in_memory else 'in its file'}"
    return f"{grouped(writer.lost)} of its {counted(writer.rows, 'tick')} are lost, {kept}"
