"""What a simulated study assumes: choices and numbers that the paper does not print, the `[assumptions]` of a file.

The defaults are what this program assumes where a file has no such table.
"""

from typing import Annotated, Any

import msgspec

from core.control.controllers import Preset
from core.device import Device, with_brakes
from core.device_interface import VELOCITY_WINDOW
from core.files import InputError, NotNegative, Positive, Table, choice, text_of_form
from core.mechanism import A, B

NO_VIBRATION = "no vibration"
IDEAL, ENCODERS = SENSINGS = ("ideal", "encoders")
Sensing = Annotated[str, choice(*SENSINGS)]

#: N s/m, or the paper's own rule: the largest gain without detectable vibration.
LowGain = Positive | Annotated[str, text_of_form(NO_VIBRATION, f'a number or "{NO_VIBRATION}"')]


class Assumptions(Table, frozen=True):
    """One set of assumptions. To add one: its line here, and what it changes."""

    # the brakes of the simulated device
    lag_factor: Positive = 1.0  # times both time constants
    drag_factor: NotNegative = 1.0  # times the torque without current, k_2
    torque_factor: Positive = 1.0  # times the torque that current adds, K - k_2
    backlash_deg: Annotated[float, msgspec.Meta(ge=0, lt=360)] | None = None  # of every brake; none: as in its file
    # what the controller sees of the simulated device
    sensing: Sensing = IDEAL  # "ideal", or "encoders": the counts of the device file
    filter_samples: Annotated[int, msgspec.Meta(ge=3, le=63)] = VELOCITY_WINDOW  # n: a velocity is (n - 1) / 2 ms old
    delay_samples: Annotated[int, msgspec.Meta(ge=0, le=63)] = 1  # ms until the controller has a sample
    # the controllers, on a real device too
    gap_reading: Annotated[str, choice("half", "full")] = "half"  # a gap is "half" or the "full" width of the band
    low_gain: LowGain | None = None  # of the proportional controller of least gain, or "no vibration"

    @property
    def changed(self) -> dict[str, Any]:
        """The assumptions that are not the defaults."""
        own, usual = msgspec.structs.asdict(self), msgspec.structs.asdict(DEFAULTS)
        return {name: value for name, value in own.items() if value != usual[name]}

    def applied_to(self, device: Device) -> Device:
        """The device to simulate: with the brakes that are assumed, which its controllers know."""
        factors = self.lag_factor, self.drag_factor, self.torque_factor
        if (*factors, self.backlash_deg) != (1.0, 1.0, 1.0, None):
            return with_brakes(device, lambda brake: brake.changed(*factors, self.backlash_deg))
        return device

    def controller(self, preset: Preset) -> Preset:
        """A controller with its gap as it is read."""
        gap = preset.value("gap_m")
        return preset.replaced(gap_m=0.5 * gap) if gap and self.gap_reading == "full" else preset

    def words(self) -> str:
        """The assumptions that are not the defaults, for a figure's note, which names the low gain by itself."""
        return ", ".join(
            f"{name.replace('_', ' ')} {value:g}" if isinstance(value, float) else f"{name.replace('_', ' ')} {value}"
            for name, value in self.changed.items()
            if name != "low_gain"
        )


DEFAULTS = Assumptions()


def encoder_counts(device: Device) -> tuple[int, ...]:
    """Counts per revolution of the encoders (4,), 0 at a joint without one. InputError: they do not give the tip."""
    encoders = device.sensing.encoders if device.sensing else None
    counts = encoders.counts if encoders else (0, 0, 0, 0)
    if not any((counts[A], counts[B])) and (device.mechanism.coaxial or not any(counts)):
        raise InputError(
            f"device {device.name}: has no encoders that give its tip, so assumptions.sensing cannot be {ENCODERS!r}"
        )
    return counts
