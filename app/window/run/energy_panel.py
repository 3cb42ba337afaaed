"""The energy ledger of the running trial: no brake adds energy."""

import numpy as np
from PySide6.QtWidgets import QFrame

from app.window.widgets.parts import Figures, Panel, column, row, text_label
from app.window.widgets.plots import NO_TRIAL
from app.window.widgets.theme import COLOURS
from core import tick_log

BRAKES, KINETIC, STOPS = COLOURS.brake_slipping, COLOURS.trace, COLOURS.bad
COLUMNS = [tick_log.ENERGY_HAND, tick_log.ENERGY_BRAKES, tick_log.ENERGY_KINETIC, tick_log.ENERGY_STOPS]
ROUNDING_J = 1e-9  # heat that falls by less in a tick is rounding


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
    def residual(self) -> float:
        """What the ledger leaves unexplained, J: of an exact simulation, rounding."""
        return self.hand - self.brakes - self.kinetic - self.stops


class EnergyPanel(Panel):
    """What the hand gave is what the brakes took, what moves and what stops took; no brake adds energy."""

    def __init__(self) -> None:
        super().__init__()
        self.ledger = Ledger()
        self._bar = row(spacing=0)
        for colour in (BRAKES, KINETIC, STOPS, COLOURS.line):  # the last: what the hand gave and is nowhere yet
            part = QFrame()
            part.setFixedHeight(12)
            part.setStyleSheet(f"background: {colour}; border: none")
            self._bar.addWidget(part, 0 if colour != COLOURS.line else 1)
        self.balance, self.proof = Figures(), Figures()
        title = text_label("Energy this trial", bold=True)
        self.setLayout(column(title, self._bar, self.balance, self.proof, spacing=4, margins=(12, 6, 12, 8)))
        self.refresh_text()

    def add(self, rows: np.ndarray) -> None:
        """Ticks (n, WIDTH), n > 0, of the running trial."""
        self.ledger.add(rows)

    def clear(self) -> None:
        self.ledger = Ledger()
        self.refresh_text()

    def refresh_text(self) -> None:
        """Bring the words and the bar up to date: a few times a second, for they must be read."""
        ledger, text = self.ledger, COLOURS.text
        stops = [("+", text), (f"stops {ledger.stops:z.2f}", STOPS)] if ledger.stops > 0.005 else []
        balance = [
            (f"hand {ledger.hand:z.2f} J =", text), (f"brakes {ledger.brakes:z.2f}", BRAKES), ("+", text),
            (f"kinetic {ledger.kinetic:z.2f}", KINETIC), *stops,
        ]  # fmt: skip
        if ledger.added > ROUNDING_J:
            verdict = (f"a brake added {small_energy(ledger.added)}", COLOURS.bad)
        else:
            verdict = ("no brake added energy", COLOURS.good)
        residual = small_energy(ledger.residual) if abs(ledger.residual) > ROUNDING_J else "under 1 nJ"
        self.balance.show_parts(*balance if ledger.began else [(NO_TRIAL, COLOURS.quiet)])
        self.proof.show_parts(*[(f"residual {residual} ·", COLOURS.quiet), verdict] if ledger.began else [])
        parts_J = [max(part, 0.0) for part in (ledger.brakes, ledger.kinetic, ledger.stops)]
        whole = max(ledger.hand, sum(parts_J), 1e-3)
        for i, part in enumerate((*parts_J, whole - sum(parts_J))):
            self._bar.setStretch(i, round(1000.0 * part / whole))
            self._bar.itemAt(i).widget().setVisible(round(1000.0 * part / whole) > 0)
