"""Parts that are added to a protocol's text: what each is called in the menu, and its commented lines."""

import re
from pathlib import Path
from typing import NamedTuple


class Part(NamedTuple):
    """Lines of a protocol that go together. {n}: one more than there are such tables."""

    title: str  # in the menu
    text: str  # begins with its table, [name] or [[name]]; or a single key, which stands before all tables

    @property
    def head(self) -> str:
        """What its first line begins with: its table, or its key."""
        return re.match(r"\[*\w+\]*", self.text)[0]  # type: ignore[index]

    @property
    def is_once(self) -> bool:
        """Whether a protocol has it once at most."""
        return not self.head.startswith("[[")


def read_parts(text: str) -> tuple[tuple[Part, ...], ...]:
    """The groups of a text of parts, in which "## " begins a part and an empty "##" another group."""
    groups = (re.findall(r"^## (.+)\n((?:(?!##).*\n)+)", group, re.MULTILINE) for group in text.split("##\n"))
    return tuple(tuple(Part(*part) for part in group) for group in groups)


#: In the order of the menu, in groups.
PARTS = read_parts(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


class Place(NamedTuple):
    """Where in a text something is put: from `begin` to `end` (letters), and what stands there then."""

    begin: int
    end: int
    text: str


def place_of(part: Part, text: str) -> Place:
    """Where a part goes: a table at the end, a key before the first table.

    One that a protocol has once, and that is there already: its own line, unchanged.
    """
    name = re.escape(part.head)
    there = [found for found in re.finditer(rf"^[ \t]*{name}(?![\w]).*$", text, re.MULTILINE)]
    if part.is_once and there:
        return Place(there[0].start(), there[0].end(), there[0].group())
    lines = part.text.replace("{n}", str(len(there) + 1))
    if part.head.startswith("["):
        end = len(text.rstrip())
        return Place(end, len(text), f"\n\n{lines}" if end else lines)
    table = re.search(r"^[ \t]*\[", text, re.MULTILINE)
    begin = table.start() if table else len(text)
    return Place(begin, begin, lines + "\n")
