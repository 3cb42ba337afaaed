"""How far apart colours are, for normal sight and for three kinds of colour blindness."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from colorspacious import cspace_convert

#: Machado et al. 2009, at full severity.
SIGHTS = {"normal": "", "protanopia": "protanomaly", "deuteranopia": "deuteranomaly", "tritanopia": "tritanomaly"}


class Nearest(NamedTuple):
    """The two colours that are nearest to each other."""

    distance: float  # of CAM02-UCS
    one: str
    other: str


def seen(colours: Sequence[str], sight: str) -> np.ndarray:
    """(n, 3) J', a', b' of CAM02-UCS of colours ("#rrggbb") as they are seen."""
    rgb = np.array([[int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)] for colour in colours])
    if SIGHTS[sight]:
        space = {"name": "sRGB1+CVD", "cvd_type": SIGHTS[sight], "severity": 100}
        rgb = np.clip(cspace_convert(rgb, space, "sRGB1"), 0.0, 1.0)  # what a screen would show
    return np.asarray(cspace_convert(rgb, "sRGB1", "CAM02-UCS"))


def nearest(colours: Sequence[str], sight: str) -> Nearest:
    """Of some colours the two that are hardest to tell apart."""
    places = seen(colours, sight)
    pairs = itertools.combinations(range(len(colours)), 2)
    return min(Nearest(float(np.linalg.norm(places[i] - places[j])), colours[i], colours[j]) for i, j in pairs)
