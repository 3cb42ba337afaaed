"""The plan as a grid: a row of cells for each block of each configuration, each cell a trial with its status."""

from collections.abc import Sequence

from PySide6.QtCore import QEvent, QRectF, QSize, Qt
from PySide6.QtGui import QHelpEvent, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QToolTip, QWidget

from app import theme
from core.control import PRESETS
from experiments.plan import PlannedTrial

HEAD_PX, ROW_PX, SPACE_PX, LABEL_PX = 24, 24, 8, 54
#: Said by shape too, not by colour alone.
MARKS = {"timeout": "t", "aborted": "×", "redone": "r", "recovered": "c"}


def describe(planned: PlannedTrial) -> str:
    """A planned trial in words."""
    return f"{planned.configuration} · {PRESETS[planned.controller].name} · segment {planned.segment}"


class PlanGrid(QWidget):
    """60 trials at a glance; a cell's tooltip says which trial it is."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._plan: tuple[PlannedTrial, ...] = ()
        self.statuses: dict[int, str] = {}  # run -> status
        self.next: int | None = None  # run
        self.running = False
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def show_plan(
        self,
        plan: Sequence[PlannedTrial],
        statuses: dict[int, str] | None = None,
        coming: int | None = None,
        running: bool = False,
    ) -> None:
        """The trials, what became of those that are over, and which run is next or running."""
        self._plan, self.statuses, self.next, self.running = tuple(plan), dict(statuses or {}), coming, running
        self.updateGeometry()
        self.update()

    def _groups(self) -> dict[str, dict[int, list[PlannedTrial]]]:
        groups: dict[str, dict[int, list[PlannedTrial]]] = {}
        for trial in self._plan:
            groups.setdefault(trial.configuration, {}).setdefault(trial.block, []).append(trial)
        return groups

    def sizeHint(self) -> QSize:
        groups = self._groups()
        rows = sum(len(blocks) for blocks in groups.values())
        return QSize(230, len(groups) * HEAD_PX + rows * ROW_PX + max(len(groups) - 1, 0) * SPACE_PX)

    def minimumSizeHint(self) -> QSize:
        return self.sizeHint()

    def cells(self) -> dict[int, QRectF]:
        """Run -> its cell (px)."""
        places, y = {}, 0.0
        for blocks in self._groups().values():
            y += HEAD_PX
            for trials in blocks.values():
                step = (self.width() - LABEL_PX) / len(trials)
                side = min(step - 3.0, ROW_PX - 6.0)
                for i, trial in enumerate(trials):
                    places[trial.run] = QRectF(LABEL_PX + i * step, y + 0.5 * (ROW_PX - side), side, side)
                y += ROW_PX
            y += SPACE_PX
        return places

    def event(self, event: QEvent) -> bool:
        if event.type() == QEvent.Type.ToolTip and isinstance(event, QHelpEvent):
            cells = self.cells()
            for trial in self._plan:
                if cells[trial.run].contains(event.pos()):
                    status = self.statuses.get(trial.run, "next" if trial.run == self.next else "to come")
                    QToolTip.showText(event.globalPos(), f"Trial {trial.run} · {describe(trial)} · {status}", self)
                    return True
            QToolTip.hideText()
            return True
        return super().event(event)

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.fillRect(self.rect(), theme.colour(theme.PANEL))
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        middle = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
        cells = self.cells()
        y = 0.0
        for configuration, blocks in self._groups().items():
            painter.setFont(theme.font(theme.NORMAL, bold=True))
            painter.setPen(theme.colour(theme.QUIET))
            painter.drawText(QRectF(0.0, y, self.width(), HEAD_PX), middle, configuration)
            y += HEAD_PX
            for block, trials in blocks.items():
                painter.setFont(theme.font(theme.SMALL))
                painter.setPen(theme.colour(theme.QUIET))
                painter.drawText(QRectF(0.0, y, LABEL_PX, ROW_PX), middle, f"block {block}")
                for trial in trials:
                    self._paint_cell(painter, cells[trial.run], trial.run)
                y += ROW_PX
            y += SPACE_PX

    def _paint_cell(self, painter: QPainter, cell: QRectF, run: int) -> None:
        status = self.statuses.get(run)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(theme.colour(theme.STATUS[status], 0.55) if status else theme.colour(theme.LINE, 0.6))
        if run == self.next and not status:
            painter.setPen(QPen(theme.colour("#ffffff" if self.running else theme.ACCENT), 2.0))
            painter.setBrush(theme.colour(theme.ACCENT if self.running else theme.ACCENT_DARK))
        painter.drawRoundedRect(cell, 3.0, 3.0)
        if status in MARKS:
            painter.setFont(theme.font(theme.SMALL, bold=True))
            painter.setPen(theme.colour(theme.TEXT))
            painter.drawText(cell, Qt.AlignmentFlag.AlignCenter, MARKS[status])
