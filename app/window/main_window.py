"""The experimenter's window: five pages between a header (pages, lights, brakes) and a footer (data folder).

It shows what the session server sends and asks it for what the experimenter wants; it decides nothing. The brakes-off
goes straight to the control loop, whichever page is at the front.
"""

import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from operator import itemgetter
from pathlib import Path

import numpy as np
from PySide6.QtCore import QEvent, QObject, QSize, Qt, QUrl, Signal
from PySide6.QtGui import QCloseEvent, QDesktopServices, QGuiApplication, QKeyEvent, QMouseEvent, QWindow
from PySide6.QtWidgets import (
    QApplication,
    QFileDialog,
    QLineEdit,
    QMenu,
    QPushButton,
    QSizePolicy,
    QStackedWidget,
    QWidget,
)

from app import __version__
from app.ipc import messages as m
from app.ipc.client import Client
from app.window.participant.participant_window import ParticipantWindow
from app.window.settings import HelpCard, SettingsCard, about_help, controllers_help, files_help
from app.window.widgets import memory, theme
from app.window.widgets.cards import Cards, OverlayCard
from app.window.widgets.keys import KEYS, OWN, PAGE, SESSION, WINDOW, add_key, bind
from app.window.widgets.page import ANALYSE, DEVICE, HOME, RUN, TRY, Page
from app.window.widgets.parts import NO_FOCUS, PART, OneLine, button, column, holder, row, stack, text_label
from app.window.widgets.preflight import Banner, Preflight, wrong
from app.window.widgets.words import LEAVE, as_sentence, data_folder_of, from_home, size
from experiments.plan import counted, grouped

#: page -> its module and class; a page is made when it is first shown
PAGES = {
    HOME: ("home.home_page", "HomePage"),
    TRY: ("sandbox.try_page", "TryPage"),
    RUN: ("run.run_page", "RunPage"),
    ANALYSE: ("analyse.analyse_page", "AnalysePage"),
    DEVICE: ("device.device_page", "DevicePage"),
}
TURN_ON_AFTER_S = 1.0  # since the brakes went off, by the button. Our choice
SMALLEST = (1024, 600)
RECORDING_PX, FOOT_PX = 300, 48  # wide, at least, the proof of recording; high, the footer
#: title, text with room for what would be lost, stay, go
CLOSE = (
    "A trial is being recorded",
    "Close the window? The trial ends, brakes off; its recording is kept, and the trial is repeated when you resume.",
    "Keep recording", "Abort and close",
)  # fmt: skip
UNSAVED = (
    "Not everything is on the disk",
    "Close the window? What is in memory alone would be lost: {}. Bring the folder back, make room on the disk, or go "
    "on in another data folder first.",
    "Cancel", "Lose it and close",
)  # fmt: skip
CHANGED = (
    "Not everything is saved",
    "Close the window? Not saved, and lost then: {}.",
    "Cancel",
    "Lose it and close",
)


class Folder(OneLine):
    """The data folder; a click opens it."""

    clicked = Signal()

    def __init__(self) -> None:
        super().__init__("", "", theme.SMALL)
        self.setSizePolicy(QSizePolicy.Policy.Maximum, QSizePolicy.Policy.Preferred)  # the first to be shortened
        self.setCursor(Qt.CursorShape.PointingHandCursor)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self.rect().contains(event.position().toPoint()):
            self.clicked.emit()


class Footer(QWidget):
    """At the left proof of recording, at the right the data folder."""

    def __init__(self, open_folder: Callable[[Path], None]) -> None:
        super().__init__()
        self.recording = OneLine("", "quiet")
        self.recording.setMinimumWidth(RECORDING_PX)
        self.folder = Folder()
        self._path = Path()
        self.folder.clicked.connect(lambda: open_folder(self._path))
        self.setLayout(row((self.recording, 1), text_label("Data in", "quiet", theme.SMALL), self.folder))

    def show_folder(self, folder: Path, about: str = "") -> None:
        """about: seed, plan and version: with them a session can be laid out again."""
        self._path = folder
        self.folder.setText(from_home(folder))
        self.folder.setToolTip("\n".join(filter(None, (f"Open {folder}", about))))

    def show_opened(self, opened: m.Opened) -> None:
        """Where the data are, and where the session comes from."""
        protocol, sha256 = opened.protocol, opened.plan_sha256
        plan = f", plan {sha256[:4]}…{sha256[-2:]}" if sha256 else ""
        self.show_folder(Path(opened.folder), f"Seed {protocol.seed}{plan}, phd {__version__}\n{protocol.note()}")

    def show_pulse(self, pulse: m.Pulse) -> None:
        proof, verified = pulse.proof, pulse.verified
        if proof is None:
            self.recording.setText(f"{counted(verified, 'recording')} verified" if verified else "")
            return
        earlier = {0: "", 1: "1 earlier one verified"}.get(verified, f"all {verified} earlier ones verified")
        parts = [f"Recording {proof.name}", f"{grouped(proof.rows)} rows", size(proof.bytes)]
        parts += [f"last write {proof.age_s:.1f} s ago", earlier]
        self.recording.setText(PART.join(filter(None, parts)))

    def show_dead(self) -> None:
        self.recording.setText("Not recording")


class MainWindow(QWidget):
    """Header, one page at a time, footer."""

    participant_asked = Signal()  # show or hide the participant's window
    restart_asked = Signal(object, object)  # as `Page.setup_asked`
    setting_changed = Signal(str)  # a key of `memory`, whose new value is remembered
    closed = Signal()

    def __init__(self, client: Client) -> None:
        super().__init__()
        self.setWindowTitle("PHD")
        self.client, self.participant = client, ParticipantWindow()
        self.participant.changed.connect(self._show_participant)
        self.opened: m.Opened | None = None
        self.snapshot = m.Snapshot(m.PREPARING)
        self._then: object = None  # a command for the session server, once it serves
        self._off_since_s = 0.0  # when the brakes went off
        self._stake: tuple | None = None  # `_at_stake` when the user closed the window last
        self.dead = self._closing = False
        self.pages: dict[str, Page] = {}
        self.shown = ""  # the page at the front
        self.preflight, self.banner = Preflight(), Banner()
        self.preflight.clicked.connect(partial(self.show_page, DEVICE))
        self.footer, self._stack = Footer(self._open_folder), QStackedWidget()
        self.tabs = {name: QPushButton(name, objectName="tab", checkable=True, autoDefault=True) for name in PAGES}
        self._lay_out()
        self.cards = Cards(self._stack)
        self._connect()
        self.footer.show_folder(client.setup.data_dir)
        self.show_page(HOME)

    def _lay_out(self) -> None:
        for tab in self.tabs.values():
            tab.setFont(theme.font(theme.TITLE))
        head = row(*self.tabs.values(), spacing=0)
        head.addSpacing(8)
        head.addWidget(self.preflight, 1)
        self.settings = button("⚙", self.show_settings, "small", "Settings")
        self.help = QPushButton("?", objectName="small", toolTip="Help")
        self.help.setMenu(menu := QMenu(self.help))
        for text, do in (
            ("Keys  F1", self.show_keys), ("What the controllers do", self.show_controllers),
            ("Where files are", self.show_files), ("About PHD", self.show_about),
        ):  # fmt: skip
            menu.addAction(text, do)
        for pressed in (self.settings, self.help):
            pressed.setAccessibleName(pressed.toolTip())
            pressed.setFont(theme.font(theme.TITLE, bold=True))
        for pressed in (self.settings, self.help, self.preflight.brakes):
            pressed.setFocusPolicy(NO_FOCUS)
            head.addSpacing(6)
            head.addWidget(pressed)
        self._foot = stack(self.footer, holder(row(self.banner, margins=(0, 2, 0, 4))))
        self._foot.setFixedHeight(FOOT_PX)
        pages = column(head, (self._stack, 1), spacing=8)
        self.setLayout(column((pages, 1), self._foot, spacing=0, margins=(theme.GAP, 6, theme.GAP, 0)))
        room = QGuiApplication.primaryScreen().availableSize() - QSize(*theme.FRAME)
        self.setMinimumSize(min(SMALLEST[0], room.width()), min(SMALLEST[1], room.height()))

    def _connect(self) -> None:
        for name, tab in self.tabs.items():
            tab.clicked.connect(lambda _=False, name=name: self.show_page(name))
        self.preflight.brakes.clicked.connect(self._press_brakes)
        own: dict[str, Callable[[], object]] = {
            "brakes on": self.allow_brakes,
            "participant": self.participant_asked.emit,
            "keys": self.show_keys,
            "help": self.help.showMenu,
            "settings": self.show_settings,
            **{name.lower(): partial(self.show_page, name) for name in PAGES if name.lower() in KEYS},
        }
        bind(self, own | {name: partial(self.do, name) for name in KEYS if name not in (*own, "escape")})
        QGuiApplication.instance().focusWindowChanged.connect(self._listen)  # type: ignore[union-attr]

    def _listen(self, window: QWindow | None) -> None:
        """Hear Esc in the window that has the keyboard now, whether it is one of the app, a dialog or a menu."""
        if window is not None:
            window.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Esc, before any dialog, menu or field can keep it to itself: Qt asks first whether it is a shortcut."""
        if not (isinstance(event, QKeyEvent) and isinstance(watched, QWindow) and event.key() == Qt.Key.Key_Escape):
            return super().eventFilter(watched, event)
        if event.type() == QEvent.Type.ShortcutOverride:
            event.accept()
            if not event.isAutoRepeat():
                self.press_escape()
            return True
        return QApplication.activeModalWidget() is None  # a dialog closes itself

    # ------------------------------------------------------------------------------------------- pages and keys

    def page(self, name: str) -> Page:
        """A page, made when it is first asked for."""
        if name not in self.pages:
            module, cls = PAGES[name]
            page = getattr(import_module(f"app.window.{module}"), cls)(self.send)
            page.page_asked.connect(self.show_page)
            page.pointer_moved.connect(lambda *hand: self.client.ring.aim(*hand))
            page.pointer_left.connect(lambda: self.client.ring.let_go())
            page.setup_asked.connect(self.restart_asked)
            page.folder_asked.connect(self._open_folder)
            page.turn_asked.connect(self.participant.start)
            page.consent_asked.connect(self.participant.ask_consent)
            page.answers_changed.connect(self.participant.questions.show_values)
            self.participant.questions.changed.connect(page.show_answers)
            self.participant.consent.answered.connect(page.answer_consent)
            self.pages[name] = page
            self._stack.addWidget(page)
            page.show_setup(self.client.setup)
            if self.opened is not None:
                page.show_opened(self.opened)
            self._show_participant()
        return self.pages[name]

    def show_page(self, name: str, what: object = None) -> None:
        """Bring a page to the front, with what it is to show."""
        page = self.page(name)
        if name != self.shown:
            close_popups()
            if self.shown:
                self.pages[self.shown].end()
                page.setFocus()  # not what had the keyboard on the other page
        self.shown = name
        for other, tab in self.tabs.items():
            tab.setChecked(other == name)
        self._stack.setCurrentWidget(page)
        self.cards.come_forward()
        page.begin(what)
        self._foot.setHidden(page.says_what_is_wrong)

    def _show_participant(self) -> None:
        """Hand every page what the participant is doing."""
        for page in self.pages.values():
            page.participant_answers, page.participant_reads = self.participant.isVisible(), self.participant.reads
            page.show_instructions(self.participant.instructions.at)
            page.show_snapshot(self.snapshot)

    def do(self, action: str) -> None:
        """What a key asks for: a question's answer first, else the page's."""
        if action == "start" and self.cards.question is not None:
            return
        if (act := self.pages[self.shown].keys().get(action)) is not None:
            act()

    def send(self, command: object) -> None:
        self.client.send(command)

    def _open_folder(self, folder: Path) -> None:
        """In the system's own file manager; of a folder that is not there yet, the first one above that is."""
        existing = str(next(above for above in (folder, *folder.parents) if above.is_dir()))
        if not QDesktopServices.openUrl(QUrl.fromLocalFile(existing)):
            QGuiApplication.clipboard().setText(existing)
            text = f"No file manager could be opened. The folder is {existing}, copied to the clipboard."
            self.cards.show_message("The folder cannot be shown", f"{text} Paste it into a terminal.")

    def show_keys(self) -> None:
        """Those of every page, then those of one page."""
        groups = {
            title: {" or ".join(key.keys): key.does for key in table.values()}
            for title, table in (("In a session", SESSION), ("In the window", WINDOW), ("On one page", PAGE))
        }
        own = self.pages[self.shown].own_keys()
        more = {key: does for key, does in OWN.items() if not (own and does.startswith(self.shown))}
        groups["On one page"] = dict(sorted((groups["On one page"] | more).items(), key=itemgetter(1)))
        self._show_help("Keys", "", groups | ({f"On {self.shown}": own} if own else {}))

    def event(self, event: QEvent) -> bool:
        """On a page where the space bar starts nothing it presses the button that has the keyboard."""
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.ShortcutOverride:
            if event.key() == Qt.Key.Key_Space and "start" not in self.pages[self.shown].keys():
                event.accept()
                return True
        return super().event(event)

    # ------------------------------------------------------------------------------------------- settings and help

    def show_settings(self) -> None:
        folder = self.client.setup.data_dir
        self.cards.put(SettingsCard(self._stack, self.cards.leave, self._setting_changed, folder))

    def _setting_changed(self, key: str) -> None:
        if key != memory.DATA_FOLDER:
            self.setting_changed.emit(key)
        else:
            self._choose_folder()

    def _choose_folder(self) -> None:
        if self.opened is not None and self.opened.participant:
            self.cards.show_message("Another data folder", f"Close the session first. {LEAVE}")
            return
        setup = self.client.setup
        chosen = QFileDialog.getExistingDirectory(self, "Data folder", str(setup.data_dir.parent))
        if chosen:
            self.cards.leave()
            self.restart_asked.emit(setup._replace(data_dir=data_folder_of(Path(chosen)), participant=""), None)

    def _show_help(self, title: str, text: str, groups: dict[str, dict[str, str]]) -> None:
        self.cards.put(HelpCard(title, text, groups, self._stack, self.cards.leave))

    def show_controllers(self) -> None:
        if self.opened is not None:
            named = f"Of the {self.opened.protocol.name} protocol. Try lets you feel each."
            hidden = self.opened.participant and self.snapshot.blind
            lines = {} if hidden else controllers_help(self.opened.protocol)
            self._show_help("What the controllers do", "This session is blind." if hidden else named, {"": lines})

    def show_files(self) -> None:
        self._show_help("Where files are", "", {"": files_help(str(self.client.setup.data_dir))})

    def show_about(self) -> None:
        text = "A passive haptic display guides a hand with brakes. PHD simulates one and runs the experiment."
        self._show_help("About PHD", text, {"": about_help()})

    # ------------------------------------------------------------------------------------------- brakes

    def _press_brakes(self) -> None:
        """Zero current goes straight to the control loop, even when the session server is gone.

        A press just after they went off does not turn them on: a frightened hand presses twice.
        """
        if not self.snapshot.brakes_off:
            self.client.brakes_off("the button was pressed")
        elif time.perf_counter() - self._off_since_s > TURN_ON_AFTER_S:
            self.allow_brakes()

    def allow_brakes(self) -> None:
        if self.snapshot.can_allow:
            self.send(m.AllowBrakes())

    def _to_close(self) -> Callable[[], object] | None:
        """What Esc closes: a menu, what is asked; else, unless a trial runs, what a page has open, or a text field.

        A dialog over all that closes itself.
        """
        if QApplication.activeModalWidget() is not None:
            return None
        if QApplication.activePopupWidget() is not None:
            return close_popups
        running, typing = self.snapshot.stage == m.RUNNING, self.focusWidget()
        close = self.cards.to_close()
        if close is None and (self.shown == RUN or not running):
            close = self.pages[self.shown].to_close()
        if close is None and isinstance(typing, QLineEdit) and not running:
            close = typing.clearFocus
        return close

    def press_escape(self) -> None:
        """Esc, in whichever window, dialog, menu or field: turn the brakes off, and close what is open."""
        where = "on the participant's screen" if self.participant.isActiveWindow() else "in the main window"
        close = self._to_close()
        if self.snapshot.can_turn_off:
            self.client.brakes_off(f"Esc was pressed {where}")
        if close is not None:
            close()

    def show_time(self, now_s: float) -> None:
        """60 times a second: what only the clock changes."""
        self.pages[self.shown].show_time(now_s)

    # ------------------------------------------------------------------------------------------- what the server sends

    def show_client(self, client: Client, then: object) -> None:
        """Another session server was started; then: a command for it once it serves, or None."""
        self.client, self._then, self.dead, self.opened = client, then, False, None
        self.footer.show_folder(client.setup.data_dir)
        for page in self.pages.values():
            page.show_setup(client.setup)
        self.show_snapshot(m.Snapshot(m.PREPARING))

    def show_opened(self, opened: m.Opened) -> None:
        """A session, or a protocol before one or after one."""
        begins = bool(opened.participant) and (self.opened is None or not self.opened.participant)
        ends = not opened.participant and self.opened is not None and bool(self.opened.participant)
        self.opened = opened
        self.footer.show_opened(opened)
        for page in self.pages.values():
            page.show_opened(opened)
        if begins or (ends and self.shown == RUN):
            self.show_page(RUN if begins else HOME)

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        if snapshot.brakes_off and not self.snapshot.brakes_off:
            self._off_since_s = time.perf_counter()
        self.snapshot = snapshot
        on_bench = self.opened is not None and self.opened.real_device
        if self._then is not None and snapshot.stage == m.NO_SESSION and not snapshot.session_blocker(on_bench):
            self.send(self._then)
            self._then = None
        for page in self.pages.values():
            page.show_snapshot(snapshot)
        self.preflight.show_snapshot(snapshot)
        self.banner.show_text(said := wrong(snapshot))
        self._foot.setCurrentIndex(int(bool(said)))
        self._foot.setHidden(self.pages[self.shown].says_what_is_wrong)
        if self._stake is not None and self._stake != self._at_stake():
            self.cards.withdraw({"close"})  # it is true no more

    def show_pulse(self, pulse: m.Pulse) -> None:
        self.footer.show_pulse(pulse)
        for page in self.pages.values():
            page.show_pulse(pulse)

    def show_ticks(self, rows: np.ndarray, taken: bool) -> None:
        """Ticks (n, tick_log.WIDTH) of the running trial, for the page at the front; Run gets all, for its card."""
        for name in {self.shown, RUN} & self.pages.keys() if not self.dead else ():
            self.pages[name].show_ticks(rows, taken)

    def show_dead(self, sentence: str) -> None:
        """The session server has ended, or refuses to serve this data folder."""
        self.dead = True
        if self.client.wants_other_folder:
            buttons = [("Choose another folder …  Enter", self._choose_folder), ("Close  Esc", self.cards.leave)]
            self.cards.put(OverlayCard("The data folder cannot be used", as_sentence(sentence), buttons, self._stack))
        last = self.snapshot
        self.footer.show_dead()
        self.show_snapshot(
            m.Snapshot(m.FAILED, last.rows, blind=last.blind, notes=last.notes, notice=sentence, notice_bad=True)
        )

    # ------------------------------------------------------------------------------------------- the end

    def _at_stake(self) -> tuple[tuple[str, str, str, str], str] | None:
        """What closing now would cut off or lose: the question to be asked, and what it names; None: nothing."""
        changed = " and ".join(filter(None, (page.unsaved() for page in self.pages.values())))
        if self.snapshot.in_memory and not self.dead:
            return UNSAVED, self.snapshot.in_memory
        if self.snapshot.stage == m.RUNNING and not self.snapshot.practice and not self.dead:
            return CLOSE, ""
        return (CHANGED, changed) if changed else None

    def _ask_to_close(self, asked: tuple[str, str, str, str], lost: str) -> None:
        title, text, stay, go = asked
        buttons = [(f"{stay}  Enter", self.cards.leave), (f"{go}  Alt+C", self.close_anyway)]
        card = OverlayCard(title, text.format(lost), buttons, self._stack)
        add_key("Alt+C", card, self.close_anyway)
        self.cards.put(card, "close")

    def closeEvent(self, event: QCloseEvent) -> None:
        """While something is recorded, or not on the disk, ask first."""
        self._stake = self._at_stake()
        if self._stake is not None and not self._closing:
            event.ignore()
            self.showNormal() if self.isMinimized() else self.show()
            self.raise_()
            self._ask_to_close(*self._stake)
            return
        event.accept()
        for page in self.pages.values():
            page.close()
        self.closed.emit()

    def close_anyway(self) -> None:
        self._closing = True
        self.close()


def close_popups() -> None:
    """Close every menu and list that is open, the one on top first."""
    while (popup := QApplication.activePopupWidget()) is not None:
        popup.close()
