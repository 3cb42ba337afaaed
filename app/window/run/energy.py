"""The energy ledger of the running trial: no brake adds energy."""

import numpy as np

from app.window.widgets.plots import NO_TRIAL
from app.window.widgets.theme import COLOURS
from core import tick_log

COLUMNS = [tick_log.ENERGY_HAND, tick_log.ENERGY_BRAKES, tick_log.ENERGY_KINETIC, tick_log.ENERGY_STOPS]
ROUNDING_J = 1e-9  # heat that falls by less in a tick is rounding
SHOWN_J = 0.005  # less in the stops is left out
Parts = list[tuple[str, str]]  # a line of words, each with its colour


def small_energy(energy_J: float) -> str:
    """-3 nJ, 20 µJ, 4 mJ, 1.5 J."""
    units = (("J", 1.0), ("mJ", 1e-3), ("µJ", 1e-6), ("nJ", 1e-9))
    unit, least = next(((unit, least) for unit, least in units if abs(energy_J) >= least), units[-1])
    return f"{float(f'{energy_J / least:.2g}'):g} {unit}"


class Ledger:
    """Energies (J) since the trial's first tick."""

    def __init__(self) -> None:
        self.hand = self.brakes = self.kinetic = self.stops = 0.0
        self.added = 0.0  # the most that the brakes together gave in a tick
        self._first: np.ndarray | None = None
        self._heat = 0.0

    def add(self, rows: np.ndarray) -> None:
        """Ticks (n, WIDTH), n > 0, of one trial, in order."""
        columns = rows[:, COLUMNS]
        if self._first is None:
            self._first, self._heat = columns[0].copy(), float(columns[0, 1])
        heat = columns[:, 1]
        fall = float((heat[:-1] - heat[1:]).max(initial=-np.inf))
        self.added = max(self.added, self._heat - float(heat[0]), fall)
        self._heat = float(heat[-1])
        self.hand, self.brakes, self.kinetic, self.stops = (columns[-1] - self._first).tolist()

    @property
    def began(self) -> bool:
        return self._first is not None

    @property
    def is_violated(self) -> bool:
        """Whether a brake added energy."""
        return self.added > ROUNDING_J

    @property
    def short(self) -> Parts:
        """In a few words."""
        if not self.began:
            return [(NO_TRIAL, COLOURS.quiet)]
        if self.is_violated:
            return [(f"a brake added {small_energy(self.added)}", COLOURS.bad)]
        return [(f"{self.brakes:z.2f} J taken by brakes", COLOURS.text)]

    @property
    def whole(self) -> Parts:
        """What the hand gave is what the brakes took, what moves and what the stops took."""
        if not self.began:
            return self.short
        stops = f" + stops {self.stops:z.2f}" if self.stops > SHOWN_J else ""
        balance = f"hand {self.hand:z.2f} J = brakes {self.brakes:z.2f} + kinetic {self.kinetic:z.2f}{stops},"
        verdict = self.short if self.is_violated else [("no brake added energy", COLOURS.good)]
        return [(balance, COLOURS.text), *verdict]
