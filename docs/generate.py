"""`python docs/generate.py`: writes what the pages have from the program's own declarations.

A part stands between two comments, `<!-- NAME -->` and `<!-- end -->`. `tests/app/test_pages.py` holds each to what the
program declares now.
"""

import argparse
import inspect
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import phd
from app.cli import make_parser
from experiments.analysis.metrics import METRICS
from experiments.analysis.trials_table import STATUSES

DOCS = Path(__file__).resolve().parent
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
    parts = []
    for name in phd.__all__:
        found = getattr(phd, name)
        if found.__module__ == phd.__name__:
            text = inspect.cleandoc(found.__doc__)
            parts.append(f"### {name}\n\n```python\n{call_of(found)}\n```\n\n{text}\n")
    others = [name for name in phd.__all__ if getattr(phd, name).__module__ != phd.__name__]
    rows = [(f"`{name}`", inspect.cleandoc(getattr(phd, name).__doc__).splitlines()[0]) for name in others]
    return "\n".join(parts) + "\n### Others\n\n" + table(("name", "what"), rows)


def call_of(found: Callable) -> str:
    """How a function is called, without types."""
    given = inspect.signature(found).parameters.values()
    words = ", ".join(str(one.replace(annotation=one.empty)) for one in given).replace("'", '"')
    return f"phd.{found.__name__}({words})"


PARTS: dict[str, Callable[[], str]] = {"statuses": statuses, "measures": measures, "verbs": verbs, "python": python}


def generated(page: str) -> str:
    """A page with its parts as the program has them now."""
    return PART.sub(lambda part: f"<!-- {part[1]} -->\n\n{PARTS[part[1]]()}\n<!-- end -->\n", page)


if __name__ == "__main__":
    for file in DOCS.glob("*.md"):
        before = file.read_text(encoding="utf-8")
        if before != (after := generated(before)):
            file.write_text(after, encoding="utf-8")
            print(file.name)
