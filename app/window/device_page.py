"""The device page: how the device on the bench is, what is not well, what to do, and the steps that make it ready."""

from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from app.ipc import messages as m
from app.window.cards import Notice
from app.window.device_words import (
    Rates,
    Recent,
    Word,
    board_values,
    counters_of,
    link_values,
    not_well,
    quantisation,
    sensor_values,
)
from app.window.painting import theme
from app.window.painting.labels import OneLine, breakable, line, word
from app.window.preflight import COLOURS, MARKS
from app.window.words import grouped
from core.device import Device
from core.mechanism import JOINTS
from experiments.protocol import home_of

if TYPE_CHECKING:
    from app.ipc.messages import DeviceStatus

SIMULATED = (
    "The device is simulated: it is computed on this computer, with no board and no sensors, and is always ready. "
    "A device on the bench is reached with: phd run --link serial:PORT (phd devices lists the ports)."
)
NOTHING = "–"
CLOCK = ("Clock offset", "Clock drift")


class Figures(QFrame):
    """A panel of names and values; a value that is not known is a dash."""

    def __init__(self, title: str, names: tuple[str, ...], parent: QWidget | None = None) -> None:
        super().__init__(parent, objectName="panel")
        self.values = {name: OneLine(NOTHING, size=theme.NORMAL) for name in names}
        self.inside = QVBoxLayout(self)
        self.inside.setContentsMargins(16, 10, 16, 12)
        self.inside.setSpacing(8)
        self.inside.addWidget(word(title, size=theme.TITLE, bold=True))
        grid = QGridLayout()
        grid.setHorizontalSpacing(14)
        grid.setVerticalSpacing(8)
        for at, (name, value) in enumerate(self.values.items()):
            grid.addWidget(word(name, "quiet"), at, 0)
            grid.addWidget(value, at, 1)
        grid.setColumnStretch(1, 1)
        self.inside.addLayout(grid)

    def show_values(self, values: dict[str, str]) -> None:
        """What is known now."""
        for name, label in self.values.items():
            label.setText(values.get(name) or NOTHING)


class DevicePage(QWidget):
    """Board, sensors and link in figures; above them what is not well; the steps as buttons."""

    rig_asked = Signal(str)  # CONNECT, HOME or ZERO of the messages
    reset_asked = Signal()
    back_asked = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._opened: m.Opened | None = None
        self._snapshot = m.Snapshot(m.PREPARING)
        self._linked: DeviceStatus | None = None
        self._rates, self._recent = Rates(), Recent()
        self._card: Notice | None = None
        self.title = word("Device", size=theme.HEAD, bold=True)
        self.where = OneLine("", "quiet", theme.NORMAL)
        self.back = QPushButton("Back  F3", objectName="small")
        self.back.setFont(theme.font(theme.SMALL))
        self.back.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.back.clicked.connect(self.back_asked)
        self.simulated = line(SIMULATED, size=theme.TITLE)
        self.marks = [word("●") for _ in range(5)]
        self.sentences = [line() for _ in self.marks]
        self.quantised = line("", "quiet")
        self.board = Figures(
            "Board", ("Device", "Board", "Port", "Firmware", "State", "Fault", "Encoders", "Force sensor")
        )
        self.sensors = Figures(
            "Sensors", (*(f"Joint {joint}" for joint in JOINTS), "Handle", "Hand force", "Samples", "Answer takes")
        )
        self.link = Figures(
            "Link since it was opened",
            ("Lost", "Repeated", "Damaged", "Put right", "Too late", "Refused", "No position", "Cut off", *CLOCK),
        )
        self.home, self.zero, self.reset, self.reconnect = (
            self._button(text) for text in ("Home the encoders …", "Take the zero …", "Reset faults  B", "Reconnect …")
        )
        self.home.clicked.connect(self._ask_home)
        self.zero.clicked.connect(self._ask_zero)
        self.reset.clicked.connect(self.reset_asked)
        self.reconnect.clicked.connect(self._ask_connect)
        self.why = line("", "quiet", theme.SMALL)
        self._lay_out()
        self._refresh()

    @staticmethod
    def _button(text: str) -> QPushButton:
        made = QPushButton(text)
        made.setMinimumHeight(32)
        made.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        return made

    def _lay_out(self) -> None:
        head = QHBoxLayout()
        head.setSpacing(theme.GAP)
        head.addWidget(self.title)
        head.addWidget(self.where, 1)
        head.addWidget(self.back)
        self.health = QFrame(objectName="panel")
        said = QGridLayout(self.health)
        said.setContentsMargins(16, 12, 16, 12)
        said.setHorizontalSpacing(10)
        said.setVerticalSpacing(6)
        for at, (mark, sentence) in enumerate(zip(self.marks, self.sentences, strict=True)):
            said.addWidget(mark, at, 0, Qt.AlignmentFlag.AlignTop)
            said.addWidget(sentence, at, 1)
        said.setColumnStretch(1, 1)
        steps = QGridLayout()
        steps.setSpacing(8)
        for at, button in enumerate((self.home, self.zero, self.reconnect, self.reset)):
            steps.addWidget(button, at // 2, at % 2)
        self.board.inside.addStretch(1)
        self.board.inside.addWidget(self.why)
        self.board.inside.addLayout(steps)
        self.sensors.inside.addStretch(1)
        self.sensors.inside.addWidget(self.quantised)
        self.link.inside.addStretch(1)
        self.figures = QWidget()
        columns = QHBoxLayout(self.figures)
        columns.setContentsMargins(0, 0, 0, 0)
        columns.setSpacing(theme.GAP)
        for panel in (self.board, self.sensors, self.link):
            columns.addWidget(panel, 1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(theme.GAP)
        layout.addLayout(head)
        layout.addWidget(self.simulated)
        layout.addWidget(self.health)
        layout.addWidget(self.figures)
        layout.addStretch(1)

    # what the server says

    def show_session(self, opened: m.Opened | None, snapshot: m.Snapshot) -> None:
        """What may be done now."""
        if snapshot.stage != self._snapshot.stage or opened != self._opened:
            self.leave()
        self._opened, self._snapshot = opened, snapshot
        self._refresh()

    def show_linked(self, linked: "DeviceStatus | None") -> None:
        """How the device is, about ten times a second."""
        if linked is None or linked != self._linked:
            before, self._linked = self._linked, linked
            if before is None or linked is None or linked.homed != before.homed:
                self._recent = Recent()  # what the encoders said before they were homed means nothing
            self._rates = self._recent.add(linked.told_s, counters_of(linked.report)) if linked else Rates()
            if self.isVisible():
                self._refresh()

    def showEvent(self, event) -> None:
        super().showEvent(event)
        self._refresh()

    @property
    def on_bench(self) -> bool:
        """Whether there is a device to make ready."""
        return self._opened is not None and self._opened.real_device

    def _refresh(self) -> None:
        linked, on_bench = self._linked, self.on_bench
        self.simulated.setVisible(not on_bench)
        self.health.setVisible(on_bench)
        self.figures.setVisible(on_bench)
        if not on_bench:
            self.where.setText("")
            return
        found = not_well(linked, self._rates)
        self._show_words(found or [Word(m.GOOD, "All is well.")])
        self.where.setText(linked.port if linked else "")
        if linked is None:
            return
        self.board.show_values(board_values(linked))
        self.sensors.show_values(sensor_values(linked, self._rates))
        self.link.show_values(link_values(linked.report))
        self.quantised.setText(self._quantised(linked))
        self._allow(linked)

    def _show_words(self, words: list[Word]) -> None:
        for at, (mark, sentence) in enumerate(zip(self.marks, self.sentences, strict=True)):
            there = at < len(words)
            mark.setVisible(there)
            sentence.setVisible(there)
            if there:
                mark.setText(MARKS[words[at].state])
                mark.setStyleSheet(f"color: {COLOURS[words[at].state]}")
                sentence.setText(breakable(" ".join(filter(None, words[at][1:]))))

    def _quantised(self, linked: "DeviceStatus") -> str:
        device, opened = self._device(linked.device), self._opened
        found = quantisation(device, linked, opened.controllers) if device and opened else None
        if found is None:
            return ""
        text = (
            f"One count is {1e6 * found.step_m:.0f} µm at the handle: the velocity is known to "
            f"{1e3 * found.noise_m_s:.2g} mm/s, which a gain of {grouped(round(found.gain))} N s/m turns into "
            f"{found.force_N:.1f} N, of {found.range_N:.0f} N that every brake reaches"
        )
        return f"{text}: such a controller feels the encoders' steps." if found.felt else f"{text}."

    def _device(self, name: str) -> Device | None:
        devices = self._opened.devices if self._opened else ()
        return next((device for device in devices if device.name == name), None)

    # the steps

    def _why_not(self) -> str:
        """Why no step can be taken now."""
        snapshot = self._snapshot
        if self._opened is None or not self._opened.participant:
            return "Open a session first: its journal keeps what is done here."
        if snapshot.coming is None:
            return "The plan is done."
        return "" if snapshot.stage in (m.READY, m.RERIG, m.BREAK, m.QUESTIONS) else "Not now."

    def _allow(self, linked: "DeviceStatus") -> None:
        why = self._why_not()
        self.why.setText(why)
        self.why.setVisible(bool(why))
        there = not why and not linked.problem and bool(linked.device)
        self.home.setEnabled(there and not linked.fault)
        self.zero.setEnabled(there and not linked.fault and linked.force_channels > 0)
        self.reconnect.setEnabled(not why)
        self.reset.setEnabled(bool(self._snapshot.brakes_off) and self._snapshot.stage != m.RUNNING)

    def _ask_home(self) -> None:
        coming, opened = self._snapshot.coming, self._opened
        device = self._device(coming.configuration) if coming else None
        if device is not None and opened is not None:
            x, y = home_of(device, opened.paths)
            place = f"x = {1e3 * x:.0f} mm, y = {1e3 * y:.0f} mm"
            self._ask("Home the encoders", f"Hold the handle in its jig at {place}, then go on.", m.HOME)

    def _ask_zero(self) -> None:
        self._ask("Take the zero", "Let go of the handle, go on, and do not touch it for a second.", m.ZERO)

    def _ask_connect(self) -> None:
        self._ask("Reconnect", "The connection is closed and made again; the zero has to be taken after it.", m.CONNECT)

    def _ask(self, title: str, text: str, step: str) -> None:
        self.leave()

        def do() -> None:
            self.leave()
            self.rig_asked.emit(step)

        self._card = Notice(title, text, [("Go on  Enter", do), ("Leave it  Esc", self.leave)], self)
        self._card.appear()

    def leave(self) -> bool:
        """Take the question away; whether there was one."""
        card, self._card = self._card, None
        if card is None:
            return False
        card.hide()
        card.deleteLater()
        self.window().setFocus()
        return True

    @property
    def card(self) -> Notice | None:
        """The question that is up."""
        return self._card
