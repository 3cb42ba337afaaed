"""A participant's session: its plan, its trials in order, and their recordings and rows (files: see `files`).

Nothing is overwritten: every file is new, tables are replaced whole, and what changes a table stands in the journal
first. One live process may write in a session.
"""

import contextlib
import errno
import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Self

import msgspec

from core.control.controllers import Preset, decision_words
from core.files import InputError
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis import steering
from experiments.analysis.own_measures import own_metrics
from experiments.analysis.trials_table import COUNTED, TrialRow, append_row, as_table, row_of, write_table
from experiments.inputs import MOUSE, OPERATOR, SENSOR
from experiments.plan import (
    PRACTICE_BLOCK,
    PlannedTrial,
    break_after,
    make_plan,
    participant_index,
    plan_hash,
    plan_to_json,
    practice_trial,
)
from experiments.protocol import Protocol, middle_of_first, protocol_to_json
from experiments.recording import STREAM_SUFFIX
from experiments.recording.atomic_files import reading_stored, refusing, write_new_file
from experiments.recording.reader import read_recording
from experiments.recording.schema import Sensors
from experiments.recording.writer import RecordingWriter, convert_to_parquet
from experiments.session import files
from experiments.session import journal as events
from experiments.session.blind import KEY, new_key, read_key, write_key
from experiments.session.checksums import END, sealed
from experiments.session.consent import KEY as CONSENT
from experiments.session.consent import ConsentAnswer, refuse_consent, refuse_without_consent
from experiments.session.in_memory import InMemory, discard, refuse_place
from experiments.session.metadata import operators_from_json, preset_to_json, versions
from experiments.session.recover import recover_session
from experiments.trial.normals import normals
from experiments.trial.operator import Person
from experiments.trial.population import Operators
from experiments.trial.real_trial import RealTrial
from experiments.trial.trial import Conditions, SimulatedTrial, Trial

OnEvent = Callable[[events.Event, dict[str, Any]], None]


class Participant(NamedTuple):
    """Whose session it is, and whose hand moves the handle."""

    label: str
    hand: str = MOUSE  # of `INPUTS`; of a simulated operator always OPERATOR
    operator: Person | None = None  # simulated; None: a person
    population: Operators | None = None  # of which the simulated operator is one
    form: Mapping[str, str | float] = {}  # answers to the protocol's questions
    consent: ConsentAnswer | None = None  # None: not asked


class Session:
    """One participant's session in progress; holds its lock until `close` or the end of the process."""

    _in_memory: InMemory | None = None  # its folder; None: the session is being created

    def __init__(
        self, data_dir: Path, who: Participant, protocol: Protocol, blind: bool | None = None, sync: bool = True,
        on_event: OnEvent | None = None,
    ) -> None:  # fmt: skip
        """Create the folder and store the plan.

        blind: whether the controllers stand as codes (None: as in the protocol; a simulated operator's never do).
        sync = False leaves it to the system when data reach the disk (simulated studies: they can be run again).
        on_event: called after each line of the journal.
        InputError if the session exists, the participant is none of the protocol's, or the folder cannot be made.
        """
        if who.operator is None:
            protocol.refuse_stranger(who.label)
            refuse_consent(protocol, who.label, who.consent)
        else:
            who = who._replace(hand=OPERATOR)
        protocol.refuse_unknown_low_gain()
        own_metrics(protocol)  # InputError: its own measures cannot be used
        protocol.refuse_answers(who.form)
        is_blind = (protocol.blind and who.operator is None) if blind is None else blind
        plan = make_plan(protocol, who.label, is_blind)
        files.refuse_existing(data_dir, who.label)
        self._init_common(data_dir, who, protocol, sync, on_event)
        self.blind, self.plan, self.plan_sha256 = is_blind, plan, plan_hash(plan)
        with refusing(self.folder, "cannot be created"):
            try:
                (self.folder / files.TRIALS).mkdir(parents=True, exist_ok=True)
                self._lock = files.hold_lock(self.folder)
            except OSError:
                files.remove_empty(self.folder)
                raise
        try:
            files.refuse_existing(data_dir, who.label)  # another process was faster
        except InputError:
            self.close()
            raise
        try:
            if self.blind:
                self._key = new_key(protocol.controllers)
            about = self._session_json(write_key(self.folder, self._key, sync) if self.blind else "")
            about |= {"form": dict(who.form)} if who.form else {}
            about |= {CONSENT: who.consent._asdict()} if who.consent else {}
            write_new_file(self.folder / files.STORED, sealed(about), sync)
            self.journal(events.CREATED, plan=self.plan_sha256)
            if who.consent:
                self.journal(events.CONSENT, **who.consent._asdict())
            self._in_memory = InMemory(self.folder, self.rows)
        except BaseException:
            for name in (files.STORED, KEY, events.NAME, END, files.LOCK):
                with contextlib.suppress(OSError):  # the first error is the one to report
                    (self.folder / name).unlink()
            self.close()
            files.remove_empty(self.folder)
            raise

    @classmethod
    def resume(cls, data_dir: Path, participant: str, sync: bool = True, on_event: OnEvent | None = None) -> Self:
        """Go on with a session that was interrupted, by its stored plan and protocol (whose file is not needed).

        What a crash left is recovered first; `next_planned` then gives the first trial that is still to be run. The
        simulated devices start afresh, at rest, with the play and the yield of a device just switched on: so the trials
        after a crash are not the ones that an uninterrupted session would have run, bit by bit.
        InputError if there is no such session, it cannot be read, or a live process has it.
        """
        folder = files.session_folder(data_dir, participant)
        stored = files.read_stored(folder)
        session = cls.__new__(cls)
        operator = files.stored_person(folder, stored)
        refuse_without_consent(folder, stored.protocol, stored.about)
        with reading_stored(folder / files.STORED):
            who = Participant(participant, stored.about["hand"], operator, operators_from_json(stored.about))
            session._init_common(data_dir, who, stored.protocol, sync, on_event)
            was_blind, key_sha256 = stored.about["blind"], stored.about["key_sha256"]
        session._lock = files.hold_lock(folder)
        try:
            recover_session(folder, sync)
            session._summary = summary = events.journal_summary(folder)
            session.plan, session.plan_sha256 = summary.plan(stored.plan), plan_hash(stored.plan)
            if unknown := set((summary.key or {}).values()) - set(stored.protocol.controllers):
                raise InputError(f"{folder / events.NAME}: unblinded: there is no controller {min(unknown)}")
            session.blind = was_blind and summary.key is None
            session._key = read_key(folder, key_sha256) if session.blind else summary.key or {}
            session.rows = files.rows_of(folder)
            session._in_memory = InMemory(folder, session.rows)
            if session._waiting:
                session.journal(events.RESUMED, open=len(session._waiting))
        except BaseException:
            session.close()
            raise
        return session

    def _init_common(
        self, data_dir: Path, who: Participant, protocol: Protocol, sync: bool, on_event: OnEvent | None
    ) -> None:
        """Set what a new session and a resumed one have in common."""
        self.data_dir, self.protocol, self.participant = data_dir, protocol, who.label
        self.hand, self.person, self.operators = who.hand, who.operator, who.population
        self.folder = files.session_folder(data_dir, who.label)
        self.rows: list[TrialRow] = []
        self._table = b""  # the table, as this process has written it last
        self._key = {}  # code -> controller
        self._summary = events.JournalSummary(self.folder)
        self._sync, self._on_event = sync, on_event
        self._simulations: dict[str, SimulatedDevice] = {}

    def close(self) -> None:
        """Note where the journal ends, and release the lock."""
        with contextlib.suppress(InputError):  # it cannot be read: the next reader is told so
            events.close_journal(self.folder, self._sync)
        self._lock.release()

    def journal(self, event: events.Event, **about: Any) -> None:
        """Append a line (`time`: if not now)."""
        events.write_event(self.folder, event, self._sync, **about)
        self._publish(event, about)

    def _publish(self, event: events.Event, about: dict[str, Any]) -> None:
        if self._in_memory is not None:
            self._in_memory.add_event(event, about)
        if self._on_event is not None:
            self._on_event(event, about)

    def note(self, text: str) -> None:
        """Journal a note of the experimenter."""
        self.journal(events.NOTE, text=text)

    # --------------------------------------------------------------------------------------------------- the next trial

    @property
    def _waiting(self) -> list[PlannedTrial]:
        """The planned trials still to be run, in order."""
        return files.open_trials(self.plan, self.rows, self._summary.postponed)

    @property
    def finished_count(self) -> int:
        """How many trials of the plan need not be run any more."""
        return len(self.plan) - len(self._waiting)

    def next_planned(self) -> PlannedTrial | None:
        """The next trial of the plan, or the practice before it; None: the plan is finished.

        It gets the next free run number if its own is used, by a crash or a repetition: same cell of the plan, another
        recording. A simulated operator does not practise.
        """
        if not (waiting := self._waiting):
            return None
        coming = waiting[0]
        is_begun = any(row.configuration == coming.configuration for row in self.rows)
        due = self._summary.practised[coming.configuration] < self.protocol.practice_trials
        if due and self.person is None and not is_begun:
            return self.next_practice()
        used = self._runs_used(files.TRIALS) | {row.run for row in self.rows}
        if coming.run not in used:
            return coming
        return coming._replace(run=max(used | {trial.run for trial in self.plan}) + 1)

    def next_practice(self) -> PlannedTrial:
        """A practice trial (block 0) in the next configuration, due or not. InputError if no trial comes."""
        if not (waiting := self._waiting):
            raise InputError("all trials of the plan are done, there is nothing to practise for")
        configuration = waiting[0].configuration
        number = self._summary.practised[configuration] + 1
        planned = practice_trial(self.protocol, self.participant, configuration, number, bool(self._key))
        run = max(self._runs_used(files.PRACTICE), default=0) + 1
        return planned._replace(run=run, controller=planned.controller if self.blind else self._controller_of(planned))

    def _runs_used(self, folder: str) -> set[int]:
        """Every run number that a file has or had."""
        return files.runs_used(self.folder, folder) | (self._in_memory.runs[folder] if self._in_memory else set())

    @property
    def break_due(self) -> bool:
        """Whether a break of the protocol comes before the next trial."""
        if not (waiting := self._waiting):
            return False
        configuration = waiting[0].configuration
        left, whole = (sum(trial.configuration == configuration for trial in trials) for trials in (waiting, self.plan))
        return break_after(self.protocol, whole - left, left)

    # ---------------------------------------------------------------------------------------------------------- a trial

    def _controller_of(self, planned: PlannedTrial) -> int:
        """The number of a trial's controller, also while the session is blind."""
        controller = planned.controller
        return self._key[controller] if isinstance(controller, str) else controller

    def preset(self, planned: PlannedTrial) -> Preset:
        """The controller of a trial, also while the session is blind."""
        return self.protocol.controllers[self._controller_of(planned)]

    def simulation(self, configuration: str) -> SimulatedDevice:
        """The simulated device of a configuration; it stays as the last trial left it."""
        if configuration not in self._simulations:
            tip = middle_of_first(self.protocol.paths)
            hand = None if self.person else self.protocol.mouse.hand()
            assumed = self.protocol.assumptions
            device = assumed.applied_to(self.protocol.device(configuration))
            self._simulations[configuration] = SimulatedDevice(device, tip, hand)
            self._simulations[configuration].hand.grips["target"][0, :2] = tip
        return self._simulations[configuration]

    def begin(self, planned: PlannedTrial, sensors: Sensors | None = None) -> tuple[Trial, RecordingWriter]:
        """Open a trial, or a practice trial (block 0), and its recording.

        sensors: of the device on the bench; None: the device is simulated.
        """
        generator = None
        if self.person:  # the same noise for every controller and configuration
            person = participant_index(self.participant)
            generator = normals(self.protocol.seed, person, planned.segment, planned.repetition)
        file = self.protocol.device(planned.configuration)
        preset, path = self.preset(planned), self.protocol.paths[planned.segment]
        conditions = Conditions(path, preset, self.protocol.rules, self.protocol.trial)
        trial: Trial
        if sensors:
            trial = RealTrial(file, planned, conditions)
        else:
            trial = SimulatedTrial(self.simulation(planned.configuration), planned, conditions, self.person, generator)
        is_practice = planned.block == PRACTICE_BLOCK
        folder = files.PRACTICE if is_practice else files.TRIALS
        (self.folder / folder).mkdir(exist_ok=True)
        writer = RecordingWriter(
            files.run_path(self.folder, planned.run, STREAM_SUFFIX, folder), file.braked, self._metadata(trial, preset),
            sync=self._sync, sensors=sensors, decisions=self._decisions(preset),
        )  # fmt: skip
        if self._in_memory is not None:
            self._in_memory.runs[folder].add(planned.run)
        try:
            self.journal(events.PRACTICE_BEGUN if is_practice else events.BEGUN, **planned._asdict())
        except OSError:
            writer.abandon()
            raise
        return trial, writer

    def _decisions(self, preset: Preset) -> tuple[str, ...]:
        """Words of the decisions in a recording; while the session is blind they tell no controller from another."""
        return decision_words(self.protocol.controllers.values()) if self.blind else preset.decisions

    def finish(
        self, trial: Trial, writer: RecordingWriter, cut_short: bool = False, accept_stream: bool = False
    ) -> TrialRow:
        """Close and verify the recording, measure it, and add the row to the table.

        cut_short: the experimenter did not end the trial: it is "stopped", and its cell comes again. accept_stream: if
        the Parquet file cannot be written, the stream is the recording until `recover_interrupted`. OSError if the
        recording or the row cannot be written: `recover_interrupted` writes it later.
        """
        outcome = trial.outcome()
        if cut_short and outcome["status"] == "aborted":
            outcome["status"] = "stopped"
        writer.close(outcome)
        try:
            recording = convert_to_parquet(writer.path, sync=self._sync)
        except OSError as error:
            if not accept_stream:
                raise
            self.journal(events.LEFT_AS_STREAM, file=writer.path.name, reason=error.strerror or str(error))
            recording = read_recording(writer.path)
        row = self._summary.row(row_of(recording, self.folder))
        ended = {"run": row.run, "status": row.status, "reason": outcome["reason"]}
        if trial.planned.block == PRACTICE_BLOCK:
            self.journal(events.PRACTICE_ENDED, **ended, configuration=row.configuration)
            self._summary.practised[row.configuration] += row.status in COUNTED
        else:
            self._add_row(row)
            self.journal(events.ENDED, **ended)
        return row

    def recover_interrupted(self) -> list[str]:
        """Write what a full disk or a crash left unwritten, while no trial runs.

        Returns what cannot be rescued. OSError: the disk is still full.
        """
        done = recover_session(self.folder, self._sync)
        self.rows[:] = files.rows_of(self.folder)
        return done.not_rescued

    # -------------------------------------------------------------------------------------------- a folder that is gone

    def missing_files(self) -> str:
        """What is missing from its folder, one sentence without its full stop; "": nothing. Reads the disk."""
        return self._in_memory.missing_files(self.folder, self.rows) if self._in_memory else ""

    def refuse_other_folder(self) -> None:
        """FileNotFoundError if its folder is gone, or is another session's now: we must not write there."""
        if self._in_memory is not None and not self._in_memory.is_ours(self.folder):
            raise FileNotFoundError(errno.ENOENT, f"{self.folder} is not there")

    def take_lock_again(self) -> None:
        """Take the lock of a folder that is back. InputError if another process has it."""
        self._lock.release()
        self._lock = files.hold_lock(self.folder)

    def move_to(self, data_dir: Path, unsaved: RecordingWriter | None = None) -> int:
        """Move to another data folder, with all of this one that can be read or is in memory.

        Returns how many recordings could not be copied; their trials keep their rows. unsaved: a recording in memory,
        which moves too. InputError or OSError: nothing has changed, and nothing is left there.
        """
        assert self._in_memory is not None
        folder = refuse_place(data_dir, self.participant)
        with refusing(folder, "cannot be created"):
            (folder / files.TRIALS).mkdir(parents=True)
        lock = None
        try:
            lock = files.hold_lock(folder)
            behind = self._in_memory.write_into(folder, self.folder, self.rows, self._sync)
            if unsaved is not None:
                unsaved.save(folder / unsaved.path.relative_to(self.folder))
        except BaseException:
            if lock is not None:
                lock.release()
            discard(folder)
            raise
        self._lock.release()
        self._lock, self.data_dir, self.folder, self._table = lock, data_dir, folder, b""
        return behind

    # ------------------------------------------------------------------------------------ decisions of the experimenter

    def skip(self, reason: str) -> TrialRow:
        """Do not run the coming trial or practice trial, now or later; its row."""
        planned = self.next_planned()
        if planned is None:
            raise InputError("all trials of the plan are done, there is none to skip")
        self.journal(events.SKIPPED, **planned._asdict(), reason=reason)
        row = self._summary.row(events.unmeasured_row(self.folder, planned._asdict(), "skipped"))
        if planned.block == PRACTICE_BLOCK:
            self._summary.practised[planned.configuration] += 1
        else:
            self._add_row(row)
        return row

    def redo(self, run: int, reason: str, at_end: bool = False) -> TrialRow:
        """Repeat the cell of a run: the recording stays, the row becomes `redone`; that row.

        It comes next, or at the end of its configuration. InputError if there is no such run, or its cell is open.
        """
        row = self._mark(run, events.REDONE, reason)
        if at_end:
            self.journal(events.POSTPONED, run=run)
            self._summary.postponed.append(run)
        return row

    def exclude(self, run: int, reason: str) -> TrialRow:
        """Take a run out of every result but the table: the recording stays, the row becomes `excluded`; that row.

        Its cell is not run again. InputError if there is no such run, it does not count, or no reason is given.
        """
        return self._mark(run, events.EXCLUDED, reason)

    def _mark(self, run: int, event: events.Event, reason: str) -> TrialRow:
        rows = events.mark_run(self.folder, self.rows, run, event, reason, self._sync)
        self._publish(event, {"run": run, "reason": reason})
        self._replace_rows(rows)
        return next(row for row in rows if row.run == run)

    def unblind(self, who: str) -> None:
        """Open the key, so that the tables show controllers; who did it is journalled first.

        InputError if the session is not blind, or no name is given.
        """
        if not self.blind:
            raise InputError(f"{self.folder}: is not blind, there is no key to open")
        if not who.strip():
            raise InputError(f"{self.folder}: say who opens the key")
        self.journal(events.UNBLINDED, who=who, key=self._key)
        self._summary, self.blind = events.journal_summary(self.folder), False
        self.plan = self._summary.plan(self.plan)
        self._replace_rows(events.rows_as_journalled(self.folder, self.rows, self._summary))
        if (self.data_dir / files.TABLE).exists():
            files.write_pooled_table(self.data_dir)

    def _add_row(self, row: TrialRow) -> None:
        names = {number: preset.name for number, preset in self.protocol.controllers.items()}
        self._table = append_row(self.folder / files.TABLE, row, self._table, self._sync, names)
        self.rows.append(row)

    def _replace_rows(self, rows: list[TrialRow]) -> None:
        if (self.folder / files.TABLE).exists():
            write_table(self.folder / files.TABLE, as_table(rows), replacing=True)
        self.rows = rows
        if (self.data_dir / files.STUDY).exists() and (self.data_dir / files.TABLE).exists():
            files.write_pooled_table(self.data_dir)  # of other folders the session server keeps it

    # ------------------------------------------------------------------------------------------------ contents of files

    def _common(self) -> dict[str, Any]:
        """The metadata that session.json and the recordings both store."""
        return {
            "participant": self.participant,
            "operators": self.operators._asdict() if self.operators else None,
            "seed": self.protocol.seed,
            "rules": self.protocol.rules,
            "note": self.protocol.note(),
            "assumptions": msgspec.to_builtins(self.protocol.assumptions),
            "plan_sha256": self.plan_sha256,
        }

    def _session_json(self, key_sha256: str) -> dict[str, Any]:
        """The content of session.json. key_sha256: of the key of a blind session, else empty."""
        return self._common() | {
            "created": events.now(),
            "hand": self.hand,
            "person": self.person._asdict() if self.person else None,
            "assumed": self.protocol.assumed,
            "protocol": protocol_to_json(self.protocol),
            "blind": self.blind,
            "key_sha256": key_sha256,
            "plan": plan_to_json(self.plan),
            "versions": versions(),
        }

    def _metadata(self, trial: Trial, preset: Preset) -> dict[str, Any]:
        """The metadata of a recording; without the controller while the session is blind."""
        path = trial.path
        about = self._common() | trial.planned._asdict() | {
            "start_m": (path.x0, path.y0),
            "end_m": (path.x1, path.y1),
            "path": msgspec.to_builtins(self.protocol.paths[trial.planned.segment]),
            "protocol": self.protocol.name,
            "hand": SENSOR if trial.real else self.hand,
            "link": "serial" if trial.real else "sim",
            "assumed": trial.device.assumed,
            "start": trial.start,
            steering.KEY: steering.to_metadata(trial.device),
        }  # fmt: skip
        if trial.device.command_unit != "A":
            about["command_unit"] = trial.device.command_unit
        if name := self.protocol.measure:
            text = self.protocol.code[name]
            digest = hashlib.sha256(text.encode()).hexdigest()
            about["measure"] = {"name": name.removesuffix(".py"), "sha256": digest, "text": text}
        return about if self.blind else about | {"preset": preset_to_json(preset)}
