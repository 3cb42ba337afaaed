"""The device on the bench: is it ready, what to do next, and what its board and sensors report."""

from collections.abc import Callable
from functools import partial

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent, QShowEvent
from PySide6.QtWidgets import QGridLayout

from app.ipc import messages as m
from app.window.device import figures
from app.window.device.device_view import DeviceView
from app.window.device.figures import ENCODERS, FORCE, READY_BOARD
from app.window.widgets import theme
from app.window.widgets.cards import Cards, OverlayCard
from app.window.widgets.page import Page
from app.window.widgets.parts import (
    PANEL_MARGINS,
    Panel,
    breakable,
    button,
    column,
    grid,
    holder,
    panel,
    row,
    scrolled,
    text_label,
    wrapped_label,
)
from app.window.widgets.preflight import MARKS
from experiments.protocol import home_of

SIMULATED = (
    "The device is simulated on this computer. It needs no homing and no zero. To use a real one, choose Board on the "
    "Home page and connect to its port."
)
#: row -> the words of its button, the step that it asks for, and what its question says
STEPS = {
    READY_BOARD: (
        "Reconnect …",
        m.CONNECT,
        "The connection is closed and made again. The zero must be taken again afterwards.",
    ),
    ENCODERS: ("Home the encoders …", m.HOME, "Hold the handle in its jig at {}, then go on."),
    FORCE: ("Take the zero …", m.ZERO, "Let go of the handle, go on, and do not touch it for a second."),
}
LINES_PX = (660, 400)  # the rows at most
VIEW_PX = 120  # the height of the picture at least: in a small window the figures scroll


class DevicePage(Page):
    """Row by row what must be ready, each with its button; the device as its encoders have it; figures."""

    def __init__(self, send: Callable[[object], None]) -> None:
        super().__init__(send)
        self._port = ""  # of a device on the bench; "": the device is simulated
        self._status: m.DeviceStatus | None = None
        self._rates, self._recent = dict[str, float](), figures.Rates()
        self.cards = Cards(self)
        self.title = text_label("", size=theme.HEAD, bold=True)
        self.no_figures, self.why = wrapped_label("", size=theme.TITLE), wrapped_label("", "quiet")
        self.no_figures.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.view = DeviceView()
        self.rows = {name: (text_label(), wrapped_label()) for name in figures.READINESS}  # mark, words
        named = (name for names, _ in figures.GROUPS.values() for name in names)
        self.values = {name: wrapped_label(figures.NOTHING) for name in named}
        self.steps = {name: button(text, partial(self._ask, name)) for name, (text, _, _) in STEPS.items()}
        self._lay_out()
        self._refresh()

    def _lay_out(self) -> None:
        lines = grid(10, 4, stretched=2)
        for down, (name, (mark, words)) in enumerate(self.rows.items()):
            pressed = self.steps.get(name)
            lines.addWidget(mark, down, 0)
            lines.addWidget(text_label(name, bold=True), down, 1)
            lines.addWidget(words, down, 2, 1, 1 if pressed else 2)
            if pressed is not None:
                lines.addWidget(pressed, down, 3, Qt.AlignmentFlag.AlignVCenter)
            lines.setRowStretch(down, 1)  # each row has its share
        self._lines = holder(lines)
        state = Panel()
        state.setLayout(column(self.title, (scrolled(self._lines), 1), self.why, spacing=8, margins=PANEL_MARGINS))
        self._lines.setMaximumSize(*LINES_PX)  # in a large window the rows and their buttons stay together
        self.view.setMinimumHeight(VIEW_PX)
        seen = panel("As the encoders have it", (self.view, 1), self.view.caption, spacing=4)
        panels = [(panel(title, self._grid_of(names), 1), share) for title, (names, share) in figures.GROUPS.items()]
        top = row((state, 5), (seen, 4), spacing=theme.GAP)
        self._figures = scrolled(holder(row(*panels, spacing=theme.GAP)))
        self.bench = holder(column((top, 1), self._figures, spacing=theme.GAP))
        self.setLayout(column(self.no_figures, (self.bench, 1)))

    def _grid_of(self, names: tuple[str, ...]) -> QGridLayout:
        lines = grid(8, 4, stretched=1)
        for place, name in enumerate(names):
            lines.addWidget(text_label(name, "quiet"), place, 0, Qt.AlignmentFlag.AlignTop)
            lines.addWidget(self.values[name], place, 1, Qt.AlignmentFlag.AlignTop)
        return lines

    def show_setup(self, setup: m.Setup) -> None:
        self._port, self._status, self.opened = setup.link, None, None
        self._refresh()

    def show_opened(self, opened: m.Opened) -> None:
        if opened != self.opened:
            self.cards.leave()
        super().show_opened(opened)
        self._refresh()

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        if snapshot.stage != self.snapshot.stage:
            self.cards.leave()
        super().show_snapshot(snapshot)
        self._refresh()

    def to_close(self) -> Callable[[], object] | None:
        return self.cards.to_close()

    def show_pulse(self, pulse: m.Pulse) -> None:
        status = pulse.device
        if status is None or status != self._status:
            before, self._status = self._status, status
            if before is None or status is None or status.homed != before.homed:
                self._recent = figures.Rates()  # what the encoders gave before they were homed means nothing
            self._rates = self._recent.rates(status.reported_s, figures.counters_of(status.report)) if status else {}
            self._refresh()

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._refresh()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit_figures()

    def _fit_figures(self) -> None:
        """The figures take no more room than their lines need."""
        self._figures.setMaximumHeight(self._figures.widget().heightForWidth(self.width()))

    def _refresh(self) -> None:
        status, snapshot, opened = self._status, self.snapshot, self.opened
        on_bench = opened is not None and opened.real_device
        self.no_figures.setText(f"Opening {self._port} …" if self._port else SIMULATED)
        self.no_figures.setVisible(not on_bench)
        self.bench.setVisible(on_bench)
        if opened is None or not on_bench or not self.isVisible():
            return
        values = figures.figures_of(status, opened.protocol) if status else {}
        for name, label in self.values.items():
            label.setText(breakable(values.get(name) or figures.NOTHING))
        self._fit_figures()
        why = why_no_step(opened, snapshot)
        self.why.setText(why)
        free = not why and not snapshot.step  # one step at a time
        self._show_rows(figures.readiness(snapshot, status, self._rates), free)
        runs = snapshot.stage == m.RUNNING
        self.view.show_device(status if figures.is_reached(status) else None, opened.protocol, runs)

    def _show_rows(self, found: dict[str, m.Check], free: bool) -> None:
        """What is ready; the button of the first that is not, and can be made so, is the main one."""
        status = self._status
        usable = status if free and figures.is_reached(status) and status is not None and not status.fault else None
        senses = usable is not None and usable.force_channels > 0
        can = {READY_BOARD: free, ENCODERS: usable is not None, FORCE: senses}
        due = next((name for name, check in found.items() if check.state not in (m.GOOD, m.CAUTION)), "")
        self.title.setText("Not ready yet" if due else "Ready")
        for name, pressed in self.steps.items():  # that of the brakes is in the header
            text, step, _ = STEPS[name]
            pressed.setText(m.WAITS[step] if self.snapshot.step == step else text)
            pressed.setEnabled(can[name])
            theme.set_style(pressed, "main" if name == due else "")
        for name, (mark, words) in self.rows.items():
            check = found[name]
            shape, look = MARKS[check.state]
            mark.setText(shape)
            theme.set_style(mark, look)
            words.setText(breakable(check.text[:1].upper() + check.text[1:]))

    def _ask(self, name: str) -> None:
        """Say what the step needs before it is taken."""
        text, step, needs = STEPS[name]
        coming, opened = self.snapshot.coming, self.opened
        if coming is None or opened is None:
            return
        if step == m.HOME:
            x, y = home_of(opened.protocol.device(coming.configuration), opened.protocol.paths)
            needs = needs.format(f"x = {1e3 * x:.0f} mm, y = {1e3 * y:.0f} mm")

        def do() -> None:
            self.cards.leave()
            self.send(m.PrepareDevice(step))

        answers = [("Go on  Enter", do), ("Cancel  Esc", self.cards.leave)]
        self.cards.put(OverlayCard(text.removesuffix(" …"), needs, answers, self))


def why_no_step(opened: m.Opened, snapshot: m.Snapshot) -> str:
    """Why no step can be taken now, one sentence; "": one can."""
    if not opened.participant:
        return "Start a session first: its journal records these steps."
    if snapshot.coming is None:
        return "All trials of the plan are done."
    between = snapshot.stage == m.READY or snapshot.card is not None
    return "" if between else "These steps are taken between two trials."
