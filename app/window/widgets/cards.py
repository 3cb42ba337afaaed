"""Which card is up: a question that the experimenter has asked for, else what the session waits for."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import QGridLayout, QLineEdit, QWidget

from app.ipc import messages as m
from app.window.widgets import theme
from app.window.widgets.page import ANALYSE, HOME, RUN, Page
from app.window.widgets.parts import (
    KeyButton,
    Panel,
    Segments,
    breakable,
    button,
    column,
    row,
    text_label,
    wrapped_label,
)
from app.window.widgets.words import LEAVE, clock
from experiments.plan import counted
from experiments.session.files import finished_cells

WIDTH_PX, KEYS_PX = 400, 960
ENTER = (Qt.Key.Key_Return, Qt.Key.Key_Enter)


class Ask(NamedTuple):
    """A question that is answered with a reason: one of these, or one's own words."""

    kind: str
    title: str
    text: str
    do: str  # the words of its button
    reasons: tuple[str, ...] = ()
    choices: tuple[tuple[str, str], ...] = ()  # of these one is chosen besides, the first unless another is clicked
    own: str = "Another reason"  # what one's own words are


ABORT = Ask(
    "abort", "Abort this trial?", "It goes on until you answer. Its recording is kept and marked as aborted.", "Abort",
    ("the participant asked", "the participant was distracted", "something was wrong with the device"),
    (("now", "Repeat now"), ("end", "Repeat later"), ("never", "Do not repeat")),
)  # fmt: skip
REDO = Ask(
    "redo", "Repeat trial {}?", "It comes next. The recording is kept and marked as redone.", "Repeat",
    ("the participant was distracted", "the participant had not understood", "something disturbed the trial"),
)  # fmt: skip
SKIP = Ask(
    "skip", "Skip trial {}?", "{}. It is marked as skipped and does not come again.", "Skip",
    ("the participant asked", "short of time", "something is wrong with this condition"),
)  # fmt: skip
UNBLIND = Ask(
    "unblind", "Open the key?",
    "The controllers become visible here and in the tables. The journal keeps who asked.", "Open",
    own="Who asks",
)  # fmt: skip
RESTED = "Go on when the participant is ready."
CLOSE = (
    "A trial is being recorded",
    "Close the window? The trial ends, brakes off; its recording is kept, and the trial is repeated when you resume.",
)

UNSAVED = (
    "Not everything is on the disk",
    "Close the window? What is in memory alone would be lost: {}. Bring the folder back, make room on the disk, or go "
    "on in another data folder first.",
)


class OverlayCard(Panel):
    """Title, text and buttons in the middle of its parent; whatever a subclass adds stands between them.

    buttons: words -> what it does; Enter presses the first.
    """

    wide = WIDTH_PX  # where there is room

    def __init__(self, title: str, text: str, buttons: Sequence[tuple[str, Callable[[], object]]], parent: QWidget):
        super().__init__("card", parent)
        self._around = parent
        self.title, self.text = (
            wrapped_label(title, size=theme.HEAD, bold=True),
            wrapped_label(breakable(text), "quiet"),
        )
        self.text.setVisible(bool(text))
        self.inside = column(self.title, self.text, spacing=8)
        self.buttons = [button(words, do, "" if at else "main") for at, (words, do) in enumerate(buttons)]
        for at, made in enumerate(self.buttons):
            made.setFont(theme.font(theme.NORMAL, bold=at == 0))
            made.setMinimumHeight(34)
            made.setAutoDefault(True)
        many = len(self.buttons) > 2  # no room for them side by side
        foot = column(*self.buttons, spacing=12) if many else row(1, *reversed(self.buttons))
        self.setLayout(column(self.inside, foot, spacing=12, margins=(20, 16, 20, 18)))
        parent.installEventFilter(self)

    def appear(self, focused: bool = True) -> None:
        """Take its place and come to the front, with the keyboard or without."""
        self.place()
        self.show()
        self.place()  # again: choices stand in as many lines as its width asks for
        self.raise_()
        if focused:
            self.take_focus()

    def take_focus(self) -> None:
        if self.buttons:
            self.buttons[0].setFocus()

    def enter(self) -> None:
        """Enter was pressed beside the card: press its first button."""
        if self.buttons:
            self.buttons[0].click()

    def place(self) -> None:
        """Stand in the middle of the parent."""
        around = self._around
        self.setFixedWidth(min(self.wide, max(around.width() - 2 * theme.GAP, 280)))
        height = self.heightForWidth(self.width()) if self.hasHeightForWidth() else self.sizeHint().height()
        self.setFixedHeight(min(max(height, self.minimumSizeHint().height()), max(around.height() - 8, 120)))
        self.move((around.width() - self.width()) // 2, max((around.height() - self.height()) // 2, 4))

    def key(self, key: str, do: Callable[[], object]) -> None:
        """Let a key act while the card is there."""
        QShortcut(QKeySequence(key), self, do).setAutoRepeat(False)

    def focusNextPrevChild(self, forwards: bool) -> bool:
        """Tab goes round on the card, so that Enter always means what its buttons say."""
        stops = [
            widget for widget in self.findChildren(QWidget)
            if widget.isVisible() and widget.isEnabled() and widget.focusPolicy() & Qt.FocusPolicy.TabFocus
        ]  # fmt: skip
        if stops:
            now = stops.index(self.focusWidget()) if self.focusWidget() in stops else -1 if forwards else 0
            stops[(now + (1 if forwards else -1)) % len(stops)].setFocus(Qt.FocusReason.TabFocusReason)
        return True

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Enter goes no further: what lies behind the card did not ask for it."""
        if event.key() not in ENTER:
            super().keyPressEvent(event)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if watched is self._around and not self.isHidden():
            if event.type() == QEvent.Type.Resize:
                self.place()
            elif event.type() == QEvent.Type.KeyPress and isinstance(event, QKeyEvent) and event.key() in ENTER:
                self.enter()
                return True
        return super().eventFilter(watched, event)


class Question(OverlayCard):
    """What to do, and why: Alt with 1, 2, 3, or one's own words and Enter, which may begin with any digit."""

    def __init__(
        self, ask: Ask, answered: Callable[[str], object], leave: Callable[[], object], parent: QWidget
    ) -> None:
        buttons = ((f"{ask.do}  Enter", lambda: self._answer()), ("Cancel  Esc", leave))
        super().__init__(ask.title, ask.text, buttons, parent)
        self._answered = answered
        self.confirm, self.cancel = self.buttons
        self.choices = Segments(dict(ask.choices))
        if ask.choices:
            self.choices.show_value(ask.choices[0][0])
            self.inside.addWidget(self.choices)
            self.inside.addWidget(text_label("Why?", "quiet"))
        for number, reason in enumerate(ask.reasons, start=1):
            made = KeyButton(reason[0].upper() + reason[1:], f"Alt+{number}")
            made.clicked.connect(lambda _=False, reason=reason: answered(reason))
            self.key(f"Alt+{number}", made.click)
            self.inside.addWidget(made)
        self.own = QLineEdit(placeholderText=ask.own, accessibleName=ask.own, maxLength=200)
        self.own.textChanged.connect(lambda text: self.confirm.setEnabled(bool(text.strip())))
        self.own.returnPressed.connect(self._answer)
        self.confirm.setEnabled(False)
        self.inside.addWidget(self.own)

    def take_focus(self) -> None:
        self.own.setFocus()

    enter = take_focus

    def _answer(self) -> None:
        if reason := self.own.text().strip():
            self._answered(reason)


class Cards:
    """One question and one notice at most; the question lies on top."""

    def __init__(self, parent: QWidget) -> None:
        self._parent = parent
        self.question: OverlayCard | None = None
        self._kind = ""  # of the question
        self.notice: OverlayCard | None = None
        self._waits: tuple | None = None  # what the notice is about
        self._over_s: float | None = None  # when the break may end

    # questions

    def put(self, question: OverlayCard, kind: str = "") -> None:
        """Show a question, in place of another one."""
        self.leave()
        self.question, self._kind = question, kind
        question.appear()

    def ask(self, ask: Ask, then: Callable[..., object]) -> None:
        """Ask for a reason; then: what is done with it and, where there are choices, with the chosen one."""

        def answered(reason: str) -> None:
            chosen = [question.choices.value()] if ask.choices else []
            self.leave()
            then(reason, *chosen)

        question = Question(ask, answered, self.leave, self._parent)
        self.put(question, ask.kind)

    def show_message(self, title: str, text: str) -> None:
        """Show what the user has to read."""
        self.put(OverlayCard(title, text, [("Close  Enter", self.leave)], self._parent))

    def show_keys(self, groups: Mapping[str, Mapping[str, str]]) -> None:
        """Title of a group -> key -> what it does."""
        card = OverlayCard("Keys", "", [("Close  Enter", self.leave)], self._parent)
        card.wide = KEYS_PX
        columns = row(spacing=24)
        for title, keys in groups.items():
            grid = QGridLayout()
            grid.setHorizontalSpacing(14)
            grid.setVerticalSpacing(4)
            grid.setColumnStretch(1, 1)
            for down, (key, does) in enumerate(keys.items()):
                grid.addWidget(text_label(key, bold=True), down, 0, Qt.AlignmentFlag.AlignTop)
                grid.addWidget(wrapped_label(does, "quiet"), down, 1)
            columns.addLayout(column(text_label(title, size=theme.TITLE), grid, 1), 1)
        card.inside.addLayout(columns)
        self.put(card)

    def ask_to_leave(self, close: Callable[[], None]) -> None:
        buttons = [("Close session  Enter", close), ("Cancel  Esc", self.leave)]
        self.put(OverlayCard("Close the session?", LEAVE, buttons, self._parent), "leave")

    def ask_to_close(self, close: Callable[[], None], unsaved: str = "") -> None:
        """unsaved: what would be lost; "": the running trial would be ended."""
        title, text = (UNSAVED[0], UNSAVED[1].format(unsaved)) if unsaved else CLOSE
        do = "Lose it and close" if unsaved else "Abort and close"
        card = OverlayCard(
            title,
            text,
            [("Keep recording  Enter" if not unsaved else "Cancel  Enter", self.leave), (f"{do}  Alt+C", close)],
            self._parent,
        )
        card.key("Alt+C", close)
        self.put(card, "abort")

    def leave(self) -> bool:
        """Take the question away; whether there was one."""
        question, self.question, self._kind = self.question, None, ""
        if question is None:
            return False
        question.hide()
        question.deleteLater()
        self._parent.window().setFocus()
        self.take_focus()
        return True

    def _typing(self) -> bool:
        """Whether the user is typing: a notice that comes must not take the next letters for an answer."""
        at = self._parent.window().focusWidget()
        return isinstance(at, QLineEdit) and at.isVisible()

    def take_focus(self) -> None:
        """The keyboard is the card's that is up."""
        if (card := self.question or self.notice) is not None:
            card.take_focus()

    def withdraw(self, kinds: set[str]) -> None:
        """Take the question away if it is one of these."""
        if self._kind in kinds:
            self.leave()

    def press_main(self) -> bool:
        """The space bar: the notice's first button. Whether there is a card that stands in the way of a start."""
        if self.question is not None:
            return True
        if self.notice is not None:
            self.notice.enter()
        return self.notice is not None

    # notices

    def show_session(self, opened: m.Opened, snapshot: m.Snapshot, page: Page) -> None:
        """What the session waits for; page: sends what the buttons ask for."""
        coming = snapshot.coming.configuration if snapshot.coming else ""
        card = snapshot.card and snapshot.card._replace(wait_s=0.0)  # that goes by without a new card
        has_notice = card is not None or snapshot.stage == m.FINISHED
        waits = (card, coming, snapshot.blind, opened.folder) if has_notice else None
        if waits == self._waits:
            return
        self._waits, self._over_s = waits, None
        if self.notice is not None:
            self.notice.hide()
            self.notice.deleteLater()
            self.notice = None
        if waits is not None:
            self.notice = self._make(opened, snapshot, page)
            self.notice.appear(focused=self.question is None and not self._typing())
            if self.question is not None:
                self.question.raise_()

    def _make(self, opened: m.Opened, snapshot: m.Snapshot, page: Page) -> OverlayCard:
        if (card := snapshot.card) is not None:
            if card.wait_s or snapshot.stage == m.BREAK:
                self._over_s = time.perf_counter() + card.wait_s
            buttons = [(f"{card.go_on}  Enter", lambda: page.send(m.Confirm()))] if card.go_on else []
            if card.device_page:
                buttons.append(("Device page  F3", lambda: page.page_asked.emit(HOME, RUN)))
            return OverlayCard(card.title, card.text, buttons, self._parent)
        kept = sum(bool(row.recording) for row in snapshot.rows)
        are = "is" if kept == 1 else "are"
        text = f"{counted(kept, 'run')} {are} recorded and verified in {opened.folder}."
        lacking = len(finished_cells(snapshot.rows)[1])
        if lacking:
            text += f" {lacking} of {len(opened.plan)} trials have no result: × (aborted), – (skipped) or e (excluded)."
        buttons = [("Results  F2", lambda: page.page_asked.emit(ANALYSE, None))]
        if snapshot.blind:
            buttons.append(("Open the key …", lambda: self.ask(UNBLIND, lambda who: page.send(m.Unblind(who)))))
        buttons.append(("Next participant", lambda: page.send(m.Leave())))
        return OverlayCard("Session complete", text, buttons, self._parent)

    def show_time(self, now_s: float) -> None:
        """The countdown of a break."""
        if self._over_s is None or self.notice is None:
            return
        left = self._over_s - now_s
        button = self.notice.buttons[0]
        button.setEnabled(left <= 0.0)
        title = f"Break · {clock(left)}" if left > 0.0 else "The break is over"
        if title != self.notice.title.text():
            self.notice.title.setText(title)
            if left <= 0.0:
                self.notice.text.setText(RESTED)
                button.setFocus()
