"""study.json: what a study was begun with, so that an interrupted one goes on with the same.

DIR/study.json    operators, seed, rules, low gain, devices with their brake files in full
DIR/.lock         held by the one process that runs the study
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from core.device import Device, build_device
from core.errors import InputError
from experiments.whole_files import give_new_name, written_beside

STUDY = "study.json"


@dataclass(frozen=True)
class StudyPlan:
    """What decides a study."""

    operators: int
    seed: int
    devices: tuple[Device, ...]
    rules: str = "settled"
    low_gain: float = 5.0  # N s/m, of controller 5

    @property
    def assumed(self) -> bool:
        """Whether any device has assumed numbers."""
        return any(device.assumed for device in self.devices)


def _device_texts(device: Device) -> dict:
    return {"name": device.name, "file": device.text, "brakes": device.brake_texts}


def write_study(folder: Path, study: StudyPlan) -> None:
    """Store it in a folder that has none yet. OSError if it cannot be written."""
    about = {
        "operators": study.operators,
        "seed": study.seed,
        "rules": study.rules,
        "low_gain": study.low_gain,
        "devices": [_device_texts(device) for device in study.devices],
    }
    with written_beside(folder / STUDY, json.dumps(about, indent=1, sort_keys=True).encode() + b"\n") as partial:
        give_new_name(partial, folder / STUDY)


def read_study(folder: Path) -> StudyPlan:
    """The study that a folder was begun with. InputError if there is none or it cannot be read."""
    path = folder / STUDY
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
        devices = tuple(
            build_device(stored["file"], stored["brakes"], f"{path}: devices.{stored['name']}")
            for stored in about["devices"]
        )
        operators, seed, low_gain = int(about["operators"]), int(about["seed"]), float(about["low_gain"])
        return StudyPlan(operators, seed, devices, str(about["rules"]), low_gain)
    except FileNotFoundError:
        raise InputError(f"{folder}: holds no study to resume (no {STUDY})") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({(error.strerror or str(error)).lower()})") from None
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is damaged ({type(error).__name__}: {error})") from None


def refuse_other(folder: Path, study: StudyPlan, asked: Mapping[str, object]) -> None:
    """InputError if what was asked for (field of StudyPlan -> value) is not what the study was begun with."""
    for name, value in asked.items():
        if name == "devices":
            asked_for, there = ([_device_texts(d) for d in devices] for devices in (value, study.devices))
            begun_with = "other devices: " + ", ".join(device.name for device in study.devices)
        else:
            asked_for, there, begun_with = value, getattr(study, name), f"{getattr(study, name)}"
        if asked_for != there:
            option = "device" if name == "devices" else name.replace("_", "-")
            raise InputError(
                f"{folder / STUDY}: --{option}: the study was begun with {begun_with}; "
                "leave the option out to resume it"
            )
