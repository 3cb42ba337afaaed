"""Home: what comes next, a session, the data that are there.

A choice changes nothing by itself: the page keeps the chosen `Setup`, and asks for a session server with it when a
session starts, a board is connected or a data folder is chosen.
"""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from PySide6.QtCore import QEvent, QObject, QSize, Qt
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import QFileDialog, QLineEdit, QScrollArea, QSizePolicy, QWidget

from app.ipc import messages as m
from app.window.home.board_ports import BoardPorts
from app.window.home.data_panel import DataPanel, Doing, Recent
from app.window.home.next_panel import MAIN_PX, NextPanel, is_first_visit, to_resume
from app.window.home.participant_form import ParticipantForm
from app.window.home.protocol_editor import TOML, ProtocolEditor
from app.window.home.start import (
    Loaded,
    Wanted,
    load,
    planned_trials,
    session_blocker,
    standing_of,
    start_blockers,
    start_text,
    summary_of,
    title_of,
)
from app.window.home.try_panel import DevicePicture
from app.window.participant.consent_page import ConsentPage
from app.window.widgets import theme
from app.window.widgets.cards import Cards, OverlayCard
from app.window.widgets.fields import Tick
from app.window.widgets.own_code import ask_own_code
from app.window.widgets.page import RUN, TRY, Page
from app.window.widgets.parts import (
    NO_FOCUS,
    PANEL_MARGINS,
    Choice,
    Part,
    Segments,
    breakable,
    button,
    chain_tabs,
    column,
    grid,
    holder,
    panel,
    printed,
    row,
    show_wait,
    stack,
    tab_stops,
    text_label,
    wrapped_label,
)
from app.window.widgets.preflight import listed
from app.window.widgets.work import BackgroundTask
from core.device import shipped_devices
from core.files import InputError
from experiments.inputs import CHOICES, INPUTS, MOUSE, SENSOR, is_person
from experiments.protocol import PAPER, shipped_protocols
from experiments.store.files import session_folder

LINE_PX = 32  # high, a line of the form at most
BESIDE_PX = 14  # wide, the margin beside the form, in which its scroll bar stands
SESSION_PX = 760  # wide at most: choices are no easier to read when they are wider
PLAN, NO_PLAN, MORE, LESS = "Show plan  ▾", "Hide plan  ▴", "More  ▾", "Less  ▴"
CONSENT = "consent"  # what the card of the window asks
SIMULATED, BOARD = "Simulated", "Board"
FILE, AS_PROTOCOL = "A file …", "As the protocol says"
HANDS = {name: INPUTS[name].title for name in CHOICES}


class FormArea(QScrollArea):
    """A form that is as high as what it asks for, and scrolls where there is no room."""

    def __init__(self, inside: QWidget) -> None:
        super().__init__(widgetResizable=True)
        self.setFocusPolicy(NO_FOCUS)
        inside.setObjectName("clear")
        self.viewport().setObjectName("clear")
        self.setWidget(inside)
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Maximum)

    def sizeHint(self) -> QSize:
        return QSize(super().sizeHint().width(), self.widget().heightForWidth(self.viewport().width()))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if watched is self.widget() and event.type() in (QEvent.Type.LayoutRequest, QEvent.Type.Resize):
            self.updateGeometry()
        return super().eventFilter(watched, event)


class HomePage(Page):
    """What comes next over the session, the data beside them; in their place the editor, or what is asked first."""

    def __init__(self, send: Callable[[object], None]) -> None:
        super().__init__(send)
        self.setup = self.chosen = m.Setup(Path())  # of the session server, and for the next one
        self.loaded: Loaded | InputError | None = None  # the chosen protocol; None: being read
        self._opening = ""  # whose session, or the port of which board, was asked for and is not there yet
        self._agreed: dict[str, str] = {}  # who agreed to take part -> when (ISO, UTC)
        self._named = ""  # who comes next, as typed or as the command line says; "": as `proposed`
        self._loading, self._planning = BackgroundTask(self._show_loaded), BackgroundTask(self._show_plan)
        self._recent = Recent("protocols")
        self.data = DataPanel(self)
        self.editor, self.consent, self.cards = ProtocolEditor(), ConsentPage(), Cards(self)
        self._make_choices()
        self._lay_out()
        self.data.resume_asked.connect(self._resume)
        self.consent.answered.connect(self.answer_consent)
        self.data.looked.connect(self._looked)
        self.editor.saved.connect(self.take_protocol)
        self.editor.closed.connect(self._show_columns)

    def _make_choices(self) -> None:
        self.protocol, self.devices, self.hand = Choice(), Choice(), Choice()
        self.protocol.activated.connect(self._protocol_chosen)
        self.devices.activated.connect(self._devices_chosen)
        self.hand.activated.connect(lambda: self._choose(hand=self.hand.value()))
        self.hand.fill(HANDS, MOUSE)
        self.summary, self.hand_words = wrapped_label("", "quiet"), wrapped_label("", "quiet")
        self.summary.setMinimumHeight(2 * self.summary.fontMetrics().lineSpacing())  # of what comes: nothing moves then
        self.edit = button("Edit", self._edit)
        self.link = Segments({SIMULATED: SIMULATED, BOARD: BOARD}, "Run on")
        self.link.changed.connect(self._link_chosen)
        self.ports = BoardPorts(self)
        self.ports.connect_asked.connect(self._connect)
        for wide in (self.protocol, self.devices):
            wide.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
            wide.setMinimumWidth(90)
        self.participant = QLineEdit(accessibleName="Participant", maximumWidth=150)
        self.participant.textEdited.connect(self._participant_typed)
        self.participant.returnPressed.connect(self._start)
        self.standing = text_label("", "quiet")  # "new participant", "14 of 60 done"
        self.blind = Tick("Hide controller names")
        self.blind.toggled.connect(self._ask_plan)
        self.plan = printed("No plan")
        self.form = ParticipantForm()
        self.form.changed.connect(self._refresh)
        self.form.entered.connect(self._start)
        self.checks = wrapped_label("", "quiet")
        self.why, self.start = wrapped_label("", "caution"), button("Start session", self._start)
        self.more, self.show_plan = button(MORE, self._turn_more, "link"), button(PLAN, self._turn_plan, "link")

    def _lay_out(self) -> None:
        self.next, self.picture = NextPanel(self._do_next), DevicePicture()
        choices = grid(12, 9, stretched=1)
        lines: tuple[tuple[str, QWidget, tuple[Part, ...]], ...] = (
            ("Protocol", self.protocol, (self.edit,)), ("", self.summary, ()), ("Run on", self.link, ()),
            ("", self.ports, ()), ("Participant", self.participant, ((self.standing, 1),)), ("", self.form, ()),
            ("Device", self.devices, ()), ("Hand", self.hand, ((self.hand_words, 1),)), ("Blind", self.blind, ()),
        )  # fmt: skip
        #: behind *More*, while they are as usual: each with its name and what stands beside it
        self.rare: dict[QWidget, list[QWidget]] = {self.devices: [], self.hand: [self.hand_words], self.blind: []}
        for place, (name, first, others) in enumerate(lines):
            if name:
                label = text_label(name, "quiet")
                label.setBuddy(first)
                label.setMinimumHeight(min(first.sizeHint().height(), LINE_PX))  # level with what it names
                choices.addWidget(label, place, 0, Qt.AlignmentFlag.AlignTop)
                self.rare.get(first, []).append(label)
            choices.addLayout(row(first, *others), place, 1)
        choices.setRowStretch(choices.rowCount(), 1)
        choices.setContentsMargins(0, 0, BESIDE_PX, 0)
        self.area = FormArea(holder(choices))
        self.start.setFont(theme.font(theme.NORMAL, bold=True))
        self.start.setMinimumHeight(MAIN_PX[1])
        buttons = row(self.start, 1, self.show_plan, self.more)
        foot = column(buttons, self.checks, self.why, spacing=10, margins=(0, 4, BESIDE_PX, 0))
        left, top, right, low = PANEL_MARGINS
        self.session = panel("Session", self.area, foot, 1, margins=(left, top, right - BESIDE_PX, low))
        self.planned = panel("Plan", (self.plan, 1))
        self.planned.hide()
        self.side = holder(column((self.picture, 3), (self.planned, 4), (self.data, 3), spacing=theme.GAP))
        doing = holder(column(self.next, (self.session, 1), spacing=theme.GAP))
        doing.setMaximumWidth(SESSION_PX)
        for part in (doing, self.side):
            part.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.columns = holder(row((doing, 11), (self.side, 10), spacing=theme.GAP))
        self.asking = holder(column((self.consent, 1), row(1, button("Back  Esc", self._show_columns), 1)))
        self.stack = stack(self.columns, self.editor, self.asking)
        self.setLayout(column(self.stack))

    def _turn_more(self) -> None:
        """Show what is rarely chosen, or hide it."""
        self.more.setText(LESS if self.more.text() == MORE else MORE)
        self._fill_protocols()
        self._refresh()

    def _turn_plan(self) -> None:
        """Show the participant's plan above the data, or hide it."""
        self.planned.setVisible(self.planned.isHidden())
        self.show_plan.setText(PLAN if self.planned.isHidden() else NO_PLAN)
        self._refresh()

    def _do_next(self) -> None:
        if session := to_resume(self.data.overview):
            self._resume(session.participant)
        else:
            self.page_asked.emit(TRY, None)

    # --------------------------------------------------------------------------------------- what the window hands on

    def show_setup(self, setup: m.Setup) -> None:
        self.setup, self.opened, self.snapshot = setup, None, m.Snapshot(m.PREPARING)
        self.data.show_folder(setup.data_dir)
        if setup != self.chosen:
            self._named = setup.participant
            self.link.show_value(BOARD if setup.link else SIMULATED)
            self._take(setup)
        if self._opening == setup.link:
            self._opening = ""
        self._refresh()

    def show_opened(self, opened: m.Opened) -> None:
        ended = self.opened is not None and self.opened.participant and not opened.participant
        super().show_opened(opened)
        if opened.participant:
            self._opening = ""
            self.participant.setText(opened.participant)
        if ended:  # another participant comes next
            self._named = ""
            self._load()
        self.show_snapshot(self.snapshot)

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        super().show_snapshot(snapshot)
        if snapshot.notice_bad or snapshot.stage == m.FAILED:
            self._opening = ""
        if self._consent_asked and not self.participant_answers:
            self._ask_consent()  # their screen is gone
        self._refresh()

    def begin(self, what: object = None) -> None:
        self._show_columns()
        self.participant.setFocus()  # Enter starts
        self.participant.selectAll()

    def to_close(self) -> Callable[[], object] | None:
        asked = self.cards.question is not None or self.stack.currentWidget() is not self.columns
        return self._show_columns if asked else None

    def unsaved(self) -> str:
        return f"what was changed in the editor ({self.editor.what})" if self.editor.changed else ""

    def keys(self) -> dict[str, Callable[[], object]]:
        return {"save": self.editor.save_now} if self.stack.currentWidget() is self.editor else {}

    def closeEvent(self, event: QCloseEvent) -> None:
        self.data.export_task.stop(wait=True)
        super().closeEvent(event)

    def _show_columns(self) -> None:
        self.cards.leave()
        self.consent_asked.emit(None)
        self.stack.setCurrentWidget(self.columns)

    # --------------------------------------------------------------------------------------- the choices

    def _take(self, setup: m.Setup) -> None:
        """Show these choices."""
        self.chosen = setup
        self._fill_protocols()
        devices: dict[tuple[str, ...] | None, str] = {None: AS_PROTOCOL}
        devices |= {(name,): name for name in shipped_devices()}
        devices.setdefault(setup.devices, ", ".join(Path(device).stem for device in setup.devices or ()))
        self.devices.fill({**devices, (): FILE}, setup.devices)
        self.hand.fill(HANDS, setup.hand)
        self._load()

    def _fill_protocols(self) -> None:
        """The paper's protocol, files that were used last and the chosen one; the others are rare."""
        said, chosen = shipped_protocols(), self.chosen.protocol
        shown = {name: name.capitalize() for name in said if name in (PAPER, chosen) or self.more.text() == LESS}
        files = {path: title_of(path) for path in (chosen, *self._recent.paths) if path not in said}
        self.protocol.fill({**shown, **files, "": FILE}, chosen)
        self.protocol.say({**said, **{path: path for path in files}})
        self.protocol.setToolTip(chosen if chosen in files else "")

    def _choose(self, **changes: Any) -> None:
        """Another choice; it takes effect when a session starts."""
        self._take(self.chosen._replace(**changes))

    def _protocol_chosen(self) -> None:
        name = self.protocol.value() or QFileDialog.getOpenFileName(self, "Protocol", "", TOML)[0]
        self.take_protocol(name) if name else self._choose()

    def take_protocol(self, name: str) -> None:
        """A protocol was chosen or saved: options that stood in place of another one's values are gone."""
        if name not in shipped_protocols():
            self._recent.add(name)
        self._choose(protocol=name, rules=None, low_gain=None, seed=None)

    def _devices_chosen(self) -> None:
        chosen = self.devices.value()
        if chosen == ():
            path, _ = QFileDialog.getOpenFileName(self, "Device", "", TOML)
            chosen = (path,) if path else self.chosen.devices
        self._choose(devices=chosen)

    def _looked(self) -> None:
        """Something in the data folder has changed: perhaps the participant who was proposed has declined."""
        found = self.data.session_of(self._label())
        if found is not None and found.declined and not self._named:
            self._load()
        self._ask_plan()
        self._refresh()

    def _label(self) -> str:
        """The participant as typed, without blanks around it."""
        return self.participant.text().strip()

    def _participant_typed(self) -> None:
        self._named = self._label()
        self._ask_plan()
        self._refresh()

    def _load(self) -> None:
        self.loaded = None
        self._loading.ask(load, self.chosen._replace(participant=self._named))
        self._refresh()

    def _show_loaded(self, loaded: Loaded | InputError) -> None:
        self.loaded = loaded
        self.plan.clear()
        if isinstance(loaded, Loaded):
            participant = self._named or loaded.participant
            if participant != self._label():
                self.participant.setText(participant)
                self.form.show_form({})  # it was another participant's
            self.blind.setChecked(loaded.protocol.blind and is_person(self.hand.value()))
            self.form.show_form(loaded.protocol.form)
            chain_tabs(self.participant, *tab_stops(self.form), self.blind, self.plan, self.start)
            self.picture.show_protocol(loaded.protocol)
            self._ask_plan()
        self._refresh()

    def _ask_plan(self) -> None:
        if isinstance(self.loaded, Loaded):
            label = self._label()
            found = self.data.session_of(label)
            self._planning.ask(planned_trials, self.loaded.protocol, label, self.blind.isChecked(), found)

    def _show_plan(self, trials: str | InputError) -> None:
        """The trials of the participant; none where their name or their session is refused, as is said elsewhere."""
        self.plan.setPlainText("" if isinstance(trials, InputError) else trials)

    # --------------------------------------------------------------------------------------- the board

    @property
    def on_board(self) -> bool:
        """Whether the board's ports are shown, connected or not."""
        return self.link.value() == BOARD

    def _link_chosen(self, which: str) -> None:
        if self.setup.link and which == SIMULATED:
            self.setup_asked.emit(self.chosen._replace(link=""), None)  # let the board go
        else:
            self._choose(link=self.setup.link)

    def _connect(self, port: str) -> None:
        if not self._session_open:
            self._opening = port
            self.setup_asked.emit(self.chosen._replace(link=port, hand=MOUSE), None)
            self._refresh()

    # --------------------------------------------------------------------------------------- start

    @property
    def _session_open(self) -> str:
        return self.opened.participant if self.opened is not None else ""

    @property
    def _no_board(self) -> str:
        """That a board was chosen and none is connected yet; "": nothing of the kind."""
        if not self.on_board or self.chosen.link:
            return ""
        return f"Opening {self._opening} …" if self._opening else "No board is connected. Connect to one first."

    @property
    def _checks(self) -> tuple[m.Check, ...]:
        """The checks of what was chosen: device and hand of another session server are not looked at yet."""
        other = not self._same_setup or self._no_board
        others = ("Device", "Hand", m.FORCE_SENSOR) if other else ()
        idle = self.snapshot.running is None  # a late loop matters to no trial then; the header says it, too
        return tuple(
            c for c in self.snapshot.checks
            if c.name not in others and not (idle and c.name == "Loop" and c.state == m.CAUTION)
        )  # fmt: skip

    @property
    def _asks_a_person(self) -> bool:
        """Whether a person is to be at the handle, who can be asked what a protocol asks for."""
        return self.on_board or is_person(self.hand.value())

    @property
    def _same_setup(self) -> bool:
        """Whether the session server that is there is the chosen one."""
        return self.setup == self.chosen and self.snapshot.stage != m.FAILED

    def _wanted(self) -> Wanted:
        """The session that the button would start."""
        label, overview = self._label(), self.data.overview
        asks = self._asks_a_person and isinstance(self.loaded, Loaded) and self.loaded.protocol.consent is not None
        agreed = asks and label in self._agreed
        consent_due = asks and not agreed
        problems = self.form.problems() if self._asks_a_person and not consent_due else []
        operators = overview.operators if overview is not None else 0
        found = self.data.session_of(label)
        return Wanted(label, found, self.loaded, operators, problems, consent_due, agreed, self._no_board)

    def _refresh(self) -> None:
        """Show whether a session can start, and what the button then does."""
        wanted, is_open, real_device = self._wanted(), self._session_open, bool(self.setup.link)
        snapshot = self.snapshot._replace(checks=self._checks)
        blockers = start_blockers(wanted, is_open, snapshot, real_device)
        reasons = start_blockers(wanted, is_open, snapshot._replace(checks=()), real_device)  # the list has the others
        theme.set_style(self.summary, "bad" if isinstance(self.loaded, InputError) else "")
        if text := summary_of(wanted):  # else it stays while the next one is read
            self.summary.setText(breakable(text))
        self._show_start(wanted, reasons, not blockers)
        self._show_choices(wanted)
        self.checks.setText(breakable(listed(snapshot.checks)))
        self.checks.setVisible(bool(self.checks.text()))
        why_not = session_blocker(is_open, wanted.no_board, snapshot, real_device)
        session = None if is_open else to_resume(self.data.overview)
        self.next.show_next(session, why_not, self._opening)
        first = is_first_visit(self.data.overview) and not is_open
        self.next.setVisible(first or session is not None)
        self.picture.setVisible(first and self.planned.isHidden())
        theme.set_style(self.start, "main" if self.next.isHidden() else "")  # one button is the main one
        next_one = session.participant if session else ""
        self.data.show_doing(Doing(is_open, why_not, snapshot.can_leave, self._opening, next_one))
        self.ports.show_link(self.setup.link, self.snapshot.checks if self.opened else (), self._opening)

    def _show_start(self, wanted: Wanted, reasons: list[str], can_start: bool) -> None:
        self.standing.setText(standing_of(wanted))
        self.start.setText(start_text(wanted, self._session_open))
        self.start.setEnabled(bool(self._session_open) or can_start)
        if self._opening and self._opening == wanted.participant:
            show_wait(self.start, f"Opening the session of {wanted.participant} …")
        failed = self.snapshot.notice_bad and self.snapshot.stage in (m.NO_SESSION, m.FAILED)
        sentences = [self.snapshot.notice, *reasons] if failed and self.snapshot.notice else reasons
        theme.set_style(self.why, "quiet" if self.snapshot.stage == m.PREPARING else "caution")
        self.why.setText(breakable("\n".join(sentences)))
        self.why.setVisible(bool(sentences))

    def _show_choices(self, wanted: Wanted) -> None:
        """What can be chosen now."""
        for choice in (self.protocol, self.devices, self.hand, self.link, self.ports.port, self.participant):
            choice.setEnabled(not self._session_open)
        new = wanted.found is None and not self._session_open  # blind and form are settled when a session begins
        always_blind = isinstance(self.loaded, Loaded) and self.loaded.protocol.blind
        self.blind.setEnabled(new and not always_blind and is_person(self.hand.value()))
        self.form.setVisible(new and self._asks_a_person and bool(self.form.fields) and not wanted.consent_due)
        self.ports.setVisible(self.on_board)
        unusual = {self.devices: self.chosen.devices is not None, self.hand: self.hand.value() != MOUSE,
                   self.blind: self.blind.isChecked()}  # fmt: skip
        for rare, beside in self.rare.items():
            shown = (self.more.text() == LESS or unusual[rare]) and (rare is not self.hand or not self.on_board)
            for part in (rare, *beside):
                part.setVisible(shown)
        self.hand_words.setText(INPUTS[SENSOR if self.on_board else self.hand.value()].does)

    def _start(self) -> None:
        if self._session_open:
            self.page_asked.emit(RUN, None)
        elif self.start.isEnabled():
            wanted = self._wanted()
            if wanted.found is not None:
                self._resume(wanted.participant)
            elif wanted.consent_due:
                self._ask_consent()
            else:
                consent = (True, self._agreed[wanted.participant]) if wanted.agreed else None
                self._ask(m.Open(wanted.participant, False, self.blind.isChecked(), self.form.answers(), consent))

    def _resume(self, participant: str) -> None:
        """Go on with a session; code that it holds runs then."""
        folder = session_folder(self.chosen.data_dir, participant)
        ask_own_code(self.cards, self, folder, lambda: self._ask(m.Open(participant, resume=True)))

    def _ask(self, command: m.Open) -> None:
        """Open a session, by the session server that was chosen."""
        self._agreed.clear()
        self._opening = command.participant
        if self._same_setup:
            self.send(command)
        else:
            self.setup_asked.emit(self.chosen, command)
        self._refresh()

    # --------------------------------------------------------------------------------------- consent

    @property
    def _consent_asked(self) -> bool:
        """Whether the participant reads what they agree to, on their own screen."""
        return self.cards.question is not None and self.cards.question.kind == CONSENT

    def _ask_consent(self) -> None:
        """Let the participant read what they agree to: on their own screen where there is one, else here."""
        assert isinstance(self.loaded, Loaded) and self.loaded.protocol.consent is not None
        title = f"Consent of {self._label()}"
        if self.participant_answers:
            self.consent_asked.emit(self.loaded.protocol.consent)
            text = "The participant reads it and answers on the other screen."
            self.cards.put(OverlayCard(title, text, [("Cancel  Esc", self._show_columns)], self), CONSENT)
        else:
            self._show_columns()
            self.consent.show_consent(self.loaded.protocol.consent, title)
            self.stack.setCurrentWidget(self.asking)

    def answer_consent(self, agrees: bool) -> None:
        """The participant takes part, then the form comes; or does not, and that alone is recorded."""
        participant, now = self._label(), datetime.now(UTC).isoformat(timespec="milliseconds")
        self._show_columns()
        self.participant.setFocus()
        if agrees:
            self._agreed[participant] = now
            self._refresh()
            for first in tab_stops(self.form)[:1]:
                first.setFocus()
        else:
            self._named = ""  # another participant comes next
            self._ask(m.Open(participant, consent=(False, now)))
            self._opening = ""

    # --------------------------------------------------------------------------------------- the editor

    def _edit(self) -> None:
        """The chosen protocol; what was changed in another one and is not saved is not lost without a question."""
        if not self.editor.changed or self.editor.name == self.chosen.protocol:
            self._edit_chosen()
            return
        text = f"{self.editor.what}: its changes are not saved."
        buttons = [("Go on with them  Enter", self._show_editor), ("Lose them", self._edit_chosen)]
        self.cards.put(OverlayCard("Not everything is saved", text, buttons, self))

    def _edit_chosen(self) -> None:
        self.editor.open(self.chosen.protocol)
        self._show_editor()

    def _show_editor(self) -> None:
        self.cards.leave()
        self.stack.setCurrentWidget(self.editor)
        self.editor.text.setFocus()
