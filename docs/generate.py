"""`python docs/generate.py`: writes what the pages have from the program's own declarations.

A part stands between two comments, `<!-- NAME -->` and `<!-- end -->`. `tests/app/test_pages.py` holds each to what the
program declares now.
"""

import argparse
import inspect
import json
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from struct import calcsize
from typing import Any, NamedTuple, get_args, get_origin

import msgspec

import phd
from app.cli import make_parser
from core.brake import torque_gain
from core.cobot import CobotFile
from core.control.controllers import PARAMETERS
from core.device import load_device
from core.device_file import BrakeFile, DeviceFile
from core.files import Table, shipped_names, table_in
from experiments.analysis.metrics import JUDGED, METRICS
from experiments.analysis.statistics import STATISTICS
from experiments.analysis.trials_table import STATUSES
from experiments.numbers import fixed
from experiments.protocol_file import ProtocolFile
from experiments.sensitivity.ranges import RangesFile
from experiments.simulate.cobot_scene import CobotSceneFile
from experiments.simulate.scene import SceneFile
from experiments.study.sweep import SweepFile
from experiments.trial.operator import Person
from experiments.trial.population import PopulationFile, Spread
from hardware.wire.messages import LAYOUTS, SAMPLE_HEAD, SAMPLE_TYPE, Hello, Sample

DOCS = Path(__file__).resolve().parent
SHIPPED = (
    ("device", "core/devices"),
    ("brake", "core/brake_files"),
    ("protocol", "experiments/protocols"),
    ("population", "experiments/trial/populations"),
    ("scene", "experiments/scenes"),
    ("cobot", "core/cobots"),
    ("sweep", "experiments/sweeps"),
    ("ranges", "experiments/sensitivity/ranges"),
)
#: Names of `phd` that a line explains.
IN_A_LINE = ("Device", "InputError", "load_device")
FIELD = re.compile(r"^    (\w+): [^#\n]+# (.*)$", re.MULTILINE)
ABOVE = re.compile(r"^    #: (.*)\n    (\w+): ", re.MULTILINE)
#: Kind of file -> its keys.
KINDS = {
    "protocol": ProtocolFile, "device": DeviceFile, "brake": BrakeFile, "cobot": CobotFile, "scene": SceneFile,
    "cobot_scene": CobotSceneFile, "sweep": SweepFile, "ranges": RangesFile, "population": PopulationFile,
}  # fmt: skip
#: Code of a number on the wire -> its type.
CODES = {"B": "u8", "H": "u16", "I": "u32", "Q": "u64", "h": "i16", "i": "i32"}
PART = re.compile(r"<!-- (\w+) -->\n(.*?)<!-- end -->\n", re.DOTALL)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def statuses() -> str:
    """How a trial can end."""
    return table(("status", "how the trial ended"), [(f"`{name}`", words) for name, words in STATUSES.items()])


def measures() -> str:
    """The measures that reports show. An arrow says which way is better."""
    arrows = {"lower": "↓", "higher": "↑"}
    shown = [one for one in METRICS if one in JUDGED]
    rows = [(f"`{one.name}`", one.unit, arrows[one.better], one.meaning) for one in shown]
    found = table(("measure", "unit", "better", "what"), rows)
    return f"{found}\n`columns.json` of `phd export --csv` explains the other {len(METRICS) - len(shown)}.\n"


def statistics() -> str:
    """What each number of statistics.csv is."""
    return table(("statistic", "value"), [(f"`{name}`", meaning) for name, meaning in STATISTICS.items()])


def verbs() -> str:
    """What `phd VERB --help` says of each verb, and of each of its options in a line."""
    (verbs,) = [action for action in make_parser()._actions if isinstance(action, argparse._SubParsersAction)]
    return "\n".join(verb(str(one.help), verbs.choices[one.dest]) for one in verbs._choices_actions)


def verb(summary: str, parser: argparse.ArgumentParser) -> str:
    """A verb, how it is called at least, and its options."""
    options = [one for one in parser._actions if one.dest != "help"]
    least = [words_of(one) for one in options if one.required or not one.option_strings]
    if any(one.dest == "json" for one in options):
        least.append("[--json]")
    lines = [f"- `{words_of(one)}`: {one.help}\n" for one in options if one.option_strings and one.dest != "json"]
    text = f"### {parser.prog}\n\n`{' '.join((parser.prog, *least))}`: {summary}.\n"
    return text + ("\n" + "".join(lines) if lines else "")


def words_of(option: argparse.Action) -> str:
    """An option with its value, as one types them."""
    values = argparse.HelpFormatter("")._format_args(option, option.dest)
    return f"{', '.join(option.option_strings)} {values}".strip()


def python() -> str:
    """The door for Python: each name, how it is called, and its docstring."""
    rows = [(f"`{name}`", inspect.cleandoc(getattr(phd, name).__doc__).splitlines()[0]) for name in IN_A_LINE]
    names = [name for name in phd.__all__ if name not in IN_A_LINE]
    return "\n".join(described(name, getattr(phd, name)) for name in names) + "\n" + table(("name", "what"), rows)


def messages() -> str:
    """Each message of the board's protocol: its type, its length and its fields; the long ones have tables."""
    rows = []
    for number, (kind, layout) in LAYOUTS.items():
        fields = [f"{code} {name}: {what}" for _, code, name, what in fields_of(kind, layout)]
        told = "; ".join(fields) if len(fields) < 6 else "below"
        rows.append((number, kind.__name__, str(1 + calcsize(f"<{layout}")), told))
    rows.append((SAMPLE_TYPE, "Sample", "23 + 4 e + 4 f + 2 b", "below"))
    return table(("type", "message", "bytes", "fields"), [(f"0x{number:02X}", *rest) for number, *rest in sorted(rows)])


def hello() -> str:
    """The fields of a Hello."""
    return fields_table(fields_of(Hello, dict(LAYOUTS.values())[Hello]))


def sample() -> str:
    """The fields of a Sample: the last three are as long as the board's Hello says."""
    rows = fields_of(Sample, f"{SAMPLE_HEAD} ei fi bh")
    return fields_table([*rows[:-2], *(("", *rest) for _, *rest in rows[-2:])])


def fields_table(rows: Sequence[tuple[str, ...]]) -> str:
    """Fields in Markdown, after the byte of the type."""
    return table(("offset", "field", "what"), [(at, f"{code} {name}", what) for at, code, name, what in rows])


def fields_of(kind: type, layout: str) -> list[tuple[str, str, str, str]]:
    """Offset, type, name and meaning of each field of a message."""
    said, rows, at = dict(FIELD.findall(inspect.getsource(kind))), [], 1
    for name, code in zip(kind._fields, layout.split(), strict=True):
        times = code[:-1]
        word = f"{times} bytes" if code[-1] == "s" else f"`{CODES[code[-1]]}`{f' x {times}' if times else ''}"
        rows.append((str(at), word, name, said[name]))
        at += calcsize(f"<{code}") if not times or times.isdecimal() else 0
    return rows


def shipped() -> str:
    """The names of the files that come with the program."""
    rows = [(kind, ", ".join(f"`{name}`" for name in shipped_names(DOCS.parent / folder))) for kind, folder in SHIPPED]
    return "".join(f"- {kind}: {names}\n" for kind, names in rows)


def assumed() -> str:
    """What we assume of the paper's devices and of their brake."""
    three, four = column_of("three-brake"), column_of("four-brake")
    same = {what: value for what, value in three.items() if four[what] == value}
    return table(
        ("", "assumed"), [(what, same.get(what, f"{three[what]}; four brakes: {four[what]}")) for what in three]
    )


def column_of(name: str) -> dict[str, str]:
    """The numbers of a device, as people read them, by what they are."""
    device = load_device(name)
    at, mass, brake = device.file.geometry, device.file.mass, device.brake_files["A"]
    gains = [fixed(torque_gain(device.brakes, 0, current), 2) for current in (0.0, 0.2, 0.6, brake.current_max_A)]
    return {
        "distance of the bases": f"{1e3 * (at.base_B_m[0] - at.base_A_m[0]):.0f} mm",
        "links at the bases, at the tip": f"{1e3 * at.L_AE_m:.0f}, {1e3 * at.L_ED_m:.0f} mm",
        "mass of each link; of handle and force sensor": f"{mass.AE.mass_kg:g}; {mass.tip_kg:g} kg",
        "brakes on the elbows E; C": f"{mass.joint_E_kg:g}; {mass.joint_C_kg:g} kg",
        "inertia of a rotor": f"{1e4 * mass.rotor_inertia_kg_m2:g} kg cm²",
        "torque K of a brake at 0 (its drag), 0.2, 0.6, 1 A": f"{', '.join(gains)} N m",
        "time constant of a brake, rising; falling": f"{1e3 * brake.rise.a_avg_s:g}; {1e3 * brake.fall.a_avg_s:g} ms",
        "backlash of a brake": f"{brake.backlash_deg:g}°",
        "encoder counts a turn, at A and B": f"{device.file.sensing.encoders.A:,}",
    }


def keys(kind: type[Table]) -> str:
    """The keys of a file as it has them: its own, then those of each table. Required ones are bold."""
    heads = {field.name: f"[[{field.name}]]" for field in msgspec.structs.fields(kind) if is_array(field.type)}
    groups: dict[str, list[str]] = {"": []}
    for row in rows_of(kind):
        (place, *others) = {name.partition(".")[0] if "." in name else "" for name in row.names}
        head = heads.get(place, f"[{place}]") if place and not others else ""
        names = [name.removeprefix(f"{place}.") if head else heads.get(name, name) for name in row.names]
        defaults = ["none"] if names[0].startswith("[[") and row.defaults == ["[]"] else row.defaults
        groups.setdefault(head, []).append(f"- {with_defaults(names, defaults)}: {row.what}\n")
    parts = ["".join(lines) if not head else f"`{head}`\n\n{''.join(lines)}" for head, lines in groups.items()]
    return "\n".join(parts)


def is_array(kind: Any) -> bool:
    """Whether a key holds tables, so that a file has them as `[[key]]`."""
    found = next((one for one in (kind, *get_args(kind)) if get_origin(one) is tuple), None)
    return found is not None and (table_in(found) is not None or get_origin(get_args(found)[0]) is dict)


def with_defaults(names: Sequence[str], defaults: Sequence[str]) -> str:
    """Keys as a file has them with their defaults, of which there is one, or one each."""
    if defaults == [""]:
        return ", ".join(f"**`{name}`**" for name in names)
    if defaults == ["none"]:
        return ", ".join(f"`{name}`" for name in names)
    if len(defaults) < len(names):
        return f"{', '.join(f'`{name}`' for name in names)} = {defaults[0]}"
    return ", ".join(f"`{name} = {value}`" for name, value in zip(names, defaults, strict=True))


class Row(NamedTuple):
    """Keys that one sentence explains."""

    names: list[str]
    defaults: list[str]  # one where all have the same
    what: str


def rows_of(kind: type[Table], above: str = "") -> list[Row]:
    """The keys of a table, the required ones first; each value of a table inside it, unless that has a comment.

    A key without a comment belongs to the one before. Tables of one kind share their rows.
    """
    said, rows, before = comments(kind), [], None
    built = [name for base in kind.__bases__ if base.__name__.startswith("_") for name in base.__struct_fields__]
    for field in sorted(msgspec.structs.fields(kind), key=lambda one: (one.name in built, not one.required)):
        name, inner = f"{above}{field.name}", table_in(field.type)
        if field.name in said:
            inner = None
        if inner and inner is before:
            more = rows_of(inner, f"{name}.")
            for row, same in zip(rows[-len(more) :], more, strict=True):
                row.names.extend(same.names)
        elif inner:
            rows += rows_of(inner, f"{name}.")
        elif field.name in said or not rows:
            rows.append(Row([name], [default(field)], said[field.name]))
        else:
            rows[-1].names.append(name)
            if [default(field)] != rows[-1].defaults:
                rows[-1].defaults.append(default(field))
        before = inner
    return rows


def comments(kind: type[Table]) -> dict[str, str]:
    """Field -> its comment, behind it or above it with `#:`, of a table and those that it is made of."""
    found = {name: f"{parameter.word} of a built-in controller" for name, parameter in PARAMETERS.items()}
    if kind is PopulationFile:
        found = dict(FIELD.findall(inspect.getsource(Person)))
    for one in reversed(kind.__mro__):
        if one.__module__.partition(".")[0] in ("core", "experiments") and not one.__name__.startswith("_"):
            source = inspect.getsource(one)
            found |= {name: words for words, name in ABOVE.findall(source)} | dict(FIELD.findall(source))
    return found


def default(field: msgspec.structs.FieldInfo) -> str:
    """A key's default as a file has it; "" where it is required."""
    value = field.default if field.default_factory is msgspec.NODEFAULT else field.default_factory()
    if value is msgspec.NODEFAULT:
        return ""
    if isinstance(value, Spread):
        value = value.value
    return "none" if value is None else json.dumps({} if isinstance(value, Table) else value)


def described(name: str, found: Any) -> str:
    """A function; a class with its methods; a named tuple with its fields."""
    is_tuple = inspect.isclass(found) and issubclass(found, tuple)
    call = "" if is_tuple else f"`phd.{call_of(name, found)}`\n\n"
    text = f"### {name}\n\n{call}{inspect.cleandoc(found.__doc__)}\n"
    if not inspect.isclass(found):
        return text
    if is_tuple:
        said = dict(FIELD.findall(inspect.getsource(found)))
        return text + "\n" + "".join(f"- `{field}`: {said[field]}\n" for field in found._fields)
    if given := inspect.getdoc(found.__init__):
        text += f"\n{given}\n"
    members = [(member, value) for member, value in vars(found).items() if not member.startswith("_")]
    shown = [(member, value) for member, value in members if callable(value) or isinstance(value, property)]
    rows = [
        (
            f"`{member if isinstance(value, property) else call_of(member, value)}`",
            " ".join(inspect.getdoc(value).split()),
        )
        for member, value in shown
    ]
    return text + ("\n" + table(("member", "what"), rows) if rows else "")


def call_of(name: str, found: Callable) -> str:
    """How a function is called, without types."""
    given = [one.replace(annotation=one.empty) for one in inspect.signature(found).parameters.values()]
    words = ", ".join(str(one) for one in given if one.name != "self").replace("'", '"')
    return f"{name}({words})"


PARTS: dict[str, Callable[[], str]] = {
    "statuses": statuses,
    "measures": measures,
    "statistics": statistics,
    "verbs": verbs,
    "assumed": assumed,
    "messages": messages,
    "hello": hello,
    "sample": sample,
    "shipped": shipped,
    "python": python,
    **{f"{name}_keys": partial(keys, kind) for name, kind in KINDS.items()},
}


def generated(page: str) -> str:
    """A page with its parts as the program has them now."""
    return PART.sub(lambda part: f"<!-- {part[1]} -->\n\n{PARTS[part[1]]()}\n<!-- end -->\n", page)


if __name__ == "__main__":
    for file in DOCS.glob("*.md"):
        before = file.read_text(encoding="utf-8")
        if before != (after := generated(before)):
            file.write_text(after, encoding="utf-8")
            print(file.name)
