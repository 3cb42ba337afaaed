"""The steps of `phd bring-up` on the device page: what to do now, what was seen, what to mend."""

from collections.abc import Callable

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLineEdit, QWidget

from app.ipc import messages as m
from app.window.widgets import theme
from app.window.widgets.parts import button, column, holder, panel, row, scrolled, text_label, wrapped_label
from app.window.widgets.preflight import Checklist

STATES = {"passed": m.GOOD, "failed": m.BAD, "not done": m.WAITING}
ABOUT = (
    "Checks a device that has just been wired, one thing after another. At first no current flows; later brakes get "
    "10 % of theirs, and a hand is asked to the handle last. You sign the record with your name."
)


class BringUpPanel(QWidget):
    """A name and a button before; the present step and the results while it goes on."""

    closed = Signal()

    def __init__(self, send: Callable[[object], None]) -> None:
        super().__init__()
        self.send, self.shown, self._usable = send, m.BringUpShown("", "", False, ()), False
        self.name = QLineEdit(placeholderText="Your name", accessibleName="Your name")
        self.name.textChanged.connect(lambda _: self._refresh())
        self.begin = button("Begin", self._begin, "main")
        self.go_on = button("Done", lambda: self.send(m.PrepareDevice(m.GO_ON)), "main")
        self.end = button("Close", self._end)
        self.title, self.ask = text_label("", size=theme.TITLE, bold=True), wrapped_label("")
        self.results = Checklist()
        self.found = panel("What was found", self.results)
        head = panel("Bring up the device", self.title, self.ask, row(self.name, self.begin, self.go_on, self.end, 1))
        self.setLayout(column(head, (scrolled(holder(column(self.found, 1))), 1), spacing=theme.GAP))

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
        self.shown = m.BringUpShown("", "", False, ())
        self.send(m.PrepareDevice(m.BRING_UP, self.name.text().strip()))

    def _end(self) -> None:
        if self.shown.title:
            self.send(m.PrepareDevice(m.BREAK_OFF))
        else:
            self.closed.emit()

    def _refresh(self) -> None:
        shown = self.shown
        self.title.setText(shown.title or "Before it begins")
        self.ask.setText((shown.ask or "Wait: this is checked without you.") if shown.title else ABOUT)
        self.name.setVisible(not shown.title)
        self.begin.setVisible(not shown.title)
        self.begin.setEnabled(self._usable and bool(self.name.text().strip()))
        self.go_on.setVisible(shown.confirmed)
        self.end.setText("Break off" if shown.title else "Close")
        checks = (m.Check(title, STATES[state], saw, advice) for title, state, saw, advice in shown.results)
        self.results.show_checks(tuple(checks))
        self.found.setVisible(bool(shown.results))
