"""Cards over a part of the window: a message, or a question that is answered by a button, a reason or own words."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QLineEdit, QWidget

from app.window.widgets import theme
from app.window.widgets.keys import add_key
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

WIDTH_PX = 400  #
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
    leave: str = "Cancel"  # the words of the button that closes it

    def of_trial(self, name: str, about: str = "") -> "Ask":
        """The same of one trial, by its name: "trial 4"."""
        return self._replace(title=self.title.format(name), text=self.text.format(about))


EXCLUDE = Ask(
    "exclude", "Exclude {}?", "Its recording is kept; it does not count and does not come again.", "Exclude",
    (
        "the pointer left the window", "the participant was distracted", "the device was disturbed",
        "the task was not followed",
    ),
)  # fmt: skip


class OverlayCard(Panel):
    """Title, text and buttons in the middle of its parent; whatever a subclass adds stands between them.

    buttons: words -> what it does; Enter presses the first.
    """

    wide_px, kind = WIDTH_PX, ""  # how wide it is where there is room; what it asks

    def __init__(self, title: str, text: str, buttons: Sequence[tuple[str, Callable[[], object]]], parent: QWidget):
        super().__init__("card", parent)
        self._around = parent
        self.title = wrapped_label(title, size=theme.HEAD, bold=True)
        self.text = wrapped_label(breakable(text), "quiet")
        self.text.setVisible(bool(text))
        self.inside = column(self.title, self.text, spacing=8)
        self.buttons = [button(words, do, "" if place else "main") for place, (words, do) in enumerate(buttons)]
        for place, answer in enumerate(self.buttons):
            answer.setFont(theme.font(theme.NORMAL, bold=place == 0))
            answer.setMinimumHeight(34)
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
        width = max(self.wide_px, self.minimumSizeHint().width())  # its buttons are never cut
        self.setFixedWidth(min(width, max(around.width() - 2 * theme.GAP, 280)))
        height = self.heightForWidth(self.width()) if self.hasHeightForWidth() else self.sizeHint().height()
        self.setFixedHeight(min(max(height, self.minimumSizeHint().height()), max(around.height() - 8, 120)))
        self.move((around.width() - self.width()) // 2, max((around.height() - self.height()) // 2, 4))

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
        """Enter that no button or field on the card has used; what lies behind the card did not ask for it."""
        if event.key() not in ENTER:
            super().keyPressEvent(event)
        elif self.isVisible():  # else it was just answered
            self.enter()

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
        buttons = ((f"{ask.do}  Enter", lambda: self._answer()), (ask.leave, leave))
        super().__init__(ask.title, ask.text, buttons, parent)
        self._answered = answered
        self.confirm, self.cancel = self.buttons
        self.choices = Segments(dict(ask.choices))
        if ask.choices:
            self.choices.show_value(ask.choices[0][0])
            self.inside.addWidget(self.choices)
            self.inside.addWidget(text_label("Why?", "quiet"))
        for number, reason in enumerate(ask.reasons, start=1):
            answer = KeyButton(reason[0].upper() + reason[1:], f"Alt+{number}")
            answer.clicked.connect(lambda _=False, reason=reason: answered(reason))
            add_key(f"Alt+{number}", self, answer.click)
            self.inside.addWidget(answer)
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
    """One question at most over a part of the window."""

    def __init__(self, parent: QWidget) -> None:
        self._parent = parent
        self.question: OverlayCard | None = None
        self._came_from: QWidget | None = None  # what had the keyboard before it

    def put(self, question: OverlayCard, kind: str = "") -> None:
        """Show a question, in place of another one; kind: for `withdraw`."""
        self.leave()
        self._came_from = self._parent.window().focusWidget()
        self.question, question.kind = question, kind
        question.appear()

    def ask(self, ask: Ask, then: Callable[..., object], written: str = "") -> None:
        """Ask for a reason; then: what is done with it and, where there are choices, with the chosen one.

        written: own words that stand in the field already.
        """

        def answered(reason: str) -> None:
            chosen = [question.choices.value()] if ask.choices else []
            self.leave()
            then(reason, *chosen)

        question = Question(ask, answered, self.leave, self._parent)
        question.own.setText(written)
        self.put(question, ask.kind)

    def written(self, kind: str) -> str:
        """The own words that stand in the field of a question of this kind; "": none, or no such question."""
        question = self.question
        return question.own.text().strip() if isinstance(question, Question) and question.kind == kind else ""

    def show_message(self, title: str, text: str) -> None:
        self.put(OverlayCard(title, text, [("Close  Enter", self.leave)], self._parent))

    def leave(self) -> bool:
        """Take the question away; whether there was one."""
        question, self.question = self.question, None
        if question is None:
            return False
        question.hide()
        question.deleteLater()
        before = self._came_from
        if before in self._parent.window().findChildren(QWidget) and before.isVisible() and before.isEnabled():
            before.setFocus()
        else:
            self._parent.window().setFocus()
        if not isinstance(before, QLineEdit):  # one who was typing types on
            self.take_focus()
        return True

    def to_close(self) -> Callable[[], object] | None:
        """What Esc does to a question; None: there is none."""
        return self.leave if self.question is not None else None

    def come_forward(self) -> None:
        """Lie over what was brought to the front since."""
        if self.question is not None:
            self.question.raise_()

    def take_focus(self) -> None:
        """Give the keyboard to the card that is up."""
        if self.question is not None:
            self.question.take_focus()

    def withdraw(self, kinds: set[str]) -> None:
        """Take the question away if it is one of these."""
        if self.question is not None and self.question.kind in kinds:
            self.leave()
