"""What the window and the control loop tell each other, over a pipe between two processes.

The window sends intents (Start, Aim, Abort, Quit), the loop what happened and, about 60 times a second, the ticks.
"""

from typing import NamedTuple

import numpy as np

from experiments.plan import PlannedTrial
from experiments.trials_table import TrialRow

Point = tuple[float, float]  # m

# window -> loop


class Start(NamedTuple):
    """Run the next trial of this participant; the first one creates the session."""

    participant: str


class Aim(NamedTuple):
    """Where the pointer is, m."""

    x: float
    y: float


class Abort(NamedTuple):
    """Stop the trial at once, brakes off."""

    reason: str


class Quit(NamedTuple):
    """Abort what runs, keep it, and end."""

    reason: str


# loop -> window


class Prepared(NamedTuple):
    """The kernels are compiled: trials can start."""


class Begun(NamedTuple):
    """A trial has started, the handle at `tip`."""

    planned: PlannedTrial
    tip: Point


class Proof(NamedTuple):
    """What of the recording is in its file by now."""

    name: str
    rows: int
    bytes: int
    age_s: float  # since the last write


class Ticks(NamedTuple):
    """The ticks since the last message of this kind: (n, row.WIDTH)."""

    rows: np.ndarray
    taken: bool  # the pointer has hold of the handle
    proof: Proof


class Ended(NamedTuple):
    """A trial is over, its recording verified and its row in the tables."""

    row: TrialRow
    reason: str
    next: PlannedTrial | None  # None: that was the last of the plan
    tip: Point  # where the handle stands in the configuration of the next trial


class Refused(NamedTuple):
    """A start that cannot be: why, in a sentence. Nothing has changed."""

    sentence: str


class Failed(NamedTuple):
    """No more trials can be run: why, in a sentence."""

    sentence: str
