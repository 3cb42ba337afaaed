"""What is stored about a session, and what each of its recordings says of its trial."""

import importlib.metadata
import platform
from datetime import UTC, datetime
from typing import Any

import msgspec

from core.control.controllers import KINDS, Preset
from experiments.plan import PlannedTrial, plan_hash, plan_to_json
from experiments.protocol import Protocol, protocol_to_json
from experiments.trial.linked_trial import LinkedTrial
from experiments.trial.operator import Person
from experiments.trial.trial import Trial

SENSOR = "force sensor"  # of a device on the bench: whoever moves the handle
LIBRARIES = ("numpy", "scipy", "numba", "pyarrow")


def session_about(
    participant: str, protocol: Protocol, person: Person | None, hand: str, plan: tuple[PlannedTrial, ...],
    key_sha256: str,
) -> dict[str, Any]:  # fmt: skip
    """What session.json holds. key_sha256: of the key of a blind session, whose plan holds codes; else empty."""
    return {
        "participant": participant,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "hand": hand,
        "person": person._asdict() if person else None,
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
        "versions": {"phd": _version("phd"), "python": platform.python_version()}
        | {name: _version(name) for name in LIBRARIES},
    }


def recording_metadata(
    participant: str, protocol: Protocol, hand: str, trial: Trial | LinkedTrial, preset: Preset | None
) -> dict[str, Any]:
    """What a recording says of its trial. preset: its controller; None: nothing may tell it, the session is blind."""
    planned, path, linked = trial.planned, trial.path, isinstance(trial, LinkedTrial)
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
        "hand": SENSOR if linked else hand,
        "link": "serial" if linked else "sim",
        "assumed": trial.device.assumed,
    }
    if isinstance(trial, Trial):
        about["start"] = trial.start
    if preset is not None:
        about["preset"] = preset_to_json(preset)
    return about


def preset_to_json(preset: Preset) -> dict[str, Any]:
    """A controller as plain words and numbers."""
    kind = next(word for word, algorithm in KINDS.items() if algorithm == preset.algorithm)
    return {"name": preset.name, "kind": kind, "gap_m": preset.gap_m, "gain_N_s_m": preset.gain}


def preset_from_json(about: dict[str, Any]) -> Preset:
    """A controller as a recording has it. KeyError if something is missing."""
    return Preset(about["name"], KINDS[about["kind"]], float(about["gap_m"]), float(about["gain_N_s_m"]))


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
