"""The steps of `phd bring-up` on the device page: all of them, how far one is, what was seen, what to mend."""

from collections.abc import Callable

from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QLineEdit, QWidget

from app.ipc import messages as m
from app.window.widgets import theme
from app.window.widgets.parts import button, column, holder, panel, row, scrolled, text_label, wrapped_label
from app.window.widgets.preflight import NOW, Checklist

STATES = {"passed": m.GOOD, "failed": m.BAD, "not done": m.WAITING}
ALONE, MEND = "Wait: this is checked without you.", "Mend what has failed, then begin again."
NONE = m.BringUpShown("", "", False, ())
ABOUT = (
    "Checks a device that has just been wired, one thing after another. At first no current flows; later brakes get "
    "10 % of theirs, and a hand is asked to the handle last. You sign the record with your name."
)


class BringUpPanel(QWidget):
    """A name and a button before; the present step among all of them while it goes on."""

    closed = Signal()

    def __init__(self, send: Callable[[object], None]) -> None:
        super().__init__()
        self.send, self.shown, self._usable = send, NONE, False
        self.name = QLineEdit(placeholderText="Your name", accessibleName="Your name")
        self.name.textChanged.connect(lambda _: self._refresh())
        self.begin = button("Begin", self._begin, "main")
        self.go_on = button("Done", lambda: self.send(m.PrepareDevice(m.GO_ON)), "main")
        self.end = button("Close", self._end)
        self.title, self.ask = text_label("", size=theme.TITLE, bold=True), wrapped_label("")
        self.far = text_label("", "quiet")
        self.steps = Checklist()
        self._scrolled = scrolled(holder(column(self.steps, 1)))
        self._scrolled.verticalScrollBar().rangeChanged.connect(lambda *_: self._show_present())
        self.list = panel("Steps", (self._scrolled, 1))
        answers = row(self.name, self.begin, self.go_on, self.end, 1)
        head = panel("Bring up the device", row(self.title, 1, self.far), self.ask, answers)
        self.setLayout(column(head, (self.list, 1), spacing=theme.GAP))

    @property
    def can_open(self) -> bool:
        return self._usable or bool(self.shown.title)

    def show_status(self, status: m.DeviceStatus | None, usable: bool) -> None:
        """usable: whether a step may be taken now."""
        running = status.bring_up if status else None
        self.shown = running or self.shown._replace(title="", ask="", confirmed=False)
        self._usable = usable
        self._refresh()

    def _begin(self) -> None:
        self.shown = NONE
        self.send(m.PrepareDevice(m.BRING_UP, self.name.text().strip()))

    def _end(self) -> None:
        if self.shown.title:
            self.send(m.PrepareDevice(m.BREAK_OFF))
        else:
            self.closed.emit()

    def _refresh(self) -> None:
        shown = self.shown
        goes_on = bool(shown.title)
        passed = sum(state == "passed" for _, state, _, _ in shown.results)
        of = f"{passed} of {len(shown.steps)} steps have passed" if shown.results else "Before it begins"
        self.title.setText(shown.title or of)
        self.far.setText(f"Step {len(shown.results) + 1} of {len(shown.steps)}" if goes_on else "")
        self.ask.setText((shown.ask or ALONE) if goes_on else MEND if passed < len(shown.results) else ABOUT)
        self.name.setVisible(not goes_on)
        self.begin.setVisible(not goes_on)
        self.begin.setEnabled(self._usable and bool(self.name.text().strip()))
        self.go_on.setVisible(shown.confirmed)
        self.end.setText("Stop the check" if goes_on else "Close")
        self.list.setVisible(bool(shown.steps))
        checks = [m.Check(title, STATES[state], saw, advice) for title, state, saw, advice in shown.results]
        if goes_on:
            checks.append(m.Check(shown.title, NOW, ""))
        checks += [m.Check(title, m.WAITING, "") for title in shown.steps[len(checks) :]]
        if self.steps.show_checks(tuple(checks)):
            QTimer.singleShot(0, self._show_present)

    def _show_present(self) -> None:
        """Once the list is laid out: scroll to the present step, after the last one to the first that has failed."""
        failed = next((title for title, state, _, _ in self.shown.results if state == "failed"), "")
        if (name := self.steps.names.get(self.shown.title or failed)) is not None:
            self._scrolled.ensureWidgetVisible(name, 0, name.height() * 3)
