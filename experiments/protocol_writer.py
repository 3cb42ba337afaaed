"""Writes protocol files: TOML that `experiments.protocol` reads."""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from core.device import Device, load_device
from core.drawn_path import DRAWING
from core.files import InputError, toml_text
from experiments.atomic_files import reason_of, replace_file, write_new_file
from experiments.language import shipped_languages
from experiments.protocol import Protocol, read_protocol

ABOUT = "# A protocol of phd. docs/files-and-commands.md says what each key is.\n"


def protocol_text(content: Mapping[str, Any]) -> str:
    """The TOML text of a protocol (content as `tomllib` reads it)."""
    return ABOUT + toml_text(content)


def save_protocol(path: Path, text: str, replacing: bool = False) -> None:
    """Write a protocol file that can be run. InputError, and nothing written, if it cannot, or if the file exists.

    replacing: an existing file is replaced. Devices given by path are looked for from the file's folder.
    """
    read_protocol(text, path.parent, str(path))
    try:
        write = replace_file if replacing else write_new_file
        write(path, text.encode(), sync=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({reason_of(error)})") from None


def whole_text(protocol: Protocol, name: str, about: str) -> str:
    """A protocol as one file of this name that needs no other; about: the comment at its top.

    Options, devices and brakes are part of it. Instructions, a translation and the calibration of a force sensor are
    left out: a simulated operator needs none.
    """
    content = _without_files(protocol) | {
        "name": name,
        "rules": protocol.rules,
        "seed": protocol.seed,
        "assumptions": msgspec.to_builtins(protocol.assumptions),
        **_with_brakes(protocol.devices),
    }
    return about + toml_text(content)


def _with_brakes(used: Sequence[Device]) -> dict[str, Any]:
    """The part of a protocol's file that names devices and holds them and their brakes."""
    brakes: dict[str, dict[str, Any]] = {}  # by their text
    devices = []
    for device in used:
        content = tomllib.loads(device.text)
        for joint, reference in content["brakes"].items():
            text = device.brake_texts[reference]
            if text not in brakes:
                brake = tomllib.loads(text)
                if any(other["name"] == brake["name"] for other in brakes.values()):
                    brake["name"] += f" {len(brakes) + 1}"
                brakes[text] = brake
            content["brakes"][joint] = brakes[text]["name"]
        if device.calibration_text is not None:
            del content["sensing"]["force"]["calibration"]
        devices.append(content)
    return {"devices": [device.name for device in used], "device": devices, "brake": list(brakes.values())}


def protocol(
    name: str,
    devices: Sequence[str | Path | Device],
    paths: Sequence[Mapping[str, Any] | np.ndarray],
    controllers: Sequence[Mapping[str, Any]],
    **keys: Any,
) -> Protocol:
    """A protocol from values. `.text` is its protocol file, which holds its devices and brakes.

    devices: shipped names, files, or what `device` returns. paths: the keys of each ({"kind": "segment", "start_m":
    (x, y), "end_m": (x, y)}), or its points, array (n, 2). controllers: the keys of each ({"name": "Soft guide",
    "kind": "proportional", "gain_N_s_m": 300.0}). keys: others of a protocol file (seed, repetitions, trial, ..).
    """
    found = [device if isinstance(device, Device) else load_device(device) for device in devices]
    content = {
        "name": name,
        **keys,
        **_with_brakes(found),
        "path": [
            _plain(path if isinstance(path, Mapping) else {"kind": "polyline", "points_m": path}) for path in paths
        ],
        "controller": [_plain(controller) for controller in controllers],
    }
    return read_protocol(protocol_text(content), Path(), f"protocol {name}")


def _plain(table: Mapping[str, Any]) -> dict[str, Any]:
    """A table with the numbers of its arrays, tuples and lists as Python's."""
    return {key: value if isinstance(value, Mapping) else np.asarray(value).tolist() for key, value in table.items()}


def _without_files(protocol: Protocol) -> dict[str, Any]:
    """A protocol's file so that it needs no other: no devices, instructions, translation, measures; paths as points."""
    left_out = ("about", "instruction", "device", "brake", "measure")
    content = {key: value for key, value in tomllib.loads(protocol.text).items() if key not in left_out}
    for place, entry in enumerate(content["path"], start=1):
        if entry["kind"] == DRAWING:
            number = entry.get("number", place)
            content["path"][place - 1] = {"number": number, **msgspec.to_builtins(protocol.paths[number])}
    if protocol.language not in shipped_languages():
        content.pop("language", None)
    return content
