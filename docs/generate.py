"""`python docs/generate.py`: writes what the pages have from the program's own declarations.

A part stands between two comments, `<!-- NAME -->` and `<!-- end -->`. `tests/app/test_pages.py` holds each to what the
program declares now.
"""

import argparse
import inspect
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import phd
from app.cli import make_parser
from core.brake import torque_gain
from core.device import load_device
from core.files import shipped_names
from experiments.analysis.metrics import METRICS
from experiments.analysis.trials_table import STATUSES
from experiments.numbers import fixed

DOCS = Path(__file__).resolve().parent
SHIPPED = (
    ("device", "core/devices"),
    ("brake", "core/brake_files"),
    ("protocol", "experiments/protocols"),
    ("population", "experiments/trial/populations"),
    ("scene", "experiments/scenes"),
)
#: Names of `phd` that a line explains.
IN_A_LINE = ("Device", "InputError", "load_device")
FIELD = re.compile(r"^    (\w+): [^#\n]+# (.*)$", re.MULTILINE)
PART = re.compile(r"<!-- (\w+) -->\n(.*?)<!-- end -->\n", re.DOTALL)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def statuses() -> str:
    """How a trial can end."""
    return table(("status", "how the trial ended"), [(f"`{name}`", words) for name, words in STATUSES.items()])


def measures() -> str:
    """The measures of a trial. An arrow says which way is better."""
    arrows = {"lower": "↓", "higher": "↑"}
    rows = [(f"`{one.name}`", one.unit, arrows[one.better], one.meaning) for one in METRICS]
    return table(("measure", "unit", "better", "what"), rows)


def verbs() -> str:
    """What `phd --help` says of each verb."""
    (verb,) = [action for action in make_parser()._actions if isinstance(action, argparse._SubParsersAction)]
    return table(("verb", "does"), [(f"`phd {one.dest}`", str(one.help)) for one in verb._choices_actions])


def python() -> str:
    """The door for Python: each name, how it is called, and its docstring."""
    rows = [(f"`{name}`", inspect.cleandoc(getattr(phd, name).__doc__).splitlines()[0]) for name in IN_A_LINE]
    names = [name for name in phd.__all__ if name not in IN_A_LINE]
    return "\n".join(described(name, getattr(phd, name)) for name in names) + "\n" + table(("name", "what"), rows)


def shipped() -> str:
    """The names of the files that come with the program."""
    rows = [(kind, ", ".join(f"`{name}`" for name in shipped_names(DOCS.parent / folder))) for kind, folder in SHIPPED]
    return table(("kind", "shipped names"), rows)


def assumed() -> str:
    """What we assume of the paper's devices and of their brake."""
    three, four = column_of("three-brake"), column_of("four-brake")
    return table(("", "three brakes", "four brakes"), [(what, three[what], four[what]) for what in three])


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


INNER = "\n    "  # of a call that is longer than a line


def described(name: str, found: Any) -> str:
    """A function; a class with its methods; a named tuple with its fields."""
    text = f"### {name}\n\n"
    if not (inspect.isclass(found) and issubclass(found, tuple)):
        call = f"phd.{call_of(name, found)}"
        if len(call) > 120:
            call = f"{call.replace('(', '(' + INNER, 1)[:-1]}\n)"
        text += f"```python\n{call}\n```\n\n"
    text += f"{inspect.cleandoc(found.__doc__)}\n"
    if not inspect.isclass(found):
        return text
    if issubclass(found, tuple):
        said = dict(FIELD.findall(inspect.getsource(found)))
        return text + "\n" + table(("field", "what"), [(f"`{field}`", said.get(field, "")) for field in found._fields])
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
    "verbs": verbs,
    "assumed": assumed,
    "shipped": shipped,
    "python": python,
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
