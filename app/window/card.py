"""A card in the middle of the workspace: a question with its reasons, the re-rig, the break, the end.

In the window, never a window of its own: nothing is covered for good, every answer has a key. Tab stays on the card.
"""

from collections.abc import Callable, Sequence

from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtGui import QKeyEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLineEdit, QPushButton, QVBoxLayout, QWidget

from app.window.painting import theme
from app.window.painting.labels import KeyButton, breakable, line

WIDTH_PX = 400
ENTER = (Qt.Key.Key_Return, Qt.Key.Key_Enter)
LEAVE, LEAVE_RUNNING = ("Leave it", "Esc"), ("Leave it", "Alt+0")  # while a trial runs Esc is brakes off

ABORT_REASONS = ("the participant asked", "the participant was distracted", "something was wrong with the device")
REDO_REASONS = ("the participant was distracted", "the participant had not understood", "something disturbed the trial")
SKIP_REASONS = ("the participant asked", "short of time", "something is wrong with this condition")


class Card(QFrame):
    """Title, text and, below them, whatever a subclass adds; it stays in the middle of its parent."""

    def __init__(self, title: str, text: str, parent: QWidget) -> None:
        super().__init__(parent, objectName="card")
        self.title, self.text = line(title, size=theme.HEAD, bold=True), line(breakable(text), "quiet")
        self.text.setVisible(bool(text))
        self.inside = QVBoxLayout(self)
        self.inside.setContentsMargins(20, 16, 20, 18)
        self.inside.setSpacing(8)
        self.inside.addWidget(self.title)
        self.inside.addWidget(self.text)
        parent.installEventFilter(self)

    def button(self, text: str, do: Callable[[], None], main: bool = False) -> QPushButton:
        """One more button at the bottom of the card."""
        made = QPushButton(text, objectName="main" if main else "")
        made.setFont(theme.font(theme.NORMAL, bold=main))
        made.setMinimumHeight(34)
        made.setAutoDefault(True)
        made.clicked.connect(lambda: do())
        return made

    def appear(self, focused: bool = True) -> None:
        """Take its place and come to the front, with the keyboard or without."""
        self.show()
        self.place()
        self.raise_()
        if focused:
            self.take_focus()

    def take_focus(self) -> None:
        """The keyboard is its own."""

    def place(self) -> None:
        """Into the middle of the parent."""
        parent = self.parentWidget()
        self.setFixedWidth(min(WIDTH_PX, max(parent.width() - 2 * theme.GAP, 280)))
        height = self.heightForWidth(self.width()) if self.hasHeightForWidth() else self.sizeHint().height()
        self.setFixedHeight(min(max(height, self.minimumSizeHint().height()), max(parent.height() - 8, 120)))
        self.move((parent.width() - self.width()) // 2, max((parent.height() - self.height()) // 2, 4))

    def key(self, key: str, do: Callable[[], None]) -> None:
        """Let a key act while the card is there."""
        QShortcut(QKeySequence(key), self, do).setAutoRepeat(False)

    def enter(self) -> None:
        """Enter was pressed beside the card: as on it."""

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
        if watched is self.parentWidget() and not self.isHidden():
            if event.type() == QEvent.Type.Resize:
                self.place()
            elif event.type() == QEvent.Type.KeyPress and isinstance(event, QKeyEvent) and event.key() in ENTER:
                self.enter()
                return True
        return super().eventFilter(watched, event)


class Question(Card):
    """What to do, and why: Alt with 1, 2, 3, or one's own words and Enter, which may begin with any digit."""

    answered = Signal(str)
    left = Signal()

    def __init__(
        self,
        title: str,
        text: str,
        reasons: Sequence[str],
        do: str,
        parent: QWidget,
        leave: tuple[str, str] = LEAVE,
    ) -> None:
        """do: what the button says; leave: what the other one says, and its key."""
        super().__init__(title, text, parent)
        self.reasons = tuple(reasons)
        for number, reason in enumerate(self.reasons, start=1):
            button = KeyButton(reason[0].upper() + reason[1:], f"Alt+{number}")
            button.clicked.connect(lambda _=False, chosen=reason: self.answered.emit(chosen))
            self.key(f"Alt+{number}", button.click)
            self.inside.addWidget(button)
        self.own = QLineEdit()
        self.own.setPlaceholderText("Another reason")
        self.own.setAccessibleName("Another reason")
        self.own.setMaxLength(200)
        self.own.textChanged.connect(lambda text: self.confirm.setEnabled(bool(text.strip())))
        self.own.returnPressed.connect(self._answer)
        self.confirm = self.button(f"{do}  Enter", self._answer, main=True)
        self.confirm.setEnabled(False)
        self.cancel = self.button("  ".join(leave), self.left.emit)
        if leave != LEAVE:  # Esc is the window's
            self.key(leave[1], self.left.emit)
        row = QHBoxLayout()
        row.setSpacing(8)
        row.addWidget(self.cancel)
        row.addStretch(1)
        row.addWidget(self.confirm)
        self.inside.addWidget(self.own)
        self.inside.addSpacing(4)
        self.inside.addLayout(row)

    def take_focus(self) -> None:
        self.own.setFocus()

    enter = take_focus

    def _answer(self) -> None:
        if reason := self.own.text().strip():
            self.answered.emit(reason)


class Notice(Card):
    """What has to be done or is over, with buttons; the first is the one that Enter presses."""

    def __init__(self, title: str, text: str, buttons: Sequence[tuple[str, Callable[[], None]]], parent: QWidget):
        super().__init__(title, text, parent)
        self.buttons = [self.button(says, do, main=i == 0) for i, (says, do) in enumerate(buttons)]
        self.inside.addSpacing(4)
        if len(self.buttons) > 2:  # no room for them side by side
            for made in self.buttons:
                self.inside.addWidget(made)
            return
        row = QHBoxLayout()
        row.setSpacing(8)
        row.addStretch(1)
        for made in reversed(self.buttons):
            row.addWidget(made)
        self.inside.addLayout(row)

    def take_focus(self) -> None:
        if self.buttons:
            self.buttons[0].setFocus()

    def enter(self) -> None:
        if self.buttons:
            self.buttons[0].click()
