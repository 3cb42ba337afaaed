"""Protocols: what an experiment is, from its file to what plans, sessions and screens read.

A protocol stands in a TOML file (format: `ProtocolFile`; lengths in m, forces in N, times in s, gains in N s/m); the
paper's is shipped and the default. What is stored with a session or a study (`protocol_to_json`) holds every file in
full, so that the session can be resumed when the files are lost.
"""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import msgspec

from core.control.controllers import ALGORITHMS, PARAMETERS, Preset, make_preset
from core.control.rule_sets import RULE_SETS
from core.device import Device, build_device, load_device
from core.files import InputError, NotNegative, Positive, Table, one_of, parse_toml, read_text
from core.path import PathFile, build_path, outline, path_from, point_at
from core.simulator.hand import Hand, spring_hand
from core.workspace import tip_is_free

PROPORTIONAL, GAIN = "proportional", "gain_N_s_m"  # whose least gain `--low-gain` sets
FEEDBACKS = ("none", "time", "error")  # what the participant sees after a trial
NUMBER, TEXT = "number", "text"  # what a field of the form takes where it lists no choices

Count = Annotated[int, msgspec.Meta(ge=1, le=1000)]
Text = Annotated[str, msgspec.Meta(min_length=1)]


#: Parameter of an algorithm -> what a file may say for it.
PARAMETER_TYPES = {name: Positive if one.default is None else NotNegative for name, one in PARAMETERS.items()}


class _NamedController(Table, frozen=True):
    """What every controller has."""

    name: Text
    kind: str  # a word of ALGORITHMS
    number: Count | None = None  # its place in the list where it is left out

    def __post_init__(self) -> None:
        plain_text(self.name, "name")
        self.preset()

    def preset(self) -> Preset:
        """The controller. ValueError if its parameters are not those of its algorithm."""
        one_of(self.kind, tuple(ALGORITHMS), "kind")
        return make_preset(self.name, self.kind, {name: getattr(self, name) for name in PARAMETERS})


#: One controller as it stands in a file: an algorithm and its parameters.
ControllerFile = msgspec.defstruct(
    "ControllerFile", [(name, kind | None, None) for name, kind in PARAMETER_TYPES.items()],
    bases=(_NamedController,), frozen=True, kw_only=True, forbid_unknown_fields=True,
)  # fmt: skip


class TrialFile(Table, frozen=True):
    """How a trial goes: approach, hold, move, end. The end radius is assumed; the paper prints none of these."""

    hold_s: NotNegative = 0.5  # at the start, before "go"
    start_radius_m: Positive = 0.003  # within which the start is held
    end_radius_m: Positive = 0.01  # within which the end is reached
    time_out_s: Positive = 30.0  # longest move
    approach_time_out_s: Positive = 30.0  # longest approach of a simulated operator; a person has 10 minutes
    end_s: NotNegative = 0.3  # recorded after the end, brakes off


class Release(Table, frozen=True):
    """Release of a trapped hand, on a real device alone: a full lock pushed so hard for so long lets go (assumed)."""

    on: bool = True
    force_N: Positive = 30.0
    time_s: Positive = 1.0


class TrialRules(NamedTuple):
    """How a trial goes, as a trial reads it: the fields of `TrialFile`, and the release (None: off)."""

    hold_s: float = 0.5
    start_radius_m: float = 0.003
    end_radius_m: float = 0.01
    time_out_s: float = 30.0
    approach_time_out_s: float = 30.0
    end_s: float = 0.3
    release: Release | None = Release()


class Cues(Table, frozen=True):
    """Durations of the move that earn the participant a "slower" (shorter ones) or a "faster" (longer ones)."""

    too_fast_s: Positive
    too_slow_s: Positive

    def __post_init__(self) -> None:
        if not self.too_fast_s < self.too_slow_s:
            raise ValueError(f"too_fast_s ({self.too_fast_s:g}) must be shorter than too_slow_s ({self.too_slow_s:g})")


class Breaks(Table, frozen=True):
    """A break comes after so many trials of a configuration, and lasts at least so long."""

    after_trials: Count
    least_s: NotNegative


class MouseHand(Table, frozen=True):
    """The spring by which the pointer pulls the handle. Assumed: soft enough to feel, capped to what an arm does."""

    stiffness_N_m: Positive = 200.0
    damping_N_s_m: NotNegative = 8.0
    force_max_N: Positive = 40.0
    mass_kg: NotNegative = 0.0  # a pointer has no arm behind it

    def hand(self) -> Hand:
        """The spring-damper for the simulator."""
        k, b = self.stiffness_N_m, self.damping_N_s_m
        return spring_hand((k, 0.0, k), (b, 0.0, b), self.force_max_N, self.mass_kg)


class Questionnaire(Table, frozen=True):
    """Whether the participant answers a short questionnaire after each block."""

    on: bool = False


class ProtocolFile(Table, frozen=True):
    """One protocol as it stands in its file."""

    name: Text
    devices: Annotated[tuple[Text, ...], msgspec.Meta(min_length=1)]  # shipped names, or paths from the file's folder
    path: Annotated[tuple[dict[str, Any], ...], msgspec.Meta(min_length=1)]  # each a path of core.path
    controller: Annotated[tuple[ControllerFile, ...], msgspec.Meta(min_length=1)]
    rules: str = "settled"
    seed: Annotated[int, msgspec.Meta(ge=0)] = 1
    blocks: Count = 1  # of each configuration; every controller x path once in each
    repetitions: Count = 1  # of a cell within a block
    practice_trials: Annotated[int, msgspec.Meta(ge=0, le=1000)] = 0  # before each configuration, not counted
    participants: tuple[str, ...] = ()  # none named: anybody
    blind: bool = False  # the console sees codes in place of controllers
    show_linkage: bool = False  # to the participant
    feedback: str = "none"
    provenance: str = ""  # "assumed": the paths are not measured or published, and every figure notes it
    trial: TrialFile = TrialFile()
    cues: Cues | None = None
    breaks: Breaks | None = None
    mouse: MouseHand = MouseHand()
    release: Release = Release()
    questionnaire: Questionnaire = Questionnaire()
    form: dict[str, tuple[Text, ...] | str] = {}  # asked of each participant: choices, "number" or "text"

    def __post_init__(self) -> None:
        plain_text(self.name, "name")
        one_of(self.rules, tuple(RULE_SETS), "rules")
        one_of(self.feedback, FEEDBACKS, "feedback")
        one_of(self.provenance, ("", "assumed"), "provenance")
        for label in self.participants:
            if not (label.isascii() and label.isalnum()):
                raise ValueError(f"participants: {label!r} must be letters and digits only")
        if len(set(self.participants)) < len(self.participants):
            raise ValueError("participants: the same label stands there twice")
        for name, kind in self.form.items():
            if not (name.isascii() and name.isidentifier()):
                raise ValueError(f"form: {name!r} must be of letters, digits and _")
            if isinstance(kind, str):
                one_of(kind, (NUMBER, TEXT), f"form.{name}")
            elif len(set(kind)) < 2:
                raise ValueError(f"form.{name} must offer at least two different choices")

    def trial_rules(self) -> TrialRules:
        """The tables `trial` and `release` together."""
        return TrialRules(*msgspec.structs.astuple(self.trial), release=self.release if self.release.on else None)


def plain_text(value: str, key: str) -> None:
    """For `__post_init__`: a ValueError unless the text can stand in tables and file names."""
    if not value.isprintable() or value != value.strip() or any(letter in ';"/\\' for letter in value):
        raise ValueError(f'{key} must be plain text without ; " / or \\, not {value!r}')


SHIPPED_FOLDER = Path(__file__).resolve().parent / "protocols"
PAPER = "paper"
MOST_TRIALS = 10_000  # of a participant. Our choice: 40 hours and more; what is typed in error is more
REACH_SPACING_M = 0.002  # between the places of a path at which a device's stops are looked at


@dataclass(frozen=True)
class Protocol:
    """An experiment, checked: every device can follow every path."""

    name: str
    text: str  # the file in full
    overrides: dict[str, Any]  # what was asked for in its place: devices (names), rules, low_gain, seed
    devices: tuple[Device, ...]
    paths: dict[int, PathFile]
    controllers: dict[int, Preset]
    rules: str
    seed: int
    blocks: int  # of each configuration
    repetitions: int  # of a cell within a block
    practice_trials: int  # before each configuration, not counted
    participants: tuple[str, ...]  # none: anybody
    blind: bool  # the console sees codes in place of controllers
    show_linkage: bool  # to the participant
    feedback: str  # to the participant: "none", "time", "error"
    paths_assumed: bool
    trial: TrialRules
    mouse: MouseHand
    questionnaire: bool
    cues: Cues | None = None
    breaks: Breaks | None = None
    form: dict[str, tuple[str, ...] | str] = field(default_factory=dict)  # as in `ProtocolFile`
    device_files: dict[str, str] = field(default_factory=dict, compare=False)  # device -> how a refusal names it

    @property
    def assumed(self) -> bool:
        """Whether any device or the paths have assumed numbers."""
        return self.paths_assumed or any(device.assumed for device in self.devices)

    @property
    def low_gain(self) -> float | None:
        """The least gain of its proportional controllers, N s/m; None without any."""
        gains = [preset.value(GAIN) for preset in self.controllers.values() if preset.kind == PROPORTIONAL]
        return min(gains, default=None)

    def note(self) -> str:
        """The note on every figure: protocol, rules, the low gain, what is assumed."""
        parts = [f"{self.name} protocol", f"{self.rules} rules"]
        if self.low_gain is not None:
            parts.append(f"low gain {self.low_gain:g} N s/m")
        if any(device.assumed for device in self.devices):
            parts.append("parameters assumed")
        elif self.paths_assumed:
            parts.append("paths assumed")
        return ", ".join(parts)

    def controller_name(self, controller: int | str) -> str:
        """A controller's name; a code stays as it is."""
        return controller if isinstance(controller, str) else self.controllers[controller].name

    def refuse_stranger(self, participant: str) -> None:
        """InputError if the protocol names its participants, and this is none of them."""
        if self.participants and participant not in self.participants:
            raise InputError(
                f"participant {participant}: is none of the {self.name} protocol's ({', '.join(self.participants)})"
            )

    def labels(self) -> dict[int | str, str]:
        """Controller -> its name in lines that fit under a box."""
        return {number: label(preset.name) for number, preset in self.controllers.items()}

    def device(self, name: str) -> Device:
        """The device of a configuration."""
        return next(device for device in self.devices if device.name == name)


def label(name: str) -> str:
    """A controller's name in lines that fit under a box."""
    return textwrap.fill(name, 13)


def shipped_protocols() -> list[str]:
    """Names of the protocols that come with the product."""
    return sorted(file.stem for file in SHIPPED_FOLDER.glob("*.toml"))


def load_protocol(
    name_or_path: str | Path = PAPER,
    *,
    devices: Sequence[str | Path | Device] | None = None,
    rules: str | None = None,
    low_gain: float | None = None,
    seed: int | None = None,
) -> Protocol:
    """A shipped protocol by its name, or a protocol file by its path; what else is given stands in place of the file's.

    devices: shipped names, paths from the current folder, or devices; low_gain (N s/m): of the proportional controller
    of least gain. InputError, one sentence with file and key, for anything that cannot be run.
    """
    path = Path(name_or_path)
    if str(name_or_path) in shipped_protocols():
        path = SHIPPED_FOLDER / f"{name_or_path}.toml"
    elif not str(name_or_path) or not path.is_file():
        raise InputError(
            f"unknown protocol {str(name_or_path)!r}: neither a shipped protocol ({', '.join(shipped_protocols())}) "
            "nor a file"
        )
    given = {
        name: value for name, value in (("rules", rules), ("low_gain", low_gain), ("seed", seed)) if value is not None
    }
    return read_protocol(read_text(path), path.parent, str(path), given, devices)


def read_protocol(
    text: str,
    folder: Path,
    where: str,
    given: Mapping[str, Any] | None = None,
    devices: Sequence[str | Path | Device] | None = None,
) -> Protocol:
    """A protocol from the text of its file, which stands in `folder`; `where` names it. Else as `load_protocol`."""
    file, given = parse_toml(text, ProtocolFile, where), dict(given or {})
    if devices is None:
        found = [_device(reference, folder, f"{where}: devices") for reference in file.devices]
    else:
        found = [_device(reference, Path(), "--device") for reference in devices]
        given["devices"] = [device.name for device, _ in found]
    return build_protocol(file, text, found, given, where)


def _device(reference: str | Path | Device, folder: Path, where: str) -> tuple[Device, str]:
    """A device, and how a refusal names it: by its file, where it came from one."""
    if isinstance(reference, Device):
        return reference, f"device {reference.name}"
    try:
        device = load_device(reference, folder)
    except InputError as error:
        raise InputError(f"{where}: {error}" if str(error).startswith("unknown device") else str(error)) from None
    path = folder / reference
    return device, str(path) if path.is_file() and device.name != str(reference) else f"device {device.name}"


def build_protocol(
    file: ProtocolFile,
    text: str,
    devices: Sequence[tuple[Device, str]],
    given: Mapping[str, Any],
    where: str,
) -> Protocol:
    """The protocol of a file with its devices; `given` replaces the file's own values. InputError as above."""
    names = [device.name for device, _ in devices]
    if len(set(names)) < len(names):
        raise InputError(f"{where}: devices: two devices have the same name ({', '.join(names)})")
    controllers = _controllers(file, where)
    if "low_gain" in given:
        controllers = with_low_gain(controllers, given["low_gain"], where)
    rules, seed = given.get("rules", file.rules), given.get("seed", file.seed)
    if rules not in RULE_SETS:
        raise InputError(f"rules: {rules!r} is not one of {', '.join(RULE_SETS)}")
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise InputError(f"seed: {seed!r} must be a whole number of at least 0")
    protocol = Protocol(
        name=file.name,
        text=text,
        overrides=dict(given),
        devices=tuple(device for device, _ in devices),
        paths=_paths(file, where),
        controllers=controllers,
        rules=rules,
        seed=seed,
        blocks=file.blocks,
        repetitions=file.repetitions,
        practice_trials=file.practice_trials,
        participants=file.participants,
        blind=file.blind,
        show_linkage=file.show_linkage,
        feedback=file.feedback,
        paths_assumed=file.provenance == "assumed",
        trial=file.trial_rules(),
        mouse=file.mouse,
        questionnaire=file.questionnaire.on,
        cues=file.cues,
        breaks=file.breaks,
        form=dict(file.form),
        device_files={device.name: named for device, named in devices},
    )
    refuse_endless(protocol, where)
    check_reach(protocol, where)
    return protocol


def refuse_endless(protocol: Protocol, where: str) -> None:
    """InputError if a participant would have more trials than MOST_TRIALS."""
    cells = len(protocol.devices) * len(protocol.paths) * len(protocol.controllers)
    trials = cells * protocol.blocks * protocol.repetitions
    if trials > MOST_TRIALS:
        raise InputError(
            f"{where}: blocks, repetitions: a participant can have at most {MOST_TRIALS} trials, not {trials} "
            f"({cells} of device, path and controller, {protocol.blocks} blocks, {protocol.repetitions} repetitions)"
        )


def _numbered(key: str, numbers: Sequence[Any], where: str) -> list[int]:
    """The numbers of a list's entries: those they name, else their place in the list."""
    found = [place if number is None else number for place, number in enumerate(numbers, start=1)]
    for number in found:
        if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= 1000:
            raise InputError(f"{where}: {key}: number must be a whole number from 1 to 1000, not {number!r}")
        if found.count(number) > 1:
            raise InputError(f"{where}: {key}: number {number} stands there twice")
    return found


def _controllers(file: ProtocolFile, where: str) -> dict[int, Preset]:
    numbers = _numbered("controller", [controller.number for controller in file.controller], where)
    presets = [one.preset() for one in file.controller]
    names = [preset.name for preset in presets]
    if len(set(names)) < len(names):
        raise InputError(f"{where}: controller: two controllers have the same name ({', '.join(names)})")
    return dict(sorted(zip(numbers, presets, strict=True)))


def _paths(file: ProtocolFile, where: str) -> dict[int, PathFile]:
    numbers = _numbered("path", [entry.get("number") for entry in file.path], where)
    paths = {}
    for number, entry in sorted(zip(numbers, file.path, strict=True), key=lambda pair: pair[0]):
        about = {key: value for key, value in entry.items() if key != "number"}
        paths[number] = path_from(about, f"{where}: path {number}")
        build_path(paths[number], f"{where}: path {number}")  # it can be followed
    return paths


def with_low_gain(controllers: Mapping[int, Preset], gain: float, where: str) -> dict[int, Preset]:
    """The controllers with this gain (N s/m) for the proportional one of least gain."""
    if isinstance(gain, bool) or not isinstance(gain, int | float) or not 0.0 < gain <= 1e6:
        raise InputError(f"low gain: {gain!r} must be a number greater than 0, at most 1e6 N s/m")
    proportional = [number for number, preset in controllers.items() if preset.kind == PROPORTIONAL]
    if not proportional:
        raise InputError(f"{where}: controller: none is proportional, there is no low gain to set")
    least = min(proportional, key=lambda number: controllers[number].value(GAIN))
    return {**controllers, least: controllers[least].replaced(GAIN, float(gain))}


def check_reach(protocol: Protocol, where: str) -> None:
    """InputError if a device cannot follow a path without running into a stop."""
    for device in protocol.devices:
        for number, path in protocol.paths.items():
            places = outline(path, REACH_SPACING_M)
            free = tip_is_free(device.mechanism, places[:, 0], places[:, 1])
            if not free.all():
                x, y = places[int(free.argmin())]
                raise InputError(
                    f"{protocol.device_files[device.name]}: cannot follow path {number} of {where}, which leaves its "
                    f"workspace at ({x:.3f}, {y:.3f}) m"
                )


def protocol_to_json(protocol: Protocol) -> dict[str, Any]:
    """Everything that the protocol is, as plain dictionaries: its text, what was asked for instead, its devices."""
    return {
        "name": protocol.name,
        "text": protocol.text,
        "overrides": protocol.overrides,
        "devices": [
            {
                "name": device.name,
                "file": device.text,
                "brakes": device.brake_texts,
                **({"calibration": device.calibration_text} if device.calibration_text is not None else {}),
            }
            for device in protocol.devices
        ],
    }


def protocol_from_json(about: Mapping[str, Any], where: str) -> Protocol:
    """The protocol that was stored. InputError, or KeyError and TypeError where something is missing."""
    file = parse_toml(about["text"], ProtocolFile, f"{where}: protocol")
    devices = []
    for stored in about["devices"]:
        named = f"{where}: devices.{stored['name']}"
        device = build_device(stored["file"], stored["brakes"], named, stored.get("calibration"))
        devices.append((device, named))
    return build_protocol(file, about["text"], devices, about["overrides"], f"{where}: protocol")


def home_of(device: Device, paths: Mapping[int, PathFile]) -> tuple[float, float]:
    """Where the jig holds the handle, m; the middle of the first path where the device file has none."""
    if device.sensing is not None and device.sensing.home_m is not None:
        return device.sensing.home_m
    path = build_path(next(iter(paths.values())), "path")
    x, y, _, _ = point_at(path, 0.5 * path.length)
    return float(x), float(y)
