"""The five colours of controllers, on screen and on paper; four of them are those of joints and of lines.

Found by a search: any two on one ground are at least 15 units of CAM02-UCS apart, for normal sight and as protanopes,
deuteranopes and tritanopes see them (Machado et al. 2009, severity 100 %), and each has a contrast of 3 or more with
what is behind it (`tests/experiments/test_colours.py`).
"""

from collections.abc import Mapping
from typing import NamedTuple

from core.control.controllers import Preset


class Colours(NamedTuple):
    """Five that are told apart on one ground, in the order of Table I: none, SDOF, SDOF with gap, high gain, low gain.

    Further controllers take what the others leave, then begin again behind the first.
    """

    grey: str
    orange: str
    warm: str  # brown on white, yellow on black
    blue: str
    pale: str

    @property
    def joints(self) -> tuple[str, str, str, str]:
        """Colours of the joints A, E, B and C."""
        return self.blue, self.orange, self.warm, self.pale


ON_LIGHT = Colours("#84898f", "#d17312", "#8c3a08", "#2c479c", "#3a90d2")  # and on paper
ON_DARK = Colours("#9aa1ab", "#ee6a2a", "#f5df5e", "#5b84f5", "#93e4f4")
#: Algorithm -> its places in `Colours`, for the first of the protocol, the second, ..
PLACES = {"none": (0,), "sdof": (1, 2), "proportional": (3, 4)}


def colour_places(controllers: Mapping[int, Preset]) -> dict[int | str, int]:
    """Number -> the place of its colour, by its algorithm and its place in the protocol."""
    wanted = {kind: list(places) for kind, places in PLACES.items()}
    found: dict[int | str, int] = {}
    for number, preset in controllers.items():
        if own := wanted.get(preset.kind):
            found[number] = own.pop(0)
    left = [place for place in range(1, len(ON_LIGHT)) if place not in found.values()]
    others = [number for number in controllers if number not in found]
    for at, number in enumerate(others):
        found[number] = left[at] if at < len(left) else 1 + (at - len(left)) % (len(ON_LIGHT) - 1)
    return found
