"""A participant's session: its plan, its trials in order, and their recordings and rows (files: see `files`).

What belongs together is committed together: a trial and the event that it was begun, its row and the event that it
ended. One live process may write in a session.
"""

import contextlib
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Self

import msgspec

from core.control.controllers import Preset, decision_words
from core.files import InputError
from core.own_consent import refuse_unallowed
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis import steering
from experiments.analysis.own_measures import own_metrics
from experiments.analysis.trials_table import COUNTED, TrialRow, row_of
from experiments.atomic_files import make_folders, reading_stored, reason_of, refusing, remove
from experiments.inputs import MOUSE, OPERATOR, SENSOR, is_person
from experiments.own_controller import refuse_unusable
from experiments.plan import (
    PRACTICE_BLOCK,
    PlannedTrial,
    break_after,
    make_plan,
    participant_index,
    plan_hash,
    practice_trial,
)
from experiments.protocol import Protocol, middle_of_first
from experiments.recording import Sensors
from experiments.store import files
from experiments.store import journal as events
from experiments.store.blind import new_key
from experiments.store.cells import open_trials
from experiments.store.consent import KEY as CONSENT
from experiments.store.consent import ConsentAnswer, refuse_consent, refuse_without_consent
from experiments.store.database import DATABASE, Database, new_database
from experiments.store.metadata import operators_from_json, preset_to_json, versions
from experiments.store.recording import RecordingWriter, close_trial, read_recording
from experiments.store.repair import Repaired, repair, rescue_places
from experiments.store.stored import StoredSession, put_session, read_stored, stored_person
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

    def __init__(
        self, data_dir: Path, who: Participant, protocol: Protocol, blind: bool | None = None, sync: bool = True,
        on_event: OnEvent | None = None,
    ) -> None:  # fmt: skip
        """Create the folder and store the plan.

        blind: whether the controllers stand as codes (None: as in the protocol, for a person).
        sync = False leaves it to the system when data reach the disk (simulated studies: they can be run again).
        on_event: called after each line of the journal.
        InputError if the session exists, the participant is none of the protocol's, or the folder cannot be made.
        """
        if who.operator is not None:
            who = who._replace(hand=OPERATOR)
        if is_person(who.hand):
            protocol.refuse_stranger(who.label)
            refuse_consent(protocol, who.label, who.consent)
        protocol.refuse_unknown_low_gain()
        own_metrics(protocol)  # InputError: its own measures cannot be used
        refuse_unusable(protocol.controllers.values())
        protocol.refuse_answers(who.form)
        is_blind = (protocol.blind and is_person(who.hand)) if blind is None else blind
        plan = make_plan(protocol, who.label, is_blind)
        files.refuse_existing(data_dir, who.label)
        self._init_common(data_dir, who, protocol, sync, on_event)
        self.blind, self.plan, self.plan_sha256 = is_blind, plan, plan_hash(plan)
        with refusing(self.folder, "cannot be created"):
            try:
                make_folders(self.folder, sync)
                self.lock = files.hold_lock(self.folder)
            except OSError:
                files.remove_empty(self.folder)
                raise
        try:
            files.refuse_existing(data_dir, who.label)  # another process was faster
            self._create(who, plan)
        except BaseException:
            self.lock.release()
            if files.is_half_created(self.folder):
                with contextlib.suppress(OSError):  # the first error is the one to report
                    remove(self.folder / files.LOCK)
                files.remove_empty(self.folder)
            raise

    def _create(self, who: Participant, plan: tuple[PlannedTrial, ...]) -> None:
        """Store everything about the session, in one commit."""
        self._key = new_key(self.protocol.controllers) if self.blind else {}
        about = self._about() | {"form": dict(who.form)} | ({CONSENT: who.consent._asdict()} if who.consent else {})
        with new_database(self.folder / DATABASE, self._sync) as new:
            self._use(new)
            put_session(new, about, self.protocol, plan, self._key)
            self.add_event(events.CREATED, plan=self.plan_sha256)
            if who.consent:
                self.add_event(events.CONSENT, agreed=who.consent.agreed, answered=who.consent.time)
        self._use(Database(self.folder, self._sync))

    @classmethod
    def resume(cls, data_dir: Path, participant: str, sync: bool = True, on_event: OnEvent | None = None) -> Self:
        """Go on with a session that was interrupted, by its stored plan and protocol (whose file is not needed).

        What a crash left is recovered first; `next_planned` then gives the first trial that is still to be run. The
        simulated devices start afresh, at rest, with the play and the yield of a device just switched on: so the trials
        after a crash are not the ones that an uninterrupted session would have run, bit by bit.
        InputError if there is no such session, it cannot be read, or a live process has it.
        """
        folder = files.session_folder(data_dir, participant)
        if why := files.why_left_out(folder):
            raise InputError(f"{folder}: {why}")
        stored = read_stored(folder)
        session = cls.__new__(cls)
        operator = stored_person(folder, stored)
        refuse_without_consent(folder, stored.protocol, stored.about)
        for name, own in stored.protocol.code.items():
            refuse_unallowed(f"{folder}: {name}", own.text)
        refuse_unusable(stored.protocol.controllers.values())
        with reading_stored(folder / DATABASE):
            who = Participant(participant, stored.about["hand"], operator, operators_from_json(stored.about))
            session._init_common(data_dir, who, stored.protocol, sync, on_event)
        session.lock = files.hold_lock(folder)
        try:
            session._use(Database(folder, sync))
            session._go_on_from(stored)
        except BaseException:
            session.lock.release()
            raise
        return session

    def _go_on_from(self, stored: StoredSession) -> None:
        try:
            self._repair()
            self.plan, self.plan_sha256 = self._summary.plan(stored.plan), plan_hash(stored.plan)
            self.blind = stored.about["blind"] and self._summary.key is None
            self._key = stored.key if self.blind else self._summary.key or {}
            if self._waiting:
                self.journal(events.RESUMED, open=len(self._waiting))
        except BaseException:
            self.database.disconnect()
            raise

    def _init_common(
        self, data_dir: Path, who: Participant, protocol: Protocol, sync: bool, on_event: OnEvent | None
    ) -> None:
        """Set what a new session and a resumed one have in common."""
        self.data_dir, self.protocol, self.participant = data_dir, protocol, who.label
        self.hand, self.person, self.operators = who.hand, who.operator, who.population
        self.folder = files.session_folder(data_dir, who.label)
        self.rows: list[TrialRow] = []
        self._runs = {files.TRIALS: set[int](), files.PRACTICE: set[int]()}  # that were begun
        self.repaired = Repaired()  # what was put right as it was opened
        self._key = {}  # code -> controller
        self._summary = events.JournalSummary(self.folder)
        self._sync, self._on_event = sync, on_event
        self._simulations: dict[str, SimulatedDevice] = {}

    def _use(self, database: Database) -> None:
        self.database, self._journal = database, events.JournalWriter(database)

    def _repair(self) -> None:
        """Put right what a crash, or a disk that took no more, has left; then read journal and rows. OSError."""
        self._summary = events.journal_summary(self.folder)
        self.repaired = repair(self.folder, self.database, self._summary, self._sync)
        if self.repaired.is_something:
            done = self.repaired
            self.add_event(
                events.REPAIRED, trials=done.trials, rows=done.rows, ticks_kept_elsewhere=done.ticks_kept_elsewhere,
                not_repaired=done.not_repaired,
            )  # fmt: skip
            self.database.commit()
        self.rows = files.rows_of(self.folder)
        for folder, runs in self._runs.items():
            runs.update(files.runs_used(self.folder, folder))
        files.write_session_table(self.folder, self.rows, self._sync)

    def close(self) -> None:
        """Write what is in memory, and release the lock. OSError: it cannot be written, and the session stays open."""
        self.database.commit()
        self.end()

    def abandon(self) -> None:
        """Let go of it, and forget what is in memory: simulated trials can be run again."""
        self.database.disconnect()
        self.lock.release()

    def end(self) -> str:
        """Close in any case: what the disk refuses goes to another place (`settle.rescue_places`), else it is lost.

        Where it is, or what is lost, one sentence without its full stop; "": everything is written.
        """
        try:
            self.database.close()
            return ""
        except OSError as error:
            if not self.database.pending:
                return ""
            ticks = self.database.pending_ticks
            what = (
                f"{self.folder}: {ticks:,} ticks and {self.database.pending:,} changes in all were refused by the disk"
            )
            said = f"{what} ({reason_of(error)}) and are lost"
            for place in rescue_places(self.database.identity):
                try:
                    make_folders(place.parent)
                    self.database.rescue(place)
                except OSError:
                    continue
                said = f"{what} ({reason_of(error)}): they are in {place}, and the session takes them when it is opened"
                break
            print(f"phd: {said}", file=sys.stderr, flush=True)
            return said
        finally:
            self.lock.release()

    def journal(self, event: events.Event, **about: Any) -> None:
        """Write an event, with all that is in memory. OSError: it stays in memory."""
        self.add_event(event, **about)
        self.database.commit()

    def add_event(self, event: events.Event, **about: Any) -> None:
        """Add an event, for the next commit."""
        self._journal.write(event, **about)
        if self._on_event is not None:
            self._on_event(event, about)

    def note(self, text: str) -> None:
        """Journal a note of the experimenter."""
        self.journal(events.NOTE, text=text)

    # --------------------------------------------------------------------------------------------------- the next trial

    @property
    def _waiting(self) -> list[PlannedTrial]:
        """The planned trials still to be run, in order."""
        return open_trials(self.plan, self.rows, self._summary.postponed)

    @property
    def finished_count(self) -> int:
        """How many trials of the plan need not be run any more."""
        return len(self.plan) - len(self._waiting)

    def next_planned(self) -> PlannedTrial | None:
        """The next trial of the plan, or the practice before it; None: the plan is finished.

        It gets the next free run number if its own is used, by a crash or a repetition: same cell of the plan, another
        recording. Only people practise.
        """
        if not (waiting := self._waiting):
            return None
        coming = waiting[0]
        is_begun = any(row.configuration == coming.configuration for row in self.rows)
        due = self._summary.practised[coming.configuration] < self.protocol.practice_trials
        if due and is_person(self.hand) and not is_begun:
            return self.next_practice()
        used = self._runs[files.TRIALS] | {row.run for row in self.rows}
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
        run = max(self._runs[files.PRACTICE], default=0) + 1
        return planned._replace(run=run, controller=planned.controller if self.blind else self._controller_of(planned))

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
        """Open a trial, or a practice trial (block 0), and its recording. OSError: the disk takes no more.

        sensors: of the device on the bench; None: the device is simulated.
        """
        generator = None
        if self.person:  # the same noise for every controller and configuration
            person = participant_index(self.participant)
            generator = normals(self.protocol.seed, person, planned.path, planned.repetition)
        file = self.protocol.device(planned.configuration)
        preset, path = self.preset(planned), self.protocol.paths[planned.path]
        conditions = Conditions(path, preset, self.protocol.rules, self.protocol.trial)
        trial: Trial
        if sensors:
            trial = RealTrial(file, planned, conditions)
        else:
            trial = SimulatedTrial(self.simulation(planned.configuration), planned, conditions, self.person, generator)
        is_practice = planned.block == PRACTICE_BLOCK
        folder = files.PRACTICE if is_practice else files.TRIALS
        with self.database.at_once():
            writer = RecordingWriter(
                self.database, (folder, planned.run), file.braked, self._metadata(trial, preset), sensors,
                self._decisions(preset),
            )  # fmt: skip
            self.journal(events.PRACTICE_BEGUN if is_practice else events.BEGUN, **planned._asdict())
        self._runs[folder].add(planned.run)
        return trial, writer

    def _decisions(self, preset: Preset) -> tuple[str, ...]:
        """Words of the decisions in a recording; while the session is blind they tell no controller from another."""
        return decision_words(self.protocol.controllers.values()) if self.blind else preset.decisions

    def finish(self, trial: Trial, writer: RecordingWriter, cut_short: bool = False) -> TrialRow:
        """Close the recording, measure it, and add its row.

        cut_short: the experimenter did not end the trial: it is "stopped", and its cell comes again. OSError: the disk
        takes no more; what is missing is in memory, and the same call goes on from there.
        """
        if writer.recording is None:
            outcome = trial.outcome()
            if cut_short and outcome["status"] == "aborted":
                outcome["status"] = "stopped"
            ended = writer.close(outcome)
            self.database.commit()
            writer.recording = close_trial(self.database, ended, self._sync)
        if writer.row is None:
            row = writer.row = self._summary.row(row_of(writer.recording, self.folder))
            about = {"run": row.run, "status": row.status, "reason": writer.recording.outcome["reason"]}
            if trial.planned.block == PRACTICE_BLOCK:
                self.add_event(events.PRACTICE_ENDED, **about, configuration=row.configuration)
                self._summary.practised[row.configuration] += row.status in COUNTED
            else:
                self.add_event(events.ENDED, **about)
                self._add_row(row)
        self._store_rows()
        return writer.row

    def rescue(self, writer: RecordingWriter) -> None:
        """Close a trial whose loop was lost, with all its ticks, as recovered. OSError: as `finish`."""
        writer.flush()
        self._repair()

    # -------------------------------------------------------------------------------------------- a folder that is gone

    def missing_files(self) -> str:
        """What is missing from its folder, one sentence without its full stop; "": nothing. Reads the disk."""
        places = (*reversed(self.folder.parents), self.folder, self.database.path)
        gone = next((path for path in places if not path.exists()), None)
        return f"{gone} is gone" if gone else ""

    def open_again(self) -> None:
        """Open a folder that is back. InputError: another process has it, or it is another session's. OSError."""
        self.lock.release()
        self.lock = files.hold_lock(self.folder)
        self.database.reopen()

    # ------------------------------------------------------------------------------------ decisions of the experimenter

    def skip(self, reason: str) -> TrialRow:
        """Do not run the coming trial or practice trial, now or later; its row."""
        planned = self.next_planned()
        if planned is None:
            raise InputError("all trials of the plan are done, there is none to skip")
        self.add_event(events.SKIPPED, **planned._asdict(), reason=reason)
        row = self._summary.row(events.unmeasured_row(self.folder, planned._asdict(), "skipped"))
        if planned.block == PRACTICE_BLOCK:
            self._summary.practised[planned.configuration] += 1
        else:
            self._add_row(row)
        self._store_rows()
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
        self.rows = events.mark_run(self.database, self._journal, self.rows, run, event, reason)
        if self._on_event is not None:
            self._on_event(event, {"run": run, "reason": reason})
        self._store_rows()
        return next(row for row in self.rows if row.run == run)

    def unblind(self, who: str) -> None:
        """Open the key, so that the tables show controllers; who did it is journalled first.

        InputError if the session is not blind, or no name is given.
        """
        if not self.blind:
            raise InputError(f"{self.folder}: is not blind, there is no key to open")
        if not who.strip():
            raise InputError(f"{self.folder}: say who opens the key")
        self.add_event(events.UNBLINDED, who=who, key=self._key)
        self._summary.key, self.blind = self._key, False
        self.plan = self._summary.plan(self.plan)
        self.rows = [self._unblinded(row) for row in self.rows]
        for number, row in enumerate(self.rows, start=1):
            files.put_row(self.database, row, number)
        self._store_rows()

    def _unblinded(self, row: TrialRow) -> TrialRow:
        """A row with what the coded one lacks, measured again."""
        recording = read_recording(self.folder / row.recording) if row.recording else None
        return self._summary.row(row_of(recording, self.folder) if recording and recording.whole else row)

    def _add_row(self, row: TrialRow) -> None:
        files.add_row(self.database, row)
        self.rows = [*self.rows, row]

    def _store_rows(self) -> None:
        """Commit what is in memory, and write the table of the rows."""
        self.database.commit()
        files.write_session_table(self.folder, self.rows, self._sync)

    # ------------------------------------------------------------------------------------------------ contents of files

    def _common(self) -> dict[str, Any]:
        """What the database and the metadata of each recording both say."""
        return {
            "participant": self.participant,
            "operators": self.operators._asdict() if self.operators else None,
            "seed": self.protocol.seed,
            "rules": self.protocol.rules,
            "note": self.protocol.note(),
            "assumptions": msgspec.to_builtins(self.protocol.assumptions),
            "plan_sha256": self.plan_sha256,
        }

    def _about(self) -> dict[str, Any]:
        """What the database says about a new session."""
        return self._common() | {
            "created": events.now(),
            "hand": self.hand,
            "person": self.person._asdict() if self.person else None,
            "assumed": self.protocol.assumed,
            "blind": self.blind,
            "versions": versions(),
        }

    def _metadata(self, trial: Trial, preset: Preset) -> dict[str, Any]:
        """The metadata of a recording; without the controller while the session is blind."""
        path = trial.path
        about = self._common() | trial.planned._asdict() | {
            "start_m": (path.x0, path.y0),
            "end_m": (path.x1, path.y1),
            "path_shape": msgspec.to_builtins(self.protocol.paths[trial.planned.path]),
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
            own = self.protocol.code[name]
            about["measure"] = own._asdict() | {"sha256": own.digest}
        return about if self.blind else about | {"preset": preset_to_json(preset)}
