"""The plan as a grid: a row of cells for each block of each configuration, each cell a trial with its status."""

from collections.abc import Sequence

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QPushButton, QWidget

from app.ipc import messages as m
from app.window.widgets import theme
from app.window.widgets.parts import NO_FOCUS, clear, column, grid, holder, row, text_label
from app.window.widgets.theme import COLOURS
from app.window.widgets.words import describe
from experiments.analysis.trials_table import TrialRow
from experiments.plan import PlannedTrial
from experiments.store.cells import cell, place

#: px: of a row of cells and of the label before it; high, of a cell; between two; wide, of a cell
ROW_PX, LABEL_PX, HIGH_PX, GAP_PX, NARROWEST_PX, WIDEST_PX = 176, 52, 16, 3, 8, 17
#: Shown by shape too, not by colour alone.
MARKS = {
    "timeout": "t", "aborted": "×", "redone": "r", "recovered": "c", "skipped": "–", "stopped": "!", "excluded": "e",
}  # fmt: skip


class PlanGrid(QWidget):
    """All trials at a glance; a cell's tooltip says which trial it is, a click opens what was recorded of it."""

    clicked = Signal(object)  # the newest TrialRow of a cell

    def __init__(self) -> None:
        super().__init__()
        self._plan: Sequence[PlannedTrial] = ()
        self.cells: dict[int, QPushButton] = {}  # run of the plan -> its cell
        self.statuses: dict[int, str] = {}  # run of the plan -> status of its cell
        self._newest: dict[int, TrialRow] = {}  # run of the plan -> newest row of its cell
        self.marked: int | None = None  # run of the plan: next or running
        self.running = False
        self._whole = column()
        self.setLayout(self._whole)

    def show_session(self, opened: m.Opened, snapshot: m.Snapshot) -> None:
        """The trials, what became of those that are over, and which one is next or running."""
        if opened.plan != self._plan:
            self._lay_out(opened.plan)
        self._newest = newest_rows(opened.plan, snapshot.rows)
        self.statuses = {run: row.status for run, row in self._newest.items()}
        now = snapshot.running or snapshot.coming
        self.marked = None if now is None or now.block == 0 or not opened.plan else (
            opened.plan[min(place(now, opened.plan), len(opened.plan)) - 1].run
        )  # fmt: skip
        self.running = snapshot.running is not None
        for trial in opened.plan:
            status = self.statuses.get(trial.run, "not done yet")
            if trial.run == self.marked:
                status = "running" if self.running else "next"
            self._show_cell(trial.run, f"Trial {trial.run} · {describe(trial, opened, snapshot.blind)} · {status}")

    def _lay_out(self, plan: Sequence[PlannedTrial]) -> None:
        """A cell for each trial; a block with more than fit in a row goes on in the next."""
        self._plan, self.cells, blocks, head = plan, {}, column(spacing=3), ""
        for key in dict.fromkeys((trial.configuration, trial.block) for trial in plan):
            if key[0] != head:
                head = key[0]
                blocks.addWidget(text_label(head, "quiet", theme.SMALL, bold=True))
            trials = [trial for trial in plan if (trial.configuration, trial.block) == key]
            wide = min(max(ROW_PX // len(trials) - GAP_PX, NARROWEST_PX), WIDEST_PX)
            label = text_label(f"block {key[1]}", "quiet", theme.SMALL)
            label.setFixedSize(LABEL_PX, HIGH_PX)
            cells, in_line = grid(GAP_PX, GAP_PX, stretched=len(trials)), ROW_PX // (wide + GAP_PX)
            for number, trial in enumerate(trials):
                self.cells[trial.run] = pressed = QPushButton(focusPolicy=NO_FOCUS)
                pressed.setFont(theme.font(theme.SMALL, bold=True))
                pressed.setFixedSize(wide, HIGH_PX)
                pressed.clicked.connect(lambda _=False, run=trial.run: self.clicked.emit(self._newest[run]))
                cells.addWidget(pressed, *divmod(number, in_line))
            blocks.addLayout(row(label, (cells, 1), spacing=0))
        clear(self._whole)
        self._whole.addWidget(whole := holder(blocks))
        whole.show()  # at once, for the grid to know its height

    def _show_cell(self, run: int, hint: str) -> None:
        status, newest, pressed = self.statuses.get(run), self._newest.get(run), self.cells[run]
        ground = theme.mixed(COLOURS.panel, theme.STATUS[status] if status else COLOURS.line, 0.6).name()
        edge = "none"
        if run == self.marked:
            ground = COLOURS.accent if self.running else COLOURS.accent_ground
            edge = f"2px solid {COLOURS.text if self.running else COLOURS.accent}"
        look = f"background: {ground}; border: {edge}; border-radius: 3px; padding: 0; color: {COLOURS.text}"
        look = f"QPushButton {{ {look} }}"  # not its tooltip
        if look != pressed.styleSheet():
            pressed.setStyleSheet(look)
        pressed.setText(MARKS.get(status or "", ""))
        pressed.setToolTip(hint)
        pressed.setEnabled(newest is not None and bool(newest.recording))


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
