"""What the conductor gives the control loop to do, and what the loop answers; over a pipe."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from experiments.trial.trial import Arguments

REAL_TIME, DEFAULT = "real-time", "default"  # what the process is started with: scheduling that it may try

# jobs


class Try(NamedTuple):
    """Keep the deadlines of so many ticks with nothing to do."""

    ticks: int


class Run(NamedTuple):
    """Run this trial now."""

    arguments: "Arguments"


# answers


class Prepared(NamedTuple):
    """Trials can be run."""

    scheduling: str  # what was got, in words
    core: int  # that the loop has for itself; -1: none


class Tried(NamedTuple):
    """How late each tick was."""

    lateness_us: np.ndarray  # (n,)


class Done(NamedTuple):
    """A trial has ended."""

    changed: tuple[np.ndarray, ...]  # see `changed`


def changed(arguments: "Arguments") -> tuple[np.ndarray, ...]:
    """The arrays that running a trial changes."""
    a = arguments
    return a.hand.grips, a.state, a.trial, a.run, a.operator, a.memory
