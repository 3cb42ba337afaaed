"""What a simulated study assumes: choices and numbers that the paper does not print, the `[assumptions]` of a file.

The defaults are what this program assumes where a file has no such table.
"""

from typing import Annotated, Any

import msgspec

from core.files import NotNegative, Positive, Table, choice, text_of_form

NO_VIBRATION = "no vibration"
ENCODERS = "encoders"

#: N s/m, or the paper's own rule: the largest gain without detectable vibration.
LowGain = Positive | Annotated[str, text_of_form(NO_VIBRATION, f'a number or "{NO_VIBRATION}"')]


class Assumptions(Table, frozen=True):
    """One set of assumptions. To add one: its line here, and what it changes."""

    # the brakes of the simulated device
    fidelity: Annotated[str, choice("ideal", "static", "mr")] = "mr"  # ideal: as asked, at once, no drag; static: K(I)
    brake_model: Annotated[str, choice("yield", "signed")] = "yield"  # what the lag of Eq. (1) acts on
    lag_factor: Positive = 1.0  # of both time constants, Eq. (4)
    drag_factor: NotNegative = 1.0  # of the torque without current, k_2
    backlash_deg: Annotated[float, msgspec.Meta(ge=0, lt=360)] | None = None  # of every brake; None: as in its file
    torque_ripple_N_m: NotNegative = 0.0  # from the least to the most over a turn
    # what the controller sees of the simulated device
    sensing: Annotated[str, choice("ideal", ENCODERS)] = "ideal"
    filter_samples: Annotated[int, msgspec.Meta(ge=3, le=63)] = 15  # of the velocity, as on the bench; encoders alone
    delay_samples: Annotated[int, msgspec.Meta(ge=0, le=63)] = 1  # encoders alone
    # the controllers, on a real device too
    gap_reading: Annotated[str, choice("half", "full")] = "half"  # what a gap is: half the band's width, or all of it
    low_gain: LowGain | None = None  # of the proportional controller of least gain; None: as in its file

    @property
    def changed(self) -> dict[str, Any]:
        """Those that are not the defaults."""
        own, usual = msgspec.structs.asdict(self), msgspec.structs.asdict(DEFAULTS)
        return {name: value for name, value in own.items() if value != usual[name]}

    def words(self) -> str:
        """Those that are not the defaults, as a figure's note names them; the low gain has a note of its own."""
        return ", ".join(
            f"{name.replace('_', ' ')} {value:g}" if isinstance(value, float) else f"{name.replace('_', ' ')} {value}"
            for name, value in self.changed.items()
            if name != "low_gain"
        )


DEFAULTS = Assumptions()
