"""The device on the bench: what to do next, a row for each part of it, its picture, and its raw numbers behind it."""

from collections.abc import Callable
from functools import partial

from PySide6.QtCore import Qt
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QVBoxLayout

from app.ipc import messages as m
from app.window.canvas.path_marks import AT_DESK
from app.window.canvas.small_view import SmallView
from app.window.device import figures
from app.window.device.device_view import DeviceView
from app.window.device.next_step import ALLOW, STEP_OF, STEPS, NextStep, jig_of, needs_of, next_step, possible
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
    keep_room,
    panel,
    row,
    scrolled,
    stack,
    text_label,
    wrapped_label,
)
from app.window.widgets.preflight import MARKS
from experiments.protocol import home_of

SIMULATED = (
    "{}, simulated on this computer{}. Ringed letters: joints with a brake. It needs neither homing nor zeroing. To "
    "use a real one, choose Board on Home."
)
ASSUMED = ", with assumed numbers"
ROWS_PX, ROW_PX, NAME_PX = 720, 52, 110  # of the rows: wide at most, high at least; of a name
RAW, PICTURE = "Raw numbers  ›", "‹  Picture"


class DevicePage(Page):
    """What to do next over a row for each part; beside them the device as its encoders have it, or raw numbers."""

    def __init__(self, send: Callable[[object], None]) -> None:
        super().__init__(send)
        self._port = ""  # of a device on the bench; "": the device is simulated
        self._status: m.DeviceStatus | None = None
        self._rates, self._recent = dict[str, float](), figures.Rates()
        self.next = NextStep("", "")
        self.cards = Cards(self)
        self.title, self.text = text_label("", size=theme.HEAD, bold=True), wrapped_label("", "quiet")
        self.main = button("", lambda: self._do(self.next.step), "main")
        self.main.setFont(theme.font(theme.NORMAL, bold=True))
        self.main.setMinimumHeight(44)
        keep_room(self.main)  # nothing moves when it comes
        self.no_figures = wrapped_label("", size=theme.TITLE)
        self.no_figures.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.simulated, self.view = SmallView(AT_DESK), DeviceView()
        self.rows = {name: (text_label(), wrapped_label()) for name in figures.READINESS}  # mark, words
        named = (name for names in figures.GROUPS.values() for name in names)
        self.values = {name: wrapped_label(figures.NOTHING) for name in named}
        self.again = {step: button(words.again, partial(self._ask, step), "link") for step, words in STEPS.items()}
        self.raw = button(RAW, self._turn, "link")
        self._lay_out()
        self._refresh()

    def _lay_out(self) -> None:
        lines = grid(12, 0, stretched=2)
        for down, (name, (mark, words)) in enumerate(self.rows.items()):
            label = text_label(name, bold=True)
            label.setMinimumWidth(NAME_PX)
            for across, part in enumerate((mark, label, words)):
                lines.addWidget(part, 2 * down, across)
            if name in STEP_OF:
                lines.addWidget(self.again[STEP_OF[name]], 2 * down, 3, Qt.AlignmentFlag.AlignRight)
            lines.setRowMinimumHeight(2 * down, ROW_PX)
            lines.addWidget(Panel("line"), 2 * down + 1, 0, 1, 4)
        first, rows = Panel(), Panel()
        first.setLayout(column(self.title, self.text, row(self.main, 1), spacing=10, margins=(24, 18, 24, 20)))
        rows.setLayout(
            column((scrolled(holder(column(lines, 1))), 1), row(self.raw, 1), spacing=6, margins=(24, 8, 24, 12))
        )
        left = holder(column(first, (rows, 1), spacing=theme.GAP))
        left.setMaximumWidth(ROWS_PX)
        seen = panel("The device", (self.view, 1), self.view.caption, spacing=4)
        self.side = stack(seen, self._raw_panel())
        self.bench = holder(row((left, 5), (self.side, 4), spacing=theme.GAP, margins=(0, 0, 0, theme.GAP)))
        self.unused = holder(column((self.simulated, 3), (self.no_figures, 1), margins=(40, 40, 40, 0)))
        self.setLayout(column((self.unused, 1), (self.bench, 1)))

    def _raw_panel(self) -> Panel:
        groups: QVBoxLayout = column(spacing=10)
        for title, names in figures.GROUPS.items():
            lines = grid(12, 3, stretched=1)
            for place, name in enumerate(names):
                lines.addWidget(text_label(name, "quiet"), place, 0, Qt.AlignmentFlag.AlignTop)
                lines.addWidget(self.values[name], place, 1, Qt.AlignmentFlag.AlignTop)
            groups.addWidget(text_label(title, size=theme.TITLE, bold=True))
            groups.addLayout(lines)
        groups.addStretch(1)
        shown = Panel()
        shown.setLayout(column((scrolled(holder(groups)), 1), margins=PANEL_MARGINS))
        return shown

    def _turn(self) -> None:
        """Show the raw numbers, or the picture again."""
        self.side.setCurrentIndex(1 - self.side.currentIndex())
        self.raw.setText(PICTURE if self.side.currentIndex() else RAW)

    def show_setup(self, setup: m.Setup) -> None:
        self._port, self._status, self.opened = setup.link, None, None
        self._refresh()

    def show_opened(self, opened: m.Opened) -> None:
        if opened != self.opened:
            self.cards.leave()
        super().show_opened(opened)
        device, path = opened.protocol.devices[0], next(iter(opened.protocol.paths.values()))
        self.simulated.show_trial(device, path, home_of(device, opened.protocol.paths))
        self.simulated.show_path(None)
        self.simulated.setVisible(not opened.real_device)
        self._refresh()

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        if snapshot.stage != self.snapshot.stage:
            self.cards.leave()
        super().show_snapshot(snapshot)
        self._refresh()

    @property
    def says_what_is_wrong(self) -> bool:
        """Of a device on the bench."""
        return not self.bench.isHidden()

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

    def _refresh(self) -> None:
        status, snapshot, opened = self._status, self.snapshot, self.opened
        on_bench = opened is not None and opened.real_device
        device = opened.protocol.devices[0] if opened else None
        simulated = SIMULATED.format(device.name.capitalize(), ASSUMED * device.assumed) if device else ""
        self.no_figures.setText(f"Opening {self._port} …" if self._port else simulated)
        self.unused.setVisible(not on_bench)
        self.bench.setVisible(on_bench)
        if opened is None or not on_bench or not self.isVisible():
            return
        values = figures.figures_of(status, opened.protocol) if status else {}
        for name, label in self.values.items():
            label.setText(breakable(values.get(name) or figures.NOTHING))
        found = figures.readiness(snapshot, status, self._rates)
        self._show_rows(found, possible(opened, snapshot, status))
        asked = self.cards.question
        step = NextStep(asked.title.text(), "") if asked else next_step(found, opened, snapshot, status)
        self._show_next(step)
        runs = snapshot.stage == m.RUNNING
        self.view.show_device(status if figures.is_reached(status) else None, opened.protocol, runs)

    def _show_rows(self, found: dict[str, m.Check], can: set[str]) -> None:
        for step, pressed in self.again.items():
            pressed.setText(m.WAITS[step] if self.snapshot.step == step else STEPS[step].again)
            pressed.setEnabled(step in can)
        for name, (mark, words) in self.rows.items():
            check = found[name]
            shape, look = MARKS[check.state]
            mark.setText(shape)
            theme.set_style(mark, look)
            words.setText(breakable(check.text))

    def _show_next(self, shown: NextStep) -> None:
        self.next = shown
        self.title.setText(shown.title)
        self.text.setText(breakable(shown.text))
        self.main.setText(shown.button)
        self.main.setVisible(bool(shown.button))

    def _button_of(self, words: str, step: str, sure: bool = False) -> tuple[str, Callable[[], None]]:
        return words, partial(self._do, step, sure)

    def _ask(self, step: str) -> None:
        """Say what a step needs before it is taken again."""
        if self.opened is None:
            return
        needs = needs_of(step, self.opened, self.snapshot, self._status)
        if step == m.CONNECT:
            needs += " The zero must be taken again afterwards."
        answers = [self._button_of(f"{STEPS[step].title}  Enter", step), ("Cancel", self.cards.leave)]
        self.cards.put(OverlayCard(STEPS[step].again.removesuffix(" …"), needs, answers, self))

    def _do(self, step: str, sure: bool = False) -> None:
        """Take a step; before homing where the encoders have the handle elsewhere, ask. sure: that was asked."""
        self.cards.leave()
        opened, status = self.opened, self._status
        if step == ALLOW:
            self.send(m.AllowBrakes())
        elif step == m.HOME and not sure and opened is not None and status is not None:
            if wrong := status.wrong_jig(jig_of(opened, self.snapshot, status)):
                self._ask_about_jig(wrong)
            else:
                self.send(m.PrepareDevice(step))
        elif step != m.DONE:
            self.send(m.PrepareDevice(step, sure))

    def _ask_about_jig(self, wrong: str) -> None:
        text = (
            f"{wrong} Is it the right jig, and does it hold the handle? If homing starts here, every position changes "
            "by this distance."
        )
        answers = [("Cancel", self.cards.leave), self._button_of("Start homing all the same", m.HOME, True)]
        self.cards.put(OverlayCard("Is this the right jig?", text, answers, self))
