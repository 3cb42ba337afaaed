"""Protocols: what an experiment is, from its TOML file to what plans, sessions and screens read.

The keys of a file stand in `protocol_file`; a `Protocol` is an experiment that was checked. What is stored with a
session or a study (`protocol_to_json`) holds every file in full, so that the session can be resumed when the files are
lost. The paper's protocol is shipped and the default.
"""

import functools
import itertools
import json
import os.path
import stat
import textwrap
from base64 import b64decode, b64encode
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

import msgspec

from core.control.controllers import Preset
from core.control.guard import NOTHING, Around, locks_at_rest, why_no_guard
from core.control.own_file import declare as declared_algorithm
from core.control.reflect import WALL_N_M
from core.device import Device, build_device, inline_devices, load_device
from core.drawn_path import read_path
from core.files import InputError, from_plain, is_assumed, parse_toml, read_text, shipped_names, shipped_or_file
from core.obstacles import build_obstacles, nearest_obstacle
from core.own_consent import allow
from core.own_files import OwnFile, check_own_name, declared_by, read_own_text
from core.path import Path as PathAhead
from core.path import PathFile, build_path, outline, point_at
from core.workspace import free_tips, tip_is_free
from experiments.assumptions import ENCODERS, NO_VIBRATION, Assumptions, encoder_counts
from experiments.language import Language, language_text, read_language, shipped_languages
from experiments.numbers import in_words
from experiments.own_measure import declared_measures
from experiments.protocol_file import (
    NUMBER,
    ControllerFile,
    Count,
    InstructionPage,
    Overrides,
    ProtocolFile,
    Release,
    Settings,
    TrialFile,
)
from experiments.slave import Slave

REFLECT = "reflect"
TABLE_I = ["none", "sdof", "sdof", "proportional", "proportional"]
PRINTED_LOW_GAIN = 5.0  # "Ns/m"; our protocol reads it as 5 N per cm/s
GAIN = "gain_N_s_m"  # the least one is what `--low-gain` sets
SHIPPED_FOLDER = Path(__file__).resolve().parent / "protocols"
PAPER = "paper"
MOST_TRIALS = 10_000  # of a participant. Our choice: 40 hours and more; what is typed in error is more
MOST_PICTURE_BYTES = 10_000_000  # of an instruction, stored with every session. Our choice
PICTURE_STARTS = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")  # PNG, JPEG
REACH_SPACING_M = 0.002  # between the points of a path at which a device's stops are checked

T = TypeVar("T")


class TrialRules(TrialFile, frozen=True):
    """The rules of a trial: with release (None: off), assumptions, slave and obstacles."""

    release: Release | None = Release()
    assumptions: Assumptions = Assumptions()
    slave: Slave | None = None
    around: Around = NOTHING


class Protocol(Settings, frozen=True, kw_only=True):
    """An experiment that was checked: every device can follow every path."""

    text: str  # the file in full
    overrides: dict[str, Any]  # options that replace keys of the file
    devices: tuple[Device, ...]
    paths: dict[int, PathFile]
    drawn: dict[int, str]  # number -> how a drawing was read, in words
    drawings: dict[str, str]  # their files in full
    code: dict[str, OwnFile]  # the Python files of controllers and measures, by their names with ".py"
    controllers: dict[int, Preset]
    trial: TrialRules
    language_text: str  # in full
    pictures: dict[str, bytes]  # of the instructions

    def number_of(self, controller: int | str) -> int:
        """The number of a controller, by name or number. InputError: there is none."""
        for number, preset in self.controllers.items():
            if str(controller).casefold() in (str(number), " ".join(preset.name.split()).casefold()):
                return number
        known = ", ".join(f'{number} "{" ".join(preset.name.split())}"' for number, preset in self.controllers.items())
        raise InputError(f"protocol {self.name} has no controller {str(controller)!r}; it has {known}")

    @property
    def sentences(self) -> Language:
        return read_language(self.language_text, f"language {self.language}")

    @property
    def pages(self) -> tuple[InstructionPage, ...]:
        return tuple(InstructionPage(page.text, self.pictures.get(page.picture, b"")) for page in self.instruction)

    @property
    def paths_assumed(self) -> bool:
        """Whether the paths stand for others that are not known; without a word they are this experiment's own."""
        return bool(self.provenance.strip()) and is_assumed(self.provenance)

    @property
    def assumed_of(self) -> tuple[str, ...]:
        """Whose numbers are assumed: of a device, of brakes, of paths."""
        brakes = any(brake.assumed for device in self.devices for brake in device.brake_files.values())
        devices = any(is_assumed(device.file.provenance) for device in self.devices)
        return tuple(itertools.compress(("device", "brakes", "paths"), (devices, brakes, self.paths_assumed)))

    @property
    def assumed(self) -> bool:
        """Whether a device, a brake or a path has assumed numbers."""
        return bool(self.assumed_of)

    @property
    def low_gain(self) -> float | None:
        """The least gain of the proportional controllers, N s/m; None: there are none."""
        number = self.low_gain_controller
        return None if number is None else self.controllers[number].value(GAIN)

    @property
    def low_gain_controller(self) -> int | None:
        """The number of the proportional controller of least gain, if there is one."""
        return _low_gain_controller(self.controllers)

    @property
    def low_gain_unknown(self) -> bool:
        """Whether the low gain follows the rule "no vibration" and has not been found yet."""
        return self.assumptions.low_gain == NO_VIBRATION and "low_gain_found" not in self.overrides

    def refuse_unknown_low_gain(self) -> None:
        """InputError if the low gain is not known."""
        if self.low_gain_unknown:
            raise InputError(
                f"{self.name}: low gain {NO_VIBRATION!r}: phd study and phd sensitivity find the number on simulated "
                "trials; here it must be given in N s/m"
            )

    def note(self) -> str:
        """The note on every figure: protocol, rules and low gain where controllers have them, assumptions."""
        kinds = [preset.kind for preset in self.controllers.values()]
        ruled = "sdof" in kinds or "proportional" in kinds
        parts = [f"{self.rules} rules"] if ruled else []
        if kinds.count("proportional") > 1:
            about = [NO_VIBRATION] if self.assumptions.low_gain == NO_VIBRATION else []
            if kinds == TABLE_I and self.low_gain != PRINTED_LOW_GAIN:
                about.append(f"Table I prints {PRINTED_LOW_GAIN:g}")
            in_brackets = f" ({'; '.join(about)})" if about else ""
            parts.append(f"low gain {self.low_gain:g} N s/m{in_brackets}")
        parts += [words] if (words := self.assumptions.words()) else []
        if self.assumed:
            parts.append(f"{in_words(self.assumed_of)} assumed")
        return f"Protocol {self.name}{': ' if parts else ''}{', '.join(parts)}"

    def controller_name(self, controller: int | str) -> str:
        """The name of a controller; a code stays as it is."""
        return controller if isinstance(controller, str) else self.controllers[controller].name

    def refuse_stranger(self, participant: str) -> None:
        """InputError if the protocol names its participants and this is none of them."""
        if self.participants and participant not in self.participants:
            raise InputError(
                f"participant {participant}: is none of the {self.name} protocol's ({', '.join(self.participants)})"
            )

    def refuse_answers(self, form: Mapping[str, str | float]) -> None:
        """InputError if the protocol does not ask for an answer of this form."""
        for name, answer in form.items():
            kind = self.form.get(name)
            if kind is None:
                raise InputError(f"form: the {self.name} protocol does not ask for {name!r}")
            if isinstance(answer, str) != (kind != NUMBER) or (not isinstance(kind, str) and answer not in kind):
                wanted = f"a {kind}" if isinstance(kind, str) else f"one of {', '.join(kind)}"
                raise InputError(f"form: {name} must be {wanted}, not {answer!r}")

    def device(self, name: str) -> Device:
        return next(device for device in self.devices if device.name == name)


def label(name: str) -> str:
    """Break the name of a controller into lines that fit under a box."""
    return textwrap.fill(name, 13)


@functools.cache
def shipped_protocols() -> dict[str, str]:
    """The protocols that come with the product, the paper's first: name -> the sentence of its `[about]`."""
    names = sorted(shipped_names(SHIPPED_FOLDER), key=lambda name: (name != PAPER, name))
    texts = {name: read_text(SHIPPED_FOLDER / f"{name}.toml") for name in names}
    return {name: parse_toml(text, ProtocolFile, name).about.sentence for name, text in texts.items()}


def load_protocol(
    name_or_path: str | Path = PAPER, *, devices: Sequence[str | Path | Device] | None = None, **asked: Any
) -> Protocol:
    """A shipped protocol by its name, or a protocol file by its path.

    devices: in place of the file's: shipped names, paths from the current folder, or devices. asked: fields of
    `Overrides`; None: not asked for. InputError, one sentence with file and key, for anything that cannot be run.
    """
    path = shipped_or_file(name_or_path, SHIPPED_FOLDER, Path(), "unknown protocol")
    return read_protocol(read_text(path), path.parent, str(path), devices, **asked)


def read_protocol(
    text: str,
    folder: Path,
    where: str,
    devices: Sequence[str | Path | Device] | None = None,
    to_come: Mapping[str, str] = MappingProxyType({}),
    **asked: Any,
) -> Protocol:
    """A protocol from the text of its file, which stands in `folder`; `where` names it. Else as `load_protocol`.

    to_come: texts of Python files that are not in the folder yet, by name.
    """
    file = parse_toml(text, ProtocolFile, where)
    overrides = {name: value for name, value in asked.items() if value is not None}
    inline = inline_devices(file.device, file.brake, folder, where)
    if devices is None:
        found = [_device(inline.get(name, name), folder, f"{where}: devices") for name in file.devices]
    else:
        asked_for = [inline.get(name, name) if isinstance(name, str) else name for name in devices]
        found = [_device(reference, Path(), "--device") for reference in asked_for]
        overrides["devices"] = [device.name for _, device in found]
    try:
        words = language_text(file.language, folder)
    except InputError as error:
        raise InputError(f"{where}: language: {error}") from None
    drawings = {}
    for place, entry in enumerate(file.path, start=1):
        if isinstance(name := entry.get("file"), str):
            try:
                drawings[name] = read_text(folder / name)
            except InputError as error:
                raise InputError(f"{where}: path {entry.get('number', place)}: {error}") from None
    named = {page.picture for page in file.instruction if page.picture}
    pictures = {name: read_picture(folder / name, f"{where}: instruction: picture") for name in named}
    controllers = {controller.algorithm: None for controller in file.controller if controller.algorithm}
    texts = {name: to_come.get(name) or read_code(folder, name) for name in (*controllers, file.measure) if name}
    code = {name: _own_file(name, text, name in controllers, name == file.measure) for name, text in texts.items()}
    return _checked(file, _Contents(text, words, pictures, drawings, code), found, overrides, where)


def _own_file(name: str, text: str, is_controller: bool, is_measure: bool) -> OwnFile:
    """A file of one's own with what it declares, for which it is run. InputError, one sentence, if it cannot be."""
    check_own_name(name)
    stem = name.removesuffix(".py")
    declared = declared_by(stem, text, declared_algorithm) if is_controller else {}
    return OwnFile(stem, text, json.dumps(declared | (declared_measures(stem, text) if is_measure else {})))


def read_code(folder: Path, name: str) -> str:
    """The text of a Python file that a file in `folder` names: it stands beside that one, or it is shipped."""
    is_shipped = not (folder / name).exists() and (SHIPPED_FOLDER / name).exists()
    return read_own_text(SHIPPED_FOLDER if is_shipped else folder, name)


def is_shipped_code(name: str, text: str) -> bool:
    """Whether this is a file that comes with the program."""
    return name in {path.name for path in SHIPPED_FOLDER.glob("*.py")} and read_text(SHIPPED_FOLDER / name) == text


def read_picture(path: Path, where: str) -> bytes:
    """A PNG or JPEG file in full. InputError: it is none, no regular file, or larger than `MOST_PICTURE_BYTES`."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # a device never ends, a pipe may never begin
            raise InputError(f"{where}: {path}: is no regular file")
        with path.open("rb") as file:
            content = file.read(MOST_PICTURE_BYTES + 1)
    except OSError as error:
        raise InputError(f"{where}: {path}: {(error.strerror or str(error)).lower()}") from None
    except ValueError:  # a character that no path has
        raise InputError(f"{where}: the path is not valid") from None
    if len(content) > MOST_PICTURE_BYTES:
        raise InputError(f"{where}: {path}: is larger than {MOST_PICTURE_BYTES / 1e6:g} MB")
    if not content.startswith(PICTURE_STARTS):
        raise InputError(f"{where}: {path}: is neither PNG nor JPEG")
    return content


def _device(reference: str | Path | Device, folder: Path, where: str) -> tuple[str, Device]:
    """The name of a device for a refusal (its file, if it has one), and the device."""
    if isinstance(reference, Device):
        return f"device {reference.name}", reference
    device = load_device(reference, folder, f"{where}: unknown device")
    path = folder / reference
    return str(path) if os.path.isfile(path) and device.name != str(reference) else f"device {device.name}", device


class _Contents(NamedTuple):
    """Files in full."""

    text: str  # of the protocol
    language: str
    pictures: dict[str, bytes]
    drawings: dict[str, str]
    code: dict[str, OwnFile]


def _checked(
    file: ProtocolFile, contents: _Contents, devices: Sequence[tuple[str, Device]], overrides: Mapping[str, Any],
    where: str,
) -> Protocol:  # fmt: skip
    """The protocol of a file with these devices (each with the name for refusals). InputError as above."""
    asked = from_plain(dict(overrides), Overrides, f"{where}: options")
    where_named = "--device" if "devices" in overrides else f"{where}: devices"
    _refuse_duplicates([device.name for _, device in devices], f"{where_named}: two devices")
    presets = [_preset(controller, contents.code, where) for controller in file.controller]
    _refuse_duplicates([preset.name for preset in presets], f"{where}: controller: two controllers")
    numbers = [controller.number for controller in file.controller]
    controllers = _numbered(numbers, presets, f"{where}: controller")
    assumptions = asked.assumptions or file.assumptions
    given = {name: value for name in ("low_gain", "sensing") if (value := getattr(asked, name)) is not None}
    assumptions = msgspec.structs.replace(assumptions, **given)
    controllers = _assumed(controllers, assumptions, asked.low_gain_found, where)
    if assumptions.sensing == ENCODERS:
        for _, device in devices:
            encoder_counts(device)
    for preset in controllers.values():
        if preset.kind == REFLECT and not (file.slave or preset.value(WALL_N_M.name)):
            raise InputError(f"{where}: controller {preset.name}: needs a [slave] or wall_N_m, it has no force to show")
    paths, drawn = _paths(file.path, contents.drawings, where)
    cells = len(devices) * len(paths) * len(controllers)
    if (trials := cells * file.blocks * file.repetitions) > MOST_TRIALS:
        raise InputError(
            f"{where}: blocks, repetitions: a participant can have at most {MOST_TRIALS} trials, not {trials} "
            f"({cells} of device, path and controller, {file.blocks} blocks, {file.repetitions} repetitions)"
        )
    check_reach(devices, paths, where)
    read_language(contents.language, f"{where}: language")
    settings = {name: getattr(file, name) for name in Settings.__struct_fields__}
    settings |= {name: getattr(asked, name) for name in ("rules", "seed") if name in overrides}
    release = file.release if file.release.on else None
    settings["assumptions"] = assumptions
    settings["trial"] = TrialRules(
        **msgspec.structs.asdict(file.trial), release=release, assumptions=assumptions, slave=file.slave,
        around=_around(file, devices, paths, where),
    )  # fmt: skip
    return Protocol(
        text=contents.text, overrides=dict(overrides), devices=tuple(device for _, device in devices), paths=paths,
        drawn=drawn, drawings=contents.drawings, code=contents.code, controllers=controllers,
        language_text=contents.language, pictures=contents.pictures, **settings,
    )  # fmt: skip


def _preset(controller: ControllerFile, code: Mapping[str, OwnFile], where: str) -> Preset:
    try:
        return controller.preset(code)
    except ValueError as error:
        raise InputError(f"{where}: controller {controller.name}: {error}") from None


def _around(
    file: ProtocolFile, devices: Sequence[tuple[str, Device]], paths: Mapping[int, PathFile], where: str
) -> Around:
    """The obstacles. InputError if they are too many, hold an end of a path, or are guarded by brakes too weak."""
    try:
        edges = build_obstacles(file.obstacle)
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    around = Around(obstacles=file.obstacle, guide=file.guide, guard=file.guard)
    for number, path in paths.items():
        points = outline(path, REACH_SPACING_M)
        for end, (x, y) in (("starts", points[0]), ("ends", points[-1])):
            if nearest_obstacle(edges, len(edges), x, y).distance <= 0.0:
                raise InputError(f"{where}: path {number} {end} in an obstacle")
        for name, device in devices:
            some, on_path = points[:: max(len(points) // 8, 1)], f"on path {number}"
            if reason := why_no_guard(around, name, device, some, on_path):
                raise InputError(f"{where}: guard: {reason}")
            if around.guard and locks_at_rest(around, device, tuple(points[0])):
                raise InputError(
                    f"{where}: guard: {name} would be locked at the start of path {number}: from rest a hand of "
                    f"{around.guard.push_N:g} N could bring it into an obstacle before a lock holds; a smaller push_N "
                    "or fewer turns need less room"
                )
    return around


def _refuse_duplicates(names: Sequence[str], clash: str) -> None:
    if len(set(names)) < len(names):
        raise InputError(f"{clash} have the same name ({', '.join(names)})")


def _numbered(numbers: Iterable[int | None], entries: Iterable[T], where: str) -> dict[int, T]:
    """The entries of a list by rising number: their own, or their place in the list where they have none."""
    found: dict[int, T] = {}
    for place, (own, entry) in enumerate(zip(numbers, entries, strict=True), start=1):
        number = place if own is None else own
        if number in found:
            raise InputError(f"{where}: number {number} is used twice")
        found[number] = entry
    return dict(sorted(found.items()))


def _paths(
    entries: Sequence[dict[str, Any]], drawings: Mapping[str, str], where: str
) -> tuple[dict[int, PathFile], dict[int, str]]:
    """The paths by number, each of which can be followed; and how each drawing among them was read, in words."""
    own = [
        from_plain(entry.get("number"), Count | None, f"{where}: path {place}: number")
        for place, entry in enumerate(entries, start=1)
    ]
    paths, drawn = {}, dict[int, str]()
    for number, entry in _numbered(own, entries, f"{where}: path").items():
        about = {key: value for key, value in entry.items() if key != "number"}
        paths[number], words = read_path(about, drawings.__getitem__, f"{where}: path {number}")
        drawn |= {number: words} if words else {}
        build_path(paths[number], f"{where}: path {number}")
    return paths, drawn


def _assumed(
    controllers: dict[int, Preset], assumptions: Assumptions, found: float | None, where: str
) -> dict[int, Preset]:
    """The controllers under the assumptions; found: the low gain (N s/m) of the rule "no vibration"."""
    controllers = {number: assumptions.controller(preset) for number, preset in controllers.items()}
    gain = assumptions.low_gain
    if gain is None:
        return controllers
    least = _low_gain_controller(controllers)
    if least is None:
        raise InputError(f"{where}: controller: none is proportional, there is no low gain to set")
    number = found if gain == NO_VIBRATION else float(gain)
    return controllers if number is None else {**controllers, least: controllers[least].replaced(gain_N_s_m=number)}


def _low_gain_controller(controllers: Mapping[int, Preset]) -> int | None:
    with_gain = [number for number, preset in controllers.items() if GAIN in preset.named]
    return min(with_gain, key=lambda number: controllers[number].value(GAIN), default=None)


def check_reach(devices: Iterable[tuple[str, Device]], paths: Mapping[int, PathFile], where: str) -> None:
    """InputError if a device (given with its name for the refusal) would hit a stop on a path."""
    for named, device in devices:
        for number, path in paths.items():
            places = outline(path, REACH_SPACING_M)
            free = tip_is_free(device.mechanism, places[:, 0], places[:, 1])
            if not free.all():
                x, y = places[int(free.argmin())]
                tips = free_tips(device.mechanism)
                (x_low, y_low), (x_high, y_high) = tips.min(axis=0), tips.max(axis=0)
                raise InputError(
                    f"{named}: cannot follow path {number} of {where}, which leaves its workspace at "
                    f"({x:.3f}, {y:.3f}) m (of x {x_low:.3f} to {x_high:.3f} m, y {y_low:.3f} to {y_high:.3f} m)"
                )


def presets_of(protocol: Protocol) -> list[Preset]:
    """The controllers of the protocol's file, without assumptions and options."""
    file = parse_toml(protocol.text, ProtocolFile, protocol.name)
    return [controller.preset(protocol.code) for controller in file.controller]


def protocol_to_json(protocol: Protocol) -> dict[str, Any]:
    """A protocol as plain dictionaries: its text, the options, its devices."""
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
        **({"language": protocol.language_text} if protocol.language not in shipped_languages() else {}),
        **({"drawings": protocol.drawings} if protocol.drawings else {}),
        **({"code": {name: own.text for name, own in protocol.code.items()}} if protocol.code else {}),
        **({"declared": {name: own.declared for name, own in protocol.code.items()}} if protocol.code else {}),
        **({"pictures": {k: b64encode(v).decode() for k, v in protocol.pictures.items()}} if protocol.pictures else {}),
    }


def protocol_from_json(about: Mapping[str, Any], where: str) -> Protocol:
    """A stored protocol; no file of its own is run. InputError, or KeyError and TypeError if something is missing."""
    file = parse_toml(about["text"], ProtocolFile, f"{where}: protocol")
    devices = []
    for stored in about["devices"]:
        named = f"{where}: devices.{stored['name']}"
        devices.append((named, build_device(stored["file"], stored["brakes"], named, stored.get("calibration"))))
    words = about.get("language") or language_text(file.language, Path())
    pictures = {name: b64decode(content) for name, content in about.get("pictures", {}).items()}
    code = {
        name: OwnFile(name.removesuffix(".py"), text, about["declared"][name])
        for name, text in about.get("code", {}).items()
    }
    for name, own in code.items():
        check_own_name(name)
        if is_shipped_code(name, own.text):
            allow(own.text)
    contents = _Contents(about["text"], words, pictures, about.get("drawings", {}), code)
    return _checked(file, contents, devices, about["overrides"], f"{where}: protocol")


def home_of(device: Device, paths: Mapping[int, PathFile]) -> tuple[float, float]:
    """Where the jig holds the handle, m; the middle of the first path where the device file has none."""
    if device.sensing is not None and device.sensing.home_m is not None:
        return device.sensing.home_m
    return middle_of_first(paths)


def middle_of_first(paths: Mapping[int, PathFile]) -> tuple[float, float]:
    """The middle of the first path, m: where a simulated device is switched on."""
    return middle_of(build_path(next(iter(paths.values())), "path"))


def middle_of(path: PathAhead) -> tuple[float, float]:
    """The middle of a path, m."""
    x, y, _, _ = point_at(path, 0.5 * path.length)
    return float(x), float(y)
