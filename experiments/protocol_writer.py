"""Writes protocol files: TOML that `experiments.protocol` reads."""

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from core.control.controllers import Preset
from core.device import Device, build_device, load_device, shipped_devices
from core.drawn_path import DRAWING
from core.files import InputError, toml_text
from experiments.assumptions import IDEAL
from experiments.atomic_files import reason_of, replace_file, write_new_file, write_new_files
from experiments.language import shipped_languages
from experiments.protocol import Protocol, read_protocol
from experiments.protocol_file import MouseHand

ABOUT = "# A protocol of phd. docs/examples/protocols/every-key.toml says what each key is.\n"


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


class Variant(NamedTuple):
    """The keys that a protocol of one device and one path has in place of another's."""

    device: Device
    path: int  # its number in the other protocol
    controllers: Mapping[int, Preset]  # as the other protocol's assumptions made them
    rules: str
    mouse: MouseHand
    brake_strength: float = 1.0  # share of K(I)
    backlash_deg: float | None = None  # of all brakes; None: each brake's own
    sensing: str = IDEAL
    blend_width_m: float | None = None  # None: the path's own


def save_variant(file: Path, protocol: Protocol, variant: Variant) -> None:
    """Write a protocol like another one, of one device and one path. InputError as above; no file is overwritten.

    Device and brake files are written beside it where the brakes are changed or the device is not a shipped one.
    Instructions and a translation are left out: they stand in files beside the other protocol.
    """
    device, strength, backlash_deg = variant.device, variant.brake_strength, variant.backlash_deg
    blend_width = variant.blend_width_m
    content = _without_files(protocol)
    applied = {"gap_reading": None, "low_gain": None} | ({} if backlash_deg is None else {"backlash_deg": None})
    content["assumptions"] = msgspec.to_builtins(protocol.assumptions) | applied | {"sensing": variant.sensing}
    paths = {entry.get("number", place): entry for place, entry in enumerate(content["path"], start=1)}
    changed = strength != 1.0 or backlash_deg is not None
    changed = changed or device.name not in shipped_devices() or load_device(device.name).text != device.text
    files, changed_device = _device_files(file, device, strength, backlash_deg) if changed else ({}, device)
    renamed = {
        name: f"{name.removesuffix('.py')}_{re.sub('[^A-Za-z0-9]', '_', file.stem)}.py" for name in protocol.code
    }
    code = {renamed[name]: own.text for name, own in protocol.code.items()}
    content |= {
        "name": file.stem,
        "rules": variant.rules,
        "devices": [f"{file.stem}-device.toml" if files else device.name],
        "path": [paths[variant.path] | ({"blend_width_m": blend_width} if blend_width else {})],
        "controller": [_controller(number, preset, renamed) for number, preset in variant.controllers.items()],
        "mouse": msgspec.to_builtins(variant.mouse),
        "measure": renamed.get(protocol.measure),
    }
    text = protocol_text(content)
    read_protocol(text, file.parent, str(file), [changed_device], code)
    files |= code | {file.name: text}
    try:
        write_new_files({file.parent / name: made.encode() for name, made in files.items()})
    except OSError as error:
        raise InputError(f"{file}: cannot be written ({reason_of(error)})") from None


def whole_text(protocol: Protocol, name: str, about: str) -> str:
    """A protocol as one file of this name that needs no other; about: the comment at its top.

    Options, devices and brakes are part of it. Instructions, a translation and the calibration of a force sensor are
    left out: a simulated operator needs none.
    """
    brakes: dict[str, dict[str, Any]] = {}  # by their text
    devices = []
    for device in protocol.devices:
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
    content = _without_files(protocol) | {
        "name": name,
        "devices": [device.name for device in protocol.devices],
        "rules": protocol.rules,
        "seed": protocol.seed,
        "assumptions": msgspec.to_builtins(protocol.assumptions),
        "device": devices,
        "brake": list(brakes.values()),
    }
    return about + toml_text(content)


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


def _controller(number: int, preset: Preset, renamed: Mapping[str, str]) -> dict[str, Any]:
    """renamed: what Python files beside the protocol are called now."""
    about = {"number": number, "name": preset.name}
    if preset.own is not None:
        return about | {"algorithm": renamed[preset.kind], "parameters": preset.named}
    return about | {"kind": preset.kind, **preset.named}


def _device_files(
    path: Path, device: Device, strength: float, backlash_deg: float | None
) -> tuple[dict[str, str], Device]:
    """The files of a device with other brakes, by name, and that device."""
    about, brakes = tomllib.loads(device.text), {}
    for number, (reference, text) in enumerate(device.brake_texts.items(), start=1):
        brake = tomllib.loads(text)
        if strength != 1.0 or backlash_deg is not None:
            brake["provenance"] = "assumed"
            if "k" in brake:
                brake["k"] = [strength * k for k in brake["k"]]
            else:
                brake["torque_table"] = [[current, strength * torque] for current, torque in brake["torque_table"]]
            brake["backlash_deg"] = brake["backlash_deg"] if backlash_deg is None else backlash_deg
        named = f"{path.stem}-brake-{number}.toml"
        brakes[named] = toml_text(brake)
        for joint, other in about["brakes"].items():
            about["brakes"][joint] = named if other == reference else other
    about["name"], files = f"{path.stem}-{device.name}", dict(brakes)
    if device.calibration_text is not None:
        about["sensing"]["force"]["calibration"] = f"{path.stem}-calibration.txt"
        files[f"{path.stem}-calibration.txt"] = device.calibration_text
    made = toml_text(about)
    files[f"{path.stem}-device.toml"] = made
    return files, build_device(made, brakes, f"{path.stem}-device.toml", device.calibration_text)
