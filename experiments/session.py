"""A participant's session: its plan, its trials in order, and what is kept of them (files: see `session_files`).

Nothing is overwritten: every file is new, tables are replaced whole. One live process may write in a session.
"""

import importlib.metadata
import json
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

import numpy as np

from core.control import PRESETS
from core.device import Device
from core.errors import InputError
from core.hand import Hand
from core.simulator import Simulation, stops_of
from experiments.journal import write_event
from experiments.operator import Person
from experiments.plan import (
    SEGMENTS,
    PlannedTrial,
    make_plan,
    participant_index,
    plan_hash,
    plan_to_json,
)
from experiments.recording import STREAM_SUFFIX, RecordingWriter, convert_to_parquet, read_recording
from experiments.recover import recover_session
from experiments.session_files import (
    STORED,
    TABLE,
    hold_lock,
    is_half_created,
    open_trials,
    read_stored,
    rows_of,
    run_path,
    runs_used,
)
from experiments.session_files import session_folder as session_folder
from experiments.session_files import write_pooled_table as write_pooled_table
from experiments.trial import MouseHand, Trial, new_simulation
from experiments.trial_row import row_of
from experiments.trials_table import TrialRow, append_row
from experiments.whole_files import is_wrong_path, written_beside

LIBRARIES = ("numpy", "scipy", "numba", "pyarrow")


@dataclass(frozen=True)
class Choices:
    """What a study is one choice of, and what decides all that is random in it."""

    seed: int = 1
    rules: str = "settled"
    low_gain: float = 5.0  # N s/m, of controller 5

    def note(self, assumed: bool) -> str:
        """What every figure says of them."""
        return f"{self.rules} rules, low gain {self.low_gain:g} N s/m" + (
            ", parameters assumed" if assumed else ""
        )


def refuse_existing(data_dir: Path, participant: str) -> None:
    """InputError if this participant has a session already."""
    folder = session_folder(data_dir, participant)
    if folder.exists() and not is_half_created(folder):
        raise InputError(f"{folder}: exists already, a session is never overwritten; name another participant")


def free_participant(data_dir: Path) -> str:
    """The first number of two digits or more without a session."""
    number = 1
    while session_folder(data_dir, f"{number:02d}").exists():
        number += 1
    return f"{number:02d}"


def check_reach(devices: Sequence[Device]) -> None:
    """InputError if a device cannot follow every segment of the plan without running into a stop."""
    for device in devices:
        for number, segment in SEGMENTS.items():
            for share in np.linspace(0.0, 1.0, 41):
                x, y = (1.0 - share) * np.array(segment.start) + share * np.array(segment.end)
                if not stops_of(device, x, y).min() > 0.0:
                    raise InputError(
                        f"device {device.name}: cannot follow segment {number}, it is outside the workspace "
                        f"at ({x:.3f}, {y:.3f}) m"
                    )


class Session:
    """One participant's session in progress; it holds the session's lock until `close` or the end of the process."""

    def __init__(
        self,
        data_dir: Path,
        participant: str,
        devices: Sequence[Device],
        choices: Choices,
        person: Person | None = None,
        sync: bool = True,
    ) -> None:
        """Create the folder and store the plan. person: a simulated operator; None: a hand at the mouse.

        InputError if the session exists, a device cannot follow the paths, or the folder cannot be made.
        sync = False leaves it to the system when data reach the disk (simulated studies: they can be run again).
        """
        check_reach(devices)
        refuse_existing(data_dir, participant)
        self._take_up(data_dir, participant, devices, choices, person, sync)
        self.plan = make_plan(participant, choices.seed, tuple(self.devices))
        try:
            (self.folder / "trials").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            if not is_wrong_path(error):
                raise
            raise InputError(f"{self.folder}: cannot be created ({(error.strerror or '').lower()})") from None
        self._lock = hold_lock(self.folder)
        try:
            refuse_existing(data_dir, participant)  # another process was faster
            about = json.dumps(self._about(), indent=1, sort_keys=True).encode() + b"\n"
            with written_beside(self.folder / STORED, about, sync) as partial:
                partial.rename(self.folder / STORED)
            self.journal("created", plan=plan_hash(self.plan))
        except BaseException:
            self.close()
            raise

    @classmethod
    def resume(cls, data_dir: Path, participant: str, sync: bool = True) -> Self:
        """Go on with a session that was interrupted, by its stored plan, seed, devices and choices.

        What a crash left is recovered first; `next_planned` then gives the first trial of the plan that is not
        settled. The simulated devices start afresh, at rest, with the play and the yield of a device just switched
        on: so the trials after a crash are not the ones that an uninterrupted session would have run, bit by bit.
        InputError if there is no such session, it cannot be read, or a live process has it.
        """
        folder = session_folder(data_dir, participant)
        stored = read_stored(folder)
        about = stored.about
        try:
            choices = Choices(about["seed"], about["rules"], about["low_gain"])
            person = Person(**about["person"]) if about["person"] else None
            mouse = MouseHand(**about["mouse"]) if about["mouse"] else MouseHand()
        except (KeyError, TypeError) as error:
            raise InputError(f"{folder / STORED}: is damaged ({type(error).__name__}: {error})") from None
        session = cls.__new__(cls)
        session._take_up(data_dir, participant, stored.devices, choices, person, sync)
        session.plan, session._mouse = stored.plan, mouse
        session._lock = hold_lock(folder)
        try:
            recover_session(folder, sync)
            session.rows = rows_of(folder)
            if still_open := len(open_trials(session.plan, session.rows)):
                session.journal("resumed", open=still_open)
        except BaseException:
            session.close()
            raise
        return session

    def _take_up(
        self,
        data_dir: Path,
        participant: str,
        devices: Sequence[Device],
        choices: Choices,
        person: Person | None,
        sync: bool,
    ) -> None:
        self.data_dir, self.participant, self.choices, self.person = data_dir, participant, choices, person
        self.devices = {device.name: device for device in devices}
        self.folder = session_folder(data_dir, participant)
        self.plan: tuple[PlannedTrial, ...] = ()
        self.rows: list[TrialRow] = []
        self._mouse = MouseHand()
        self._sync = sync
        self._simulations: dict[str, Simulation] = {}

    def close(self) -> None:
        """Let other processes have the session."""
        self._lock.release()

    def _about(self) -> dict:
        return {
            "participant": self.participant,
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "hand": "operator" if self.person else "mouse",
            "person": self.person._asdict() if self.person else None,
            "mouse": None if self.person else asdict(self._mouse),
            "fidelity": "mr",
            **asdict(self.choices),
            "plan": plan_to_json(self.plan),
            "plan_sha256": plan_hash(self.plan),
            "segments": {str(number): segment._asdict() for number, segment in SEGMENTS.items()},
            "controllers": {str(number): preset._asdict() for number, preset in PRESETS.items()},
            "devices": {
                device.name: {"file": device.text, "brakes": device.brake_texts}
                for device in self.devices.values()
            },
            "assumed": self.assumed,
            "versions": {"phd": _version("phd"), "python": platform.python_version()}
            | {name: _version(name) for name in LIBRARIES},
        }

    @property
    def assumed(self) -> bool:
        """Whether any device of the session has assumed numbers."""
        return any(device.assumed for device in self.devices.values())

    def journal(self, event: str, **about: object) -> None:
        """Append one line: what happened, and when."""
        write_event(self.folder, event, self._sync, **about)

    def next_planned(self) -> PlannedTrial | None:
        """The first trial of the plan that is not settled; None: all are. It takes the next free run number if a
        crash has used up its own: same cell of the plan, another recording."""
        waiting = open_trials(self.plan, self.rows)
        if not waiting:
            return None
        used = runs_used(self.folder) | {row.run for row in self.rows}
        if waiting[0].run not in used:
            return waiting[0]
        return waiting[0]._replace(run=max(used | {trial.run for trial in self.plan}) + 1)

    @property
    def settled(self) -> int:
        """How many trials of the plan are settled."""
        return len(self.plan) - len(open_trials(self.plan, self.rows))

    def simulation(self, configuration: str) -> Simulation:
        """The simulated device of a configuration; it stays as the last trial left it."""
        if configuration not in self._simulations:
            start = SEGMENTS[1].start
            end = SEGMENTS[1].end
            middle = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]))
            hand: Hand | None = None if self.person else self._mouse.hand()
            self._simulations[configuration] = new_simulation(self.devices[configuration], middle, hand)
            self._simulations[configuration].hand.grips["target"][0, :2] = middle
        return self._simulations[configuration]

    def begin(self, planned: PlannedTrial) -> tuple[Trial, RecordingWriter]:
        """Open a trial and its recording."""
        segment = SEGMENTS[planned.segment]
        generator = None
        if self.person:  # the same noise for every controller and configuration
            key = [self.choices.seed, participant_index(self.participant), planned.segment, planned.repetition]
            generator = np.random.default_rng(np.random.SeedSequence(key))
        trial = Trial(
            self.simulation(planned.configuration), planned, segment,
            self.choices.rules, self.choices.low_gain, self.person, generator,
        )  # fmt: skip
        device = self.devices[planned.configuration]
        metadata = {
            "participant": self.participant,
            **planned._asdict(),
            "start_m": segment.start,
            "end_m": segment.end,
            "rules": self.choices.rules,
            "low_gain": self.choices.low_gain,
            "seed": self.choices.seed,
            "hand": "operator" if self.person else "mouse",
            "assumed": device.assumed,
            "plan_sha256": plan_hash(self.plan),
        }
        name = run_path(self.folder, planned.run, STREAM_SUFFIX)
        writer = RecordingWriter(name, device.braked, metadata, sync=self._sync)
        try:
            self.journal("trial begun", **planned._asdict())
        except OSError:
            writer.abandon()
            raise
        return trial, writer

    def finish(self, trial: Trial, writer: RecordingWriter) -> TrialRow:
        """Close the recording, verify it, take the measures from what was recorded, add the row to the tables."""
        writer.close(trial.outcome())
        recording = read_recording(convert_to_parquet(writer.path, sync=self._sync))
        row = row_of(recording, self.folder)
        append_row(self.folder / TABLE, row)
        self.rows.append(row)
        self.journal("trial ended", run=row.run, status=row.status, reason=trial.outcome()["reason"])
        return row


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
