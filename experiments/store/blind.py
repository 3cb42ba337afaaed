"""Blind sessions: the controllers stand as codes, K1, K2, .., everywhere but in the key.

The key is drawn from the system's randomness, so neither seed nor plan gives it away, and stands in a table of its own
in the session's database (`blind_key`), where nobody meets it who looks for something else.
While a session is blind its plan, journal, table and the metadata of its recordings hold codes, and the table leaves
out what reveals a controller by itself. The ticks of a recording hold currents and decisions: they reveal it to a
reader.
"""

import secrets
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TypeVar

from experiments.analysis.metrics import METRICS
from experiments.analysis.trials_table import TrialRow
from experiments.plan import PlannedTrial, codes

Coded = TypeVar("Coded", PlannedTrial, TrialRow)


def new_key(controllers: Iterable[int]) -> dict[str, int]:
    """Draw which code stands for which controller."""
    shuffled = list(controllers)
    secrets.SystemRandom().shuffle(shuffled)
    return dict(zip(codes(len(shuffled)), shuffled, strict=True))


def unblinded(thing: Coded, key: Mapping[str, int]) -> Coded:
    """A planned trial or row with its controller in place of the code; unchanged if the key lacks the code.

    A row then has no controller name: the key has none (`trials_table.with_name`).
    """
    number = key.get(str(thing.controller), thing.controller)
    if number == thing.controller:
        return thing
    if isinstance(thing, TrialRow):
        return replace(thing, controller=number, controller_name=None)
    return thing._replace(controller=number)


def blinded(row: TrialRow) -> TrialRow:
    """A coded row without what reveals its controller."""
    return replace(without_telltales(row), controller_name=str(row.controller))


def without_telltales(row: TrialRow) -> TrialRow:
    """A row without the measures that may reveal its controller: some shipped ones, and all of an own file."""
    telltale = {metric.name for metric in METRICS if metric.tells_controller} | row.own.keys()
    return replace(row, measures={name: value for name, value in row.measures.items() if name not in telltale})
