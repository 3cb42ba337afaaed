"""A device from values in place of a file; its text is the file that gives the same device."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from core.device import Device, device_of
from core.files import InputError, toml_text
from core.mechanism import JOINTS

LINKS = ("AE", "ED", "BC", "CD")


def device(
    links_m: Sequence[float],
    bases_m: Sequence[Sequence[float]],
    brakes: Mapping[str, str | Mapping[str, Any]],
    links_kg: Sequence[float] = (0.3, 0.3, 0.3, 0.3),
    tip_kg: float = 0.5,
    **tables: Any,
) -> Device:
    """A device from values. `.text` is its device file, `.brake_texts` its brake files by name.

    links_m, links_kg: of the links AE, ED, BC, CD, uniform rods. bases_m: ((x, y), (x, y)) of A and B.
    brakes: joint ("A", "E", "B", "C") -> shipped brake, brake file, or the keys of a brake file.
    tables: name, provenance, and the tables geometry, mass, limits and sensing of a device file, which override the
    other arguments.
    """
    if unknown := sorted(set(brakes) - set(JOINTS)):
        raise InputError(f"device: brakes: there is no joint {unknown[0]!r}; there are A, E, B, C")
    if len(links_m) != len(LINKS) or len(links_kg) != len(LINKS) or len(bases_m) != 2:
        raise InputError("device: links_m and links_kg must be four numbers (AE, ED, BC, CD), bases_m two places")
    texts: dict[str, str] = {}
    names: dict[str, str] = {}
    for joint, brake in brakes.items():
        names[joint] = brake if isinstance(brake, str) else str(brake.get("name", ""))
        if not isinstance(brake, str):
            if texts.setdefault(names[joint], text := toml_text(brake)) != text:
                raise InputError(f"device: brakes: two different ones have the same name ({names[joint]})")
    lengths = {f"L_{link}_m": float(length) for link, length in zip(LINKS, links_m, strict=True)}
    bases = {f"base_{joint}_m": [float(x) for x in place] for joint, place in zip("AB", bases_m, strict=True)}
    mass = {link: {"mass_kg": float(each)} for link, each in zip(LINKS, links_kg, strict=True)}
    content = {
        "name": "device", "provenance": "assumed", **tables,
        "geometry": {**bases, **lengths, "elbows": "out", **tables.get("geometry", {})},
        "mass": {**mass, "tip_kg": float(tip_kg), **tables.get("mass", {})},
        "brakes": names,
    }  # fmt: skip
    return device_of(toml_text(content), Path(), "device", texts)
