"""The header's pre-flight row, and the brakes-off button; what is wrong and what to do about it in a banner."""

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QMouseEvent, QResizeEvent
from PySide6.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QPushButton, QWidget

from app.ipc import messages as m
from app.window.painting import theme
from app.window.painting.labels import breakable, line, word
from app.window.painting.parts import clear

COLOURS = {m.GOOD: theme.GOOD, m.CAUTION: theme.CAUTION, m.BAD: theme.BAD, m.WAITING: theme.BRAKE_OFF}
#: Said by shape too, not by colour alone.
MARKS = {m.GOOD: "●", m.CAUTION: "▲", m.BAD: "✕", m.WAITING: "○"}
DEVICE = "Device"  # the check that leads to the device page


class Pill(QFrame):
    """One item of the pre-flight row."""

    clicked = Signal(str)  # its name

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent, objectName="pill")
        self._check: m.Check | None = None  # what is shown
        self.mark, self.name = word("", size=theme.SMALL), word("", size=theme.SMALL, bold=True)
        self.text = word("", "quiet", theme.SMALL)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(9, 0, 10, 0)
        layout.setSpacing(4)
        for label in (self.mark, self.name, self.text):
            layout.addWidget(label)
        self.setFixedHeight(30)

    def show_check(self, check: m.Check) -> None:
        """What was found, its reason and advice in the tooltip."""
        if check == self._check:
            return
        self._check = check
        theme.name_anew(self, "pill-bad" if check.state == m.BAD else "pill")
        self.mark.setText(MARKS[check.state])
        self.mark.setStyleSheet(f"color: {COLOURS[check.state]}")
        self.name.setText(check.name)
        self.text.setText(check.text)
        leads = "A click (F3) shows the device page." if check.name == DEVICE else ""
        self.setCursor(Qt.CursorShape.PointingHandCursor if leads else Qt.CursorShape.ArrowCursor)
        self.setToolTip(" ".join(filter(None, (f"{check.name}: {check.text}.", check.advice, leads))))

    @property
    def wide(self) -> int:
        """How wide it is with its text, px."""
        words = sum(label.sizeHint().width() for label in (self.mark, self.name, self.text))
        return words + 9 + 10 + 2 * 4 + 2

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self.rect().contains(event.position().toPoint()):
            self.clicked.emit(self.name.text())


class Preflight(QWidget):
    """Pills and brakes-off; `advice`, which the window places, says what is wrong."""

    brakes_off_asked = Signal()
    brakes_allowed = Signal()
    device_asked = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.pills: list[Pill] = []
        self.brakes = QPushButton("Brakes off  Esc", objectName="brakes")
        self.brakes.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.brakes.setFont(theme.font(theme.NORMAL, bold=True))
        self.brakes.setFixedHeight(34)
        self.brakes.clicked.connect(self._pressed)
        self.advice = line("", "banner", theme.NORMAL)
        self.advice.hide()
        self._off = False
        self._row = QHBoxLayout()
        self._row.setSpacing(5)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GAP)
        row.addStretch(1)
        row.addLayout(self._row)
        row.addWidget(self.brakes)

    def show_session(self, opened: m.Opened | None, snapshot: m.Snapshot) -> None:
        """Whether all is well."""
        while len(self.pills) < len(snapshot.checks):
            self.pills.append(Pill())
            self._row.addWidget(self.pills[-1])
            self.pills[-1].clicked.connect(self._asked)
        for i, pill in enumerate(self.pills):
            pill.setVisible(i < len(snapshot.checks))
            if i < len(snapshot.checks):
                pill.show_check(snapshot.checks[i])
        self._fit()
        self._show_advice(snapshot, opened is not None and opened.real_device)
        self._off = bool(snapshot.brakes_off)
        theme.name_anew(self.brakes, "brakes-off" if self._off else "brakes")
        self.brakes.setText("Allow brakes  Ctrl+B" if self._off else "Brakes off  Esc")
        self.brakes.setToolTip(
            "Let currents flow again" if self._off else "Zero current at once; a running trial ends and is kept"
        )

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Where there is no room for all texts, names and marks alone stay; the tooltips say the rest."""
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        pills = [pill for pill in self.pills if not pill.isHidden()]
        needed = self.brakes.sizeHint().width() + theme.GAP + sum(pill.wide + 5 for pill in pills)
        for pill in pills:
            pill.text.setVisible(needed <= self.width())

    def minimumSizeHint(self) -> QSize:
        """As wide as it is without the texts."""
        narrow = sum(pill.wide - pill.text.sizeHint().width() + 5 for pill in self.pills if not pill.isHidden())
        return QSize(self.brakes.sizeHint().width() + theme.GAP + narrow, super().minimumSizeHint().height())

    def _asked(self, name: str) -> None:
        if name == DEVICE:
            self.device_asked.emit()

    def _show_advice(self, snapshot: m.Snapshot, on_bench: bool) -> None:
        """One line for each thing that is wrong; nothing when all is well."""
        said = advice(snapshot)
        if said and on_bench and any(check.name == DEVICE and check.state == m.BAD for check in snapshot.checks):
            said[-1] += " F3 shows the device page."
        self.advice.setText(breakable("\n".join(said)))
        self.advice.setVisible(bool(said))

    def _pressed(self) -> None:
        (self.brakes_allowed if self._off else self.brakes_off_asked).emit()


def advice(snapshot: m.Snapshot) -> list[str]:
    """A line for each thing that is wrong and keeps trials from starting: what to do about it."""
    said = []
    if snapshot.brakes_off:
        cause = sentence(snapshot.brakes_off)
        said.append(f"Brakes are off: {cause} Ctrl+B or the button lets them act again.")
    for check in snapshot.checks:
        if check.state == m.BAD and not (snapshot.brakes_off and check.name == "Device"):
            said.append(" ".join(filter(None, (f"{check.name}: {sentence(check.text)}", check.advice))))
    return said


def sentence(text: str) -> str:
    """The text with a full stop."""
    return text if text.endswith((".", "!", "?")) else f"{text}."


class Checklist(QWidget):
    """The pre-flight checks as a list that can be read: mark, name, what was found, what to do about it."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("clear")
        self._shown: tuple[m.Check, ...] = ()
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setVerticalSpacing(6)
        self._grid.setColumnStretch(2, 1)

    def show_checks(self, checks: tuple[m.Check, ...]) -> None:
        """What was found."""
        if checks == self._shown:
            return
        self._shown = checks
        clear(self._grid)
        for row, check in enumerate(checks):
            mark = word(MARKS[check.state], size=theme.NORMAL)
            mark.setStyleSheet(f"color: {COLOURS[check.state]}")
            text = check.text if check.state == m.GOOD or not check.advice else f"{sentence(check.text)} {check.advice}"
            self._grid.addWidget(mark, row, 0, Qt.AlignmentFlag.AlignTop)
            if check.name:
                self._grid.addWidget(word(check.name, bold=True), row, 1, Qt.AlignmentFlag.AlignTop)
            self._grid.addWidget(line(breakable(text), "quiet"), row, 2)
