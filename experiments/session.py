"""A participant's session: its folder, its plan, its trials in order, and what is kept of them.

    DATA/sub-01/ses-01/session.json        plan, hash, seed, settings, device and brake files in full, versions
                       journal.jsonl       one line an event, on the disk before the next one
                       trials/run-001.arrows -> run-001.parquet once closed and verified
                       trials.csv          one row a trial
    DATA/trials.csv                        the rows of all participants

Nothing is overwritten: every file is new, tables are replaced whole.
"""

import importlib.metadata
import json
import os
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from core.control import PRESETS
from core.device import Device
from core.errors import InputError
from core.hand import Hand
from core.simulator import Simulation, stops_of
from experiments.metrics import NO_METRICS, trial_metrics
from experiments.operator import Person
from experiments.plan import (
    SEGMENTS,
    PlannedTrial,
    make_plan,
    participant_index,
    plan_hash,
    plan_to_json,
)
from experiments.recording import Recording, RecordingWriter, convert_to_parquet, read_recording
from experiments.trial import MouseHand, Trial, new_simulation
from experiments.trials_table import TrialRow, append_row, read_table, write_table
from experiments.whole_files import written_beside

LIBRARIES = ("numpy", "scipy", "numba", "pyarrow")


@dataclass(frozen=True)
class Choices:
    """What a study is one choice of, and what decides all that is random in it."""

    seed: int = 1
    rules: str = "settled"
    low_gain: float = 5.0  # N s/m, of controller 5

    def note(self, assumed: bool) -> str:
        """What every figure says of them."""
        return f"{self.rules} rules, low gain {self.low_gain:g} N s/m" + (", parameters assumed" if assumed else "")


def session_folder(data_dir: Path, participant: str) -> Path:
    """Where a participant's session is kept."""
    return data_dir / f"sub-{participant}" / "ses-01"


def refuse_existing(data_dir: Path, participant: str) -> None:
    """InputError if this participant has a session already."""
    folder = session_folder(data_dir, participant)
    if folder.exists():
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
    """One participant's session in progress."""

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
        self.data_dir, self.participant, self.choices, self.person = data_dir, participant, choices, person
        self.devices = {device.name: device for device in devices}
        self.plan = make_plan(participant, choices.seed, tuple(self.devices))
        self.folder = session_folder(data_dir, participant)
        self.rows: list[TrialRow] = []
        self._sync = sync
        self._simulations: dict[str, Simulation] = {}
        try:
            (self.folder / "trials").mkdir(parents=True)
        except OSError as error:
            raise InputError(f"{self.folder}: cannot be created ({(error.strerror or '').lower()})") from None
        about = json.dumps(self._about(), indent=1, sort_keys=True).encode() + b"\n"
        with written_beside(self.folder / "session.json", about, sync) as partial:
            partial.rename(self.folder / "session.json")
        self.journal("created", plan=plan_hash(self.plan))

    def _about(self) -> dict:
        return {
            "participant": self.participant,
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "hand": "operator" if self.person else "mouse",
            "person": self.person._asdict() if self.person else None,
            "mouse": None if self.person else asdict(MouseHand()),
            "fidelity": "mr",
            **asdict(self.choices),
            "plan": plan_to_json(self.plan),
            "plan_sha256": plan_hash(self.plan),
            "segments": {str(number): segment._asdict() for number, segment in SEGMENTS.items()},
            "controllers": {str(number): preset._asdict() for number, preset in PRESETS.items()},
            "devices": {
                device.name: {"file": device.text, "brakes": device.brake_texts} for device in self.devices.values()
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
        line = json.dumps({"time": datetime.now(UTC).isoformat(timespec="milliseconds"), "event": event, **about})
        with (self.folder / "journal.jsonl").open("a", encoding="utf-8") as file:
            file.write(line + "\n")
            if self._sync:
                file.flush()
                os.fsync(file.fileno())

    def next_planned(self) -> PlannedTrial | None:
        """The next trial of the plan that has no row yet; None: all are done."""
        return self.plan[len(self.rows)] if len(self.rows) < len(self.plan) else None

    def simulation(self, configuration: str) -> Simulation:
        """The simulated device of a configuration; it stays as the last trial left it."""
        if configuration not in self._simulations:
            start = SEGMENTS[1].start
            end = SEGMENTS[1].end
            middle = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]))
            hand: Hand | None = None if self.person else MouseHand().hand()
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
        name = self.folder / "trials" / f"run-{planned.run:03d}.arrows"
        writer = RecordingWriter(name, device.braked, metadata, sync=self._sync)
        self.journal("trial begun", run=planned.run)
        return trial, writer

    def finish(self, trial: Trial, writer: RecordingWriter) -> TrialRow:
        """Close the recording, verify it, take the measures from what was recorded, add the row to the tables."""
        writer.close(trial.outcome())
        recording = read_recording(convert_to_parquet(writer.path, sync=self._sync))
        row = row_of(recording, self.folder)
        append_row(self.folder / "trials.csv", row)
        self.rows.append(row)
        self.journal("trial ended", run=row.run, status=row.status, reason=trial.outcome()["reason"])
        return row


def row_of(recording: Recording, folder: Path) -> TrialRow:
    """A trial's row, from its recording alone; `folder`: where the table that gets it stands."""
    about, outcome = recording.metadata, recording.outcome
    start, end = tuple(about["start_m"]), tuple(about["end_m"])
    moved = recording.in_phase("move").any()
    metrics = trial_metrics(recording, start, end, about["controller"]) if moved else NO_METRICS
    place = os.path.relpath(recording.path, folder).replace(os.sep, "/")
    return TrialRow(
        about["participant"], about["run"], about["block"], about["configuration"], about["controller"],
        about["segment"], about["repetition"], outcome["status"], recording=place,
    ).with_metrics(metrics)  # fmt: skip


def write_pooled_table(data_dir: Path) -> list[TrialRow]:
    """Rewrite DATA/trials.csv from the sessions' tables; its rows."""
    rows = []
    for table in sorted(data_dir.glob("sub-*/ses-*/trials.csv")):
        rows += [row.seen_from(table.parent.relative_to(data_dir).as_posix()) for row in read_table(table)]
    write_table(data_dir / "trials.csv", rows, replacing=True)
    return rows


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
