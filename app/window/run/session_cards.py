"""The cards of a session: what the experimenter asks for, and on notices what the session waits for."""

import time
from collections.abc import Callable
from pathlib import Path

from PySide6.QtWidgets import QLineEdit, QWidget

from app.ipc import messages as m
from app.window.widgets.cards import Ask, Cards, OverlayCard
from app.window.widgets.page import ANALYSE, DEVICE, Page
from app.window.widgets.words import LEAVE, clock
from experiments.plan import counted
from experiments.store.cells import cell, finished_cells, place

ABORT = Ask(
    "abort", "Abort this trial?", "It runs until you answer. Its recording is kept and marked as aborted.", "Abort",
    ("the participant asked", "the participant was distracted", "a fault of the device"),
    (("now", "Repeat now"), ("end", "Repeat later"), ("never", "Do not repeat")),
    leave="Keep recording",
)  # fmt: skip
REDO = Ask(
    "redo", "Repeat {}?", "It comes next. The recording is kept and marked as repeated.", "Repeat",
    ("the participant was distracted", "the task was not understood", "something disturbed the trial"),
)  # fmt: skip
SKIP = Ask(
    "skip", "Skip {}?", "{}. It is marked as skipped and does not come again.", "Skip",
    ("the participant asked", "short of time", "a fault in this condition"),
)  # fmt: skip
UNBLIND = Ask(
    "unblind", "Show the controllers?",
    "Their names become visible here and in the tables. The journal keeps who asked.", "Show",
    own="Who asks",
)  # fmt: skip
NAMED = 6  # trials, at most, of those without a result
RESTED = "Go on when the participant is ready."
STOPPED = "The brakes are off. The line at the foot says why, and what is kept. Started again, it goes on from there."


def without_result(opened: m.Opened, snapshot: m.Snapshot) -> str:
    """ " Trial 4 has no result: excluded.", after another sentence; "": all have one."""
    lacking = finished_cells(snapshot.rows)[1]
    last = {place(row, opened.plan): row.status for row in snapshot.rows if cell(row) in lacking}
    if len(last) == 1:
        ((number, status),) = last.items()
        return f" Trial {number} has no result: {status}."
    named = ", ".join(f"{number} ({status})" for number, status in sorted(last.items())[:NAMED])
    more = f" and {len(last) - NAMED} more" if len(last) > NAMED else ""
    return f" {len(last)} trials have no result: {named}{more}." if last else ""


class SessionCards(Cards):
    """A notice besides the question, which lies on top of it."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.notice: OverlayCard | None = None
        self._waits: tuple | None = None  # what the notice is about
        self._over_s: float | None = None  # when the break may end

    def ask_to_leave(self, close: Callable[[], None], lost: str) -> None:
        """lost: what was not sent to the session server and goes with the session."""
        buttons = [("Close session  Enter", close), ("Cancel", self.leave)]
        text = f"{LEAVE} Not saved, and lost then: {lost}." if lost else LEAVE
        self.put(OverlayCard("Close the session?", text, buttons, self._parent), "leave")

    def _next_participant(self, page: Page) -> None:
        """Close the session, whose plan is done; asks only where something would be lost."""
        if lost := page.unsaved():
            self.ask_to_leave(lambda: page.send(m.Leave()), lost)
        else:
            page.send(m.Leave())

    def _typing(self) -> bool:
        """Whether the user is typing: a notice that comes must not take the next letters for an answer."""
        at = self._parent.window().focusWidget()
        return isinstance(at, QLineEdit) and at.isVisible()

    def take_focus(self) -> None:
        if self.question is None and self.notice is not None:
            self.notice.take_focus()
        super().take_focus()

    def press_main(self) -> bool:
        """The space bar: the notice's first button, but for one that no trial follows. Whether a card is in the way."""
        if self.question is None and self.notice is not None and self.notice.kind != m.FAILED:
            self.notice.enter()
        return self.question is not None or self.notice is not None

    def show_session(self, opened: m.Opened, snapshot: m.Snapshot, page: Page) -> None:
        """What the session waits for; page: sends what the buttons ask for."""
        coming = snapshot.coming.configuration if snapshot.coming else ""
        card = snapshot.card and snapshot.card._replace(wait_s=0.0)  # that goes by without a new card
        failed = snapshot.stage == m.FAILED and bool(opened.participant)
        has_notice = card is not None or snapshot.stage == m.FINISHED or failed
        waits = (
            (card, coming, snapshot.blind, opened.folder, failed, failed and snapshot.in_memory) if has_notice else None
        )
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
                buttons.append(("Device page  F3", lambda: page.page_asked.emit(DEVICE, None)))
            return OverlayCard(card.title, card.text, buttons, self._parent)
        if snapshot.stage == m.FAILED:
            again = m.Open(opened.participant, resume=True)
            buttons = [("Open folder", lambda: page.folder_asked.emit(Path(opened.folder)))]
            if not snapshot.in_memory:  # else that would be lost
                buttons.insert(0, ("Start again  Enter", lambda: page.setup_asked.emit(None, again)))
            notice = OverlayCard("The session has stopped", STOPPED, buttons, self._parent)
            notice.kind = m.FAILED
            return notice
        kept = sum(bool(row.recording) for row in snapshot.rows)
        are = "is" if kept == 1 else "are"
        text = f"{counted(kept, 'recording')} {are} kept and verified in {opened.folder}."
        text += without_result(opened, snapshot)
        buttons = [("Results  F2", lambda: page.page_asked.emit(ANALYSE, None))]
        if snapshot.blind:
            buttons.append(("Show the controllers …", lambda: self.ask(UNBLIND, lambda who: page.send(m.Unblind(who)))))
        buttons.append(("Next participant", lambda: self._next_participant(page)))
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
