"""The bottom line: proof of recording, and how well the loop keeps its time."""

from collections import deque
from pathlib import Path

import numpy as np
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QWidget

from app import theme
from app.labels import OneLine
from app.messages import Ticks
from core import row

SHOWN_TICKS = 10_000  # lateness is shown over the last of them
EVERY = 15  # messages between two updates of the text: four a second, so that it can be read
MISSED_US = 1000.0  # a tick later than a whole period


class StatusLine(QFrame):
    """Rows, bytes and age of the recording; lateness of the ticks."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent, objectName="panel")
        self.lamp, self.recording = QLabel("●"), OneLine("Nothing recorded yet")
        self.timing = QLabel("", objectName="quiet")
        for label in (self.lamp, self.timing):
            label.setFont(theme.font(theme.SMALL))
        layout = QHBoxLayout(self)
        layout.setContentsMargins(12, 6, 12, 6)
        layout.setSpacing(8)
        layout.addWidget(self.lamp)
        layout.addWidget(self.recording, 1)
        layout.addWidget(self.timing)
        self._late: deque[np.ndarray] = deque(maxlen=SHOWN_TICKS // 16)
        self._messages = self._missed = 0
        self._light(theme.BRAKE_OFF)

    def _light(self, colour: str) -> None:
        self.lamp.setStyleSheet(f"color: {colour}")

    def begin(self) -> None:
        """A recording starts."""
        self._late.clear()
        self._messages = self._missed = 0
        self._light(theme.BAD)

    def add(self, message: Ticks) -> None:
        """News from the loop."""
        late = message.rows[:, row.LATENESS_US]
        self._late.append(late)
        self._missed += int(np.count_nonzero(late >= MISSED_US))
        if self._messages % EVERY == 0:
            proof = message.proof
            self.recording.setText(
                f"Recording {proof.name} · {grouped(proof.rows)} rows · {1e-6 * proof.bytes:.2f} MB"
                f" · last write {proof.age_s:.1f} s ago"
            )
            self._light(theme.BAD if proof.age_s < 1.0 else theme.CAUTION)
            p50, p99 = np.percentile(np.concatenate(self._late), (50, 99))
            self.timing.setText(f"Loop 1 kHz · late p50 {p50:.0f} p99 {p99:.0f} µs · {self._missed} missed")
        self._messages += 1

    def end(self, kept: int, folder: Path) -> None:
        """The recording is closed and verified."""
        self._light(theme.GOOD)
        trials = "1 trial" if kept == 1 else f"{kept} trials"
        self.recording.setText(f"{trials} recorded and verified in {folder}")

    def stop(self) -> None:
        """There is no loop any more."""
        self._light(theme.BAD)
        self.recording.setText("Not recording")
        self.timing.setText("")


def grouped(number: int) -> str:
    """A whole number with thin gaps between thousands."""
    return f"{number:,}".replace(",", "\u2009")
