"""The five colours of controllers, on screen and on paper; four of them are those of joints and of lines.

Found by a search: any two on one ground are at least 15 units of CAM02-UCS apart, for normal sight and as protanopes,
deuteranopes and tritanopes see them (Machado et al. 2009, severity 100 %), and each has a contrast of 3 or more with
what is behind it (`tests/experiments/test_colours.py`).
"""

from typing import NamedTuple


class Colours(NamedTuple):
    """Five that are told apart on one ground, in the order of Table I: none, SDOF, SDOF with gap, high gain, low gain.

    Further controllers begin again from the first.
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
