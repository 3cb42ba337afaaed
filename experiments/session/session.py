"""A participant's session: its plan, its trials in order, and what is kept of them (files: see `files`).

Nothing is overwritten: every file is new, tables are replaced whole, and what changes a table stands in the journal
first. One live process may write in a session.
"""

import contextlib
import importlib.metadata
import json
import platform
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np

from core.control.controllers import ALGORITHMS, PARAMETERS, Preset
from core.files import InputError
from core.path import build_path, point_at
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis.trials_table import COUNTED, SETTLED, TrialRow, append_row, write_table
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
from experiments.protocol import Protocol, protocol_to_json
from experiments.recording.atomic_files import is_wrong_path, written_beside
from experiments.recording.reader import STREAM_SUFFIX, read_recording
from experiments.recording.schema import Sensors
from experiments.recording.writer import RecordingWriter, convert_to_parquet
from experiments.session.blind import KEY, new_key, read_key, write_key
from experiments.session.files import (
    LOCK,
    PRACTICE,
    STORED,
    TABLE,
    TRIALS,
    hold_lock,
    open_trials,
    read_stored,
    refuse_existing,
    remove_empty,
    rows_of,
    run_path,
    runs_used,
    session_folder,
    write_pooled_table,
)
from experiments.session.journal import (
    BEGUN,
    CREATED,
    ENDED,
    EXCLUDED,
    LEFT_AS_STREAM,
    NOTE,
    POSTPONED,
    PRACTICE_BEGUN,
    PRACTICE_ENDED,
    REDONE,
    RESUMED,
    SKIPPED,
    UNBLINDED,
    Event,
    JournalSummary,
    journal_summary,
    recorded_row,
    rows_as_journalled,
    unmeasured_row,
    write_event,
)
from experiments.session.journal import NAME as JOURNAL
from experiments.session.recover import recover_session
from experiments.trial.inputs import OPERATOR, SENSOR
from experiments.trial.operator import Person
from experiments.trial.population import Operators
from experiments.trial.trial import Trial

LIBRARIES = ("numpy", "scipy", "numba", "pyarrow")


class Session:
    """One participant's session in progress; it holds the session's lock until `close` or the end of the process."""

    def __init__(
        self,
        data_dir: Path,
        participant: str,
        protocol: Protocol,
        person: Person | None = None,
        sync: bool = True,
        blind: bool | None = None,
        hand: str = "mouse",
        operators: Operators | None = None,
    ) -> None:
        """Create the folder and store the plan. person: a simulated operator; None: a hand at the mouse or device.

        blind: whether the controllers stand as codes (None: as the protocol says; a simulated operator's never do).
        sync = False leaves it to the system when data reach the disk (simulated studies: they can be run again).
        hand: what moves the handle where it is no simulated operator. operators: the population of the person.
        InputError if the session exists, is none of the protocol's, or the folder cannot be made.
        """
        if not (participant.isascii() and participant.isalnum()):
            raise InputError(f"participant {participant!r}: must be letters and digits only")
        if person is None:
            protocol.refuse_stranger(participant)
        refuse_existing(data_dir, participant)
        self._take_up(data_dir, participant, protocol, person, sync)
        self.operators = operators
        self.hand = OPERATOR if person else hand
        self.blind = (protocol.blind and person is None) if blind is None else blind
        self._plan_as(make_plan(protocol, participant, self.blind))
        try:
            (self.folder / TRIALS).mkdir(parents=True, exist_ok=True)
            self._lock = hold_lock(self.folder)
        except OSError as error:
            remove_empty(self.folder)
            if not is_wrong_path(error):
                raise
            raise InputError(f"{self.folder}: cannot be created ({(error.strerror or '').lower()})") from None
        try:
            refuse_existing(data_dir, participant)  # another process was faster
        except InputError:
            self.close()
            raise
        try:
            key_sha256 = ""
            if self.blind:
                self._key = new_key(protocol.controllers)
                key_sha256 = write_key(self.folder, self._key, sync)
            about = session_about(participant, protocol, person, operators, self.hand, self.plan, key_sha256)
            text = json.dumps(about, indent=1, sort_keys=True).encode() + b"\n"
            with written_beside(self.folder / STORED, text, sync) as partial:
                partial.rename(self.folder / STORED)
            self.journal(CREATED, plan=self.plan_sha256)
        except BaseException:
            for name in (STORED, KEY, JOURNAL, LOCK):
                with contextlib.suppress(OSError):  # the first error tells the story
                    (self.folder / name).unlink()
            self.close()
            remove_empty(self.folder)
            raise

    @classmethod
    def resume(cls, data_dir: Path, participant: str, sync: bool = True) -> Self:
        """Go on with a session that was interrupted, by its stored plan and protocol (whose file is not needed).

        What a crash left is recovered first; `next_planned` then gives the first trial of the plan that is not
        settled. The simulated devices start afresh, at rest, with the play and the yield of a device just switched
        on: so the trials after a crash are not the ones that an uninterrupted session would have run, bit by bit.
        InputError if there is no such session, it cannot be read, or a live process has it.
        """
        folder = session_folder(data_dir, participant)
        stored = read_stored(folder)
        try:
            person = Person(**stored.about["person"]) if stored.about["person"] else None
            blind, key_sha256 = bool(stored.about["blind"]), str(stored.about["key_sha256"])
            hand, operators = str(stored.about["hand"]), operators_from_json(stored.about)
        except (KeyError, TypeError) as error:
            raise InputError(f"{folder / STORED}: is damaged ({type(error).__name__}: {error})") from None
        session = cls.__new__(cls)
        session._take_up(data_dir, participant, stored.protocol, person, sync)
        session._lock = hold_lock(folder)
        try:
            recover_session(folder, sync)
            session._summary = journal_summary(folder)
            session._plan_as(stored.plan)
            session.plan = session._summary.plan(stored.plan)
            session.hand, session.operators = hand, operators
            session.blind = blind and session._summary.key is None
            session._practised = dict(session._summary.practised)
            session._key = read_key(folder, key_sha256) if session.blind else session._summary.key or {}
            session.rows = rows_of(folder)
            if still_open := len(open_trials(session.plan, session.rows)):
                session.journal(RESUMED, open=still_open)
        except BaseException:
            session.close()
            raise
        return session

    def _take_up(self, data_dir: Path, participant: str, protocol: Protocol, person: Person | None, sync: bool) -> None:
        self.data_dir, self.participant, self.protocol, self.person = data_dir, participant, protocol, person
        self.devices = {device.name: device for device in protocol.devices}
        self.folder = session_folder(data_dir, participant)
        self.rows = []
        self.blind, self._key, self._practised = False, {}, {}
        self._summary = JournalSummary()
        self._sync = sync
        self._simulations = {}

    def _plan_as(self, plan: tuple[PlannedTrial, ...]) -> None:
        self.plan, self.plan_sha256 = plan, plan_hash(plan)

    def next_planned(self) -> PlannedTrial | None:
        """The first trial of the plan that is not settled, or the practice that comes before it; None: all are.

        It takes the next free run number if its own is used up, by a crash or because it is done again: same cell of
        the plan, another recording. A simulated operator does not practise.
        """
        waiting = open_trials(self.plan, self.rows, self._summary.postponed)
        if not waiting:
            return None
        due = self._practised.get(waiting[0].configuration, 0) < self.protocol.practice_trials
        if due and self.person is None and not self._begun(waiting[0].configuration):
            return self.next_practice()
        used = runs_used(self.folder) | {row.run for row in self.rows}
        if waiting[0].run not in used:
            return waiting[0]
        return waiting[0]._replace(run=max(used | {trial.run for trial in self.plan}) + 1)

    def _begun(self, configuration: str) -> bool:
        return any(row.configuration == configuration for row in self.rows)

    def next_practice(self) -> PlannedTrial:
        """A practice trial (block 0) in the configuration that comes next, due or not. InputError if nothing comes."""
        waiting = open_trials(self.plan, self.rows)
        if not waiting:
            raise InputError("all trials of the plan are done, there is nothing to practise for")
        configuration = waiting[0].configuration
        number = self._practised.get(configuration, 0) + 1
        planned = practice_trial(self.protocol, self.participant, configuration, number, bool(self._key))
        run = max(runs_used(self.folder, PRACTICE), default=0) + 1
        controller = planned.controller if self.blind else self._number(planned)
        return planned._replace(run=run, controller=controller)

    @property
    def settled(self) -> int:
        """How many trials of the plan are settled."""
        return len(self.plan) - len(open_trials(self.plan, self.rows))

    @property
    def break_due(self) -> bool:
        """Whether a break of the protocol comes before the next trial."""
        waiting = open_trials(self.plan, self.rows)
        if not waiting:
            return False
        here = waiting[0].configuration
        left = sum(trial.configuration == here for trial in waiting)
        return break_after(self.protocol, sum(trial.configuration == here for trial in self.plan) - left, left)

    def _number(self, planned: PlannedTrial) -> int:
        controller = planned.controller
        return self._key[controller] if isinstance(controller, str) else controller

    def preset(self, planned: PlannedTrial) -> Preset:
        """The controller of a trial, in a blind session too: not to be shown then."""
        return self.protocol.controllers[self._number(planned)]

    def simulation(self, configuration: str) -> SimulatedDevice:
        """The simulated device of a configuration; it stays as the last trial left it."""
        if configuration not in self._simulations:
            number, path_file = next(iter(self.protocol.paths.items()))
            path = build_path(path_file, f"path {number}")
            x, y, _, _ = point_at(path, 0.5 * path.length)
            hand = None if self.person else self.protocol.mouse.hand()
            self._simulations[configuration] = SimulatedDevice(self.devices[configuration], (x, y), hand)
            self._simulations[configuration].hand.grips["target"][0, :2] = (x, y)
        return self._simulations[configuration]

    def _trial(self, planned: PlannedTrial, real: bool) -> Trial:
        generator = None
        if self.person:  # the same noise for every controller and configuration
            key = [self.protocol.seed, participant_index(self.participant), planned.segment, planned.repetition]
            generator = np.random.default_rng(np.random.SeedSequence(key))
        device = self.devices[planned.configuration] if real else self.simulation(planned.configuration)
        return Trial(
            device, planned, self.protocol.paths[planned.segment], self.preset(planned), self.protocol.rules,
            self.protocol.trial, None if real else self.person, generator,
        )  # fmt: skip

    def close(self) -> None:
        """Let other processes have the session."""
        self._lock.release()

    def journal(self, event: Event, **about: Any) -> None:
        """Append one line: what happened, and when (`time`: if not now)."""
        write_event(self.folder, event, self._sync, **about)

    def note(self, text: str) -> None:
        """Keep a remark of the experimenter, with the time."""
        self.journal(NOTE, text=text)

    def begin(self, planned: PlannedTrial, sensors: Sensors | None = None) -> tuple[Trial, RecordingWriter]:
        """Open a trial, or a practice trial (block 0), and its recording.

        sensors: of the device on the bench, on which it is to be run; None: on the simulated device.
        """
        trial = self._trial(planned, real=sensors is not None)
        practice = planned.block == PRACTICE_BLOCK
        if practice:
            (self.folder / PRACTICE).mkdir(exist_ok=True)
        name = run_path(self.folder, planned.run, STREAM_SUFFIX, PRACTICE if practice else TRIALS)
        device = self.devices[planned.configuration]
        preset = None if self.blind else self.preset(planned)
        about = recording_metadata(self.participant, self.protocol, self.operators, self.hand, trial, preset)
        about["plan_sha256"] = self.plan_sha256
        writer = RecordingWriter(name, device.braked, about, sync=self._sync, sensors=sensors)
        try:
            self.journal(PRACTICE_BEGUN if practice else BEGUN, **planned._asdict())
        except OSError:
            writer.abandon()
            raise
        return trial, writer

    def finish(
        self, trial: Trial, writer: RecordingWriter, cut_short: bool = False, raw_will_do: bool = False
    ) -> TrialRow:
        """Close the recording, verify it, take the measures from what was recorded, add the row to the table.

        cut_short: a trial that was ended was not ended by the experimenter: it is "stopped", and its cell comes again.
        raw_will_do: where the disk does not take the Parquet file, the stream is the recording until `put_in_order`.
        OSError if the disk does not take what is needed; `put_in_order` then makes up for it.
        """
        outcome = trial.outcome()
        if cut_short and outcome["status"] == "aborted":
            outcome["status"] = "stopped"
        writer.close(outcome)
        path = writer.path
        try:
            path = convert_to_parquet(path, sync=self._sync)
        except OSError as error:
            if not raw_will_do:
                raise
            self.journal(LEFT_AS_STREAM, file=path.name, reason=error.strerror or str(error))
        row = recorded_row(read_recording(path), self.folder, self._summary)
        ended = {"run": row.run, "status": row.status, "reason": outcome["reason"]}
        if trial.planned.block == PRACTICE_BLOCK:
            self.journal(PRACTICE_ENDED, **ended, configuration=row.configuration)
            if row.status in COUNTED:
                self._practise(row.configuration)
            return row
        append_row(self.folder / TABLE, row)
        self.rows.append(row)
        self.journal(ENDED, **ended)
        return row

    def put_in_order(self) -> list[str]:
        """Do what a disk that was full has left undone, and take up what a crash of another process left.

        Nothing may be running. Returns what cannot be helped; OSError: the disk still takes no more.
        """
        done = recover_session(self.folder, self._sync)
        self.rows[:] = rows_of(self.folder)
        return done.not_rescued

    def _practise(self, configuration: str) -> None:
        self._practised[configuration] = self._practised.get(configuration, 0) + 1

    def skip(self, reason: str) -> TrialRow:
        """Leave the coming trial, or practice trial, out: its cell is settled, without a recording; its row."""
        planned = self.next_planned()
        if planned is None:
            raise InputError("all trials of the plan are done, there is none to skip")
        self.journal(SKIPPED, **planned._asdict(), reason=reason)
        row = unmeasured_row(self.folder, planned._asdict(), "skipped")
        if planned.block == PRACTICE_BLOCK:
            self._practise(planned.configuration)
            return row
        append_row(self.folder / TABLE, row)
        self.rows.append(row)
        return row

    def redo(self, run: int, reason: str, at_end: bool = False) -> TrialRow:
        """Have the cell of a run done again: its recording stays, its row becomes `redone`; that row.

        It comes next, or at the end of its configuration. InputError if there is no such run, or its cell is open.
        """
        found = next((row for row in self.rows if row.run == run), None)
        if found is None or found.status not in SETTLED:
            why = "is not done yet" if found is None else f"is {found.status}: its trial comes again by itself"
            raise InputError(f"run {run}: {why}, there is nothing to do again")
        self.journal(REDONE, run=run, reason=reason)
        if at_end:
            self.journal(POSTPONED, run=run)
            self._summary.postponed.append(run)
        self._replace_rows([replace(row, status="redone") if row is found else row for row in self.rows])
        return next(row for row in self.rows if row.run == run)

    def exclude(self, run: int, reason: str) -> TrialRow:
        """Take a run out of every result but the table: its recording stays, its row becomes `excluded`; that row.

        Its cell of the plan is settled. InputError if there is no such run, it does not count, or no reason is given.
        """
        found = next((row for row in self.rows if row.run == run), None)
        if found is None or found.status not in COUNTED:
            why = "is not done yet" if found is None else f"is {found.status} and does not count anyway"
            raise InputError(f"run {run}: {why}, there is nothing to exclude")
        if not reason.strip():
            raise InputError(f"run {run}: a reason is needed to exclude it")
        self.journal(EXCLUDED, run=run, reason=reason)
        self._replace_rows([replace(row, status="excluded") if row is found else row for row in self.rows])
        return next(row for row in self.rows if row.run == run)

    def unblind(self, who: str) -> None:
        """Open the key: codes become controllers in the tables, from now on; who did it is journalled first.

        InputError if the session is not blind, or no name is given.
        """
        if not self.blind:
            raise InputError(f"{self.folder}: is not blind, there is no key to open")
        if not who.strip():
            raise InputError(f"{self.folder}: say who opens the key")
        self.journal(UNBLINDED, who=who, key=self._key)
        self._summary, self.blind = journal_summary(self.folder), False
        self.plan = self._summary.plan(self.plan)
        self._replace_rows(rows_as_journalled(self.folder, self.rows, self._summary))
        if (self.data_dir / TABLE).exists():
            write_pooled_table(self.data_dir)

    def _replace_rows(self, rows: list[TrialRow]) -> None:
        if (self.folder / TABLE).exists():
            write_table(self.folder / TABLE, rows, replacing=True)
        self.rows = rows


def session_about(
    participant: str, protocol: Protocol, person: Person | None, operators: Operators | None, hand: str,
    plan: tuple[PlannedTrial, ...], key_sha256: str,
) -> dict[str, Any]:  # fmt: skip
    """What session.json holds. key_sha256: of the key of a blind session, whose plan holds codes; else empty."""
    return {
        "participant": participant,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "hand": hand,
        "person": person._asdict() if person else None,
        "operators": operators._asdict() if operators else None,
        "fidelity": "mr",
        "seed": protocol.seed,
        "rules": protocol.rules,
        "note": protocol.note(),
        "assumed": protocol.assumed,
        "protocol": protocol_to_json(protocol),
        "blind": bool(key_sha256),
        "key_sha256": key_sha256,
        "plan": plan_to_json(plan),
        "plan_sha256": plan_hash(plan),
        "versions": {"phd": version_of("phd"), "python": platform.python_version()}
        | {name: version_of(name) for name in LIBRARIES},
    }


def recording_metadata(
    participant: str, protocol: Protocol, operators: Operators | None, hand: str, trial: Trial, preset: Preset | None
) -> dict[str, Any]:
    """The metadata of a recording. preset: its controller; None: hidden, the session is blind."""
    planned, path = trial.planned, trial.path
    about = {
        "participant": participant,
        **planned._asdict(),
        "start_m": (path.x0, path.y0),
        "end_m": (path.x1, path.y1),
        "path": msgspec.to_builtins(protocol.paths[planned.segment]),
        "protocol": protocol.name,
        "rules": protocol.rules,
        "seed": protocol.seed,
        "note": protocol.note(),
        "hand": SENSOR if trial.real else hand,
        "operators": operators._asdict() if operators else None,
        "link": "serial" if trial.real else "sim",
        "assumed": trial.device.assumed,
    }
    if isinstance(trial, Trial):
        about["start"] = trial.start
    if preset is not None:
        about["preset"] = preset_to_json(preset)
    return about


def preset_to_json(preset: Preset) -> dict[str, Any]:
    """A controller as plain words and numbers."""
    return {"name": preset.name, "kind": preset.kind, **{name: preset.value(name) for name in PARAMETERS}}


def preset_from_json(about: dict[str, Any]) -> Preset:
    """A controller as a recording has it. KeyError if something is missing."""
    own = [parameter.name for parameter in ALGORITHMS[about["kind"]].parameters]
    return Preset(about["name"], about["kind"], tuple(float(about[name]) for name in own))


def operators_from_json(about: dict[str, Any]) -> Operators | None:
    """The population of the simulated operator, as session and recordings have it; None: a person, or not stored."""
    stored = about.get("operators")
    return Operators(str(stored["population"]), tuple(stored["changed_after_findings"])) if stored else None


def version_of(package: str) -> str:
    """The version of an installed package."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
