"""What a study was begun with, and its sessions: DATA/study.db, a database like that of a session."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from core.files import InputError
from experiments.atomic_files import reading_stored, refusing
from experiments.protocol import Protocol
from experiments.store.database import Database, new_database, reading
from experiments.store.files import STUDY, sessions_in
from experiments.store.stored import about_in, files_in, protocol_in, put_about, put_file, put_protocol
from experiments.trial.population import Population, population_of

POPULATION = "population.toml"


@dataclass(frozen=True)
class StudyPlan:
    """Protocol, population and number of operators of a study."""

    operators: int
    protocol: Protocol
    population: Population


def write_study(folder: Path, study: StudyPlan) -> None:
    """Store a new study. OSError if it cannot be written."""
    with refusing(folder / STUDY, "cannot be written"), new_database(folder / STUDY) as database:
        put_about(database, {"operators": study.operators, "population": study.population.name, "sessions": {}})
        put_file(database, POPULATION, study.population.text)
        put_protocol(database, study.protocol)


def note_sessions(folder: Path) -> None:
    """Note which sessions the study has, once all have been run."""
    sessions = identities_in(folder)
    if sessions != read_sessions(folder):
        with Database(folder, name=STUDY) as database:
            put_about(database, {"sessions": sessions})


def identities_in(folder: Path) -> dict[str, str]:
    """Session ("sub-01/ses-01") -> its identity, of those that can be read."""
    found = {}
    for session in sessions_in(folder).folders:
        with reading(session) as stored:
            found[session.relative_to(folder).as_posix()] = stored.identity
    return found


def read_sessions(folder: Path) -> dict[str, str]:
    """The sessions that a study has noted, as `identities_in`. InputError: it cannot be read."""
    with reading_stored(folder / STUDY), reading(folder, STUDY) as stored:
        return {str(name): str(identity) for name, identity in about_in(stored)["sessions"].items()}


def read_study(folder: Path) -> StudyPlan:
    """The study that a folder was begun with. InputError if there is none or it cannot be read."""
    path = folder / STUDY
    if not path.exists():
        raise InputError(f"{folder}: holds no study to resume (no {STUDY})")
    with reading_stored(path), reading(folder, STUDY) as stored:
        about = about_in(stored)
        operators = about["operators"]
        if not isinstance(operators, int) or isinstance(operators, bool) or operators < 1:
            raise InputError(f"{path}: operators must be a whole number of at least 1")
        population = population_of(files_in(stored)[POPULATION], f"{path}: population")
        return StudyPlan(operators, protocol_in(stored, about), population)


def refuse_other(folder: Path, study: StudyPlan, options: Mapping[str, object]) -> None:
    """InputError if the options differ from those with which the study was begun.

    options: operators, seed, rules, low_gain, sensing -> value; devices, protocol, population -> the object.
    """
    own = {"operators": study.operators, "protocol": study.protocol, "population": study.population}
    assumed = study.protocol.assumptions
    own |= {"low_gain": assumed.low_gain or study.protocol.low_gain, "sensing": assumed.sensing}
    for name, value in options.items():
        begun, words = _content(name, own[name] if name in own else getattr(study.protocol, name))
        if _content(name, value)[0] != begun:
            option = {"devices": "--device", "protocol": "PROTOCOL.toml"}.get(name, f"--{name.replace('_', '-')}")
            raise InputError(
                f"{folder / STUDY}: {option}: the study was begun with {words}; leave the option out to resume it"
            )


def _content(name: str, value: Any) -> tuple[object, str]:
    """The content of an option that is compared (texts of files, or the value), and its name in a refusal."""
    if isinstance(value, Protocol | Population):
        return value.text, f"another {name} ({value.name})"
    if isinstance(value, tuple):
        texts = [(device.name, device.text, device.brake_texts) for device in value]
        return texts, f"other devices: {', '.join(device.name for device in value)}"
    return value, "none" if value is None else f"{value:g}" if isinstance(value, float) else f"{value}"
