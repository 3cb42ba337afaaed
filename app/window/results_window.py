"""The results as they grow: three box plots, pooled or of one participant, what they say, and their export."""

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtGui import QCloseEvent, QKeyEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QProgressBar, QPushButton, QVBoxLayout, QWidget

from app.ipc import messages as m
from app.window.box_plot import BoxPlot
from app.window.export import Export, Job, new_folder
from app.window.painting import theme
from app.window.painting.labels import Choice, OneLine, word
from core.files import InputError
from experiments.analysis.findings import CANNOT_TELL, FAILS, HOLDS, Finding, findings, why_no_findings
from experiments.analysis.metrics import DRAWN
from experiments.analysis.participants import people_of, too_few
from experiments.analysis.trials_table import COUNTED, TrialRow
from experiments.protocol import label
from experiments.session.files import pooled_rows

POOLED = "All participants"
VERDICT = {HOLDS: "good", FAILS: "bad", CANNOT_TELL: "caution"}  # the look of each
LARGEST = (1280, 720)  # px, as it opens


class Verdicts(QFrame):
    """The paper's statements, each with what these data say of it."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent, objectName="panel")
        self.found: list[Finding] = []
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(12, 6, 12, 6)
        self._grid.setVerticalSpacing(2)
        self.show_found([])

    def show_found(self, found: Sequence[Finding]) -> None:
        """New verdicts, in two columns."""
        self.found = list(found)
        while (item := self._grid.takeAt(0)) is not None:
            item.widget().hide()
            item.widget().deleteLater()
        self._grid.addWidget(word("What these data say", bold=True), 0, 0, 1, 2)
        if not self.found:
            self._grid.addWidget(word("nothing yet: no trial is done", "quiet", theme.SMALL), 1, 0, 1, 2)
        half = -(-len(self.found) // 2)
        for i, finding in enumerate(self.found):
            verdict = word(finding.verdict, VERDICT[finding.verdict], theme.SMALL)
            self._grid.addWidget(verdict, 1 + i % half, 2 * (i // half))
            text = OneLine(finding.statement.text, dots=Qt.TextElideMode.ElideRight)
            self._grid.addWidget(text, 1 + i % half, 2 * (i // half) + 1)
        for column in (1, 3):
            self._grid.setColumnStretch(column, 1)


class ResultsWindow(QWidget):
    """Everything that was recorded in a data folder, as far as it is known to be counted."""

    escaped = Signal(bool)  # Esc, in the list of participants or not: whether it stops a trial is not known here

    def __init__(self, opened: m.Opened, snapshot: m.Snapshot, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("phd: results")
        self._opened, self._snapshot = opened, snapshot
        self.data_dir = Path(opened.folder).parent.parent  # DATA/sub-01/ses-01
        self._devices = tuple(device.name for device in opened.devices)
        controllers = {number: preset.name for number, preset in opened.controllers.items()}
        self._labels = {number: label(name) for number, name in controllers.items()}
        self.rows: tuple[TrialRow, ...] = ()
        self._unread = ""  # why the tables of the data folder could not be read
        self.title, self.summary = word("Results", size=theme.HEAD, bold=True), OneLine("", "quiet")
        self.whose = Choice()
        self.whose.addItem(POOLED)
        self.whose.setMinimumWidth(170)
        self.whose.currentTextChanged.connect(self._show)
        self.boxes = [BoxPlot(metric, self._devices, controllers) for metric in DRAWN]
        self.verdicts = Verdicts()
        self.said = OneLine("", "caution")
        self.bar = QProgressBar()
        self.bar.setTextVisible(False)
        self.bar.setFixedSize(140, 8)
        self.export_button = QPushButton("Export PNG · SVG · PDF · CSV  E")
        QShortcut(QKeySequence("E"), self, self.export)
        self.cancel_button = QPushButton("Cancel")
        self.export_button.clicked.connect(self.export)
        self._export = Export(self)
        self.cancel_button.clicked.connect(self._export.cancel)
        self._export.progressed.connect(lambda share: self.bar.setValue(round(100.0 * share)))
        self._export.ended.connect(self._exported)
        QShortcut(QKeySequence(Qt.Key.Key_Escape), self, lambda: self.escaped.emit(False))
        self.whose.view().installEventFilter(self)
        self._lay_out()
        self._show_busy(False)
        self.resize(*LARGEST)
        self.refresh()

    def _lay_out(self) -> None:
        head, middle, foot = QHBoxLayout(), QHBoxLayout(), QHBoxLayout()
        head.setSpacing(theme.GAP)
        head.addWidget(self.title)
        head.addWidget(self.summary, 1)
        head.addWidget(self.whose)
        middle.setSpacing(theme.GAP)
        for plot in self.boxes:
            middle.addWidget(plot, 1)
        foot.setSpacing(theme.GAP)
        foot.addWidget(self.said, 1)
        for widget in (self.bar, self.cancel_button, self.export_button):
            foot.addWidget(widget)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(16, 12, 16, 12)
        layout.setSpacing(theme.GAP)
        layout.addLayout(head)
        layout.addLayout(middle, 1)
        layout.addWidget(self.verdicts)
        layout.addLayout(foot)

    # what is shown

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        """The session went on: a trial more, or the key was opened."""
        if (snapshot.rows, snapshot.blind) != (self._snapshot.rows, self._snapshot.blind):
            self._snapshot = snapshot
            self.refresh()

    def refresh(self) -> None:
        """Read the tables of the data folder anew."""
        try:
            self.rows = tuple(pooled_rows(self.data_dir)) or self._snapshot.rows
            self._unread = ""
        except InputError as error:  # of this session at least the window knows the rows
            self.rows, self._unread = self._snapshot.rows, str(error)
        people = [POOLED, *people_of(self.rows)]
        if people != [self.whose.itemText(i) for i in range(self.whose.count())]:
            chosen = self.whose.currentText()
            self.whose.blockSignals(True)
            self.whose.clear()
            self.whose.addItems(people)
            self.whose.setCurrentText(chosen if chosen in people else POOLED)
            self.whose.blockSignals(False)
        self._show()

    @property
    def shown(self) -> tuple[TrialRow, ...]:
        """The rows of whom is chosen."""
        chosen = self.whose.currentText()
        return tuple(row for row in self.rows if chosen == POOLED or row.participant == chosen)

    def _show(self) -> None:
        rows = self.shown
        counted = [row for row in rows if row.status in COUNTED]
        people = people_of(rows)
        coded = any(isinstance(row.controller, str) for row in counted)
        who = f"{len(people)} participant{'' if len(people) == 1 else 's'}"
        trials = f"{len(counted)} trial{'' if len(counted) == 1 else 's'}"
        self.summary.setText(" · ".join(part for part in (who, trials, self._opened.note) if part))
        for plot in self.boxes:
            plot.show_rows(rows)
        refusal = why_no_findings(self._opened.controllers, coded)
        self.verdicts.setVisible(not refusal)
        self.verdicts.show_found(findings(rows) if counted and not refusal else [])
        theme.name_anew(self.said, "caution")
        self.said.setText(self._unread or refusal or (too_few(len(people)) if counted else ""))
        self.export_button.setEnabled(bool(counted) and not self._export.busy)

    # export

    def export(self) -> None:
        """All rows that are shown, into a new folder of the data folder."""
        if self._export.busy or not self.shown:
            return
        self._show_busy(True)
        self._folder = new_folder(self.data_dir)  # there when all of it has been written
        opened = self._opened
        job = Job(self.shown, self.data_dir, self._folder, opened.note, self._devices, self._labels, opened.protocol)
        self._export.start(job)

    def _exported(self, sentence: str) -> None:
        self._export.wait()
        self._show_busy(False)
        self.said.setText(sentence)
        theme.name_anew(self.said, "good" if self._folder.exists() else "caution")

    def _show_busy(self, busy: bool) -> None:
        self.bar.setValue(0)
        self.bar.setVisible(busy)
        self.cancel_button.setVisible(busy)
        self.export_button.setEnabled(not busy and bool(self.rows))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The list that has dropped down keeps its keys from the window."""
        if event.type() == QEvent.Type.KeyPress and isinstance(event, QKeyEvent) and event.key() == Qt.Key.Key_Escape:
            self.escaped.emit(True)
        return super().eventFilter(watched, event)

    def closeEvent(self, event: QCloseEvent) -> None:
        self._export.cancel()
        self._export.wait()
        super().closeEvent(event)
