"""Parts that are added to a protocol's text: what each is called in the menu, and its commented lines."""

import re
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


#: In the order of the menu, in groups.
PARTS = (
    (
        Part(
            "a segment",
            """\
[[path]]
kind = "segment"                # straight from start to end
start_m = [-0.10, 0.35]         # x, y, in metres from the middle between the two base joints
end_m = [0.10, 0.35]
""",
        ),
        Part(
            "a polyline",
            """\
[[path]]
kind = "polyline"               # straight from point to point, at least two
points_m = [[-0.09, 0.32], [0.00, 0.36], [0.09, 0.32]]   # x, y, in metres
""",
        ),
        Part(
            "an arc",
            """\
[[path]]
kind = "arc"                    # counter-clockwise where to_deg is greater than from_deg
centre_m = [0.00, 0.30]
radius_m = 0.10
from_deg = 150.0                # 0 is to the right, 90 away from the person
to_deg = 30.0
""",
        ),
    ),
    (
        Part(
            "SDOF control",
            """\
[[controller]]
name = "SDOF {n}"               # in tables and figures
kind = "sdof"                   # one brake allows the motion along the path
gap_m = 0.005                   # half the width of the band along the path without control; 0: none
""",
        ),
        Part(
            "proportional control",
            """\
[[controller]]
name = "Proportional {n}"       # in tables and figures
kind = "proportional"           # the force grows with the velocity that is not wanted
gain_N_s_m = 500.0              # so many newtons for 1 m/s
gap_m = 0.0                     # half the width of the band along the path without control
""",
        ),
    ),
    (
        Part(
            "practice trials",
            """\
practice_trials = 2             # before each device; they are recorded, and not counted
""",
        ),
        Part(
            "breaks",
            """\
[breaks]
after_trials = 12               # of a device
least_s = 60.0                  # the next trial waits so long at least
""",
        ),
        Part(
            "a longest movement",
            """\
[trial]
time_out_s = 30.0               # a movement ends after so long
hold_s = 0.5                    # at the start, before "go"
""",
        ),
        Part(
            "words for too fast and too slow",
            """\
[cues]
too_fast_s = 1.5                # after a shorter movement the participant reads "slower",
too_slow_s = 6.0                # after a longer one "faster"
""",
        ),
    ),
    (
        Part(
            "a page of instructions",
            """\
[[instruction]]
text = "Take the handle. Follow the line as exactly as you can, at a speed of your own."
""",
        ),
        Part(
            "consent",
            """\
[consent]                       # asked of each participant before anything else; no signature is kept
text = "Your movements are recorded under a number. You may stop at any time."
""",
        ),
        Part(
            "questions about the participant",
            """\
[form]                          # asked when a session is opened
handedness = ["left", "right"]  # one of these,
age = "number"                  # a number,
experience = "text"             # or any text
""",
        ),
        Part(
            "a questionnaire",
            """\
[questionnaire]
on = true
each = "block"                  # after each block; "controller": after a controller's last trial on a device
""",
        ),
    ),
)


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
