"""The plan as one row of cells, block by block, each cell a trial with its status; a click opens what was recorded."""

from collections.abc import Sequence

from PySide6.QtCore import QEvent, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QHelpEvent, QMouseEvent, QPainter, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import QSizePolicy, QToolTip, QWidget

from app.ipc import messages as m
from app.window.widgets import theme
from app.window.widgets.theme import COLOURS, text_width, write, write_from
from app.window.widgets.words import STATUS_WORDS, describe
from experiments.analysis.trials_table import TrialRow
from experiments.plan import PlannedTrial
from experiments.store.cells import cell, place, try_of

#: px: high, of a cell and of the line below; between two cells and two blocks; wide, of a cell; of one with its mark
HIGH_PX, LINE_PX, GAP_PX, BLOCK_PX, WIDEST_PX, MARKED_PX = 16.0, 18.0, 2.0, 9.0, 26.0, 10.0
#: Shown by shape too, not by colour alone.
MARKS = {
    "timeout": "t", "aborted": "×", "redone": "r", "recovered": "c", "skipped": "–", "stopped": "!", "excluded": "e",
}  # fmt: skip


class PlanBar(QWidget):
    """All trials at a glance; the tip over a cell says which trial it is."""

    clicked = Signal(object)  # the newest TrialRow of a cell

    def __init__(self) -> None:
        super().__init__()
        self.cells: dict[int, QRectF] = {}  # run of the plan -> where its cell is, px
        self.statuses: dict[int, str] = {}  # run of the plan -> status of its cell
        self.marked: int | None = None  # run of the plan: next or running
        self.running = False
        self._plan: Sequence[PlannedTrial] = ()
        self._newest: dict[int, TrialRow] = {}  # run of the plan -> newest row of its cell
        self._tips: dict[int, str] = {}
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.setFixedHeight(round(HIGH_PX + LINE_PX))
        self.setMouseTracking(True)

    def show_session(self, opened: m.Opened, snapshot: m.Snapshot) -> None:
        """The trials, what became of those that are over, and which one is next or running."""
        if opened.plan != self._plan:
            self._plan = opened.plan
            self._place_cells()
        self._newest = newest_rows(opened.plan, snapshot.rows)
        self.statuses = {run: row.status for run, row in self._newest.items()}
        now = snapshot.running or snapshot.coming
        self.marked = None if now is None or now.block == 0 or not opened.plan else (
            opened.plan[min(place(now, opened.plan), len(opened.plan)) - 1].run
        )  # fmt: skip
        self.running = snapshot.running is not None
        for trial in opened.plan:
            status = self.statuses.get(trial.run, "not done yet")
            status = STATUS_WORDS.get(status, status)
            if trial.run == self.marked:
                status = "running" if self.running else "next"
            tries = try_of(self._newest.get(trial.run, trial), snapshot.rows)
            self._tips[trial.run] = f"Trial {trial.run}{tries} · {describe(trial, opened, snapshot.blind)} · {status}"
        self.update()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._place_cells()

    def _place_cells(self) -> None:
        """A cell for each trial, with a gap between two blocks."""
        breaks = sum(_block(a) != _block(b) for a, b in zip(self._plan, self._plan[1:], strict=False))
        pitch = min((self.width() - BLOCK_PX * breaks) / max(len(self._plan), 1), WIDEST_PX)
        gap = GAP_PX if pitch > 3.0 * GAP_PX else 0.0
        self.cells, x, before = {}, 0.0, None
        for trial in self._plan:
            x += BLOCK_PX if before is not None and _block(trial) != before else 0.0
            self.cells[trial.run] = QRectF(x, 0.0, pitch - gap, HIGH_PX)
            x, before = x + pitch, _block(trial)

    def run_at(self, at: QPointF) -> int | None:
        """The run of the plan whose cell is at a place, px."""
        return next((run for run, box in self.cells.items() if box.contains(at)), None)

    def _can_open(self, run: int | None) -> bool:
        return run in self._newest and bool(self._newest[run].recording)

    def event(self, event: QEvent) -> bool:
        if isinstance(event, QHelpEvent):
            tip = self._tips.get(self.run_at(QPointF(event.pos())) or 0, "")
            QToolTip.showText(event.globalPos(), tip, self)
            return True
        return super().event(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        can = self._can_open(self.run_at(event.position()))
        self.setCursor(Qt.CursorShape.PointingHandCursor if can else Qt.CursorShape.ArrowCursor)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        run = self.run_at(event.position())
        if run is not None and self._can_open(run):
            self.clicked.emit(self._newest[run])

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        device, y = "", HIGH_PX + 0.5 * LINE_PX + 1.0
        for trial in self._plan:
            box, status = self.cells[trial.run], self.statuses.get(trial.run)
            self._paint_cell(painter, trial.run, box, status)
            if trial.configuration != device:
                device = trial.configuration
                write_from(painter, QPointF(box.left(), y), device, theme.SMALL, False, COLOURS.quiet)
        legend = [
            f"{mark} {STATUS_WORDS.get(status, status)}"
            for status, mark in MARKS.items()
            if status in self.statuses.values()
        ]
        text = "   ".join(legend)
        left = self.width() - text_width(text, theme.SMALL)
        write_from(painter, QPointF(left, y), text, theme.SMALL, False, COLOURS.quiet)

    def _paint_cell(self, painter: QPainter, run: int, box: QRectF, status: str | None) -> None:
        painter.setPen(Qt.PenStyle.NoPen)
        ground = theme.mixed(COLOURS.panel, theme.STATUS[status] if status else COLOURS.line, 0.6)
        painter.setBrush(ground)
        if run == self.marked:
            painter.setBrush(theme.shade(COLOURS.accent if self.running else COLOURS.accent_ground))
            painter.setPen(theme.pen(COLOURS.text, 2.0))
            box = box.adjusted(1.0, 1.0, -1.0, -1.0)
        painter.drawRoundedRect(box, 2.0, 2.0)
        mark = MARKS.get(status or "", "")
        if mark and box.width() + 2.0 >= MARKED_PX:
            write(painter, box.center(), mark, theme.SMALL, True, COLOURS.text)


def _block(trial: PlannedTrial) -> tuple[str, int]:
    return trial.configuration, trial.block


def newest_rows(plan: Sequence[PlannedTrial], rows: Sequence[TrialRow]) -> dict[int, TrialRow]:
    """Run of the plan -> the newest row of its cell. Rows of a blind session carry a code in place of the controller:
    such a row is found by its run number."""
    found: dict[int, TrialRow] = {}
    by_run = {trial.run: trial for trial in plan}
    for newer in rows:
        planned = by_run.get(newer.run)
        if planned is None:  # a redo or a resumed trial has a run number of its own
            planned = next((trial for trial in plan if cell(trial) == cell(newer)), None)
        if planned is not None:
            found[planned.run] = newer
    return found
