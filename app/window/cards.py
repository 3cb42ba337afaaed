"""Which card is up: a question that the experimenter has asked for, else what the session waits for."""

import time
from collections.abc import Callable, Sequence

from PySide6.QtWidgets import QLineEdit, QWidget

from app.ipc import messages as m
from app.window.card import LEAVE, LEAVE_RUNNING, Card, Notice, Question
from app.window.plan_grid import statuses
from app.window.words import clock
from experiments.analysis.trials_table import COUNTED

UNBLIND = ("Open the key?", "The controllers become visible here and in the tables. Who asks is kept in the journal.")
RESTED = "Go on when the participant is ready."
A_MOMENT = "A moment"  # begins what is said while a step is being done
CLOSE = (
    "A trial is being recorded",
    "Close the window? The trial ends, brakes off; what was recorded is kept. It comes again when you resume.",
)


class Cards:
    """One question and one notice at most; the question lies on top."""

    def __init__(self, parent: QWidget) -> None:
        self._parent = parent
        self._question: Card | None = None
        self._kind = ""
        self._notice: Card | None = None
        self._waits: tuple | None = None  # what the notice is about
        self._over_s: float | None = None  # when the break may end

    # questions

    def ask(
        self, kind: str, title: str, text: str, reasons: Sequence[str], do: str, then: Callable[[str], None]
    ) -> None:
        """Put a question, in place of another one."""
        self.leave()
        question = Question(title, text, reasons, do, self._parent, LEAVE_RUNNING if kind == "abort" else LEAVE)

        def answered(reason: str) -> None:
            self.leave()
            then(reason)

        question.answered.connect(answered)
        question.left.connect(self.leave)
        self._question, self._kind = question, kind
        question.appear()

    def ask_to_close(self, close: Callable[[], None]) -> None:
        """Whether to close while a trial is recorded."""
        self.leave()
        self._kind = "abort"
        answers = [("Go on  Enter", self.leave), ("Abort and close  Alt+C", close)]
        self._question = Notice(*CLOSE, answers, self._parent)
        self._question.key("Alt+C", close)
        self._question.appear()

    def leave(self) -> bool:
        """Take the question away; whether there was one."""
        question, self._question, self._kind = self._question, None, ""
        if question is None:
            return False
        question.hide()
        question.deleteLater()
        self._parent.window().setFocus()
        self.take_focus()
        return True

    def _typing(self) -> bool:
        """Whether somebody is writing a note: a notice that comes must not take the next letters for an answer."""
        at = self._parent.window().focusWidget()
        return isinstance(at, QLineEdit) and at.isVisible()

    def take_focus(self) -> None:
        """The keyboard is the card's that is up."""
        if (card := self._question or self._notice) is not None:
            card.take_focus()

    def withdraw(self, kinds: set[str]) -> None:
        """Take the question away if it is one of these."""
        if self._kind in kinds:
            self.leave()

    @property
    def question(self) -> Card | None:
        """The question that is up."""
        return self._question

    @property
    def notice(self) -> Card | None:
        """The notice that is up."""
        return self._notice

    def press_main(self) -> bool:
        """The space bar: the notice's first button. Whether there is a card that stands in the way of a start."""
        if self._question is not None:
            return True
        if isinstance(self._notice, Notice):
            if self._notice.buttons and self._notice.buttons[0].isEnabled():
                self._notice.buttons[0].click()
            return True
        return self._notice is not None

    # notices

    def show_session(self, opened: m.Opened, snapshot: m.Snapshot, do) -> None:
        """What the session waits for; do: the window's commands."""
        coming = snapshot.coming.configuration if snapshot.coming else ""
        waits = (snapshot.stage, coming, snapshot.wait_for, snapshot.blind, opened.folder)
        if snapshot.stage not in (m.RERIG, m.BREAK, m.QUESTIONS, m.FINISHED):
            waits = None
        if waits == self._waits:
            return
        self._waits, self._over_s = waits, None
        if self._notice is not None:
            self._notice.hide()
            self._notice.deleteLater()
            self._notice = None
        if waits is not None:
            self._notice = self._make(opened, snapshot, do)
            self._notice.appear(focused=self._question is None and not self._typing())
            if self._question is not None:
                self._question.raise_()

    def _make(self, opened: m.Opened, snapshot: m.Snapshot, do) -> Card:
        if snapshot.stage == m.RERIG and snapshot.coming is not None:
            name = snapshot.coming.configuration
            if not opened.real_device:
                answers = [("It is done  Enter", do.confirm)]
                return Notice(f"Change to {name}", snapshot.wait_for, answers, self._parent)
            answers = [("Go on  Enter", do.confirm), ("Device page  F3", do.device)]
            busy = snapshot.wait_for.startswith(A_MOMENT)
            return Notice(f"Make {name} ready", snapshot.wait_for, [] if busy else answers, self._parent)
        if snapshot.stage == m.BREAK:
            self._over_s = time.monotonic() + snapshot.wait_s
            return Notice("Break", snapshot.wait_for, [("Go on  Enter", do.confirm)], self._parent)
        if snapshot.stage == m.QUESTIONS:
            return Notice("Questions", "The participant answers them on the other screen.", [], self._parent)
        kept = sum(bool(row.recording) for row in snapshot.rows)
        text = f"{kept} runs are recorded and verified in {opened.folder}."
        lacking = sum(status not in COUNTED for status in statuses(opened.plan, snapshot.rows).values())
        if lacking:
            text += f" {lacking} of {len(opened.plan)} trials have no result: × (aborted) or – (skipped) in the plan."
        buttons = [("Results  F2", do.results)]
        if snapshot.blind:
            buttons.append(("Open the key …", lambda: self.ask("unblind", *UNBLIND, (), "Open", do.unblind)))
        buttons.append(("Next participant", do.leave))
        return Notice("The plan is done", text, buttons, self._parent)

    def show_time(self, now_s: float) -> None:
        """The countdown of a break."""
        if self._over_s is None or not isinstance(self._notice, Notice):
            return
        left = self._over_s - now_s
        button = self._notice.buttons[0]
        button.setEnabled(left <= 0.0)
        says = f"Break · {clock(left)}" if left > 0.0 else "The break is over"
        if says != self._notice.title.text():
            self._notice.title.setText(says)
            if left <= 0.0:
                self._notice.text.setText(RESTED)
                button.setFocus()
