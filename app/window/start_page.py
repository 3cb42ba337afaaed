"""The page before a session: who takes part, go on with an interrupted session, or just try it with the mouse."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QCheckBox, QFrame, QHBoxLayout, QLineEdit, QPushButton, QVBoxLayout, QWidget

from app.ipc import messages as m
from app.window.painting import theme
from app.window.painting.labels import breakable, line, word

CARD_PX = 372
RESUMABLE_MOST = 4  # shown; the others can be typed
OWN = "This session goes on with its own protocol: {}, as it was stored."


class StartPage(QWidget):
    """Two cards: a session; a try without one."""

    session_asked = Signal(str, bool, bool)  # participant, resume, blind
    practice_asked = Signal()
    device_asked = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.participant = QLineEdit()
        self.participant.setMaxLength(20)
        self.participant.setFont(theme.font(theme.TITLE))
        self.participant.setAccessibleName("Participant")
        self.participant.returnPressed.connect(self._open)
        self.participant.textChanged.connect(lambda _: self._allow())
        self.wrong = line("Letters a to z and digits only, without spaces", "quiet", theme.SMALL)
        self.blind = QCheckBox("Blind console")
        self.blind.setToolTip("Hides controllers and currents from the experimenter too, until the key is opened")
        self.new = self._button("New session  Enter", main=True)
        self.new.clicked.connect(self._open)
        self.about = line("", "quiet")
        self.resume_head = line("", "caution")
        self.resumable: list[QPushButton] = []
        self.problem = line("", "bad")
        self.practice = self._button("Try a trial with the mouse  F4", main=True)
        self.practice.setShortcut("F4")  # a letter would go into the participant's name
        self.practice.clicked.connect(self.practice_asked)
        self.device = self._button("Device page  F3")
        self.device.clicked.connect(self.device_asked)
        self.why = line("", "caution", theme.SMALL)
        self._why = "preparing"  # why nothing can be opened
        self._resumable: tuple[str, ...] = ()  # participants whose session is unfinished
        self._finished: tuple[str, ...] = ()  # .. is done
        self._why_no_practice = "preparing"
        self._otherwise: dict[str, str] = {}  # participant -> the protocol of their session, where it is another one
        self._name, self._protocol, self._always_blind = "", "", False
        self._problem, self._problem_of = "", ""  # what went wrong, and the label that stood there then
        self._off = False  # brakes are off
        self._lay_out()
        self._allow()

    @staticmethod
    def _button(text: str, main: bool = False) -> QPushButton:
        made = QPushButton(text, objectName="main" if main else "")
        made.setFont(theme.font(theme.NORMAL, bold=True))
        made.setMinimumHeight(38)
        made.setAutoDefault(True)
        return made

    def _lay_out(self) -> None:
        session, inside = self._card("A session", "Every trial of the plan, recorded for one participant.")
        who = QHBoxLayout()
        who.setSpacing(10)
        who.addWidget(word("Participant", "quiet"))
        who.addWidget(self.participant, 1)
        inside.addLayout(who)
        inside.addWidget(self.wrong)
        inside.addWidget(self.problem)
        inside.addWidget(self.about)
        inside.addWidget(self.blind)
        inside.addStretch(1)
        inside.addWidget(self.new)
        self._resume = QVBoxLayout()
        self._resume.setSpacing(6)
        inside.addWidget(self.resume_head)
        inside.addLayout(self._resume)

        text = "One trial with the mouse as the hand. Nothing to set up; it counts nowhere."
        practice, inside = self._card("Just try it", text)
        for step in (
            f"1   Touch the {theme.HANDLE_NAME} dot: the pointer takes hold of it",
            "2   Bring it into the green circle and keep still",
            "3   Follow the line to the orange circle",
        ):
            inside.addWidget(line(step))
        inside.addWidget(line("The brakes can only resist: the dot is heavy where the path is not.", "quiet"))
        inside.addStretch(1)
        inside.addWidget(self.practice)

        text = "A session begins with its guided steps: connect, home, take the zero. The hand moves the real handle."
        bench, inside = self._card("The device is on the bench", text)
        inside.addWidget(line("Real currents flow in real brakes. Esc takes them off at once, in any window."))
        inside.addWidget(line("Its page says how it is and what to do if it is not well.", "quiet"))
        inside.addStretch(1)
        inside.addWidget(self.device)
        self._practice, self._bench = practice, bench
        bench.hide()

        cards = QHBoxLayout()
        cards.setSpacing(2 * theme.GAP)
        cards.addStretch(1)
        cards.addWidget(session)
        cards.addWidget(practice)
        cards.addWidget(bench)
        cards.addStretch(1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addStretch(2)
        layout.addWidget(word("Passive haptic display", size=theme.HEAD, bold=True), 0, Qt.AlignmentFlag.AlignHCenter)
        layout.addSpacing(2 * theme.GAP)
        layout.addLayout(cards)
        layout.addSpacing(theme.GAP)
        layout.addWidget(self.why, 0, Qt.AlignmentFlag.AlignHCenter)
        layout.addStretch(3)
        self.why.setMinimumWidth(2 * CARD_PX)
        self.why.setAlignment(Qt.AlignmentFlag.AlignHCenter)
        for absent in (self.wrong, self.problem, self.resume_head):
            absent.hide()

    @staticmethod
    def _card(title: str, text: str) -> tuple[QFrame, QVBoxLayout]:
        frame = QFrame(objectName="panel")
        frame.setFixedWidth(CARD_PX)
        frame.setMinimumHeight(270)
        inside = QVBoxLayout(frame)
        inside.setContentsMargins(20, 16, 20, 18)
        inside.setSpacing(10)
        inside.addWidget(line(title, size=theme.TITLE, bold=True))
        inside.addWidget(line(text, "quiet"))
        return frame, inside

    def show_session(self, opened: m.Opened | None, snapshot: m.Snapshot) -> None:
        """What can be opened, and what went wrong when it was tried."""
        if opened is not None:
            names = " and ".join(device.name for device in opened.devices)
            trials = f"{len(opened.plan)} trials, " if opened.plan else ""
            self._name = opened.protocol
            self._protocol = f"Protocol {opened.protocol}: {trials}{names}, {len(opened.controllers)} controllers."
            if opened.blind != self._always_blind:
                self._always_blind = opened.blind
                self.blind.setChecked(opened.blind)
        self._otherwise = dict(snapshot.otherwise)
        self._show_resumable(snapshot.resumable)
        self._finished = snapshot.finished
        problem = snapshot.said if snapshot.said_bad and snapshot.stage != m.FAILED else ""  # there a banner says it
        if problem != self._problem:
            self._problem, self._problem_of = problem, self.participant.text()
        self._mind_keys(bool(snapshot.brakes_off))
        on_bench = opened is not None and opened.real_device
        self._practice.setVisible(not on_bench)
        self._bench.setVisible(on_bench)
        prepares = snapshot.stage == m.PREPARING
        self._why = "Preparing …" if prepares else snapshot.why_no_session(on_bench)
        self._why_no_practice = "Preparing …" if prepares else snapshot.why_not
        if snapshot.stage == m.PREPARING:
            self.why.setText("Preparing … on first use this takes about a quarter of a minute.")
        else:
            self.why.setText(f"Not yet: {self._why}" if self._why and snapshot.stage != m.FAILED else "")
        self._allow()

    def offer(self, participant: str) -> None:
        """Somebody for a session, at first and after another one's."""
        self.participant.setText(participant)
        self.blind.setChecked(self._always_blind)

    def _mind_keys(self, off: bool) -> None:
        """While brakes are off the letter B allows them: the field does not take it before it is clicked."""
        if off == self._off:
            return
        self._off = off
        self.participant.setFocusPolicy(Qt.FocusPolicy.ClickFocus if off else Qt.FocusPolicy.StrongFocus)
        if off:
            self.participant.clearFocus()
        elif self.isVisible():
            self.participant.setFocus()

    def _show_resumable(self, participants: tuple[str, ...]) -> None:
        shown = participants[:RESUMABLE_MOST]
        texts = [self._resume_text(label) for label in shown]
        if [button.property("says") for button in self.resumable] != texts:
            for button in self.resumable:
                self._resume.removeWidget(button)
                button.deleteLater()
            self.resumable = [self._resume_button(label, text) for label, text in zip(shown, texts, strict=True)]
        more = len(participants) - len(shown)
        several = "Interrupted sessions can go on"
        one = "An interrupted session can go on:" if len(participants) == 1 else f"{several}:"
        self.resume_head.setText(one if more <= 0 else f"{several} (type the name for {more} more):")
        self.resume_head.setVisible(bool(participants))
        self._resumable = participants

    def _resume_text(self, label: str) -> str:
        other = self._otherwise.get(label)
        if other is None:
            return f"Resume participant {label}"
        return f"Resume participant {label} · {other if other != self._name else 'other settings'}"

    def _resume_button(self, label: str, text: str) -> QPushButton:
        button = self._button("")
        room = CARD_PX - 2 * 20 - 2 * 14  # px, between the edges of the card and of the button
        button.setText(button.fontMetrics().elidedText(text, Qt.TextElideMode.ElideRight, room))
        button.setProperty("says", text)
        if label in self._otherwise:
            button.setToolTip(OWN.format(self._otherwise[label]))
        button.clicked.connect(lambda: self._ask(label, True, False))
        self._resume.addWidget(button)
        return button

    def _allow(self) -> None:
        label = self.participant.text()
        there, fits = label in (*self._resumable, *self._finished), label.isascii() and label.isalnum()
        done = "Open this finished session" if label in self._finished else "New session"
        self.new.setText(f"{'Resume this session' if label in self._resumable else done}  Enter")
        self.new.setEnabled(not self._why and fits)
        self.wrong.setVisible(bool(label) and not fits)
        self.problem.setText(breakable(self._problem))
        self.problem.setVisible(bool(self._problem) and label == self._problem_of)
        other = self._otherwise.get(label) if there else None
        self.about.setText(self._protocol if other is None else OWN.format(other))
        self.blind.setVisible(not there)  # of a session that is there it was settled with it
        self.blind.setEnabled(not self._always_blind)
        self.blind.setText("Blind console: the protocol says so" if self._always_blind else "Blind console")
        self.practice.setEnabled(not self._why_no_practice)
        for button in self.resumable:
            button.setEnabled(not self._why)

    def _open(self) -> None:
        if self.new.isEnabled():
            label = self.participant.text()
            there = label in (*self._resumable, *self._finished)
            self._ask(label, there, self.blind.isChecked() and not there)

    def _ask(self, label: str, resume: bool, blind: bool) -> None:
        self._problem_of = self.participant.text()  # what may be said now is about this
        self.session_asked.emit(label, resume, blind)
