"""`python hardware/firmware/pin_map.py`: the pin map of the NUCLEO-F446RE as a Markdown table, from the firmware's own
table (stm32f4/pins.h); README.md beside it ends with it.
"""

import re
from pathlib import Path

TABLE = Path(__file__).parent / "stm32f4" / "pins.h"
_PIN = re.compile(r'PIN\((\w+), (\w), (\d+), (\w+), \d+, (\w+), "(CN\d+-\d+)", "([^"]+)"\)')
MODES = {"IN": "input", "OUT": "output", "PERIPHERAL": "of a peripheral", "ANALOG": "analog"}
PULLS = {"NONE": "", "UP": "up", "DOWN": "down"}


def rows() -> list[tuple[str, str, str, str, str, str]]:
    """Name, pin, place, direction, pull inside the chip, and what it is wired to, of each pin in order."""
    text = TABLE.read_text(encoding="utf-8")
    return [
        (name, f"P{port}{number}", place, MODES[mode], PULLS[pull], wired)
        for name, port, number, mode, pull, place, wired in _PIN.findall(text)
    ]


def table() -> str:
    """The rows in Markdown."""
    lines = ["| pin | on the Nucleo | direction | pull | wired to |", "|---|---|---|---|---|"]
    lines += [f"| {pin} | {place} | {mode} | {pull} | {wired} |" for _, pin, place, mode, pull, wired in rows()]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(table(), end="")
