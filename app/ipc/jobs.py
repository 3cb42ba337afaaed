"""The messages between the session server and the control loop: it gives jobs to the loop, which answers each."""

from typing import TYPE_CHECKING, NamedTuple

from app.ipc.messages import DeviceStatus

if TYPE_CHECKING:  # else each process imports all of this before it can start the next
    import numpy as np

    from app.ipc.scheduling import Scheduling
    from core.device import Device
    from core.device_interface import ZeroRecord
    from experiments.trial.trial import Trial, TrialState

REAL_TIME, DEFAULT = "real-time", "default"  # what the loop is started with: scheduling that it may try


class CheckTiming(NamedTuple):
    """Keep this many deadlines without work, to measure lateness."""

    ticks: int


class RunTrial(NamedTuple):
    """Run a trial to its end, or until it is to be handed back."""

    trial: "Trial"


class Connect(NamedTuple):
    """Connect the board of one of these devices, the first that is found."""

    devices: "tuple[Device, ...]"


class HomeAt(NamedTuple):
    """Set the encoders: the handle is held at `tip` (m)."""

    tip: tuple[float, float]


class TakeZero(NamedTuple):
    """Take the present readings as zero: the handle is free."""


class Reset(NamedTuple):
    """Reset the faults of the board and the brakes-off, unless it was pressed again since."""

    presses: int  # of the brakes-off, so far (`Ring.presses`)


LoopJob = CheckTiming | RunTrial | Connect | HomeAt | TakeZero | Reset


class Compiling(NamedTuple):
    """The loop compiles its kernels, which it does once on a computer."""

    number: int  # of the kernel
    of: int
    linking: bool  # all are compiled, and are made one


class Prepared(NamedTuple):
    """The loop can run trials."""

    scheduling: "Scheduling"  # that the loop got


class TimingChecked(NamedTuple):
    """The lateness of ticks without work."""

    lateness_us: "np.ndarray"  # (n,)


class TrialReturned(NamedTuple):
    """A trial has ended, or is handed back before its end."""

    state: "TrialState"  # for `Trial.take_back`


class ConnectEnded(NamedTuple):
    """The search for boards has ended; the `DeviceStatus` just before has its result."""


class HomeSet(NamedTuple):
    """The encoders were set with the handle at `tip`, m."""

    tip: tuple[float, float]


class Zeroed(NamedTuple):
    """The zero that was taken."""

    record: "ZeroRecord"


class NotDone(NamedTuple):
    """A job failed."""

    why: str


LoopAnswer = (
    Compiling | Prepared | TimingChecked | TrialReturned | DeviceStatus | ConnectEnded | HomeSet | Zeroed | NotDone
)
