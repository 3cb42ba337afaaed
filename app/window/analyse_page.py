"""The page Analyse: what was recorded in a data folder, as points and boxes, and any trial of it beside them."""

import pickle
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from PySide6.QtCore import Qt, QUrl, Signal
from PySide6.QtGui import QDesktopServices, QResizeEvent
from PySide6.QtWidgets import (
    QApplication,
    QButtonGroup,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QMenu,
    QProgressBar,
    QPushButton,
    QScrollArea,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from app.ipc import messages as m
from app.window.box_plot import ChartPlot, trial_of
from app.window.flow import Flow
from app.window.page import Page
from app.window.painting import theme
from app.window.painting.labels import OneLine, line, word
from app.window.trial_view import TrialView
from app.window.work import Verb, Work
from core.files import InputError
from experiments.analysis.charts import ORDER, PERSON, POOLED, QUESTIONS, SPEED, View, charts, left_out
from experiments.analysis.findings import CANNOT_TELL, FAILS, HOLDS
from experiments.analysis.participants import people_of
from experiments.analysis.trials_table import STATUSES, TrialRow
from experiments.export.results import Conclusions, Job, Results, conclude, new_folder, read_results
from experiments.session.files import STORED
from experiments.session.playback import read_playback

FINDINGS = "findings"
PAGES = {
    POOLED: "Pooled", PERSON: "Per participant", ORDER: "Order and learning", SPEED: "Speed and error",
    QUESTIONS: "Questionnaire", FINDINGS: "Findings",
}  # fmt: skip
VERDICT = {HOLDS: "good", FAILS: "bad", CANNOT_TELL: "caution"}  # the look of each
SHOWN_FIRST = ("done", "timeout")  # of the statuses
MOST_CHIPS = 8  # more are a menu
SIDE_SHARE, SIDE_PX = 0.36, (400, 620)  # of the width, and at least and at most: the trial beside the charts
ROOM_PX = 1100  # a narrower page shows either the charts or the trial
CANCELLED = "The export was cancelled, nothing was written."
NO_FOLDER = "No data folder is open: choose one on Home."


class Chips(QWidget):
    """A filter: a chip for each choice, lit while it is shown; many of them are a menu."""

    changed = Signal()

    def __init__(self, title: str) -> None:
        super().__init__()
        self._title, self._off = title, set()
        self._names: dict[str, str] = {}
        self.chips: dict[str, QPushButton] = {}
        self._row = QHBoxLayout(self)
        self._row.setContentsMargins(0, 0, 0, 0)
        self._row.setSpacing(6)

    @property
    def chosen(self) -> set[str]:
        """What is to be shown."""
        return set(self._names) - self._off

    def show_choices(self, names: Mapping[str, str], off: Sequence[str] = ()) -> None:
        """What there is to choose from, and what it is called; off: what is not shown unless it is asked for."""
        if dict(names) == self._names:
            return
        self._off |= {choice for choice in off if choice not in self._names}
        self._names = dict(names)
        while (item := self._row.takeAt(0)) is not None:
            item.widget().deleteLater()
        self.chips = {}
        if len(names) > MOST_CHIPS:
            self._row.addWidget(self._menu())
            return
        self._row.addWidget(word(self._title, "quiet"))
        for choice, name in names.items():
            chip = QPushButton(name, objectName="toggle", checkable=True, checked=choice not in self._off)
            chip.setFocusPolicy(Qt.FocusPolicy.NoFocus)
            chip.toggled.connect(lambda on, choice=choice: self._switch(choice, on))
            self.chips[choice] = chip
            self._row.addWidget(chip)

    def _menu(self) -> QPushButton:
        button, menu = QPushButton(f"{self._title}: {len(self._names)}"), QMenu(self)
        for choice, name in self._names.items():
            action = menu.addAction(name)
            action.setCheckable(True)
            action.setChecked(choice not in self._off)
            action.toggled.connect(lambda on, choice=choice: self._switch(choice, on))
        button.setMenu(menu)
        return button

    def _switch(self, choice: str, on: bool) -> None:
        (self._off.discard if on else self._off.add)(choice)
        self.changed.emit()


class Verdicts(QScrollArea):
    """The paper's statements, each with what these data say of it; then what else the statistics say."""

    def __init__(self) -> None:
        super().__init__()
        self.setWidgetResizable(True)
        self.shown: Conclusions | None = None

    def show_conclusions(self, said: Conclusions | None) -> None:
        """None: they are being computed."""
        self.shown = said
        inside = QFrame(objectName="panel")
        grid = QGridLayout(inside)
        grid.setContentsMargins(16, 12, 16, 12)
        grid.setVerticalSpacing(8)
        grid.setHorizontalSpacing(16)
        grid.setColumnStretch(1, 2)
        grid.setColumnStretch(2, 3)
        self._row = 0

        def add(*widgets: QWidget) -> None:
            for column, widget in enumerate(widgets):
                grid.addWidget(widget, self._row, column, 1, 1 if len(widgets) > 1 else 3)
            self._row += 1

        if said is None:
            add(word("The statistics are being computed …", "quiet"))
        else:
            for warning in (*said.warnings, said.refusal):
                if warning:
                    add(line(warning, "caution"))
            if said.found:
                add(word("What these data say of the paper's statements", bold=True, size=theme.TITLE))
            for one in said.found:
                verdict = word(one.verdict, VERDICT[one.verdict], bold=True)
                add(verdict, line(one.statement.text), line(one.sentence, "quiet"))
            if said.sentences:
                add(word("What else to know", bold=True, size=theme.TITLE))
            for sentence in said.sentences:
                add(line(sentence))
        grid.setRowStretch(self._row, 1)
        self.setWidget(inside)


class AnalysePage(Page):
    """Everything of a data folder: of the open session's, or of one that was asked for."""

    def __init__(self, send: Callable[[object], None]) -> None:
        super().__init__(send)
        self.results: Results | None = None
        self.chosen: TrialRow | None = None  # the trial that is open
        self.page = POOLED
        self._asked: Path | None = None  # a folder, in place of the open session's
        self._folder = Path()  # that is shown or being read
        self._reading, self._opening, self._concluding = Work(), Work(), Work()
        self.tabs: dict[str, QPushButton] = {}
        self.people, self.devices, self.statuses = Chips("Participants"), Chips("Devices"), Chips("Trials")
        self.timeouts, self.logarithmic = (
            QPushButton(text, objectName="toggle", checkable=True) for text in ("Timeouts in the boxes", "Log scale")
        )
        for chips in (self.people, self.devices, self.statuses):
            chips.changed.connect(self._show)
        for toggle in (self.timeouts, self.logarithmic):
            toggle.setFocusPolicy(Qt.FocusPolicy.NoFocus)
            toggle.toggled.connect(self._show)
        self.summary, self.message = word("", "quiet"), OneLine("", "quiet")
        self.plots = [ChartPlot() for _ in range(3)]
        self.empty, self.verdicts, self.stack = line("", "quiet", theme.TITLE), Verdicts(), QStackedWidget()
        self.side = TrialView()
        self._reading.done.connect(self._show_results)
        self._concluding.done.connect(self.verdicts.show_conclusions)
        self._opening.done.connect(self.side.show_trial)
        self.side.closed.connect(self.close_trial)
        self.side.stepped.connect(self.step)
        for plot in self.plots:
            plot.chosen.connect(self.open_trial)
        self.report_button, self.export_button = QPushButton("Session report"), QPushButton("Export", objectName="main")
        self.report_button.setToolTip("A PDF of each session: who, when, plan, measures, timing, faults, figures")
        self.export_button.setToolTip("What is shown as PNG, SVG, PDF and CSV: Ctrl+E")
        self.export_button.clicked.connect(self.export)
        self.report_button.clicked.connect(lambda: self.export(report=True))
        self.bar, self.cancel_button = QProgressBar(textVisible=False), QPushButton("Cancel", objectName="small")
        self.folder_button = QPushButton("Open folder", objectName="small")
        self.folder_button.clicked.connect(
            lambda: QDesktopServices.openUrl(QUrl.fromLocalFile(str(self._job.folder)))
        )
        self._export, self._cancelled = Verb(), False
        self._job: Job | None = None  # the newest
        self._export.progressed.connect(lambda share: self.bar.setValue(round(100.0 * share)))
        self._export.done.connect(self._exported)
        self.cancel_button.clicked.connect(self.cancel_export)
        QApplication.instance().aboutToQuit.connect(self.cancel_export)
        self._lay_out()
        self._show_busy(False)
        self.side.hide()
        self._show_empty(NO_FOLDER)

    def _lay_out(self) -> None:
        head, tabs, filters, foot, body = QHBoxLayout(), Flow(2), Flow(14), QHBoxLayout(), QHBoxLayout()
        group = QButtonGroup(self)
        for page, name in PAGES.items():
            tab = QPushButton(name, objectName="key", checkable=True, checked=page == self.page)
            tab.setFocusPolicy(Qt.FocusPolicy.NoFocus)
            tab.clicked.connect(lambda _=False, page=page: self.show_page(page))
            group.addButton(tab)
            self.tabs[page] = tab
            tabs.addWidget(tab)
        head.addLayout(tabs, 1)
        for button in (self.report_button, self.export_button):
            head.addWidget(button, 0, Qt.AlignmentFlag.AlignTop)
        for widget in (self.people, self.devices, self.statuses, self.timeouts, self.logarithmic):
            filters.addWidget(widget)
        self.summary.setMinimumHeight(self.timeouts.sizeHint().height())
        filters.addWidget(self.summary)
        self._charts = QWidget()
        row = QHBoxLayout(self._charts)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(8)
        for plot in self.plots:
            row.addWidget(plot, 1)
        for widget in (self._charts, self.verdicts, self.empty):
            self.stack.addWidget(widget)
        body.setSpacing(8)
        body.addWidget(self.stack, 1)
        body.addWidget(self.side)
        self.bar.setFixedSize(160, 8)
        foot.addWidget(self.message, 1)
        for widget in (self.folder_button, self.bar, self.cancel_button):
            foot.addWidget(widget)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(8)
        for part in (head, filters):
            layout.addLayout(part)
        layout.addLayout(body, 1)
        layout.addLayout(foot)

    # what the main window hands over

    def show_opened(self, opened: m.Opened) -> None:
        if self.opened is not None and opened.folder != self.opened.folder:
            self._asked = None
        super().show_opened(opened)
        if self.isVisible() and self._asked is None:
            self._read(self._of_session())

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        grown = (snapshot.rows, snapshot.blind) != (self.snapshot.rows, self.snapshot.blind)
        super().show_snapshot(snapshot)
        if grown and self.isVisible() and self._folder == self._of_session():
            self._read(self._folder)

    def begin(self, what: object = None) -> None:
        """What: a data folder, a study's or a session's; or a recording. Without: the open session's data folder."""
        if what is not None:
            path = Path(str(what))
            recording = path if path.is_file() else None
            self._asked = data_folder_of(path) if recording else path
            if recording:
                self._open(recording)
        self._read(self._asked or self._of_session())

    def end(self) -> None:
        self.side.end()

    def cancel(self) -> bool:
        """Esc closes the trial beside the charts."""
        if not self.side.isVisible():
            return False
        self.close_trial()
        return True

    def keys(self) -> dict[str, Callable[[], object]]:
        return {"export": self.export, **({"start": self.side.play_or_pause} if self.side.isVisible() else {})}

    def _of_session(self) -> Path:
        """The data folder of the open session (DATA/sub-01/ses-01), or the one where sessions will be."""
        if self.opened is None or not self.opened.folder:
            return Path()
        folder = Path(self.opened.folder)
        return folder.parent.parent if self.opened.participant else folder

    # reading

    def _read(self, folder: Path) -> None:
        if folder == Path():
            self._show_empty(NO_FOLDER)
            return
        if folder != self._folder:
            self.results = None
            self._show_empty(f"Reading {folder} …")
        self._folder = folder
        self._reading.ask(read_results, folder)

    def _show_results(self, results: Results | InputError) -> None:
        if isinstance(results, InputError):
            self._show_empty(str(results))
            return
        self.results = results
        count = {who: sum(row.participant == who for row in results.rows) for who in people_of(results.rows)}
        planned = {who: results.planned.get(who, 0) for who in count}
        self.people.show_choices({
            who: f"P{who}" if n >= planned[who] else f"P{who} {n} of {planned[who]}" for who, n in count.items()
        })  # fmt: skip
        self.devices.show_choices({name: name for name in results.configurations})
        there = {row.status for row in results.rows if row.recording}
        statuses = [status for status in STATUSES if status in there or status in SHOWN_FIRST]
        self.statuses.show_choices(
            {status: status for status in statuses}, [status for status in statuses if status not in SHOWN_FIRST]
        )
        self.message.setText(" ".join(results.problems))
        theme.name_anew(self.message, "caution")
        self._show()

    # what is shown

    @property
    def rows(self) -> tuple[TrialRow, ...]:
        """The trials that the filters let through."""
        if self.results is None:
            return ()
        people, devices, statuses = self.people.chosen, self.devices.chosen, self.statuses.chosen
        return tuple(
            row
            for row in self.results.rows
            if row.participant in people and row.configuration in devices and row.status in statuses
        )

    @property
    def view(self) -> View:
        """How they are shown."""
        results = self.results
        devices = tuple(name for name in results.configurations if name in self.devices.chosen)
        on = self.timeouts.isChecked(), self.logarithmic.isChecked()
        return View(devices or results.configurations, results.labels, results.lengths, *on)

    def show_page(self, page: str) -> None:
        """One of `PAGES`."""
        self.page = page
        self.tabs[page].setChecked(True)
        self._show()

    def _show(self) -> None:
        results, rows = self.results, self.rows
        self.export_button.setEnabled(bool(rows) and not self._export.busy)
        self.report_button.setEnabled(bool(results and results.sessions and rows) and not self._export.busy)
        if results is None:
            return
        people, late = len(people_of(rows)), sum(row.status == "timeout" for row in rows)
        parts = [count_of(people, "participant"), count_of(len(rows), "trial"), f"{late} timed out"]
        self.summary.setText(" · ".join(parts if late else parts[:2]))
        if not results.rows:
            self._show_empty(f"Nothing is recorded in {results.folder} yet.")
        elif self.page == FINDINGS:
            self.stack.setCurrentWidget(self.verdicts)
            self.verdicts.show_conclusions(None)
            self._concluding.ask(conclude, rows, results.controllers, self.timeouts.isChecked())
        else:
            self._show_charts(rows)
        self._make_room()

    def _show_charts(self, rows: Sequence[TrialRow]) -> None:
        answers = [answer for answer in self.results.answers if answer.participant in self.people.chosen]
        shown = charts(self.page, rows, self.view, answers)
        if not shown:
            self._show_empty("No questionnaire was answered in these sessions.")
            return
        self.stack.setCurrentWidget(self._charts)
        warning = "" if self.page == QUESTIONS else left_out(rows, *self.view.timeouts_on(shown[0]))
        for plot, chart in zip(self.plots, shown, strict=False):
            plot.show_chart(chart, self.view, warning)
            plot.show_ring(trial_of(self.chosen))
        for plot in self.plots:
            plot.setVisible(plot in self.plots[: len(shown)])

    def _show_empty(self, text: str) -> None:
        self.empty.setText(text)
        self.stack.setCurrentWidget(self.empty)
        if self.results is None:
            self.summary.setText("")
            self.export_button.setEnabled(False)
            self.report_button.setEnabled(False)

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._make_room()
        super().resizeEvent(event)

    def _make_room(self) -> None:
        """The trial beside the charts, or in their place where there is no room for both."""
        narrow = self.width() < ROOM_PX
        least, most = SIDE_PX
        width = self.width() if narrow else int(min(max(SIDE_SHARE * self.width(), least), most))
        self.side.setMinimumWidth(min(width, least))
        self.side.setMaximumWidth(width)
        self.stack.setVisible(not (narrow and self.side.isVisibleTo(self)))

    # one trial

    def open_trial(self, row: TrialRow) -> None:
        """Beside the charts, and ringed in all of them."""
        self.chosen = row
        self.side.show_row(row)
        if row.recording:
            self._open(self.results.folder / row.recording)
        self.side.show()
        for plot in self.plots:
            plot.show_ring(trial_of(row))
        self._make_room()

    def _open(self, recording: Path) -> None:
        self._opening.ask(read_playback, recording)
        self.side.show()
        self._make_room()

    def close_trial(self) -> None:
        """The charts have the whole page."""
        self.chosen = None
        self.side.end()
        self.side.hide()
        for plot in self.plots:
            plot.show_ring(None)
        self._make_room()

    def step(self, by: int) -> None:
        """The next trial of those that are shown, or the one before."""
        rows = sorted(self.rows, key=lambda row: (row.participant, row.run))
        at = next((i for i, row in enumerate(rows) if trial_of(row) == trial_of(self.chosen)), -1 if by > 0 else 0)
        if rows:
            self.open_trial(rows[(at + by) % len(rows)])

    # export

    def export(self, report: bool = False) -> None:
        """What is seen, or the reports of the sessions that are seen, into a new folder of the data folder."""
        results, rows = self.results, self.rows
        if results is None or not rows or self._export.busy or (report and not results.sessions):
            return
        people = set(people_of(rows))
        sessions = [one for one in results.sessions if one.parent.name.removeprefix("sub-") in people]
        answers = tuple(answer for answer in results.answers if answer.participant in people)
        page = self.page if self.page != FINDINGS else POOLED
        folder = new_folder(results.folder)  # there when all of it has been written
        self._job = Job(page, rows, answers, self.view, results.note, results.folder, tuple(sessions), folder, report)
        self._show_busy(True)
        self._cancelled = False
        self._export.begin(module="app.window.export", given=pickle.dumps(self._job))

    def cancel_export(self) -> None:
        """Stop now; nothing is left behind."""
        self._cancelled = True
        self._export.stop(wait=True)

    def _exported(self, end: str | InputError) -> None:
        folder = self._job.folder
        done = folder.exists()
        if not done:  # killed: what it had begun is removed in its place
            shutil.rmtree(self._job.partial, ignore_errors=True)
        self._show_busy(False)
        failed = CANCELLED if self._cancelled else f"Nothing was written: {end}"
        self.message.setText(str(end) if done else failed)
        theme.name_anew(self.message, "good" if done else "caution")
        self.folder_button.setVisible(done)

    def _show_busy(self, busy: bool) -> None:
        self.bar.setValue(0)
        self.folder_button.hide()
        for widget in (self.bar, self.cancel_button):
            widget.setVisible(busy)
        for button in (self.export_button, self.report_button):
            button.setEnabled(not busy and bool(self.rows))

    def closeEvent(self, event) -> None:
        self.side.end()
        self.cancel_export()
        super().closeEvent(event)


def count_of(number: int, word: str) -> str:
    """As "1 trial", "2 trials"."""
    return f"{number} {word}{'s' if number != 1 else ''}"


def data_folder_of(recording: Path) -> Path | None:
    """The data folder of DATA/sub-01/ses-01/trials/run-001.parquet; None: the recording stands by itself."""
    session = recording.resolve().parent.parent
    return session.parent.parent if (session / STORED).exists() else None
