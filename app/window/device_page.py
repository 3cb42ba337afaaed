"""The device on the bench: what is wrong and what to do about it, its figures, and the steps that make it ready."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from datetime import datetime
from functools import partial

from PySide6.QtCore import Qt
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QGridLayout

from app.ipc import messages as m
from app.window.bring_up_panel import BringUpPanel
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
from app.window.widgets.preflight import Checklist
from core.control.controllers import Preset
from core.device import Device
from core.device_interface import VELOCITY_NOISE_HZ, encoder_step
from core.mechanism import JOINTS
from experiments.plan import grouped
from experiments.protocol import Protocol, home_of

RECENT_S = 10.0  # what is counted as happening now
SAMPLE_HZ, LEAST_HZ = 1000.0, 990.0  # samples a second; fewer than the second are worth a word. Our choice
RESIDUAL_S, DRIFT = 1e-3, 200e-6  # our choice: a quartz drifts by less, a quiet USB port is ten times as regular
FELT_SHARE = 0.05  # of what the brakes can do, from where a noise may be felt. Our choice
SIMULATED = (
    "The device is simulated on this computer. It needs no homing and no zero. To use a real one, choose Board on the "
    "Home page and connect to its port."
)
NOTHING = "–"
BUSY = "Close other programs; phd doctor names what stands in the way."
#: counter -> how often a second is worth a word (our choice), the word, and what to do about it
RISING = {
    "lost": (1.0, "Samples are lost: {:.2g} a second.", "Plug the board in without a hub."),
    "frames_bad": (0.0, "Messages arrive damaged: {:.2g} a second.", "Keep the cable short and away from the brakes."),
    "late_commands": (0.0, "Commands reach the board too late, so it does not obey them.", BUSY),
    "not_closed": (
        0.0, "The encoders contradict each other: their angles belong to no position of the linkage.",
        "Home the encoders again; if that does not help, check their plugs.",
    ),
    "refused": (0.0, "The board refuses commands.", "Reconnect it."),
}  # fmt: skip
#: counter of a report -> its word, and what to do about it: each is worth a look as long as the connection lasts
COUNTED = {
    "lost_links": ("Connections lost since the start: {}.", "Check cable and plug."),
    "begun_anew": (
        "Of these, because this computer's clock stood still: {}.",
        "Do not suspend the computer, or pause a virtual machine, while the device is in use.",
    ),
    "guarded": (
        "Torques made smaller so that no motor gives energy: {}.",
        "A brake slipped for it: move on.",
    ),
    "board_time_back": ("Jumps back of the board's clock: {}.", "Its firmware must count microseconds in 64 bits."),
}
STATES = {
    "BOOT": "starting", "IDLE": "idle: waits for the limits", "READY": "ready: no current",
    "ACTIVE": "active: currents may flow", "FAULT": "fault: no current until it is reset",
}  # fmt: skip
BOARD = ("Device", "Board", "Port", "Link", "Firmware", "State", "Fault", "Encoders", "Force sensor")
SENSORS = (*(f"Joint {joint}" for joint in JOINTS), "Handle", "Hand force", "Samples", "Round trip", "Delay")
#: name -> counters, as they are shown
LINK = {
    "Lost": "{lost} of {all} samples", "Repeated": "{repeated} samples",
    "Damaged": "{frames_bad} messages", "Gaps": "{frames_resyncs} after damage",
    "Too late": "{late_commands} commands", "Refused": "{refused} messages", "No position": "{not_closed} samples",
    "Lost links": "{lost_links}",
}  # fmt: skip
CLOCK = ("Clock offset", "Clock drift")
#: button -> the step it asks for, and what its question says
STEPS = {
    "Home the encoders …": (m.HOME, "Hold the handle in its jig at {}, then go on."),
    "Take the zero …": (m.ZERO, "Let go of the handle, go on, and do not touch it for a second."),
    "Reconnect …": (m.CONNECT, "The connection is closed and made again. The zero must be taken again afterwards."),
}


class Rates:
    """The counters of the last seconds."""

    def __init__(self) -> None:
        self._taken: deque[tuple[float, dict[str, int]]] = deque()

    def rates(self, now_s: float, counters: dict[str, int]) -> dict[str, float]:
        """How often a second each has risen since the oldest that is not older than RECENT_S; {}: not known yet."""
        taken = self._taken
        if taken and any(counters.get(name, 0) < value for name, value in taken[-1][1].items()):
            taken.clear()  # another connection, which counts anew
        taken.append((now_s, counters))
        while len(taken) > 2 and taken[1][0] <= now_s - RECENT_S:
            taken.popleft()
        before_s, before = taken[0]
        if now_s - before_s < 0.5:
            return {}
        return {name: (value - before.get(name, 0)) / (now_s - before_s) for name, value in counters.items()}


def counters_of(report: dict) -> dict[str, int]:
    """The whole numbers of a report of hardware.serial_device.Health, those of frames among them."""
    counted = ("samples", "lost", "repeated", "late_commands", "refused", "not_closed", "lost_links")
    frames = {f"frames_{name}": report.get("frames", {}).get(name, 0) for name in ("bad", "resyncs")}
    return {name: report.get(name, 0) for name in counted} | frames


def worth_a_look(status: m.DeviceStatus, rates: dict[str, float]) -> list[m.Check]:
    """What does not keep trials from starting, but makes them worse."""
    found, report, clock = [], status.report, status.report.get("clock", {})
    for name, (least, what, advice) in RISING.items():
        if rates.get(name, 0.0) > least and (status.homed or name != "not_closed"):
            found.append((what.format(rates[name]), advice))
    if rates and rates["samples"] < LEAST_HZ and rates["lost"] <= RISING["lost"][0]:
        found.append((f"Only {rates['samples']:.0f} of {SAMPLE_HZ:.0f} samples a second arrive.", BUSY))
    found += [(what.format(report[name]), advice) for name, (what, advice) in COUNTED.items() if report.get(name, 0)]
    if clock.get("residual_s", 0.0) > RESIDUAL_S or abs(clock.get("drift", 0.0)) > DRIFT:
        what = "The clocks of the board and of this computer run unevenly, so times are less exact."
        found.append((what, "Close other programs, and plug the board in without a hub."))
    return [m.Check("", m.CAUTION, *words) for words in found]


def quantisation(device: Device, status: m.DeviceStatus, controllers: dict[int, Preset]) -> tuple[float, ...] | None:
    """What the encoders' steps do to the proportional controller of greatest gain, where the handle is.

    The gain (N s/m), a count at the tip where it is coarsest (m), the noise of the filtered velocity (m/s) and of the
    force (N). None where there is no such controller, or the board has not reported enough.
    """
    counts, joints = status.report.get("counts_per_rev", ()), [JOINTS.index(letter) for letter in status.encoders]
    gain = max((preset.value("gain_N_s_m") for preset in controllers.values()), default=0.0)
    if gain <= 0.0 or not status.homed or len(counts) != len(joints) or not all(counts):
        return None
    per_joint = dict(zip(joints, counts, strict=True))
    step = encoder_step(device, status.tip, [per_joint.get(i, 0) for i in range(4)])
    noise = VELOCITY_NOISE_HZ * step
    return (gain, step, noise, noise * gain) if math.isfinite(step) else None


def figures_of(status: m.DeviceStatus, rates: dict[str, float]) -> dict[str, str]:
    """Everything that is known, by the names of BOARD, SENSORS, LINK and CLOCK."""
    report, reached = status.report, bool(status.device) and not status.problem
    state = STATES.get(report.get("state", ""), report.get("state", ""))
    figures = {
        "Device": status.device, "Board": status.board, "Port": status.port,
        "State": state if reached else "not connected",
    }  # fmt: skip
    if reached:
        homed = f"homed{at(status.homed_at) or ' before this program began'}" if status.homed else "not homed"
        zeroed = f"zero{at(status.zeroed_at)}" if status.zeroed else "no zero yet"
        figures |= {
            "Fault": status.fault or "none", "Encoders": f"{' '.join(status.encoders)}: {homed}",
            "Force sensor": f"{status.force_channels} channels, {zeroed}" if status.force_channels else "none",
        }  # fmt: skip
    if reached and status.counts:
        encoders = dict(zip(status.encoders, status.counts, strict=False))
        for i, joint in enumerate(JOINTS):
            angle = f"{math.degrees(status.theta[i]):.2f}°" if status.homed and len(status.theta) == 4 else ""
            count = f"{grouped(encoders[joint])} counts" if joint in encoders else "computed" if angle else ""
            figures[f"Joint {joint}"] = "  ".join(filter(None, (angle, count)))
        fx, fy = status.hand_force
        if status.homed and math.isfinite(sum(status.tip)):
            figures["Handle"] = f"x {1e3 * status.tip[0]:z.1f}   y {1e3 * status.tip[1]:z.1f} mm"
        if status.force_channels and math.isfinite(fx + fy):
            figures["Hand force"] = f"{math.hypot(fx, fy):.1f} N   x {fx:z.1f}   y {fy:z.1f} N"
        if rates:
            figures["Samples"] = f"{rates['samples']:.0f} a second"
    if report:
        counts = counters_of(report)
        shown = {name: grouped(count) for name, count in counts.items()}
        shown["all"] = grouped(counts["samples"] + counts["lost"])
        figures |= {name: text.format_map(shown) for name, text in LINK.items()}
        figures["Firmware"] = f"{report.get('firmware', NOTHING)}, protocol {report.get('protocol', NOTHING)}"
        figures["Link"] = report.get("link", "")
        if report.get("round_trip_s") is not None:
            figures["Round trip"] = f"{1e3 * report['round_trip_s']:.1f} ms at best"
        if ticks := report.get("delay_ticks"):
            figures["Delay"] = f"{ticks} {'tick' if ticks == 1 else 'ticks'}, sample to current"
        if (clock := report.get("clock")) and clock["blocks"]:
            figures["Clock offset"] = f"{clock['offset_s']:+.4f} s ± {1e6 * clock['residual_s']:.0f} µs"
            figures["Clock drift"] = f"{1e6 * clock['drift']:+z.0f} ppm" if clock["blocks"] >= 3 else ""
    return figures


def at(when: float) -> str:
    """ " at 13:02" of a time (s since 1970); "" of none."""
    return f" at {datetime.fromtimestamp(when):%H:%M}" if when else ""


class DevicePage(Page):
    """What is wrong; board, sensors and link in figures; the steps as buttons."""

    def __init__(self, send: Callable[[object], None]) -> None:
        super().__init__(send)
        self._port = ""  # of a device on the bench; "": the device is simulated
        self._status: m.DeviceStatus | None = None
        self._rates, self._recent = dict[str, float](), Rates()
        self.cards = Cards(self)
        self.no_figures, self.health = wrapped_label("", size=theme.TITLE), Checklist()
        self.no_figures.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.why, self.quantised = wrapped_label("", "quiet"), wrapped_label("", "quiet")
        self.values = {name: wrapped_label(NOTHING) for name in (*BOARD, *SENSORS, *LINK, *CLOCK)}
        self.steps = {text: button(text, partial(self._ask, text)) for text in STEPS}
        self.reset = button("Reset faults  Ctrl+B", lambda: self.send(m.AllowBrakes()))
        self.bring_up = BringUpPanel(send)
        self.bring_up.opened.connect(self._refresh)
        self._lay_out()
        self._refresh()

    def _lay_out(self) -> None:
        title = text_label("Is it ready?", size=theme.HEAD, bold=True)
        buttons = *self.steps.values(), self.bring_up.ask_open, self.reset
        head = row(title, 1, *buttons)  # above what grows: no button moves
        state = Panel()
        state.setLayout(column(head, self.health, self.quantised, self.why, spacing=8, margins=PANEL_MARGINS))
        # shares of the width: what the board is called may take two lines, numbers that change may not
        groups = ("Board", BOARD, 5), ("Sensors", SENSORS, 6), ("Link since it was opened", (*LINK, *CLOCK), 6)
        panels = [(panel(title, self._figures(names), 1), share) for title, names, share in groups]
        figures = scrolled(holder(column(row(*panels, spacing=theme.GAP), 1)))
        self.bench = holder(column(state, (figures, 1), spacing=theme.GAP))
        self.setLayout(column(self.no_figures, (self.bench, 1), (self.bring_up, 1), spacing=theme.GAP))

    def _figures(self, names: Sequence[str]) -> QGridLayout:
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

    def cancel(self) -> bool:
        return self.cards.leave()

    def show_pulse(self, pulse: m.Pulse) -> None:
        status = pulse.device
        if status is None or status != self._status:
            before, self._status = self._status, status
            if before is None or status is None or status.homed != before.homed:
                self._recent = Rates()  # what the encoders gave before they were homed means nothing
            self._rates = self._recent.rates(status.reported_s, counters_of(status.report)) if status else {}
            self._refresh()

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._refresh()

    def _refresh(self) -> None:
        status, snapshot, opened = self._status, self.snapshot, self.opened
        on_bench = opened is not None and opened.real_device
        self.no_figures.setText(f"Opening {self._port} …" if self._port else SIMULATED)
        self.no_figures.setVisible(not on_bench)
        self.bench.setVisible(on_bench and not self.bring_up.is_open)
        if opened is None or not on_bench or not self.isVisible():
            return
        found = [check for check in snapshot.checks if check.name in ("Device", "Hand") and check.state != m.GOOD]
        for text, button_of_step in self.steps.items():
            button_of_step.setText(m.WAITS[snapshot.step] if snapshot.step == STEPS[text][0] else text)
        found += worth_a_look(status, self._rates) if status and not status.problem else []
        self.health.show_checks(tuple(found) or (m.Check("", m.GOOD, "All is well."),))
        figures = figures_of(status, self._rates) if status else {}
        for name, label in self.values.items():
            label.setText(breakable(figures.get(name) or NOTHING))
        self.quantised.setText(quantised(status, opened.protocol) if status else "")
        why = why_no_step(opened, snapshot)
        self.why.setText(why)
        self.why.setVisible(bool(why))
        why = why or snapshot.step  # one at a time
        usable = status if status is not None and not why and not status.problem and not status.fault else None
        home, zero, reconnect = self.steps.values()
        home.setEnabled(usable is not None and bool(usable.device))
        zero.setEnabled(usable is not None and bool(usable.device) and usable.force_channels > 0)
        reconnect.setEnabled(not why)
        self.bring_up.show_status(status, not why and status is not None and not status.problem)
        self.reset.setEnabled(bool(snapshot.brakes_off) and snapshot.stage != m.RUNNING)

    def _ask(self, text: str) -> None:
        """Say what the step needs before it is taken."""
        step, needs = STEPS[text]
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


def quantised(status: m.DeviceStatus, protocol: Protocol) -> str:
    """What the encoders' steps do, in words; "": nothing is known of it."""
    device = next((device for device in protocol.devices if device.name == status.device), None)
    found = quantisation(device, status, protocol.controllers) if device else None
    if device is None or found is None:
        return ""
    gain, step, noise, force = found
    return (
        f"One encoder count is {1e6 * step:.0f} µm at the handle. The velocity is known to {1e3 * noise:.2g} mm/s, "
        f"which a gain of {grouped(gain)} N s/m turns into {force:.1f} N (every brake reaches "
        f"{device.force_normalised_N:.0f} N)"
        f"{': the encoder steps can be felt.' if force > FELT_SHARE * device.force_normalised_N else '.'}"
    )
