"""The plan as a grid: a row of cells for each block of each configuration, each cell a trial with its status."""

from collections.abc import Sequence

from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QHelpEvent, QMouseEvent, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QToolTip, QWidget

from app.ipc import messages as m
from app.window.widgets import theme
from app.window.widgets.theme import COLOURS
from app.window.widgets.words import describe
from experiments.analysis.trials_table import TrialRow
from experiments.plan import PlannedTrial
from experiments.session.files import cell, place

HEAD_PX, ROW_PX, SPACE_PX, LABEL_PX = 20, 20, 6, 52
LEAST_SHARE = 0.7  # where there is little room, rows are so much lower before the grid must be scrolled
CELL_LEAST_PX = 8.0  # a block with more trials than fit in a row goes on in the next
#: Shown by shape too, not by colour alone.
MARKS = {
    "timeout": "t", "aborted": "×", "redone": "r", "recovered": "c", "skipped": "–", "stopped": "!", "excluded": "e",
}  # fmt: skip


class PlanGrid(QWidget):
    """All trials at a glance; a cell's tooltip says which trial it is, a click opens what was recorded of it."""

    clicked = Signal(object)  # the newest TrialRow of a cell

    def __init__(self) -> None:
        super().__init__()
        self._opened: m.Opened | None = None
        self._blind = False
        self._groups: dict[str, dict[int, list[PlannedTrial]]] = {}
        self.statuses: dict[int, str] = {}  # run of the plan -> status of its cell
        self._newest: dict[int, TrialRow] = {}  # run of the plan -> newest row of its cell
        self.marked: int | None = None  # run of the plan: next or running
        self.running = False
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Maximum)

    def show_session(self, opened: m.Opened, snapshot: m.Snapshot) -> None:
        """The trials, what became of those that are over, and which one is next or running."""
        self._opened, self._blind = opened, snapshot.blind
        self._groups = {}
        for trial in opened.plan:
            self._groups.setdefault(trial.configuration, {}).setdefault(trial.block, []).append(trial)
        self._newest = newest_rows(opened.plan, snapshot.rows)
        self.statuses = {run: row.status for run, row in self._newest.items()}
        now = snapshot.running or snapshot.coming
        self.marked = None if now is None or now.block == 0 or not opened.plan else (
            opened.plan[min(place(now, opened.plan), len(opened.plan)) - 1].run
        )  # fmt: skip
        self.running = snapshot.running is not None
        self.updateGeometry()
        self.update()

    # lengths

    def _per_row(self) -> int:
        return max(int((self.width() - theme.text_px(LABEL_PX)) / (CELL_LEAST_PX + 3.0)), 1)

    def _rows_of(self, trials: Sequence[PlannedTrial]) -> int:
        return -(-len(trials) // self._per_row())

    def sizeHint(self) -> QSize:
        rows = sum(self._rows_of(trials) for blocks in self._groups.values() for trials in blocks.values())
        spaces = max(len(self._groups) - 1, 0) * SPACE_PX
        return QSize(230, len(self._groups) * theme.text_px(HEAD_PX) + rows * theme.text_px(ROW_PX) + spaces)

    def minimumSizeHint(self) -> QSize:
        return QSize(120, round(LEAST_SHARE * self.sizeHint().height()))

    def _share(self) -> float:
        """How high a row is, of its full height."""
        return min(max(self.height() / max(self.sizeHint().height(), 1), LEAST_SHARE), 1.0)

    def cells(self) -> dict[int, QRectF]:
        """Run of the plan -> its cell (px)."""
        return self._places()[0]

    def _places(self) -> tuple[dict[int, QRectF], list[tuple[str, QRectF, bool]]]:
        """Run of the plan -> its cell (px); the words beside the cells: text, place, whether it is a head."""
        cells, words, y, per_row, share = {}, [], 0.0, self._per_row(), self._share()
        high = share * theme.text_px(ROW_PX)
        for configuration, blocks in self._groups.items():
            words.append((configuration, QRectF(0.0, y, self.width(), share * theme.text_px(HEAD_PX)), True))
            y += share * theme.text_px(HEAD_PX)
            for block, trials in blocks.items():
                words.append((f"block {block}", QRectF(0.0, y, theme.text_px(LABEL_PX), high), False))
                step = (self.width() - theme.text_px(LABEL_PX)) / min(len(trials), per_row)
                side = min(step - 3.0, high - 4.0)
                for i, trial in enumerate(trials):
                    x, down = theme.text_px(LABEL_PX) + i % per_row * step, i // per_row * high
                    cells[trial.run] = QRectF(x, y + down + 0.5 * (high - side), min(step - 3.0, 1.6 * side), side)
                y += self._rows_of(trials) * high
            y += share * SPACE_PX
        return cells, words

    # events

    def event(self, event: QEvent) -> bool:
        if event.type() == QEvent.Type.ToolTip and isinstance(event, QHelpEvent) and self._opened:
            trial = self._at(event.pos().toPointF())
            if trial is None:
                QToolTip.hideText()
                return True
            status = self.statuses.get(trial.run, "not done yet")
            if trial.run == self.marked:
                status = "running" if self.running else "next"
            text = f"Trial {trial.run} · {describe(trial, self._opened, self._blind)} · {status}"
            QToolTip.showText(event.globalPos(), text, self)
            return True
        return super().event(event)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        trial = self._at(event.position())
        if trial is not None and (row := self._newest.get(trial.run)) is not None and row.recording:
            self.clicked.emit(row)

    def _at(self, place: QPointF) -> PlannedTrial | None:
        cells = self.cells()
        plan = self._opened.plan if self._opened else ()
        return next((trial for trial in plan if cells[trial.run].contains(place)), None)

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.fillRect(self.rect(), theme.shade(COLOURS.panel))
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(theme.shade(COLOURS.quiet))
        cells, words = self._places()
        for text, box, head in words:
            painter.setFont(theme.font(theme.SMALL, bold=head))
            painter.drawText(box, Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter, text)
        for run, box in cells.items():
            self._paint_cell(painter, box, run)

    def _paint_cell(self, painter: QPainter, box: QRectF, run: int) -> None:
        status = self.statuses.get(run)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(theme.shade(theme.STATUS[status], 0.55) if status else theme.shade(COLOURS.line, 0.6))
        if run == self.marked:
            painter.setPen(QPen(theme.shade(COLOURS.text if self.running else COLOURS.accent), 2.0))
            painter.setBrush(theme.shade(COLOURS.accent if self.running else COLOURS.accent_ground))
        painter.drawRoundedRect(box, 3.0, 3.0)
        if status in MARKS:
            painter.setFont(theme.font(theme.SMALL, bold=True))
            painter.setPen(theme.shade(COLOURS.text))
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, MARKS[status])


def newest_rows(plan: Sequence[PlannedTrial], rows: Sequence[TrialRow]) -> dict[int, TrialRow]:
    """Run of the plan -> the newest row of its cell. Rows of a blind session carry a code in place of the controller:
    such a row is found by its run number."""
    found: dict[int, TrialRow] = {}
    by_run = {trial.run: trial for trial in plan}
    for row in rows:
        planned = by_run.get(row.run)
        if planned is None:  # a redo or a resumed trial has a run number of its own
            planned = next((trial for trial in plan if cell(trial) == cell(row)), None)
        if planned is not None:
            found[planned.run] = row
    return found
