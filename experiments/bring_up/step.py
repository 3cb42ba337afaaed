"""What a step of bringing a board up is: data, a course of currents, a judgement. Nothing here reaches a device."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from core.device import Device
from core.device_interface import DeviceError, DeviceSample

Currents = tuple[float, float, float, float]
Point = tuple[float, float]
NO_CURRENT: Currents = (0.0, 0.0, 0.0, 0.0)
SHARE = 0.1  # of each brake's largest current: more never flows


class Row(NamedTuple):
    """A sample of the device, with the command that held when it came."""

    sample: DeviceSample
    asked: Currents  # A, the newest command when it came
    came_s: float  # by the host's clock


class Observed(NamedTuple):
    """The samples of a step, and the device that they are of."""

    rows: list[Row]
    device: Device
    about: dict[str, Any]  # the device's report, with its `encoders` and `force_channels`

    def column(self, name: str) -> np.ndarray:
        """A field of the samples, (n,) or (n, k)."""
        return np.array([getattr(row.sample, name) for row in self.rows])

    @property
    def largest(self) -> np.ndarray:
        """(4,) A, of the brake files."""
        return np.asarray(self.device.brakes.current_max, dtype=float)

    @property
    def braked(self) -> list[int]:
        """Indices (of `JOINTS`) of the joints with a brake."""
        return [i for i in range(4) if self.device.brakes.present[i]]

    def part(self, begin: int | None, end: int | None) -> "Observed":
        """These rows alone, so that a look at a growing record takes no longer each time."""
        return self._replace(rows=self.rows[begin:end])

    def turned(self) -> dict[str, float]:
        """Joint with an encoder -> how far it has turned, rad, counter-clockwise."""
        first, last = (np.array(self.rows[k].sample.counts) for k in (0, -1))
        counts_per_rev = self.about.get("counts_per_rev", ())
        if len(counts_per_rev) != len(first):
            raise DeviceError(f"the device reports counts_per_rev {counts_per_rev} for {len(first)} encoders")
        moved = (last - first) * 2.0 * math.pi / np.array(counts_per_rev)
        return dict(zip(self.about["encoders"], moved.tolist(), strict=True))


class Finding(NamedTuple):
    """Whether a step has passed, what was seen, and what to mend."""

    passed: bool
    saw: str
    advice: str = ""
    figures: dict[str, Any] = {}  # noqa: RUF012  (never changed)


def at_once(observed: Observed) -> bool:
    return True


def never(observed: Observed) -> bool:
    return False


def no_current(t: float, largest: np.ndarray) -> Currents:
    return NO_CURRENT


class Step(NamedTuple):
    """One check. It lasts from when `begins` holds (no current until then) to when `ends` holds, at most `lasts_s`."""

    name: str
    title: str
    judge: Callable[[Observed], Finding]
    lasts_s: float
    ask: str = ""  # what the person does
    order: dict[str, Any] = {}  # noqa: RUF012  (never changed) the same, for the hand of an emulated board
    confirmed: bool = False  # the person says when it is done; else `begins` and `ends` show it
    needs: tuple[str, ...] = ()  # steps that must have passed
    begins: Callable[[Observed], bool] = at_once
    ends: Callable[[Observed], bool] = never
    drive: Callable[[float, np.ndarray], Currents] = no_current  # A at s since `begins`, with the largest currents
    may_fault: bool = False  # the device may latch a fault meanwhile
    silent_s: float = 0.0  # no command from the end of `lasts_s` for so long
    homes: Point | None = None  # the encoders are set to this place first, m
    zeroes: bool = False  # the zero is taken first
