"""The page Analyse: what was recorded in a data folder, as points and boxes, and any trial of it alone."""

import pickle
import shutil
from collections import Counter
from collections.abc import Callable
from html import escape
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import QGridLayout, QProgressBar, QWidget

from app.ipc import messages as m
from app.window.analyse.box_plot import SHAPES, ChartPlot, trial_of
from app.window.analyse.chips import Chips
from app.window.analyse.force_plot import ForcePlot
from app.window.analyse.trial_view import TrialView
from app.window.widgets import theme
from app.window.widgets.cards import EXCLUDE, Cards
from app.window.widgets.page import Page
from app.window.widgets.parts import (
    PART,
    Choice,
    Flow,
    OneLine,
    Segments,
    button,
    column,
    holder,
    keep_room,
    row,
    stack,
    toggle,
    wrapped_label,
)
from app.window.widgets.preflight import sentence, wrong
from app.window.widgets.theme import COLOURS, colour_at, colour_of
from app.window.widgets.words import STATUS_WORDS, data_folder_of, from_home, in_colour
from app.window.widgets.work import BackgroundTask, VerbProcess
from core.files import InputError
from experiments.analysis.charts import (
    ORDER,
    PERSON,
    POOLED,
    QUESTIONS,
    SPEED,
    View,
    charts,
    coloured,
    left_out,
    legend,
    paths_of,
)
from experiments.analysis.colours import colour_places
from experiments.analysis.metrics import DRAWN
from experiments.analysis.statistics import people_of
from experiments.analysis.trials_table import STATUSES, TrialRow, Trials, as_rows
from experiments.atomic_files import first_free, partial_name
from experiments.export.results import Results, ResultsJob, read_results
from experiments.inputs import INPUTS
from experiments.plan import counted
from experiments.store.cells import finished_cells, trial_names
from experiments.store.files import relative_to
from experiments.store.journal import exclude_run
from experiments.study.playback import Playback, read_playback

TRIAL = "trial"
PAGES = {POOLED: "Pooled", PERSON: "Per participant", TRIAL: "One trial"}
AXES = {POOLED: "by controller", ORDER: "by order of trials", SPEED: "by speed"}  # of `POOLED`
QUESTION_AXIS = {QUESTIONS: "by question"}  # where a questionnaire was answered
SHOWN_FIRST = ("done", "timeout")  # of the statuses
MOST_CHARTS = 4  # beside each other; three where the protocol has no measures of its own
CANCELLED = "The export was cancelled, nothing was written."
NO_ANSWERS = "None of the chosen participants answered a questionnaire."


class AnalysePage(Page):
    """Everything of a data folder: of the open session's, or of one that was asked for."""

    _job: ResultsJob  # of the newest export, once there was one

    def __init__(self, send: Callable[[object], None]) -> None:
        super().__init__(send)
        self.results: Results | None = None
        self.chosen: TrialRow | None = None  # the trial that is open, or was last: ringed in the charts
        self._charted = POOLED  # of the pages of charts the one that is shown, or was last
        self._asked: Path | None = None  # a folder, in place of the open session's
        self._folder = self._data_dir = Path()  # that is shown or being read; of the session server
        self._reading, self._opening = BackgroundTask(self.show_results), BackgroundTask(self._show_trial)
        self._excluding = BackgroundTask(self._excluded)
        self.tabs = Segments(PAGES)
        self.tabs.changed.connect(self.show_page)
        self.axis = Choice()
        self.axis.fill(AXES, POOLED)
        self.axis.activated.connect(lambda _: self._show())
        self.people, self.devices, self.statuses = Chips("Participants"), Chips("Devices"), Chips("Trials")
        self.measures = Chips("Measures")  # where the protocol has some of its own
        self.timeouts = toggle("Timeouts in the boxes", lambda _: self._show())
        # Our choice: the paper's axis is linear; there the error without control, ten times the others', flattens them
        self.logarithmic = toggle("Path error: log scale", lambda _: self._show(), on=True)
        for chips in (self.people, self.devices, self.statuses, self.measures):
            chips.changed.connect(self._show)
        self.source, self.message = OneLine("", "quiet"), OneLine()
        self.plots = [ChartPlot() for _ in range(MOST_CHARTS)]
        self.empty = wrapped_label("", "quiet", theme.TITLE)
        self.empty.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.legend = wrapped_label("", size=theme.SMALL)  # which controller is which, marks, what is left out
        self.legend.setTextFormat(Qt.TextFormat.RichText)
        self.force, self.places = ForcePlot(), QGridLayout()
        self.places.setSpacing(theme.GAP)
        for place, plot in enumerate((*self.plots, self.force)):
            self.places.addWidget(plot, 0, place)
        self.charts = holder(column((self.places, 1), self.legend))
        self.side = TrialView()
        self.stack = stack(self.charts, self.empty, self.side)
        self.side.exclude_asked.connect(self.exclude)
        self.side.stepped.connect(self.step)
        for plot in self.plots:
            plot.chosen.connect(self.open_trial)
        report = "A PDF of each session: who, when, plan, measures, timing, faults, figures"
        self.report_button = button("Session report", lambda: self.export(report=True), hint=report)
        files = "The charts as PNG, SVG and PDF, the trials as CSV: Ctrl+E"
        self.export_button = button("Export", self.export, hint=files)
        self.export_task, self.bar = VerbProcess(self._exported), QProgressBar(textVisible=False, maximum=1000)
        self.export_task.progressed.connect(self.bar.setValue)
        self.cancel_button = button("Cancel", lambda: self.export_task.stop(wait=True), "small")
        self.bar.setFixedSize(160, 8)
        self.folder_button = button("Open folder", lambda: self.folder_asked.emit(self._job.folder), "small")
        keep_room(self.cancel_button)
        self._lay_out()
        self.tabs.show_value(POOLED)
        self.cards = Cards(self)
        self.folder_button.hide()
        self._show_empty("")
        theme.follow(self._show)

    def _lay_out(self) -> None:
        head = row(self.tabs, self.axis, 1, self.report_button, self.export_button)
        for pressed in (self.report_button, self.export_button):
            head.setAlignment(pressed, Qt.AlignmentFlag.AlignTop)
        foot = row(self.source, self.folder_button, self.message, self.bar, self.cancel_button)
        chips = self.people, self.devices, self.statuses, self.measures
        self.filters = holder(Flow(*chips, self.logarithmic, self.timeouts, gap=14))
        self.setLayout(column(head, self.filters, (self.stack, 1), foot, spacing=8, margins=(0, 0, 0, 6)))

    @property
    def says_what_is_wrong(self) -> bool:
        """The window's footer is of the open session, not of what is shown here: it is there while a trial runs."""
        return not wrong(self.snapshot) and self.snapshot.running is None

    # what the main window hands over

    def show_setup(self, setup: m.Setup) -> None:
        self._data_dir, self.opened = setup.data_dir, None

    def show_opened(self, opened: m.Opened) -> None:
        if self.opened is not None and opened.folder != self.opened.folder:
            self._asked = None
        super().show_opened(opened)
        if self.isVisible() and self._asked is None:
            self._read(self._of_session())

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        before = self.snapshot
        grown = (snapshot.rows, snapshot.blind) != (before.rows, before.blind)
        super().show_snapshot(snapshot)
        if grown and self.isVisible() and self._of_session() in (self._folder, *self._folder.parents):
            self._read(self._folder)
        if snapshot.notice_bad and snapshot.notice != before.notice and self.side.isVisible():
            self.side.note_that(snapshot.notice, bad=True)

    def begin(self, what: object = None) -> None:
        """What: a data folder, a study's or a session's; or its recording. Without: the open session's data folder."""
        path = Path(str(what or ""))
        if what is not None:
            self._asked = data_folder_of(path.resolve().parent.parent) if path.is_file() else path
        self._read(self._asked or self._of_session())
        if path.is_file():
            self._opening.ask(read_playback, path)
            self.tabs.show_value(TRIAL)

    def end(self) -> None:
        self.side.end()

    def to_close(self) -> Callable[[], object] | None:
        """What is asked, else the trial."""
        return (
            self.cards.to_close() or self.side.cards.to_close() or (self.close_trial if self.side.isVisible() else None)
        )

    def keys(self) -> dict[str, Callable[[], object]]:
        of_trial = {"start": self.side.play_or_pause, "exclude": self.exclude} if self.side.isVisible() else {}
        return {"export": self.export, **of_trial}

    def own_keys(self) -> dict[str, str]:
        """Those of the player, which has them from a click on it on."""
        return {key: does for key, (does, _) in self.side.keys().items()} if self.side.isVisible() else {}

    def _of_session(self) -> Path:
        """The data folder of the open session (DATA/sub-01/ses-01), or the one where sessions will be."""
        if self.opened is None or not self.opened.folder:
            return self._data_dir
        folder = Path(self.opened.folder)
        return folder.parent.parent if self.opened.participant else folder

    # reading

    def _read(self, folder: Path) -> None:
        if folder != self._folder:
            self.results = self.chosen = None
            self.tabs.show_value(self._charted)
            self._show_empty(f"Reading {folder} …")
        self._folder = folder
        self._reading.ask(read_results, folder)

    def show_results(self, results: Results | InputError) -> None:
        if isinstance(results, InputError):
            self._show_empty(f"{results}. Open another on Home, under Data.")
            return
        self.results = results
        rows = as_rows(results.trials)
        self.people.show_choices({who: who for who in people_of(results.trials)})
        self.devices.show_choices({name: name for name in results.configurations})
        recorded = {row.status for row in rows if row.recording}
        statuses = [status for status in STATUSES if status in recorded]
        self.statuses.show_choices(
            {status: STATUS_WORDS.get(status, status) for status in statuses},
            [status for status in statuses if status not in SHOWN_FIRST],
        )
        offered = {metric.name: metric.title for metric in (*DRAWN, *results.own)} if results.own else {}
        self.measures.show_choices(offered, list(offered)[MOST_CHARTS:])
        unread = [sentence(problem) for problem in results.problems if rows]  # else they stand in the middle
        self.show_message(PART.join(unread), "caution")
        self.message.setToolTip("\n".join(unread))
        axes, axis = AXES | (QUESTION_AXIS if results.answers else {}), self.axis.value()
        self.axis.fill(axes, axis if axis in axes else POOLED)
        self._show()
        now = next((row for row in rows if trial_of(row) == trial_of(self.chosen)), None)
        before = self.chosen if self.tabs.value() == TRIAL else None
        if before is not None and now is not None and now.status != before.status:
            self.open_trial(now)

    # what is shown

    @property
    def trials(self) -> "Trials | None":
        """The trials that the filters let through; None: nothing is read."""
        if self.results is None:
            return None
        trials = self.results.trials
        return trials[
            trials["participant"].isin(self.people.chosen)
            & trials["configuration"].isin(self.devices.chosen)
            & trials["status"].isin(self.statuses.chosen)
        ]

    def view(self, results: Results) -> View:
        """Devices and switches as the charts take them."""
        devices = tuple(name for name in results.configurations if name in self.devices.chosen)
        on = self.timeouts.isChecked(), self.logarithmic.isChecked()
        measures = tuple(metric for metric in (*DRAWN, *results.own) if metric.name in self.measures.chosen)
        shown = measures[:MOST_CHARTS] or DRAWN
        colours = colour_places(results.controllers)
        names = trial_names(as_rows(results.trials))
        return View(devices or results.configurations, results.labels, results.lengths, *on, shown, colours, names)

    def show_page(self, page: str) -> None:
        """One of `PAGES`, or of the axes of the first."""
        self.tabs.show_value(page if page in PAGES else POOLED)
        if page != POOLED:  # whose axis stays as it was chosen
            self.axis.show_value(page)
        if page == TRIAL and self.chosen is None:
            self.step(1)
        if page != TRIAL:
            self.side.end()
            self._charted = self.tabs.value()
        self._show()

    @property
    def page(self) -> str:
        """The page of charts that is chosen, as `charts` has it."""
        return PERSON if self._charted == PERSON else self.axis.value()

    def _show(self) -> None:
        """What page, filters and switches say."""
        results, trials = self.results, self.trials
        if results is None or trials is None:
            return
        if not len(results.trials):
            unread = [f"No trial in {results.folder} can be read.", "", *map(sentence, results.problems)]
            nothing = f"Nothing is recorded in {results.folder} yet."
            self._show_empty("\n".join(unread) if results.problems else nothing)
        elif not len(trials):
            self._show_empty("None of the trials is chosen: the filters above leave all of them out.")
        else:
            self._show_charts(results, trials)
        if self.tabs.value() == TRIAL and self.chosen is not None:
            self.stack.setCurrentWidget(self.side)
        self._offer()

    def _show_charts(self, results: Results, trials: Trials) -> None:
        answers = [answer for answer in results.answers if answer.participant in self.people.chosen]
        view = self.view(results)
        shown = charts(self.page, trials, view, answers)
        if not shown:
            self._show_empty(NO_ANSWERS)
            return
        self.stack.setCurrentWidget(self.charts)
        named = {
            controller: escape(f" {name}").replace(" ", "\u00a0") for controller, name in coloured(shown, view).items()
        }
        lines = [
            " &nbsp; ".join(
                in_colour("●", colour_at(view.colours.get(controller))) + name for controller, name in named.items()
            )
        ]
        tried = trials[trials["status"] != "excluded"]  # that one is not shown unless it is asked for
        left = left_out(tried, *view.timeouts_on(shown[0])) if self.page != QUESTIONS else ""
        paths = paths_of(shown)
        shapes = [f"{SHAPES[path - 1]} path {path}." for path in paths if 1 < len(paths) and path <= len(SHAPES)]
        if self.page == POOLED:
            self.force.show_marks(trials, view)
        how = " ".join([*legend(shown[0], view), *shapes, self.force.meaning() if self.page == POOLED else ""])
        for text, colour in ((how, COLOURS.quiet), (left, COLOURS.caution)):
            lines.append(in_colour(text, colour) if text else "")
        self.legend.setText(f"<div style='line-height: 135%'>{'<br>'.join(filter(None, lines))}</div>")
        for plot, chart in zip(self.plots, shown, strict=False):
            plot.show_chart(chart)
            plot.show_ring(trial_of(self.chosen))
        seen: list[QWidget] = [*self.plots[: len(shown)], *[self.force][: self.page == POOLED]]
        columns = 2 if len(seen) == 4 else max(len(seen), 1)
        for place, widget in enumerate(seen):
            self.places.addWidget(widget, *divmod(place, columns))
        for each in (*self.plots, self.force):
            each.setVisible(each in seen)

    def _show_empty(self, text: str) -> None:
        self.empty.setText(text)
        self.stack.setCurrentWidget(self.empty)
        self._offer()

    def _offer(self) -> None:
        """What can be done with what is shown, and nothing else."""
        results, trials, page = self.results, self.trials, self.stack.currentWidget()
        shown = 0 if trials is None else len(trials)
        self.source.setText("" if results is None else source_of(results, trials))
        self.source.setToolTip("" if results is None else "\n".join(map(str, (results.folder, *results.sessions))))
        late = 0 if trials is None else int((trials["status"] == "timeout").sum())
        busy = self.export_task.busy
        self.filters.setVisible(self.tabs.value() != TRIAL)
        self.tabs.setEnabled(results is not None and len(results.trials) > 0)
        self.axis.setVisible(self.tabs.value() == POOLED and self.tabs.isEnabled())
        self.logarithmic.setVisible(page is self.charts)
        self.timeouts.setVisible(late > 0 and page is not self.empty and self.page != QUESTIONS)
        for widget in (self.bar, self.cancel_button):
            widget.setVisible(busy)
        self.export_button.setEnabled(page is not self.empty and not busy)
        self.report_button.setEnabled(shown > 0 and not busy and results is not None and bool(results.sessions))

    # one trial

    def open_trial(self, row: TrialRow) -> None:
        """In place of the charts; it is ringed in all of them."""
        self.chosen = row
        if self.results is not None:
            name = trial_names(as_rows(self.results.trials)).get((row.participant, row.run), "")
            self.side.show_row(row, name, colour_of(row.controller, self.results.controllers))
        if row.recording and self.results is not None:
            self._opening.ask(read_playback, self.results.folder / row.recording)
        self.tabs.show_value(TRIAL)
        self.stack.setCurrentWidget(self.side)
        self._offer()

    def _show_trial(self, trial: Playback | InputError) -> None:
        self.side.show_trial(trial)
        if isinstance(trial, Playback) and trial.row is not None:
            self.chosen = trial.row
        self.stack.setCurrentWidget(self.side)
        self._offer()

    def close_trial(self) -> None:
        """Back to the charts, in which it is ringed."""
        self.show_page(self._charted)

    def step(self, by: int) -> None:
        """The next trial of those that are shown, or the one before."""
        rows = [] if self.trials is None else as_rows(self.trials.sort_values(["participant", "run"], kind="stable"))
        at = next((i for i, row in enumerate(rows) if trial_of(row) == trial_of(self.chosen)), -1 if by > 0 else 0)
        if rows:
            self.open_trial(rows[(at + by) % len(rows)])

    def exclude(self) -> None:
        """Ask why, then take the trial that is shown out of every result."""
        trial = self.side.trial
        if trial is not None and trial.row is not None and self.side.exclude.isVisible():
            self.cards.ask(
                EXCLUDE._replace(title=f"Exclude {trial.title}?"), lambda reason: self._exclude(trial, reason)
            )

    def _exclude(self, trial: Playback, reason: str) -> None:
        """By the session server if it has the session, else here."""
        assert trial.row is not None
        session = trial.path.resolve().parent.parent
        if self.opened is not None and self.opened.participant and Path(self.opened.folder).resolve() == session:
            self.send(m.Exclude(trial.row.run, reason))
        else:
            self._excluding.ask(exclude_run, session, trial.row.run, reason)

    def _excluded(self, refused: InputError | None) -> None:
        if refused is not None:
            self.side.note_that(str(refused), bad=True)
        else:
            self._read(self._folder)

    # export

    def export(self, report: bool = False) -> None:
        """What is seen, or the reports of the sessions that are seen, into a new folder of the data folder."""
        results, trials = self.results, self.trials
        if results is None or trials is None or not (self.report_button if report else self.export_button).isEnabled():
            return
        people = set(people_of(trials))
        sessions = [session for session in results.sessions if session.parent.name.removeprefix("sub-") in people]
        answers = tuple(answer for answer in results.answers if answer.participant in people)
        folder = first_free(data_folder_of(results.folder), "results")  # there when all of it has been written
        given = trials, answers, self.view(results), results.note, results.folder, tuple(sessions), folder, report
        self._job = ResultsJob(self.page, *given)
        self.export_task.begin(module="app.window.analyse.export", given=pickle.dumps(self._job))
        self.bar.setValue(0)
        self._offer()
        self.show_message(f"Writing the {'reports' if report else 'charts and tables'} …", "quiet")

    def _exported(self, end: str | InputError) -> None:
        folder = self._job.folder
        done = folder.exists()
        if not done:  # killed: what it had begun is removed in its place
            shutil.rmtree(partial_name(self._job.folder), ignore_errors=True)
        self._offer()
        failed = CANCELLED if self.export_task.stopped else f"Nothing was written: {end}"
        self.show_message(str(end).strip() if done else failed, "good" if done else "caution")
        self.folder_button.setVisible(done)

    def show_message(self, text: str, look: str) -> None:
        theme.set_style(self.message, look)
        self.message.setText(text)
        self.message.setVisible(bool(text))  # else the source has its room
        self.folder_button.hide()  # it is of the message before

    def closeEvent(self, event: QCloseEvent) -> None:
        self.side.end()
        self.export_task.stop(wait=True)
        super().closeEvent(event)


def source_of(results: Results, trials: "Trials | None") -> str:
    """Whose results are shown: the folder, its sessions, how many trials; those that are not shown, and why."""
    rows, shown = as_rows(results.trials), set() if trials is None else {trial_of(row) for row in as_rows(trials)}
    names = [relative_to(results.folder, f"{session}") for session in results.sessions if session != results.folder]
    which = counted(len(names), "session") if len(names) > 1 else "".join(names)
    hidden = Counter(row.status for row in rows if trial_of(row) not in shown)
    why = [f"{n} {STATUS_WORDS.get(status, status)}" for status, n in hidden.items()]
    done = sum(len(finished_cells(row for row in rows if row.participant == who)[0]) for who in results.planned)
    to_do = sum(results.planned.values()) - done
    parts = [f"Results of {from_home(results.folder)}", which, f"{counted(len(shown), 'trial')} shown"]
    left = [f"not shown: {', '.join(why)}" if why else "", f"still to do: {to_do}" if to_do > 0 else ""]
    moved = ", ".join(INPUTS[hand].title.lower() for hand in results.hands if hand in INPUTS)
    return PART.join(filter(None, [*parts, *left, f"moved by: {moved}" if moved else ""]))
