"""The files of a study with other numbers: its devices, its people, its paths."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from math import cos, radians, sin
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt

from core.device import Device, build_device
from core.files import InputError, toml_text
from core.path import Segment, outline
from core.workspace import free_tips, tip_is_free
from experiments.protocol import REACH_SPACING_M
from experiments.trial.operator import Person

LINKS = ("AE", "ED", "BC", "CD")
FROM_LENGTH = ("com_m", "inertia_kg_m2")  # of a link: what a uniform rod has by itself
DECIMALS = 6  # of the ends of a path, m
GRID_M = 5e-3  # of the places among which the middle of the workspaces is found
TRIES = 50  # of a path on its way to the middle, and again on its way to no length


def changed_devices(
    devices: Sequence[Mapping[str, Any]], numbers: Mapping[str, Any], factors: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Stored devices with these numbers, and factors on others, in the files that have them."""
    return [{**device, "file": _changed_device(device["file"], numbers, factors)} for device in devices]


def _changed_device(text: str, numbers: Mapping[str, Any], factors: Mapping[str, Any]) -> str:
    content = tomllib.loads(text)
    for name, value in numbers.items():
        for holder, key in _places(content, name):
            holder[key] = value
    found = [(holder, key, factor) for name, factor in factors.items() for holder, key in _places(content, name)]
    for holder, key, factor in found:
        value = holder[key]
        holder[key] = [factor * number for number in value] if isinstance(value, list) else factor * value
    if found:
        for link in LINKS:
            for key in FROM_LENGTH:
                content["mass"][link].pop(key, None)
    return toml_text(content)


def names_in(text: str, pattern: str) -> list[str]:
    """The numbers of a file whose dotted names match the pattern."""
    return [name for name, _, _ in _numbers(tomllib.loads(text)) if fnmatchcase(name, pattern)]


def _places(content: dict[str, Any], pattern: str) -> list[tuple[dict[str, Any], str]]:
    return [(holder, key) for name, holder, key in _numbers(content) if fnmatchcase(name, pattern)]


def _numbers(content: dict[str, Any], before: str = "") -> Iterator[tuple[str, dict[str, Any], str]]:
    """Every number, or list of numbers, of a file: its dotted name, the table that holds it, its key."""
    for key, value in content.items():
        if isinstance(value, dict):
            yield from _numbers(value, f"{before}{key}.")
        elif isinstance(value, int | float | list) and not isinstance(value, bool):
            yield f"{before}{key}", content, key


def changed_people(text: str, numbers: Mapping[str, Any], factors: Mapping[str, Any]) -> str:
    """A population file with these numbers for everyone, and these factors on others."""
    if not numbers and not factors:
        return text
    content = tomllib.loads(text)
    for key, value in numbers.items():
        content[key] = {"value": value, "source": "assumed: of a sample"}
    for beginning, factor in factors.items():
        names = (name for name in Person._fields if name == beginning or name.startswith(f"{beginning}_"))
        for key in (name for name in names if name in content):
            spread = content[key]
            scaled = {key: float(factor) * number for key, number in spread.items() if key != "source"}
            content[key] = {**scaled, "source": f"assumed: {factor:g} times {spread['source']}"}
    return toml_text(content)


def changed_paths(text: str, devices: Sequence[Mapping[str, Any]], values: Mapping[str, Any]) -> str:
    """A protocol's text whose straight paths lie where the values say, or as near as all devices reach.

    values: by "NUMBER.KEY", as ranges files have them; a key that is missing is as in the text.
    """
    content = tomllib.loads(text)
    built = [build_device(device["file"], device["brakes"], device["name"]) for device in devices]
    middle = _middle(built)
    for place, path in enumerate(content["path"], start=1):
        number = path.get("number", place)
        own = {key.partition(".")[2]: value for key, value in values.items() if key.partition(".")[0] == str(number)}
        if own:
            start, end = np.array(path["start_m"]), np.array(path["end_m"])
            dx, dy = end - start
            asked = {
                "x_m": 0.5 * (start[0] + end[0]),
                "y_m": 0.5 * (start[1] + end[1]),
                "length_m": np.hypot(dx, dy),
                "angle_deg": np.degrees(np.arctan2(dy, dx)),
                **own,
            }
            ends = within_reach(built, asked, middle)
            path["start_m"], path["end_m"] = ends.tolist()
    return toml_text(content)


def within_reach(devices: Sequence[Device], asked: Mapping[str, float], middle: np.ndarray) -> np.ndarray:
    """The ends (2, 2), m, of the straight path that is asked for.

    Where a device does not reach it, the path moves to the middle (m), and is then shortened, until all do.
    """
    at, angle = np.array([asked["x_m"], asked["y_m"]]), radians(asked["angle_deg"])
    half = 0.5 * asked["length_m"] * np.array([cos(angle), sin(angle)])
    ways = [(1.0 - k / TRIES, 1.0) for k in range(TRIES)] + [(0.0, 1.0 - k / TRIES) for k in range(TRIES)]
    for away, length in ways:
        centre = middle + away * (at - middle)
        ends = np.array([centre - length * half, centre + length * half]).round(DECIMALS)
        if all(_free(device, ends) for device in devices):
            return ends
    raise InputError("no straight path in the middle of the workspaces can be reached by all devices")


def _middle(devices: Sequence[Device]) -> np.ndarray:
    """The place (m) that all devices reach and that is farthest from one that some device does not reach."""
    tips = np.vstack([free_tips(device.mechanism) for device in devices])
    low, high = tips.min(axis=0) - GRID_M, tips.max(axis=0) + GRID_M
    x, y = np.meshgrid(*(np.arange(a, b, GRID_M) for a, b in zip(low, high, strict=True)))
    free = np.all([tip_is_free(device.mechanism, x, y) for device in devices], axis=0)
    place = np.unravel_index(np.argmax(distance_transform_edt(free)), free.shape)
    return np.array([x[place], y[place]])


def _free(device: Device, ends: np.ndarray) -> bool:
    """Whether a device follows the straight path between the ends, as its protocol will ask."""
    (start, end) = ends.tolist()
    places = outline(Segment(tuple(start), tuple(end)), REACH_SPACING_M)
    return bool(tip_is_free(device.mechanism, places[:, 0], places[:, 1]).all())
