"""The device on the bench: how it is, what is wrong and what to do about it, and the steps that make it ready."""

import math
from collections import deque
from datetime import datetime
from typing import NamedTuple

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QGridLayout, QVBoxLayout, QWidget

from app.ipc import messages as m
from app.window.cards import Notice
from app.window.painting import theme
from app.window.painting.labels import OneLine, breakable, line, word
from app.window.painting.parts import button, panel, row
from app.window.preflight import Checklist
from app.window.words import grouped
from core import faults
from core.control.controllers import Preset
from core.device import Device
from core.device_interface import VELOCITY_NOISE_HZ, encoder_step
from core.mechanism import JOINTS
from experiments.protocol import home_of

RECENT_S = 10.0  # what is counted as happening now
SAMPLE_HZ = 1000.0
#: Our choice: fewer samples or more losses than this are worth a word; recordings keep every gap either way.
LEAST_HZ, LOST_SHARE = 990.0, 0.001
RESIDUAL_S, DRIFT = 1e-3, 200e-6  # our choice: a quartz drifts by less, a quiet USB port is ten times as regular
FELT_SHARE = 0.05  # of what the brakes can do, from where a noise may be felt. Our choice
SIMULATED = (
    "The device is simulated on this computer and is always ready. To use a real one, choose Board on the Home page "
    "and connect to its port."
)
NOTHING = "–"
BUSY = "Close other programs; phd doctor names what stands in the way."
#: counter -> what its rise in the last seconds means, and what to do about it
RISING = {
    "lost": ("{n} samples were lost in the last {s:.0f} s.", "Plug the board in without a hub."),
    "frames_bad": (
        "{n} messages arrived damaged in the last {s:.0f} s.",
        "Use a short, shielded cable, away from the leads of the brakes.",
    ),
    "late_commands": ("Commands reach the board too late, so it does not obey them.", BUSY),
    "not_closed": (
        "The encoders contradict each other: their angles belong to no position of the linkage.",
        "Home the encoders again; if that does not help, check their plugs.",
    ),
    "refused": ("The board refuses commands.", "Reconnect it."),
}
STATES = {
    "BOOT": "starting", "IDLE": "idle: waits for the limits", "READY": "ready: no current",
    "ACTIVE": "active: currents may flow", "FAULT": "fault: no current until it is reset",
}  # fmt: skip
BOARD = ("Device", "Board", "Port", "Firmware", "State", "Fault", "Encoders", "Force sensor")
SENSORS = (*(f"Joint {joint}" for joint in JOINTS), "Handle", "Hand force", "Samples", "Round trip")
LINK = (
    "Lost", "Repeated", "Damaged", "Resynchronised", "Too late", "Refused", "No position", "Disconnected",
    "Clock offset", "Clock drift",
)  # fmt: skip
#: button -> the step it asks for, and what its question says
STEPS = {
    "Home the encoders …": (m.HOME, "Hold the handle in its jig at {home}, then go on."),
    "Take the zero …": (m.ZERO, "Let go of the handle, go on, and do not touch it for a second."),
    "Reconnect …": (m.CONNECT, "The connection is closed and made again. The zero must be taken again afterwards."),
}


class Rates(NamedTuple):
    """What was counted over the last seconds."""

    over_s: float = 0.0  # 0: not known yet
    counts: dict = {}  # noqa: RUF012  (never changed)

    def per_s(self, name: str) -> float:
        """How often a second."""
        return self.counts.get(name, 0) / self.over_s if self.over_s else 0.0


class Recent:
    """The counters of the last seconds."""

    def __init__(self) -> None:
        self._taken: deque[tuple[float, dict]] = deque()

    def add(self, now_s: float, counters: dict) -> Rates:
        """New counters; what was counted since the oldest that is not older than RECENT_S."""
        taken = self._taken
        if taken and any(counters.get(name, 0) < value for name, value in taken[-1][1].items()):
            taken.clear()  # another connection, which counts anew
        taken.append((now_s, counters))
        while len(taken) > 2 and taken[1][0] <= now_s - RECENT_S:
            taken.popleft()
        before_s, before = taken[0]
        if now_s - before_s < 0.5:
            return Rates()
        return Rates(now_s - before_s, {name: value - before.get(name, 0) for name, value in counters.items()})


def counters_of(report: dict) -> dict:
    """The whole numbers of a report of hardware.serial_device.Health, those of frames among them."""
    frames = {f"frames_{name}": value for name, value in report.get("frames", {}).items()}
    counted = ("samples", "lost", "repeated", "late_commands", "refused", "not_closed", "lost_links")
    return {**{name: report.get(name, 0) for name in counted}, **frames}


def health(status: m.DeviceStatus | None, rates: Rates) -> list[m.Check]:
    """What keeps trials from starting, then what is worth a look; empty: all is well."""
    if status is None:
        return [m.Check("", m.WAITING, "Connecting to the board …")]
    if status.problem:
        back = "Check cable and supply. The connection comes back by itself as soon as the board answers."
        return [m.Check("", m.BAD, f"No connection: {status.problem}.", faults.advice(status.problem) or back)]
    bad, worth = [], []
    if status.fault:
        bad.append((f"Fault on the board: {status.fault}. No current flows.", faults.advice(status.fault)))
    if not status.homed:
        bad.append(("The encoders are not homed: the place of the handle is unknown.", "Home the encoders."))
    if status.force_channels == 0:
        worth.append(("There is no force sensor: the controllers use the motion alone.", ""))
    elif not status.zeroed:
        bad.append(("The force sensor has no zero yet.", "Take the zero while nobody holds the handle."))
    report, clock, counts = status.report, status.report.get("clock", {}), rates.counts
    wanted, lost = SAMPLE_HZ * rates.over_s, counts.get("lost", 0)
    anew, back = report.get("begun_anew", 0), report.get("board_time_back", 0)
    cut = report.get("lost_links", 0) - anew
    least = {"lost": LOST_SHARE * wanted, "not_closed": 0 if status.homed else math.inf}
    for name, (what, advice) in RISING.items():
        if counts.get(name, 0) > least.get(name, 0):
            worth.append((what.format(n=counts[name], s=rates.over_s), advice))
    if wanted and rates.per_s("samples") < LEAST_HZ and lost <= LOST_SHARE * wanted:
        worth.append((f"Only {rates.per_s('samples'):.0f} of {SAMPLE_HZ:.0f} samples a second arrive.", BUSY))
    if cut > 0:
        worth.append((f"The connection was lost {times(cut)} since the start.", "Check cable and plug."))
    if anew > 0:
        what = f"The connection was made anew {times(anew)}, because this computer's clock stood still."
        worth.append((what, "Do not suspend the computer, or pause a virtual machine, while the device is in use."))
    if back > 0:
        what = f"The clock of the board jumped back {times(back)}."
        worth.append((what, "Its firmware must count microseconds in 64 bits."))
    if clock.get("residual_s", 0.0) > RESIDUAL_S or abs(clock.get("drift", 0.0)) > DRIFT:
        what = "The clocks of the board and of this computer run unevenly, so times are less exact."
        worth.append((what, "Close other programs, and plug the board in without a hub."))
    return [m.Check("", m.BAD, *one) for one in bad] + [m.Check("", m.CAUTION, *one) for one in worth]


def times(number: int) -> str:
    """once, twice, 3 times."""
    return {1: "once", 2: "twice"}.get(number, f"{number} times")


class Quantisation(NamedTuple):
    """What the encoders' steps do to the proportional controller of greatest gain, where the handle is."""

    gain: float  # N s/m
    step_m: float  # at the tip, of one count, in the direction where it is coarsest
    noise_m_s: float  # of the filtered velocity
    force_N: float  # the noise times the gain
    range_N: float  # what every brake reaches everywhere

    @property
    def felt(self) -> bool:
        """Whether it is a good part of what the brakes can do."""
        return self.force_N > FELT_SHARE * self.range_N


def quantisation(device: Device, status: m.DeviceStatus, controllers: dict[int, Preset]) -> Quantisation | None:
    """From the counts a revolution and the Jacobians; None where the board has not reported enough."""
    counts, joints = status.report.get("counts_per_rev", ()), [JOINTS.index(letter) for letter in status.encoders]
    gain = max((preset.value("gain_N_s_m") for preset in controllers.values()), default=0.0)
    if gain <= 0.0 or not status.homed or len(counts) != len(joints) or not all(counts):
        return None
    per_joint = dict(zip(joints, counts, strict=True))
    step = encoder_step(device, status.tip, [per_joint.get(i, 0) for i in range(4)])
    noise = VELOCITY_NOISE_HZ * step
    return Quantisation(gain, step, noise, noise * gain, device.force_normalised_N) if math.isfinite(step) else None


def figures_of(status: m.DeviceStatus, rates: Rates) -> dict[str, str]:
    """Everything that is known, by the names of BOARD, SENSORS and LINK."""
    report, counts = status.report, counters_of(status.report)
    figures = {"Device": status.device, "Board": status.board, "Port": status.port}
    if "firmware" in report:
        figures["Firmware"] = f"{report['firmware']}, protocol {report['protocol']}"
    reached = bool(status.device) and not status.problem
    figures["State"] = STATES.get(report.get("state", ""), report.get("state", "")) if reached else "not connected"
    if reached:
        homed = f"homed{at(status.homed_at) or ' before this program began'}" if status.homed else "not homed"
        zeroed = f"zeroed{at(status.zeroed_at)}" if status.zeroed else "no zero yet"
        figures["Fault"], figures["Encoders"] = status.fault or "none", f"{' '.join(status.encoders)}: {homed}"
        figures["Force sensor"] = f"{status.force_channels} channels, {zeroed}" if status.force_channels else "none"
    if not status.problem and status.counts:
        encoders = dict(zip(status.encoders, status.counts, strict=False))
        for i, joint in enumerate(JOINTS):
            angle = f"{math.degrees(status.theta[i]):.2f}°" if status.homed and len(status.theta) == 4 else ""
            count = f"{grouped(encoders[joint])} counts" if joint in encoders else "computed" if angle else ""
            figures[f"Joint {joint}"] = "   ".join(filter(None, (angle, count)))
        fx, fy = status.hand_force
        if status.homed:
            figures["Handle"] = f"x {1e3 * status.tip[0]:.1f} mm   y {1e3 * status.tip[1]:.1f} mm"
        if status.force_channels and math.isfinite(fx + fy):
            figures["Hand force"] = f"{math.hypot(fx, fy):.1f} N   x {fx:.1f}   y {fy:.1f}"
        if rates.over_s:
            figures["Samples"] = f"{rates.per_s('samples'):.0f} a second"
        if (round_trip := report.get("round_trip_s")) is not None:
            figures["Round trip"] = f"{1e3 * round_trip:.1f} ms at best"
    if report:
        whole = counts["samples"] + counts["lost"]
        share = f" ({100.0 * counts['lost'] / whole:.2g} %)" if counts["lost"] else ""
        figures |= {
            "Lost": f"{grouped(counts['lost'])} of {grouped(whole)} samples{share}",
            "Repeated": f"{grouped(counts['repeated'])} samples",
            "Damaged": f"{grouped(counts.get('frames_bad', 0))} messages of this connection",
            "Resynchronised": times(counts["frames_resyncs"]) if counts.get("frames_resyncs") else "never",
            "Too late": f"{grouped(counts['late_commands'])} commands",
            "Refused": f"{grouped(counts['refused'])} messages",
            "No position": f"{grouped(counts['not_closed'])} samples",
            "Disconnected": times(counts["lost_links"]) if counts["lost_links"] else "never",
        }
        clock = report.get("clock")
        if clock and clock["blocks"]:
            figures["Clock offset"] = f"{clock['offset_s']:+.4f} s, ± {1e6 * clock['residual_s']:.0f} µs"
            figures["Clock drift"] = f"{1e6 * clock['drift']:+.0f} ppm" if clock["blocks"] >= 3 else ""
    return figures


def at(when: float) -> str:
    """ " at 13:02" of a time (s since 1970); "" of none."""
    return f" at {datetime.fromtimestamp(when):%H:%M}" if when else ""


class DevicePage(QWidget):
    """What is wrong; board, sensors and link in figures; the steps as buttons."""

    asked = Signal(object)  # a command for the session server
    left = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._opened: m.Opened | None = None
        self._snapshot = m.Snapshot(m.PREPARING)
        self._status: m.DeviceStatus | None = None
        self._rates, self._recent = Rates(), Recent()
        self.card: Notice | None = None  # the question that is up
        self.simulated, self.health = line(SIMULATED, size=theme.TITLE), Checklist()
        self.why, self.quantised = line("", "quiet"), line("", "quiet")
        self.values: dict[str, OneLine] = {}
        self.steps = {text: button(text, lambda text=text: self._ask(text)) for text in STEPS}
        self.reset = button("Reset faults  Ctrl+B", lambda: self.asked.emit(m.AllowBrakes()))
        self._lay_out()
        self._refresh()

    def _lay_out(self) -> None:
        self.bench = QWidget()
        bench = QGridLayout(self.bench)
        bench.setContentsMargins(0, 0, 0, 0)
        bench.setSpacing(theme.GAP)
        state, inside = panel("Is it ready?")
        inside.addWidget(self.health)
        inside.addWidget(self.why)
        inside.addLayout(row(*self.steps.values(), self.reset, 1))
        bench.addWidget(state, 0, 0, 1, 3)
        figures = (("Board", BOARD), ("Sensors", SENSORS), ("Link since it was opened", LINK))
        for column, (title, names) in enumerate(figures):
            frame, inside = panel(title)
            grid = QGridLayout()
            grid.setColumnStretch(1, 1)
            for at, name in enumerate(names):
                self.values[name] = OneLine(NOTHING, size=theme.NORMAL)
                grid.addWidget(word(name, "quiet"), at, 0)
                grid.addWidget(self.values[name], at, 1)
            inside.addLayout(grid)
            if names == SENSORS:
                inside.addWidget(self.quantised)
            inside.addStretch(1)
            bench.addWidget(frame, 1, column)
            bench.setColumnStretch(column, 1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(theme.GAP)
        layout.addLayout(row(word("Device", size=theme.HEAD, bold=True), 1, button("Back  Esc", self.left.emit)))
        layout.addWidget(self.simulated)
        layout.addWidget(self.bench, 1)
        layout.addStretch(1)

    def show_session(self, opened: m.Opened | None, snapshot: m.Snapshot) -> None:
        """What may be done now."""
        if snapshot.stage != self._snapshot.stage or opened != self._opened:
            self.leave()
        self._opened, self._snapshot = opened, snapshot
        self._refresh()

    def show_status(self, status: m.DeviceStatus | None) -> None:
        """How the device is, about ten times a second."""
        if status is None or status != self._status:
            before, self._status = self._status, status
            if before is None or status is None or status.homed != before.homed:
                self._recent = Recent()  # what the encoders gave before they were homed means nothing
            self._rates = self._recent.add(status.told_s, counters_of(status.report)) if status else Rates()
            self._refresh()

    def showEvent(self, event) -> None:
        super().showEvent(event)
        self._refresh()

    def _refresh(self) -> None:
        status, on_bench = self._status, self._opened is not None and self._opened.real_device
        self.simulated.setVisible(not on_bench)
        self.bench.setVisible(on_bench)
        if not on_bench or not self.isVisible():
            return
        self.health.show_checks(tuple(health(status, self._rates)) or (m.Check("", m.GOOD, "All is well."),))
        figures = figures_of(status, self._rates) if status else {}
        for name, label in self.values.items():
            label.setText(figures.get(name) or NOTHING)
        self.quantised.setText(breakable(self._quantised(status) if status else ""))
        why, snapshot = self._why_not(), self._snapshot
        self.why.setText(why)
        self.why.setVisible(bool(why))
        there = not why and status is not None and not status.problem and bool(status.device)
        home, zero, reconnect = self.steps.values()
        home.setEnabled(there and not status.fault)
        zero.setEnabled(there and not status.fault and status.force_channels > 0)
        reconnect.setEnabled(not why)
        self.reset.setEnabled(bool(snapshot.brakes_off) and snapshot.stage != m.RUNNING)

    def _why_not(self) -> str:
        """Why no step can be taken now."""
        if self._opened is None or not self._opened.participant:
            return "Start a session first: its journal records these steps."
        if self._snapshot.coming is None:
            return "All trials of the plan are done."
        between = self._snapshot.stage in (m.READY, m.RERIG, m.BREAK, m.QUESTIONS)
        return "" if between else "These steps are taken between two trials."

    def _quantised(self, status: m.DeviceStatus) -> str:
        device = self._device(status.device)
        found = quantisation(device, status, self._opened.controllers) if device and self._opened else None
        if found is None:
            return ""
        return (
            f"One encoder count is {1e6 * found.step_m:.0f} µm at the handle. The velocity is known to "
            f"{1e3 * found.noise_m_s:.2g} mm/s, which a gain of {grouped(round(found.gain))} N s/m turns into "
            f"{found.force_N:.1f} N (every brake reaches {found.range_N:.0f} N)"
            f"{': the encoder steps can be felt.' if found.felt else '.'}"
        )

    def _device(self, name: str) -> Device | None:
        return next((one for one in (self._opened.devices if self._opened else ()) if one.name == name), None)

    def _ask(self, text: str) -> None:
        """Say what the step needs before it is taken."""
        self.leave()
        step, says = STEPS[text]
        device = self._device(self._snapshot.coming.configuration) if self._snapshot.coming else None
        x, y = home_of(device, self._opened.paths) if device and self._opened else (math.nan, math.nan)
        says = says.format(home=f"x = {1e3 * x:.0f} mm, y = {1e3 * y:.0f} mm")

        def do() -> None:
            self.leave()
            self.asked.emit(m.Rig(step))

        self.card = Notice(text.removesuffix(" …"), says, [("Go on  Enter", do), ("Cancel  Esc", self.leave)], self)
        self.card.appear()

    def leave(self) -> bool:
        """Take the question away; whether there was one."""
        card, self.card = self.card, None
        if card is not None:
            card.hide()
            card.deleteLater()
        return card is not None
