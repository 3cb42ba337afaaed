"""Data: the sessions of the data folder, how far each is, and what can be done with them."""

from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import NamedTuple

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFileDialog, QLayout, QMenu, QProgressBar, QPushButton

from app.ipc import messages as m
from app.window.widgets import memory, theme
from app.window.widgets.page import ANALYSE, RUN, Page
from app.window.widgets.parts import (
    NO_FOCUS,
    PANEL_MARGINS,
    OneLine,
    Panel,
    breakable,
    button,
    clear,
    column,
    holder,
    row,
    scrolled,
    show_wait,
    text_label,
    wrapped_label,
)
from app.window.widgets.words import LACKING, LEAVE
from app.window.widgets.work import VerbProcess, Watch
from core.files import InputError
from experiments.atomic_files import first_free
from experiments.plan import counted
from experiments.store.files import recordings_in
from experiments.store.overview import DataOverview, SessionOverview, scan_folder

RECENT_MOST = 6
DATE_PX = 96  # wide, a date
FORMS = {"bids": "BIDS-Motion", "csv": "CSV"}


class Recent:
    """Files that were used last; kept in the user's settings if the application has a name."""

    def __init__(self, kind: str) -> None:
        self._kind, self._settings = kind, memory.file()
        kept = self._settings.value(kind, []) if self._settings else []
        paths = kept if isinstance(kept, list) else [kept]  # a list of one comes back as a text
        self.paths = [str(path) for path in paths if path and Path(str(path)).exists()]

    def add(self, path: str) -> None:
        self.paths = [path, *(other for other in self.paths if other != path)][:RECENT_MOST]
        if self._settings:
            self._settings.setValue(self._kind, self.paths)


class Doing(NamedTuple):
    """What is being done with a session now."""

    participant: str = ""  # whose session is open
    why_not: str = ""  # why no other one can be opened, a sentence; "": one can
    can_leave: bool = False  # whether the open one can be closed
    opening: str = ""  # whose session is being opened
    next: str = ""  # whose session another button of the page resumes


class DataPanel(Panel):
    """The sessions, how far each is, and what can be done with it."""

    resume_asked = Signal(str)  # participant: take up their session, unfinished or not
    looked = Signal()  # something in the folder has changed

    def __init__(self, page: Page) -> None:
        """page: the one that it stands on, which brings other pages to the front."""
        super().__init__()
        self._page = page
        self.overview: DataOverview | None = None  # None: not looked at yet
        self._doing = Doing()
        self._folder = Path()  # until the session server says which
        self._looking = Watch(self, lambda: (scan_folder, self._folder), self.show_overview)
        self.export_task, self._out = VerbProcess(self._exported), Path()
        self.count = wrapped_label("", "quiet")
        self.whole = button("All results", lambda: self._page.page_asked.emit(ANALYSE, self._folder))
        self.export_as = QPushButton("Export …", autoDefault=True)
        self.export_as.setMenu(forms := QMenu(self.export_as))
        for form, name in FORMS.items():
            self._entry(forms, f"{name}, into a new folder", partial(self._ask_export, form))
        self.exporting, self.bar = wrapped_label("", "quiet"), QProgressBar(textVisible=False, maximum=1000)
        self.cancel = button("Cancel", self.export_task.stop, "small")
        self.show_export = button("Show", lambda: self._page.folder_asked.emit(self._out), "small")
        self._rows = column(spacing=8, margins=(0, 0, 4, 0))
        self.export_task.progressed.connect(self.bar.setValue)
        self._lay_out()

    def _lay_out(self) -> None:
        self.area = scrolled(holder(self._rows))
        self.area.setFocusPolicy(NO_FOCUS)
        self.setLayout(column(
            row(text_label("Data", size=theme.HEAD, bold=True), 1, self.whole, self.export_as), self.count,
            (self.area, 1), self.exporting,
            row(self.bar, self.cancel, self.show_export), spacing=8, margins=PANEL_MARGINS,
        ))  # fmt: skip
        for absent in (self.exporting, self.bar, self.cancel, self.show_export, self.whole, self.export_as):
            absent.hide()

    def show_folder(self, folder: Path) -> None:
        """The data folder of the session server."""
        if folder != self._folder:
            self._folder, self.overview = folder, None
            self._looking.forget()
            self._looking.look()

    def show_doing(self, doing: Doing) -> None:
        """What is being done with a session now."""
        if doing != self._doing:
            self._doing = doing
            self._fill()

    def session_of(self, participant: str) -> SessionOverview | None:
        sessions = self.overview.sessions if self.overview else ()
        return next((session for session in sessions if session.participant == participant), None)

    def show_overview(self, overview: DataOverview) -> None:
        if overview != self.overview:
            self.overview = overview
            self._fill()
            self.looked.emit()

    def _fill(self) -> None:
        overview = self.overview
        if overview is None:
            return
        clear(self._rows)
        sessions = overview.sessions
        if overview.problem:
            self.count.setText(breakable(overview.problem))
        else:
            kind = f"Study of {counted(overview.operators, 'simulated operator')}" if overview.operators else ""
            trials = f"{overview.done} of {counted(overview.planned, 'trial')}"
            parts = (kind, counted(len(sessions), "session"), trials) if len(sessions) > 1 else ()  # its row says it
            self.count.setText(" · ".join(filter(None, parts)))
        self.count.setVisible(bool(self.count.text()))
        self.whole.setVisible(overview.done > 0)
        self.export_as.setVisible(overview.done > 0)
        self.export_as.setEnabled(not self.export_task.busy)
        for session in sessions:
            self._rows.addWidget(Panel("line"))
            self._rows.addLayout(self._row(session))
        self._rows.addStretch(1)
        if not sessions and not overview.problem:
            for text, look in (("No sessions yet.", ""), ("The first one will appear here.", "quiet")):
                self._rows.addWidget(text_label(text, look), 0, Qt.AlignmentFlag.AlignHCenter)
            self._rows.addStretch(1)

    def _row(self, session: SessionOverview) -> QLayout:
        """A session: who and when, how far, what to do with it."""
        is_open = session.participant == self._doing.participant
        if is_open:
            main = button("Close", lambda: self._page.page_asked.emit(RUN, m.Leave()), hint=LEAVE)  # Run asks first
            main.setEnabled(self._doing.can_leave)
        elif session.declined:
            main = button("Folder", lambda: self._page.folder_asked.emit(session.folder), "link")
        elif session.complete:
            main = button("Results", lambda: self._page.page_asked.emit(ANALYSE, session.folder), "link")
        else:
            main = button("Resume", lambda: self.resume_asked.emit(session.participant), "link")
            main.setEnabled(self._can_open(session))
            main.setToolTip(self._doing.why_not)
            main.setVisible(session.participant != self._doing.next)
        if session.participant == self._doing.opening:
            show_wait(main, "Opening …")
        done = text_label(f"{session.done} of {session.planned}")
        if session.problem or session.declined:
            done.setText("cannot be read" if session.problem else "does not take part")
        name = OneLine(session.participant, "", theme.NORMAL, bold=True)
        name.setToolTip(session.problem or f"Participant {session.participant}, {session.protocol} protocol")
        when = datetime.fromtimestamp(session.changed_s)
        date = text_label("" if session.problem else f"{when.day} {when:%b %Y}", "quiet")
        date.setFixedWidth(DATE_PX)
        done.setMinimumWidth(DATE_PX)
        lines = column(row((name, 1), date, done, main, self._more(session, is_open), spacing=8), spacing=2)
        if session.lacking and not (session.problem or session.declined):
            lacking = wrapped_label(f"{session.lacking} without a result", "quiet", theme.SMALL)
            lacking.setToolTip(LACKING)
            lines.addWidget(lacking)
        return lines

    def _can_open(self, session: SessionOverview) -> bool:
        return not (self._doing.why_not or self._doing.opening or session.problem)

    def _more(self, session: SessionOverview, is_open: bool) -> QPushButton:
        about = f"More about {session.participant}"
        more = QPushButton("…", objectName="small", accessibleName=about, autoDefault=True)
        more.setMenu(menu := QMenu(more))
        can_open = self._can_open(session) and not (is_open or session.declined)
        self._entry(menu, "Open the session", lambda: self.resume_asked.emit(session.participant), can_open)
        self._entry(menu, "Results", lambda: self._page.page_asked.emit(ANALYSE, session.folder), session.done > 0)
        self._entry(menu, "Replay trials", lambda: self._replay(session), session.done > 0)
        self._entry(menu, "Show the folder", lambda: self._page.folder_asked.emit(session.folder))
        return more

    @staticmethod
    def _entry(menu: QMenu, text: str, do: Callable[[], object], can: bool = True) -> None:
        menu.addAction(text, lambda: do()).setEnabled(can)

    def _replay(self, session: SessionOverview) -> None:
        recordings = recordings_in(session.folder)
        self._page.page_asked.emit(ANALYSE, recordings[-1] if recordings else session.folder)

    # export

    def _ask_export(self, form: str) -> None:
        into = QFileDialog.getExistingDirectory(self, f"Where to put the {FORMS[form]} files", str(Path.home()))
        if into:
            self.export(form, Path(into))

    def export(self, form: str, into: Path) -> None:
        """Write all sessions for other programs into a new folder in this one."""
        self._out = first_free(into, f"{self._folder.name}-{form}")
        self.exporting.setText(f"Exporting as {FORMS[form]} …")
        self.bar.setValue(0)
        for widget, shown in ((self.exporting, True), (self.bar, True), (self.cancel, True), (self.show_export, False)):
            widget.setVisible(shown)
        self.export_task.begin("export", str(self._folder), f"--{form}", str(self._out))
        self._fill()

    def _exported(self, result: str | InputError) -> None:
        failed = isinstance(result, InputError)
        self.exporting.setText(breakable(f"Nothing was exported: {result}" if failed else f"Exported to {self._out}"))
        self.bar.hide()
        self.cancel.hide()
        self.show_export.setVisible(not failed)
        self._fill()
