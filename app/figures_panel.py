"""The right panel: live error and force of the running trial, and the results so far with their export."""

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from app import theme
from app.labels import OneLine
from app.live_boxes import LiveBoxes
from app.traces import Trace
from core import row
from experiments.boxplots import MEASURES
from experiments.metrics import path_deviation
from experiments.plan import Segment
from experiments.trials_table import TrialRow


class FiguresPanel(QWidget):
    """Two traces over three box plots."""

    export_asked = Signal()

    def __init__(self, configurations: Sequence[str], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFixedWidth(372)
        self.error = Trace("Path error", "mm", theme.TRACE, 10.0)
        self.force = Trace("Hand force", "N", theme.GOOD, 10.0)
        self.boxes = [LiveBoxes(measure, configurations) for measure in MEASURES]
        self._button = QPushButton("Export ..")
        self._button.setFont(theme.font(theme.SMALL))
        self._button.setToolTip("Box plots as PNG, SVG and PDF and the trials as CSV, into a new folder")
        self._button.setStyleSheet("padding: 3px 10px")
        self._button.clicked.connect(self.export_asked)
        self.note = OneLine(self._legend(configurations), "quiet")

        results = QFrame(objectName="panel")
        inside = QVBoxLayout(results)
        inside.setContentsMargins(12, 8, 12, 8)
        inside.setSpacing(8)
        for plot in self.boxes:
            inside.addWidget(plot, 1)
        foot = QHBoxLayout()
        foot.addWidget(self.note, 1)
        foot.addWidget(self._button)
        inside.addLayout(foot)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(theme.GAP)
        layout.addWidget(self.error, 2)
        layout.addWidget(self.force, 2)
        layout.addWidget(results, 7)
        self.allow_export(False)

    @staticmethod
    def _legend(configurations: Sequence[str]) -> str:
        drawn = zip(("filled", "open", "third"), configurations, strict=False)
        return " · ".join(f"{how} {name}" for how, name in drawn)

    def add(self, rows: np.ndarray, segment: Segment) -> None:
        """Ticks (n, row.WIDTH) of the running trial; the error counts from go to the end."""
        t = rows[:, row.T]
        self.force.add(t, np.hypot(rows[:, row.HAND_FX], rows[:, row.HAND_FY]))
        moving = rows[:, row.PHASE] == row.MOVE
        if moving.any():
            tip = rows[moving][:, (row.TIP_X, row.TIP_Y)]
            self.error.add(t[moving], 1e3 * path_deviation(tip, segment.start, segment.end))

    def clear(self) -> None:
        """A new trial."""
        self.error.clear()
        self.force.clear()

    def show_results(self, rows: Sequence[TrialRow]) -> None:
        """The boxes of the trials so far."""
        for plot in self.boxes:
            plot.show_rows(rows)

    def allow_export(self, allowed: bool) -> None:
        """Whether there is something to export now."""
        self._button.setEnabled(allowed)

    def say(self, sentence: str) -> None:
        """What became of an export."""
        self.note.setText(sentence)
