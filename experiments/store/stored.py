"""What a session's database says about the session: participant, plan, protocol with all its files, versions."""

import contextlib
import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from core.files import InputError
from experiments.analysis.trials_table import TrialRow
from experiments.atomic_files import reading_stored
from experiments.inputs import INPUTS
from experiments.plan import PlannedTrial, participant_index, plan_hash
from experiments.protocol import Protocol, protocol_from_json, protocol_to_json
from experiments.store.database import DATABASE, Database, Stored, reading
from experiments.trial.operator import Person


@dataclass(frozen=True)
class StoredSession:
    """What is stored of a session when it is created."""

    participant: str
    protocol: Protocol
    plan: tuple[PlannedTrial, ...]  # over codes if the session was begun blind
    about: dict[str, Any]  # everything that has no table of its own
    key: dict[str, int]  # code -> controller; empty if it was not begun blind


#: What `about` must hold -> its type.
_NEEDED = {
    "participant": str, "hand": str, "person": dict | None, "protocol": dict, "blind": bool, "plan_sha256": str,
    "seed": int,
}  # fmt: skip


def put_session(
    database: Database, about: Mapping[str, Any], protocol: Protocol, plan: tuple[PlannedTrial, ...],
    key: Mapping[str, int],
) -> None:  # fmt: skip
    """Everything about a new session, for the next commit."""
    put_about(database, about)
    put_protocol(database, protocol)
    for trial in plan:
        database.put("plan", *trial)
    for code, controller in key.items():
        database.put("blind_key", code, controller)


def put_about(database: Database, about: Mapping[str, Any]) -> None:
    """Facts by name, for the next commit."""
    for name, value in about.items():
        database.put("about", name, json.dumps(value, allow_nan=False))


def about_in(stored: Stored) -> dict[str, Any]:
    """Facts by name. InputError: one was changed."""
    with reading_stored(stored.path):
        return {name: json.loads(value) for name, value in stored.whole_rows("about")}


def put_protocol(database: Database, protocol: Protocol) -> None:
    """A protocol with its files in full, for the next commit."""
    about = deepcopy(protocol_to_json(protocol))
    for name, place, key in _texts_of(about):
        put_file(database, name, place[key])
        place[key] = None
    database.put("about", "protocol", json.dumps(about))


def put_file(database: Database, name: str, text: str) -> None:
    """A file in full, for the next commit."""
    database.put("file", name, hashlib.sha256(text.encode()).hexdigest(), text)


def files_in(stored: Stored) -> dict[str, str]:
    """Name -> text of the files. InputError: one was changed."""
    return {name: text for name, _, text in stored.whole_rows("file")}


def protocol_in(stored: Stored, about: dict[str, Any]) -> Protocol:
    """The protocol, from `about_in`, whose entry it completes."""
    with reading_stored(stored.path):
        return protocol_from_json(_with_texts(stored, about), str(stored.path))


def protocol_and_hand(session: Path) -> tuple[dict[str, Any], str]:
    """The protocol of a session as JSON, with its files in full; what moved the handle. InputError: cannot be read."""
    with reading_stored(session / DATABASE), reading(session) as stored:
        about = about_in(stored)
        return _with_texts(stored, about), about["hand"]


def _with_texts(stored: Stored, about: dict[str, Any]) -> dict[str, Any]:
    protocol, texts = about["protocol"], files_in(stored)
    for name, place, key in _texts_of(protocol):
        place[key] = texts[name]
    return dict(protocol)


def _texts_of(protocol: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], str]]:
    """The texts in a protocol as JSON: the name of each as a file, and where it stands."""
    yield "protocol.toml", protocol, "text"
    for device in protocol["devices"]:
        folder = f"devices/{device['name']}"
        yield f"{folder}.toml", device, "file"
        for name in device["brakes"]:
            yield f"{folder}/brakes/{name}", device["brakes"], name
        if "calibration" in device:
            yield f"{folder}/calibration", device, "calibration"
    if "language" in protocol:
        yield "language", protocol, "language"
    for kind in ("drawings", "code", "pictures"):
        for name in protocol.get(kind, {}):
            yield f"{kind}/{name}", protocol[kind], name


def read_stored(session: Path) -> StoredSession:
    """Read what is stored of a session. InputError if it cannot be read, lacks something or was changed."""
    path = session / DATABASE
    with reading_stored(path), reading(session) as stored:
        about = about_in(stored)
        if missing := [key for key in _NEEDED if key not in about]:
            raise InputError(f"{path}: is damaged (it lacks {' and '.join(missing)})")
        if wrong := [key for key, kind in _NEEDED.items() if not isinstance(about[key], kind)]:
            raise InputError(f"{path}: is damaged ({' and '.join(wrong)} cannot be read)")
        if about["hand"] not in INPUTS:
            raise InputError(f"{path}: hand {about['hand'][:40]!r} is none of {', '.join(INPUTS)}")
        participant_index(about["participant"])  # InputError unless it is a label
        protocol = protocol_in(stored, about)
        plan = tuple(PlannedTrial(*values) for values in stored.whole_rows("plan"))
        key = dict(stored.whole_rows("blind_key"))
    if plan_hash(plan) != about["plan_sha256"]:
        raise InputError(f"{path}: plan: does not match plan_sha256, it was changed")
    if about["blind"] and set(key.values()) != set(protocol.controllers):
        raise InputError(f"{path}: blind_key: is not the key of these controllers, it was changed")
    for trial in plan:
        refuse_trial(trial, protocol, f"{path}: plan")
    return StoredSession(about["participant"], protocol, plan, about, key)


def refuse_trial(trial: PlannedTrial | TrialRow, protocol: Protocol, where: str) -> None:
    """InputError if a protocol lacks the device, the path or the controller of a trial."""
    lacks = {
        f"device {trial.configuration}": trial.configuration not in {device.name for device in protocol.devices},
        f"path {trial.path}": trial.path not in protocol.paths,
        f"controller {trial.controller}": isinstance(trial.controller, int)
        and trial.controller not in protocol.controllers,
    }
    if any(lacks.values()):
        missing = ", ".join(name for name, is_missing in lacks.items() if is_missing)
        raise InputError(f"{where}: the {protocol.name} protocol of the session has no {missing}")


def stored_person(session: Path, stored: StoredSession) -> Person | None:
    """The simulated operator of a stored session; None: a person. InputError: it cannot be read."""
    about = stored.about["person"]
    with reading_stored(session / DATABASE):
        person = Person(**about) if about else None
    for name, value in (about or {}).items():
        if not isinstance(value, float | int) or isinstance(value, bool) or not math.isfinite(value):
            raise InputError(f"{session / DATABASE}: person: {name} must be a number")
    return person


def controller_names(session: Path) -> dict[int, str]:
    """Controller -> its name in the session's protocol; empty if that cannot be read (`phd verify` says why)."""
    with contextlib.suppress(InputError):
        return {number: preset.name for number, preset in read_stored(session).protocol.controllers.items()}
    return {}


def other_protocol(data_dir: Path, participant: str, protocol: Protocol) -> str:
    """The participant of the newest other session, if that was run by another protocol; else ""."""
    others = [
        file for file in data_dir.glob(f"sub-*/ses-01/{DATABASE}") if file.parents[1].name != f"sub-{participant}"
    ]
    for file in sorted(others, key=lambda file: file.stat().st_mtime, reverse=True):
        with contextlib.suppress(InputError):  # one that cannot be read does not count
            same = protocol_and_hand(file.parent)[0] == protocol_to_json(protocol)
            return "" if same else file.parents[1].name.removeprefix("sub-")
    return ""
