"""What the conductor gives a control loop with a device on the bench to do besides, and what that answers."""

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:  # else the conductor imports all of numba before it can start the loop
    from core.device import Device
    from core.device_interface import ZeroRecord
    from experiments.trial.linked_trial import LinkedTrial

# jobs


class Connect(NamedTuple):
    """Reach the board of one of these devices, the first that it is wired to."""

    devices: "tuple[Device, ...]"


class HomeAt(NamedTuple):
    """The handle is held at `tip` (m) now: set the encoders."""

    tip: tuple[float, float]


class TakeZero(NamedTuple):
    """Nobody touches the handle: take what is read as zero."""


class Reset(NamedTuple):
    """Brakes may act again: forget the board's faults and the brakes-off, unless it was pressed again since."""

    presses: int  # of the brakes-off, that were seen (`Ring.presses`)


class RunLinked(NamedTuple):
    """Run this trial now."""

    trial: "LinkedTrial"


# answers


class Linked(NamedTuple):
    """How the device on the bench is; about ten times a second while no trial runs."""

    device: str = ""  # the one that its board is wired to; "": none has been reached
    board: str = ""  # its number
    problem: str = ""  # why there are no samples
    fault: str = ""  # latched on the board
    homed: bool = False
    zeroed: bool = False
    tip: tuple[float, float] = (0.0, 0.0)  # m
    hand_force: tuple[float, float] = (0.0, 0.0)  # N
    encoders: str = ""
    force_channels: int = 0
    report: dict = {}  # health counters and clock
    port: str = ""
    counts: tuple[int, ...] = ()  # of the encoders, in the order of their letters
    theta: tuple[float, ...] = ()  # rad, joints A, E, B, C
    homed_at: float = 0.0  # s since 1970, when it was last done here; 0: not here
    zeroed_at: float = 0.0
    told_s: float = 0.0  # monotonic clock


class Looked(NamedTuple):
    """The boards to be reached have been looked for; the `Linked` just before says what was found."""


class Homed(NamedTuple):
    """The encoders stand at the place where the handle was held, m."""

    tip: tuple[float, float]


class Zeroed(NamedTuple):
    """What was read with nobody at the handle."""

    record: "ZeroRecord"


class NotDone(NamedTuple):
    """A job could not be done; one sentence."""

    why: str


class LinkedDone(NamedTuple):
    """A trial has ended, as it was when it ended."""

    trial: "LinkedTrial"
