"""study.json: what a study was begun with, so that an interrupted one goes on with the same.

DIR/study.json    operators, population, protocol, device and brake files, all in full
DIR/.lock         held by the one process that runs the study
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from core.files import InputError
from experiments.protocol import Protocol, protocol_from_json, protocol_to_json
from experiments.recording.atomic_files import reading_stored, write_new_file
from experiments.trial.population import Population, population_of

STUDY = "study.json"


@dataclass(frozen=True)
class StudyPlan:
    """What decides a study."""

    operators: int
    protocol: Protocol
    population: Population


def refuse_study(folder: Path) -> None:
    """InputError if the folder is a study's: its tables and statistics are of its simulated operators alone."""
    if (folder / STUDY).exists():
        raise InputError(f"{folder}: holds a study, which takes no other session; choose another data folder")


def write_study(folder: Path, study: StudyPlan) -> None:
    """Store it in a folder that has none yet. OSError if it cannot be written."""
    about = {
        "operators": study.operators,
        "population": {"name": study.population.name, "text": study.population.text},
        "protocol": protocol_to_json(study.protocol),
    }
    write_new_file(folder / STUDY, json.dumps(about, indent=1, sort_keys=True).encode() + b"\n", sync=True)


def read_study(folder: Path) -> StudyPlan:
    """The study that a folder was begun with. InputError if there is none or it cannot be read."""
    path = folder / STUDY
    if not path.exists():
        raise InputError(f"{folder}: holds no study to resume (no {STUDY})")
    with reading_stored(path):
        about = json.loads(path.read_text(encoding="utf-8"))
        population = population_of(about["population"]["text"], f"{path}: population")
        return StudyPlan(int(about["operators"]), protocol_from_json(about["protocol"], str(path)), population)


def refuse_other(folder: Path, study: StudyPlan, asked: Mapping[str, object]) -> None:
    """InputError if what was asked for is not what the study was begun with.

    asked: operators, seed, rules, low_gain -> value; devices, protocol, population -> the thing itself.
    """
    own = {"operators": study.operators, "protocol": study.protocol, "population": study.population}
    own |= {"low_gain": study.protocol.assumptions.low_gain or study.protocol.low_gain}
    for name, value in asked.items():
        begun = own[name] if name in own else getattr(study.protocol, name)
        if _content(value) != _content(begun):
            option = {"devices": "--device", "protocol": "PROTOCOL.toml"}.get(name, f"--{name.replace('_', '-')}")
            raise InputError(
                f"{folder / STUDY}: {option}: the study was begun with {_words(name, begun)}; leave the option out to "
                "resume it"
            )


def _content(thing: object) -> object:
    """What is compared of a thing: the texts of its files, or the plain value."""
    if isinstance(thing, Protocol | Population):
        return thing.text
    return [(device.name, device.text, device.brake_texts) for device in thing] if isinstance(thing, tuple) else thing


def _words(name: str, thing: object) -> str:
    if isinstance(thing, Protocol | Population):
        return f"another {name} ({thing.name})"
    if isinstance(thing, tuple):
        return f"other devices: {', '.join(device.name for device in thing)}"
    return "none" if thing is None else f"{thing:g}" if isinstance(thing, float) else f"{thing}"
