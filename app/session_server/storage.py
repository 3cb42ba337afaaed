"""Writes the open session to the disk: its trials, its journal, the tables.

What cannot be written (a full disk, a folder that is gone) stays in memory and is tried again. The experimenter reads
what is in memory and what is lost, and no trial starts meanwhile. The session can also go on in another folder
(`move_to`). A stream that cannot be converted to Parquet stops nothing: it is converted later.
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
from experiments.analysis.trials_table import FINISHED
from experiments.plan import counted, grouped
from experiments.recording import STREAM_SUFFIX
from experiments.recording.atomic_files import refusing
from experiments.recording.writer import RecordingWriter
from experiments.session.files import hold_lock, write_pooled_table
from experiments.session.in_memory import refuse_place
from experiments.session.journal import LOOP_LOST, Event, now

RETRY_S = 5.0  # between two attempts to write, and between two checks of the folder
#: Status of a trial that did not go to its end -> words after its name; the reason alone does not say so.
HOW_ENDED = {"aborted": " was aborted", "stopped": " stopped"}


class Storage:
    """The open session as far as it concerns the disk; one session at a time."""

    def __init__(self, data_dir: Path, runner: TrialRunner, notify: Callable[..., None]) -> None:
        """notify: shows the experimenter a sentence."""
        self._data_dir, self._runner, self._notify = data_dir, runner, notify
        self.moved: tuple[str, str] | None = None  # a session that was moved: its new data folder, its participant
        self.set_session(None)

    def set_session(self, progress: SessionProgress | None) -> None:
        """Set the open session; None: none is open."""
        self.progress = progress
        self.moved = None if progress is not None else self.moved
        self.verified = ""  # name of the run whose recording was verified last
        self._failed = ""  # what could not be written
        self.not_written = ""  # the same with its reason, a sentence without its full stop; "": everything is written
        self._unsaved_lines: list[tuple[Event, str, dict]] = []  # lines of the journal that are in memory
        self._unsaved_trial: TrialRun | None = None  # a trial that has ended and whose recording is in memory
        self._was_gone = False  # the folder was gone since everything was last written: its lock went with it
        self._reported: TrialRun | None = None  # the running trial whose failure the experimenter has read about
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
        """The data that are in no file: "run 5, 5,481 ticks"; "": none."""
        parts = []
        if self._unsaved_trial is not None and (writer := self._unsaved_trial.unsaved) is not None:
            parts.append(f"{self._unsaved_trial.name.lower()}, {counted(writer.rows - writer.lost, 'tick')}")
        elif self._runner.run is not None and self._reported is self._runner.run:
            parts.append(f"the ticks of {self._reported.name.lower()}")
        if self._unsaved_lines:
            parts.append(f"{counted(len(self._unsaved_lines), 'line')} of the journal")
        return " and ".join(parts)

    def leave(self) -> None:
        """Close the session if everything in memory can be written; else OSError or InputError, and it stays open.

        Streams that are no Parquet files yet are converted when it is opened again, or by `phd recover`.
        """
        self._write_unsaved_lines()
        if self._unsaved_trial is not None:
            self._store_unsaved_trial()
        self.close_session()

    def close_session(self) -> str:
        """Close the session in any case. Returns what is lost, "" for nothing.

        Lines of the journal that cannot be written go to the log.
        """
        if self.progress is None:
            return ""
        session = self.open.session
        try:
            if self._unsaved_trial is not None:
                self._store_unsaved_trial()
            self._write_unsaved_lines()
        except (InputError, OSError) as error:
            for event, at, about in self._unsaved_lines:
                print(f"{session.folder}: not in the journal ({error}): {at} {event.name} {about}", file=sys.stderr)
        lost = self.in_memory
        session.close()
        self.set_session(None)
        return lost

    def write(self, event: Event, **about: Any) -> None:
        """Write a line into the journal, if a session is open; during a trial the recorder's thread does it."""
        if self.progress is None:
            return
        session, at = self.open.session, now()
        self.open.apply_event(event, at, about)

        def write_line() -> None:
            try:
                session.refuse_other_folder()
                session.journal(event, time=at, **about)
            except OSError:
                self._unsaved_lines.append((event, at, about))
                raise

        try:
            if self._runner.run is not None:
                self._runner.run.recorder.write_between(write_line)
            else:
                write_line()
        except OSError as error:
            self.fail("The journal is not complete", error)

    def _write_unsaved_lines(self) -> None:
        """Write the lines of the journal that are in memory, with their own times. OSError."""
        while self._unsaved_lines:
            event, at, about = self._unsaved_lines[0]
            self.open.session.refuse_other_folder()
            self.open.session.journal(event, time=at, **about)
            self._unsaved_lines.pop(0)

    def fail(self, trouble: str, error: Exception) -> None:
        """Show the experimenter that something could not be written: what is in memory, what is lost, what to do."""
        gone = self.open.session.missing_files()
        self._failed, self._tried_s, self._was_gone = trouble, time.perf_counter(), self._was_gone or bool(gone)
        reason = gone or getattr(error, "strerror", None) or cause_of(error)
        parts = [*filter(None, (trouble, reason))]
        if gone or isinstance(error, OSError) or isinstance(error.__cause__, OSError):
            code = "folder-gone" if gone else "recording-failed"
            parts += [FAULTS[code].advice, "Or go on in another folder"]
        parts += self._memory_report()
        if self._runner.run is None:
            parts.append(f"It is tried again every {RETRY_S:.0f} s")
        self.not_written = ". ".join(part[0].upper() + part[1:].rstrip(".") for part in parts)
        self._notify(f"{self.not_written}.", bad=True)

    def _memory_report(self) -> list[str]:
        """What is in memory and what is lost, in sentences without their full stops."""
        running = self._runner.run if self._reported is self._runner.run else None
        run, sentences = self._unsaved_trial or running, []
        if run is not None and (writer := run.recorder.writer) is not None and writer.trouble is not None:
            if run is running:
                sentences.append(
                    "The trial goes on, and its ticks are kept in memory" if not writer.lost else "It is ended"
                )
            else:
                sentences.append(_where_ticks_are(writer))
        if self._unsaved_lines:
            lines = len(self._unsaved_lines)
            sentences.append(f"{counted(lines, 'line')} of the journal {'is' if lines == 1 else 'are'} in memory")
        if sentences and not (running and running is run):
            sentences.append("What is in memory is lost if this program ends before it is written")
        return sentences

    def check_folder(self) -> bool:
        """Whether the session's folder and files are there; if not, no trial starts. It waits for the disk."""
        if self.progress is None:
            return True
        gone = self.open.session.missing_files()
        if gone and gone not in self.not_written:
            self.fail(self._failed, InputError(gone))
        return not gone

    def watch(self, run: TrialRun) -> None:
        """Report once when the disk fails during a trial of the session."""
        if (trouble := run.recorder.trouble) is not None and self._reported is not run:
            self._reported = run
            self.fail(f"The disk has failed under {run.name.lower()}", trouble)

    def store_trial(self, run: TrialRun) -> None:
        """Store a trial that has ended."""
        try:
            self._finish_trial(run)
            if self.not_written:
                self._store()
        except (InputError, OSError) as error:
            run.abandon_recording()
            self._keep_in_memory(run, f"{run.name} is not complete", error)

    def _keep_in_memory(self, run: TrialRun, trouble: str, error: Exception) -> None:
        """Keep the recording of a trial in memory if it is not on the disk, and report that."""
        self._unsaved_trial = run if run.unsaved is not None else None
        writer, sentence = run.recorder.writer, trouble
        if self._unsaved_trial is None and writer is not None and writer.lost:
            sentence = f"{trouble} ({_where_ticks_are(writer)})"
        self.fail(sentence, error)

    def _finish_trial(self, run: TrialRun) -> None:
        """Add the row of a trial and tell the experimenter. InputError or OSError: recording or row is not written."""
        reason = run.trial.outcome()["reason"]
        row = run.finish(self.open.session)
        notice = with_advice(f"{self.open.name_of(row)}{HOW_ENDED.get(row.status, '')}", reason)
        self.verified = run.name.lower() if row.recording else self.verified
        if row.status == "aborted" and run.again != "never" and row.block:
            self.open.session.redo(row.run, reason, at_end=run.again == "end")
            notice += " It is repeated next." if run.again == "now" else " It is repeated at the end."
        if row.status == "stopped":
            notice += " It is repeated next; it can be skipped." if row.block else " It is repeated next."
        if row.recording.endswith(STREAM_SUFFIX):
            notice += f" The disk did not take the Parquet file of {run.name.lower()}: its stream is whole."
        self.open.trial_ended(row)
        self.update_tables(notice.strip())

    def rescue(self, run: TrialRun, why: str) -> None:
        """Recover a trial with which the control loop was lost."""
        notice = with_advice("", why)
        try:
            run.rescue(self.open.session)
            self.write(LOOP_LOST, run=run.planned.run, reason=why)
            self.open.last_end_s = None
            self.update_tables(f"{notice} {run.name} is recovered and its trial is repeated next.", bad=True)
        except (InputError, OSError) as error:
            self._keep_in_memory(run, f"{why}; {run.name.lower()} is not complete", error)

    def update_tables(self, notice: str, bad: bool = False) -> None:
        """After a row was added or marked: the next trial, the table of all participants, a notice. OSError."""
        self.open.update_next()
        self._notify(" ".join(filter(None, (notice, self.open.without_valid_trial()))), bad=bad)
        try:
            write_pooled_table(self._data_dir)
        except InputError as error:  # another session's table cannot be read: this one goes on
            self._notify(f"{notice} The table of all participants was not rewritten: {error}.".strip(), bad=True)

    def retry(self) -> None:
        """Every `RETRY_S`, while no trial runs: check the folder and write what could not be written."""
        if self.progress is None or time.perf_counter() - self._tried_s < RETRY_S:
            return
        self._tried_s = time.perf_counter()
        if self.check_folder() and (self.not_written or self.streams or self._unsaved_lines):
            self._store()

    def _store(self) -> None:
        """Write everything that could not be written before."""
        session, streams = self.open.session, self.streams
        runs_before = {row.run for row in session.rows}
        try:
            if self._was_gone:
                session.take_lock_again()
            self._write_unsaved_lines()
            if self._unsaved_trial is not None:
                self._store_unsaved_trial()
            not_rescued = session.recover_interrupted()
            if self.not_written or self.streams != streams:
                new = [row for row in session.rows if row.run not in runs_before]
                runs = ", ".join(f"run {row.run} is {row.status}" for row in new)
                notice = f"All pending data are written{': ' if runs else ''}{runs}."
                if any(row.status not in FINISHED for row in new):
                    notice += " What was cut off is repeated."
                notice += "".join(f" It cannot be rescued: {file}." for file in not_rescued)
                self.update_tables(notice, bad=bool(not_rescued))
        except (InputError, OSError) as error:
            trouble = "The session is not complete" if self.not_written else "Streams are still to be converted"
            self.fail(self._failed or trouble, error)
            return
        self.not_written, self._failed, self._was_gone, self._reported = "", "", False, None

    def _store_unsaved_trial(self) -> None:
        """Write the trial in memory to its file; one that was cut off is recovered from there like any other.

        InputError or OSError: it cannot be written, or its row cannot.
        """
        run = self._unsaved_trial
        assert run is not None
        self.open.session.refuse_other_folder()
        if (writer := run.unsaved) is not None:
            writer.save()
        try:
            if run.recorder.writer is not None and run.recorder.writer.ended:
                self._finish_trial(run)
        finally:
            if run.unsaved is None:  # its file is there: what else is missing is made from it
                self._unsaved_trial = None

    def move_to(self, data_dir: Path) -> None:
        """Move the session to another data folder and close it here; the window then opens it there (`moved`).

        InputError or OSError: it cannot be written there, and stays open here.
        """
        session, before = self.open.session, self.open.session.folder
        if data_dir.resolve() == self._data_dir.resolve():
            raise InputError(f"{data_dir}: is the data folder of this session already; choose another")
        refuse_place(data_dir, session.participant)
        with refusing(data_dir, "cannot be used"):
            data_dir.mkdir(parents=True, exist_ok=True)
        with hold_lock(data_dir):
            unsaved = self._unsaved_trial.unsaved if self._unsaved_trial is not None else None
            left_behind = session.move_to(data_dir, unsaved)
            self._data_dir, self._was_gone = data_dir, False
            self._store()
        if self.not_written:  # it is in the other folder, which has become full
            return
        moved, notice = (str(data_dir), session.participant), f"The session goes on in {session.folder}."
        if left_behind:
            notice += (
                f" {counted(left_behind, 'recording')} could not be copied from {before}: copy them into the new "
                "folder when that one is back; phd verify names each. Their measures are in the table."
            )
        self.close_session()
        self.moved = moved
        self._notify(notice, bad=bool(left_behind))


def _where_ticks_are(writer: RecordingWriter) -> str:
    """The place of the ticks that the file of a recording lacks, in words."""
    if not writer.lost:
        return f"All its {counted(writer.rows, 'tick')} are in memory"
    kept = f"{grouped(writer.rows - writer.lost)} are {'in memory' if writer.in_memory else 'in its file'}"
    return f"{grouped(writer.lost)} of its {counted(writer.rows, 'tick')} are lost, {kept}"
