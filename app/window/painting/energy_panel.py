"""The energy ledger of the running trial: what the hand gave is what the brakes took, what moves, what stops took.

Of an exact simulation the residual is rounding. No brake adds energy: their heat never falls.
"""

import numpy as np
from PySide6.QtCore import QRect, QRectF
from PySide6.QtGui import QPainter
from PySide6.QtWidgets import QWidget

from app.window.painting import theme
from app.window.painting.panel import LEFT, PAD, WORDS_EVERY_S, Panel
from app.window.painting.theme import font, shade, text_width
from core import tick_log

BRAKES, KINETIC, STOPS = theme.BRAKE_SLIPPING, theme.TRACE, theme.BAD
BAR, LINE = 12.0, 18.0  # px: of the bar, of a line of text
COLUMNS = [tick_log.ENERGY_HAND, tick_log.ENERGY_BRAKES, tick_log.ENERGY_KINETIC, tick_log.ENERGY_STOPS]
ROUNDING_J = 1e-9  # heat that falls by less in a tick is rounding
NOT_YET = "no trial yet"


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
        """Whether it has had a tick."""
        return self._first is not None

    @property
    def residual(self) -> float:
        """What the ledger leaves unexplained, J."""
        return self.hand - self.brakes - self.kinetic - self.stops


class EnergyPanel(Panel):
    """A bar and two lines."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("Energy this trial", parent)
        self.ledger = Ledger()
        self._worded_s = -np.inf
        self.lines: list[list[tuple[str, str]]] = []  # lines of (words, colour)
        self.setFixedHeight(int(30.0 + BAR + 3.0 * LINE + 14.0))
        self._word()

    def add(self, rows: np.ndarray) -> None:
        """Ticks (n, WIDTH) of the running trial."""
        if not len(rows):
            return
        self.ledger.add(rows)
        now = float(rows[-1, tick_log.T])
        if not self._worded_s <= now < self._worded_s + WORDS_EVERY_S:
            self._worded_s = now
            self._word()

    def clear(self) -> None:
        """A new trial."""
        self.ledger, self._worded_s = Ledger(), -np.inf
        self._word()

    @property
    def said(self) -> str:
        """All words of the panel."""
        return " ".join(words for line in self.lines for words, _ in line)

    def _word(self) -> None:
        ledger = self.ledger
        balance = [
            (f"hand {ledger.hand:.2f} J =", theme.TEXT),
            (f"brakes {ledger.brakes:.2f}", BRAKES),
            ("+", theme.TEXT),
            (f"kinetic {ledger.kinetic:.2f}", KINETIC),
        ]
        stops = [("+", theme.TEXT), (f"stops {ledger.stops:.2f}", STOPS)] if ledger.stops > 0.005 else []
        if ledger.added > ROUNDING_J:
            verdict = (f"a brake added {small_energy(ledger.added)}", theme.BAD)
        else:
            verdict = ("no brake added energy", theme.GOOD)
        residual = small_energy(ledger.residual) if abs(ledger.residual) > ROUNDING_J else "under 1 nJ"
        proof = [(f"residual {residual} ·", theme.QUIET), verdict] if ledger.began else [(NOT_YET, theme.QUIET)]
        self.lines = [balance, stops, proof]
        self.lines = [line for line in self.lines if line]
        self.update()

    def paint_moving(self, painter: QPainter, dirty: QRect) -> None:
        inside = self.inside
        ledger, x = self.ledger, inside.x()
        painter.fillRect(QRectF(x, inside.y(), inside.width(), BAR), shade(theme.LINE, 0.6))
        parts = ((ledger.brakes, BRAKES), (ledger.kinetic, KINETIC), (ledger.stops, STOPS))
        whole = max(ledger.hand, sum(max(part, 0.0) for part, _ in parts), 1e-3)
        for part, colour in parts:
            width = inside.width() * max(part, 0.0) / whole
            painter.fillRect(QRectF(x, inside.y(), width, BAR), shade(colour))
            x += width
        painter.setFont(font(theme.SMALL))
        y = inside.y() + BAR + 5.0
        for line in self.lines:
            x = PAD
            for words, colour in line:
                painter.setPen(shade(colour))
                painter.drawText(QRectF(x, y, self.width() - x, LINE), LEFT, words)
                x += text_width(words + " ", theme.SMALL)
            y += LINE
