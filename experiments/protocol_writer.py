"""Writes protocol files: TOML that `experiments.protocol` reads, and paths from the points that draw them."""

import cmath
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from core.files import InputError, Pair
from core.path import Polyline, Segment, path_from
from experiments.protocol import read_protocol
from experiments.recording.atomic_files import reason_of, write_new_file, written_beside

#: kind of path -> how many points draw it; a polyline takes any number from two on
POINTS = {"segment": 2, "polyline": 2, "arc": 3}
ABOUT = "# A protocol of phd. The shipped experiments/protocols/paper.toml says what each key is.\n"


def protocol_text(content: Mapping[str, Any]) -> str:
    """The TOML text of a protocol that is given as `tomllib` reads it: dictionaries, lists, texts and numbers.

    Keys keep their order, but tables come after plain values. A key whose value is None is left out.
    """
    return ABOUT + "\n".join(_table(content, "")).strip("\n") + "\n"


def save_protocol(path: Path, content: Mapping[str, Any], replacing: bool = False) -> None:
    """Write a protocol file that can be run. InputError, and nothing written, if it cannot, or if the file exists.

    replacing: an existing file is replaced. Devices given by path are looked for from the file's folder.
    """
    text = protocol_text(content)
    read_protocol(text, path.parent, str(path))
    try:
        if replacing:
            with written_beside(path, text.encode()) as partial:
                partial.replace(path)
        else:
            write_new_file(path, text.encode(), sync=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({reason_of(error)})") from None


def _table(content: Mapping[str, Any], name: str) -> list[str]:
    """The lines of a table: its plain values, then the tables and the lists of tables in it."""
    given = {key: value for key, value in content.items() if value is not None}
    nested = {key: value for key, value in given.items() if isinstance(value, Mapping) or _is_list_of_tables(value)}
    lines = [f"{_key(key)} = {_value(value)}" for key, value in given.items() if key not in nested]
    for key, value in nested.items():
        inner = f"{name}.{_key(key)}" if name else _key(key)
        if isinstance(value, Mapping):
            lines += ["", f"[{inner}]", *_table(value, inner)]
        else:
            for entry in value:
                lines += ["", f"[[{inner}]]", *_table(entry, inner)]
    return lines


def _is_list_of_tables(value: Any) -> bool:
    return isinstance(value, list | tuple) and bool(value) and all(isinstance(entry, Mapping) for entry in value)


def _key(key: str) -> str:
    return key if key.isascii() and key.replace("_", "").replace("-", "").isalnum() else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # as TOML writes texts, integers, booleans


def points_of(path: Mapping[str, Any]) -> list[Pair]:
    """The points (m) by which a path, as it stands in a file, is drawn: ends, corners, and the middle of an arc.

    None where it is not a path.
    """
    try:
        found = path_from({key: value for key, value in path.items() if key != "number"}, "path")
    except InputError:
        return []
    if isinstance(found, Segment):
        return [found.start_m, found.end_m]
    if isinstance(found, Polyline):
        return list(found.points_m)
    (x, y), r, first, last = found.centre_m, found.radius_m, found.from_deg, found.to_deg
    angles = (math.radians(angle) for angle in (first, 0.5 * (first + last), last))
    return [(x + r * math.cos(angle), y + r * math.sin(angle)) for angle in angles]


def path_through(kind: str, points: Sequence[Pair]) -> dict[str, Any]:
    """The path of a kind through points (m), as it stands in a file. InputError where there is none."""
    rounded = [[round(x, 6), round(y, 6)] for x, y in points]
    if len(points) < POINTS[kind]:
        raise InputError(f"path: {kind} needs {POINTS[kind]} points")
    if kind == "segment":
        return {"kind": kind, "start_m": rounded[0], "end_m": rounded[-1]}
    if kind == "polyline":
        return {"kind": kind, "points_m": rounded}
    a, b, c = (complex(*point) for point in (points[0], points[1], points[-1]))
    if abs(((c - a) * (b - a).conjugate()).imag) <= 1e-9:
        raise InputError("path: the three points of an arc lie on a line")
    w = (c - a) / (b - a)
    centre = (b - a) * (w - abs(w) ** 2) / (2j * w.imag) + a  # of the circle through a, b, c
    first, via, last = (math.degrees(cmath.phase(point - centre)) for point in (a, b, c))
    turn = (last - first) % 360.0
    if (via - first) % 360.0 > turn:  # clockwise
        turn -= 360.0
    middle, radius = [round(centre.real, 6), round(centre.imag, 6)], round(abs(a - centre), 6)
    return {
        "kind": kind, "centre_m": middle, "radius_m": radius,
        "from_deg": round(first, 3), "to_deg": round(first + turn, 3),
    }  # fmt: skip
