"""BIDS-Motion (specification 1.11): a data set that other laboratories' programs read, one motion file a recording.

OUT/dataset_description.json, README.md, participants.tsv, participants.json, scans.json
    task-pathfollow_events.json, task-pathfollow_tracksys-fivebar_channels.json     hold for every recording
    sub-01/ses-01/sub-01_ses-01_scans.tsv          a row a recording: when, which cell of the plan, its measures
                  motion/sub-01_.._run-07_motion.tsv, _motion.json, _channels.tsv, _events.tsv
    phenotype/tlxsmoothness.tsv, .json             the answers to the questionnaire, if there are any

Text does not go into a motion file: phases are events; `stuck` is a channel of 0 and 1 for each brake; `decision` is
a number, its words are in _motion.json. File names hold device and run, never the controller.
"""

import contextlib
import csv
import re
import secrets
from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from core.files import InputError
from experiments.analysis.movement import SAMPLE_RATE_HZ
from experiments.analysis.trials_table import (
    COLUMNS,
    DICTIONARY,
    STATUSES,
    DictionaryEntry,
    TrialRow,
    as_table,
    table_bytes,
)
from experiments.export.files import (
    PHASE_LEVELS,
    Exported,
    ExportedTrial,
    answers_and_notes,
    controller_levels,
    own_columns_described,
    recording_column,
    write_columns,
    write_json,
    write_phenotype,
    write_rows,
)
from experiments.inputs import INPUTS, is_person
from experiments.protocol_file import Export
from experiments.recording import Recording
from experiments.store.metadata import version_of
from experiments.store.stored import StoredSession, read_stored

BIDS_VERSION = "1.11.1"
TASK, TRACKSYS = "pathfollow", "fivebar"
MISSING = "n/a"
#: Days on which a participant's first trial may be put: of 1900 to 1919, so that five years of sessions fit in.
_SHIFTED_FROM, _SHIFTED_DAYS = date(1900, 1, 1).toordinal(), 7304
_LATENCY_DECIMALS = 6  # at most, by the specification
#: Columns of trials.csv in a scans table; the other two stand in the name of the file.
_SCANNED = tuple(name for name in COLUMNS if name not in ("participant", "recording"))
_EMULATED = "EMULATED"  # begins the number of a board that `phd emulate` stands for, whose hand is simulated too
#: The specification's type of a channel; it has none for forces, currents and torques (MISC).
_KINDS = (("t_s", "LATENCY"), ("tip_v", "VEL"), ("tip_a", "ACCEL"), ("tip_", "POS"))


class _Channel(NamedTuple):
    """A row of a channels table; the fields are its columns."""

    name: str
    component: str = MISSING
    type: str = "MISC"
    tracked_point: str = MISSING
    units: str = MISSING
    placement: str = MISSING
    reference_frame: str = MISSING
    description: str = ""


_SHIFTED = (
    b"\nDates (`acq_time`) are shifted to before 1925, by the same days for all of one participant; the time of day\n"
    b"and the days between are as they were.\n"
)
_PERSON = ("participant_id", "species", "age", "sex", "handedness")  # BIDS's own columns; a form may fill them


class BidsOptions(NamedTuple):
    """How a BIDS data set is written."""

    shift_dates: bool = False  # to before 1925, by days drawn for each participant and not stored
    said: Export = Export()  # of the data set, in place of what protocols say
    usual: Export = Export()  # what protocols do not say


AS_PROTOCOLS_SAY = BidsOptions()


class BidsDataset:
    """A BIDS export in a folder that exists and is empty."""

    def __init__(self, folder: Path, options: BidsOptions) -> None:
        self.folder, self._options = folder, options
        self._shifts: dict[str, timedelta] = {}  # subject -> of its dates
        self._hands: dict[str, str] = {}  # subject -> hand
        self._scans: dict[tuple[str, str], list[dict[str, str]]] = {}
        self._rows: list[TrialRow] = []

    def add(self, trial: ExportedTrial) -> None:
        """Write one recording: motion, channels, events."""
        device = re.sub("[^A-Za-z0-9]", "", trial.row.configuration) or "device"
        tracking = f"task-{TASK}_tracksys-{TRACKSYS}_acq-{device}_run-{trial.row.run:02d}"
        stem = f"{trial.subject}_{trial.session}_{tracking}"
        motion = self.folder / trial.subject / trial.session / "motion"
        motion.mkdir(parents=True, exist_ok=True)
        channels, columns = _channels(trial)
        write_columns(motion / f"{stem}_motion.tsv", columns, "\t", header=False, missing=MISSING)
        write_json(motion / f"{stem}_motion.json", _about(trial, channels))
        write_rows(motion / f"{stem}_channels.tsv", [_Channel._fields, *channels])
        write_rows(motion / f"{stem}_events.tsv", [("onset", "duration", "trial_type"), *_phases(trial.recording)])
        self._rows.append(trial.row)
        self._hands.setdefault(trial.subject, str(trial.about.get("hand", MISSING)))
        self._scans.setdefault((trial.subject, trial.session), []).append(
            {"filename": f"motion/{stem}_motion.tsv", "acq_time": self._day_time(trial), **_cells(trial.row)}
        )

    def _day_time(self, trial: ExportedTrial) -> str:
        """When the trial began, as the specification wants it, in UTC.

        It marks shifted dates by years up to 1925, and all of one participant are to be shifted by the same days.
        """
        try:
            begun = datetime.fromisoformat(trial.begun).astimezone(UTC)
        except ValueError:
            return MISSING
        if self._options.shift_dates:
            first = timedelta(days=begun.toordinal() - _SHIFTED_FROM - secrets.randbelow(_SHIFTED_DAYS))
            begun -= self._shifts.setdefault(trial.subject, first)
        return f"{begun:%Y-%m-%dT%H:%M:%S.%f}Z"

    def finish(self, exported: Exported) -> None:
        """Write the tables and what describes the whole data set."""
        own = own_columns_described(exported.sessions)
        protocols = _protocols_of(exported.sessions)
        self._write_scans(own)
        self._write_participants(protocols)
        answers, _ = answers_and_notes(exported.sessions)
        write_phenotype(self.folder, [a for a in answers if f"sub-{a.participant}" in self._hands])
        controllers = controller_levels(self._rows, exported.sessions)
        phd = version_of("phd")
        about: dict[str, dict[str, Any]] = {
            "scans.json": {
                name: _scan_column(name, meaning, controllers.get(name, {}))
                for name, meaning in ({name: DICTIONARY[name] for name in _SCANNED} | own).items()
            },
            "participants.json": self._participants_described(protocols),
            f"task-{TASK}_events.json": {
                "trial_type": {"Description": "phase of the trial", "Levels": PHASE_LEVELS},
                "StimulusPresentation": {"SoftwareName": "phd", "SoftwareVersion": phd},
            },
            f"task-{TASK}_tracksys-{TRACKSYS}_channels.json": _CHANNELS_JSON,
            "dataset_description.json": {
                "Name": exported.name or "phd",
                "BIDSVersion": BIDS_VERSION,
                "DatasetType": "raw",
                "GeneratedBy": [{"Name": "phd", "Version": phd}],
                **_described(self._options.usual),
                **_from_protocols(protocols),
                **_described(self._options.said),
            },
        }
        for name, content in about.items():
            write_json(self.folder / name, content)
        shifted = _SHIFTED if self._options.shift_dates else b""
        (self.folder / "README.md").write_bytes(exported.readme("bids") + shifted)

    def _write_scans(self, own: Mapping[str, DictionaryEntry]) -> None:
        """A table of each session: a row a recording."""
        for (subject, session), lines in self._scans.items():
            place = self.folder / subject / session / f"{subject}_{session}_scans.tsv"
            header = ["filename", "acq_time", *_SCANNED, *own]
            write_rows(place, [header, *([line.get(name) or MISSING for name in header] for line in lines)])

    def _write_participants(self, protocols: Mapping[Path, StoredSession]) -> None:
        """participants.tsv: what each participant answered to the protocol's form, and whose hand it was."""
        forms = {f"sub-{stored.participant}": stored.about.get("form", {}) for stored in protocols.values()}
        columns = [*_PERSON, *(name for name in _form_of(protocols) if name not in _PERSON)]
        lines = [
            [subject, *(_answer(forms.get(subject, {}).get(name, MISSING)) for name in columns[1:]), hand]
            for subject, hand in self._hands.items()
        ]
        write_rows(self.folder / "participants.tsv", [[*columns, "hand"], *lines])

    def _participants_described(self, protocols: Mapping[Path, StoredSession]) -> dict[str, Any]:
        """The content of participants.json."""
        levels = {name: hand.meaning for name, hand in INPUTS.items() if name in self._hands.values()}
        hand = {"Description": "where the force of the hand came from"} | ({"Levels": levels} if levels else {})
        return {name: _form_column(kind) for name, kind in _form_of(protocols).items()} | {"hand": hand}


def _protocols_of(sessions: Sequence[Path]) -> dict[Path, StoredSession]:
    """What is stored of each session that can be read."""
    found = {}
    for folder in sessions:
        with contextlib.suppress(InputError):  # `phd verify` names what is wrong with it
            found[folder] = read_stored(folder)
    return found


def _form_of(protocols: Mapping[Path, StoredSession]) -> dict[str, tuple[str, ...] | str]:
    """All that the protocols' forms ask of a participant."""
    return {name: kind for stored in protocols.values() for name, kind in stored.protocol.form.items()}


def _from_protocols(protocols: Mapping[Path, StoredSession]) -> dict[str, Any]:
    """What protocols say of the data set, for dataset_description.json. InputError where they differ."""
    folders: dict[Export, Path] = {}  # one for each [export]
    for folder, stored in protocols.items():
        folders.setdefault(stored.protocol.export, folder)
    if len(folders) > 1:
        raise InputError(
            f"{' and '.join(map(str, folders.values()))}: their protocols differ in [export], and a data set says one "
            "thing"
        )
    return {key: value for export in folders for key, value in _described(export).items()}


def _described(export: Export) -> dict[str, Any]:
    """What is said of a data set, by the keys of dataset_description.json."""
    keys = {"authors": "Authors", "license": "License", "hed_version": "HEDVersion"}
    return {key: value for name, key in keys.items() if (value := getattr(export, name))}


def _answer(answer: str | float) -> str:
    return f"{answer:g}" if isinstance(answer, float) else str(answer)


def _form_column(kind: Sequence[str] | str) -> dict[str, Any]:
    """The description of a column that the protocol's form asks for. kind: as in `Protocol.form`."""
    levels = {} if isinstance(kind, str) else {"Levels": {choice: choice for choice in kind}}
    return {"Description": "asked of each participant before the session", **levels}


def _channels(trial: ExportedTrial) -> tuple[list[_Channel], dict[str, np.ndarray]]:
    """The channels of a recording and their columns, in order."""
    recording = trial.recording
    channels: list[_Channel] = []
    columns: dict[str, np.ndarray] = {}
    for name in trial.names:
        if name == "phase":
            continue
        if name == "stuck":
            letters = recording.words["stuck"]
            for joint in recording.braked:
                stuck = np.array([joint in word for word in letters])[recording.column("stuck")]
                columns[f"stuck_{joint}"] = stuck.astype(np.int8)
                meaning = f"1: the brake at joint {joint} is stuck, 0: it is not"
                channels.append(_Channel(f"stuck_{joint}", description=meaning))
            continue
        meaning, unit, _ = recording_column(name, recording.metadata.get("command_unit", "A"))
        meaning += ": the code of a word in Decisions of _motion.json" if name == "decision" else ""
        columns[name] = recording.column(name)
        if name == "t_s":
            columns[name] = np.round(columns[name], _LATENCY_DECIMALS)
        kind = next((kind for start, kind in _KINDS if name.startswith(start)), "MISC")
        channel = _Channel(name, type=kind, units=unit or MISSING, description=meaning)
        if name.startswith(("tip_", "hand_", "target_", "sensed_")):
            found = re.search(r"_[vaf]?([xy])_", name)
            channel = channel._replace(component=found[1] if found else MISSING, reference_frame="workspace")
            if not name.startswith("target_"):
                channel = channel._replace(tracked_point="handle", placement="handle")
        channels.append(channel)
    return channels, columns


def _about(trial: ExportedTrial, channels: list[_Channel]) -> dict[str, Any]:
    """The content of _motion.json."""
    recording = trial.recording
    t = recording.column("t_s")
    kinds = [channel.type for channel in channels]
    counts = {kind: kinds.count(kind) for kind in ("ACCEL", "LATENCY", "POS", "VEL")}
    board = _board(trial)
    about: dict[str, Any] = {
        "TaskName": TASK,
        "TaskDescription": "Move the handle from the start of a path to its end, along the path.",
        "Instructions": "Move to the start. Hold. Go.",
        "SamplingFrequency": SAMPLE_RATE_HZ,
        "SamplingFrequencyEffective": round((len(t) - 1) / float(t[-1] - t[0]), 6) if len(t) > 1 else MISSING,
        "RecordingDuration": round(len(t) / SAMPLE_RATE_HZ, 6),
        "TrackingSystemName": f"five-bar {trial.row.configuration}",
        "TrackedPointsCount": 1,
        "MotionChannelCount": counts["ACCEL"] + counts["POS"] + counts["VEL"],
        **{f"{kind}ChannelCount": count for kind, count in counts.items()},
        **{f"{kind}ChannelCount": 0 for kind in ("ANGACCEL", "GYRO", "JNTANG", "MAGN", "ORNT")},
        "MISCChannelCount": kinds.count("MISC"),
        "MissingValues": MISSING,
        "SubjectArtefactDescription": MISSING,
        "Manufacturer": MISSING,
        "ManufacturersModelName": trial.row.configuration,
        "DeviceSerialNumber": board or MISSING,
        "SoftwareVersions": f"phd {trial.software}",
        "InstitutionName": MISSING,
        "InstitutionAddress": MISSING,
        "InstitutionalDepartmentName": MISSING,
        "SimulatedDevice": not board or board.startswith(_EMULATED),
        "SimulatedOperator": not is_person(trial.about.get("hand", "")) or board.startswith(_EMULATED),
        "Trial": trial.about,
        "Outcome": trial.outcome,
    }
    if "decision" in trial.names:
        about["Decisions"] = {str(code): word for code, word in enumerate(recording.words["decision"])}
    return about


def _board(trial: ExportedTrial) -> str:
    """The number of the board on the bench; "": the device is simulated, also where a recording does not name one."""
    if trial.about.get("link", "sim") == "sim":
        return ""
    return str(trial.outcome.get("link", {}).get("board") or "unknown")


def _phases(recording: Recording) -> list[tuple[str, str, str]]:
    """Onset, duration and name of each stretch of ticks in one phase."""
    phase, t = recording.column("phase"), recording.column("t_s")
    if not len(phase):
        return []
    firsts = [0, *(np.flatnonzero(np.diff(phase)) + 1).tolist()]
    ends = [*t[firsts[1:]].tolist(), float(t[-1]) + 1.0 / SAMPLE_RATE_HZ]
    return [
        (_seconds(t[first]), _seconds(end - t[first]), recording.words["phase"][phase[first]])
        for first, end in zip(firsts, ends, strict=True)
    ]


def _seconds(value: float) -> str:
    return repr(round(float(value), _LATENCY_DECIMALS))


def _cells(row: TrialRow) -> dict[str, str]:
    """A row of trials.csv as a scans table shows it, by column."""
    [cells] = csv.DictReader(table_bytes(as_table([row])).decode().splitlines())
    return cells


def _scan_column(name: str, entry: DictionaryEntry, levels: dict[str, str]) -> dict[str, Any]:
    """levels: cell -> words, of a column that names one of a few things."""
    levels = STATUSES if name == "status" else levels
    return {
        "Description": entry.meaning,
        **({"Units": entry.unit} if entry.unit else {}),
        **({"Levels": levels} if levels else {}),
    }


_CHANNELS_JSON = {
    "reference_frame": {
        "Description": "how the frame of the channel lies",
        "Levels": {
            "workspace": {
                "Description": "x to the participant's right, y away from the participant; the motion is plane; "
                "the origin is that of the device file",
                "SpatialAxes": "RF_",
                "RotationRule": MISSING,
                "RotationOrder": MISSING,
            }
        },
    }
}
