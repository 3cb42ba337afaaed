"""`python hardware/firmware/pin_map.py`: the pin map of the NUCLEO-F446RE as a Markdown table, from the firmware's own
table (stm32f4/pins.h); README.md beside it ends with it.
"""

import re
from pathlib import Path

TABLE = Path(__file__).parent / "stm32f4" / "pins.h"
_PIN = re.compile(r'PIN\((\w+), (\w), (\d+), \w+, \d+, \w+, "(CN\d+-\d+)", "([^"]+)"\)')


def rows() -> list[tuple[str, str, str, str]]:
    """Name, pin, place, and what it is wired to, of each pin in order."""
    found = _PIN.findall(TABLE.read_text(encoding="utf-8"))
    return [(name, f"P{port}{number}", place, wired) for name, port, number, place, wired in found]


def table() -> str:
    """The rows in Markdown."""
    lines = ["| pin | on the Nucleo | wired to |", "|---|---|---|"]
    lines += [f"| {pin} | {place} | {wired} |" for _, pin, place, wired in rows()]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(table(), end="")
