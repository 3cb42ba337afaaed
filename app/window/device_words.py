"""What the device page says of a device on the bench: figures in words, what is not well, and what to do about it."""

import math
from collections import deque
from datetime import datetime
from typing import TYPE_CHECKING, NamedTuple

from app.ipc import messages as m
from app.window.words import grouped
from core import faults
from core.control.controllers import Preset
from core.device import Device
from core.device_interface import VELOCITY_NOISE_HZ, encoder_step
from core.mechanism import JOINTS

if TYPE_CHECKING:
    from app.ipc.messages import DeviceStatus

RECENT_S = 10.0  # what is counted as happening now
SAMPLE_HZ = 1000.0
#: Our choice: fewer samples or more losses than this are worth a word; recordings keep every gap either way.
LEAST_HZ, LOST_SHARE = 990.0, 0.001
RESIDUAL_S, DRIFT = 1e-3, 200e-6  # our choice: a quartz drifts by less, a quiet USB port is ten times as regular
FELT_SHARE = 0.05  # of what the brakes can do, from where a noise may be felt. Our choice

STATES = {
    "BOOT": "starting",
    "IDLE": "idle: waits for the limits",
    "READY": "ready: no current",
    "ACTIVE": "active: currents may flow",
    "FAULT": "fault: no current until it is reset",
}
NO_CONNECTION = "Look at cable and supply: as soon as the board answers, the connection is there again by itself."


class Word(NamedTuple):
    """One thing that is not well."""

    state: str  # m.BAD: trials cannot start; m.CAUTION; m.WAITING
    what: str
    advice: str = ""


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


def not_well(linked: "DeviceStatus | None", rates: Rates) -> list[Word]:
    """What keeps trials from starting, then what is worth a look; empty: all is well."""
    if linked is None:
        return [Word(m.WAITING, "The board is being reached.")]
    if linked.problem:
        return [Word(m.BAD, f"No connection: {linked.problem}.", faults.advice(linked.problem) or NO_CONNECTION)]
    words = []
    if linked.fault:
        what = f"Fault latched on the board: {linked.fault}. No current flows."
        words.append(Word(m.BAD, what, faults.advice(linked.fault)))
    if not linked.homed:
        what = "The encoders are not homed: the place of the handle is unknown."
        words.append(Word(m.BAD, what, "Home the encoders."))
    if linked.force_channels == 0:
        words.append(Word(m.CAUTION, "There is no force sensor: the controllers see motion alone."))
    elif not linked.zeroed:
        words.append(Word(m.BAD, "The force sensor has no zero yet.", "Take the zero, with nobody at the handle."))
    return words + _lately(linked, rates)


def _lately(linked: "DeviceStatus", rates: Rates) -> list[Word]:
    words, counts = [], rates.counts

    def say(when: bool, what: str, advice: str) -> None:
        if when:
            words.append(Word(m.CAUTION, what, advice))

    wanted = SAMPLE_HZ * rates.over_s
    frames, lost = counts.get("frames_bad", 0), counts.get("lost", 0)
    say(
        bool(wanted) and lost > LOST_SHARE * wanted,
        f"{lost} samples were lost in the last {rates.over_s:.0f} s.",
        "Plug the board straight into the computer, without a hub.",
    )
    say(
        bool(wanted) and rates.per_s("samples") < LEAST_HZ and lost <= LOST_SHARE * wanted,
        f"Only {rates.per_s('samples'):.0f} samples a second come, of {SAMPLE_HZ:.0f}.",
        "Close other programs; phd doctor says what stands in the way.",
    )
    say(
        frames > 0,
        f"{frames} messages came damaged in the last {rates.over_s:.0f} s.",
        "Use a short, shielded cable, away from the brakes' leads.",
    )
    say(
        counts.get("late_commands", 0) > 0,
        "Commands reach the board too late, and it does not obey them.",
        "Close other programs; phd doctor says what stands in the way.",
    )
    say(
        linked.homed and counts.get("not_closed", 0) > 0,
        "The encoders contradict each other: their angles belong to no position of the linkage.",
        "Home the encoders again; if it comes back, look at their plugs.",
    )
    say(counts.get("refused", 0) > 0, "The board refuses commands.", "Reconnect it.")
    anew = linked.report.get("begun_anew", 0)
    cut = linked.report.get("lost_links", 0) - anew
    say(cut > 0, f"The connection was lost {times(cut)} since the start.", "Look at cable and plug.")
    say(
        anew > 0,
        f"The connection was begun anew {times(anew)}: the board would have taken every command for late.",
        "This computer's clock stood still: no suspend and no pause of a virtual machine while the device is in use.",
    )
    back = linked.report.get("board_time_back", 0)
    say(back > 0, f"The board's time went back {times(back)}.", "Its firmware must count microseconds in 64 bits.")
    clock = linked.report.get("clock", {})
    say(
        clock.get("residual_s", 0.0) > RESIDUAL_S or abs(clock.get("drift", 0.0)) > DRIFT,
        "The board's clock and this computer's do not run evenly side by side.",
        "Times are known less well; close other programs, plug the board in without a hub.",
    )
    return words


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


def quantisation(device: Device, linked: "DeviceStatus", controllers: dict[int, Preset]) -> Quantisation | None:
    """From the counts a revolution and the Jacobians; None where the board has not told enough to say."""
    counts = linked.report.get("counts_per_rev", ())
    joints = [JOINTS.index(letter) for letter in linked.encoders]
    gain = max((preset.value("gain_N_s_m") for preset in controllers.values()), default=0.0)
    if gain <= 0.0 or not linked.homed or len(counts) != len(joints) or not all(counts):
        return None
    per_joint = dict(zip(joints, counts, strict=True))
    step = encoder_step(device, linked.tip, [per_joint.get(i, 0) for i in range(4)])
    if not math.isfinite(step):
        return None
    noise = VELOCITY_NOISE_HZ * step
    return Quantisation(gain, step, noise, noise * gain, device.force_normalised_N)


if TYPE_CHECKING:
    from app.ipc.messages import DeviceStatus


def board_values(linked: "DeviceStatus") -> dict[str, str]:
    """Who the board is, and whether it is ready."""
    report = linked.report
    state = report.get("state", "")
    homed = "homed" + at(linked.homed_at, " before this program began") if linked.homed else "not homed"
    zeroed = "zeroed" + at(linked.zeroed_at, "") if linked.zeroed else "no zero yet"
    reached = bool(linked.device) and not linked.problem
    return {
        "Device": linked.device,
        "Board": linked.board,
        "Port": linked.port,
        "Firmware": f"{report['firmware']}, protocol {report['protocol']}" if "firmware" in report else "",
        "State": STATES.get(state, state) if reached else "not connected",
        "Fault": (linked.fault or "none") if reached else "",
        "Encoders": f"{' '.join(linked.encoders)}: {homed}" if reached else "",
        "Force sensor": (f"{linked.force_channels} channels, {zeroed}" if linked.force_channels else "none")
        if reached
        else "",
    }


def at(when: float, else_: str) -> str:
    """ " at 13:02" of a time (s since 1970), or what is said without one."""
    return f" at {datetime.fromtimestamp(when):%H:%M}" if when else else_


def sensor_values(linked: "DeviceStatus", rates: Rates) -> dict[str, str]:
    """What the sensors say now."""
    if linked.problem or not linked.counts:
        return {}
    counts = dict(zip(linked.encoders, linked.counts, strict=False))
    values = {}
    for i, joint in enumerate(JOINTS):
        angle = f"{math.degrees(linked.theta[i]):.2f}°" if linked.homed and len(linked.theta) == 4 else ""
        told = f"{grouped(counts[joint])} counts" if joint in counts else "computed" if angle else ""
        values[f"Joint {joint}"] = "   ".join(filter(None, (angle, told)))
    fx, fy = linked.hand_force
    if linked.homed:
        values["Handle"] = f"x {1e3 * linked.tip[0]:.1f} mm   y {1e3 * linked.tip[1]:.1f} mm"
    if linked.force_channels and math.isfinite(fx + fy):
        values["Hand force"] = f"{math.hypot(fx, fy):.1f} N   x {fx:.1f}   y {fy:.1f}"
    if rates.over_s:
        values["Samples"] = f"{rates.per_s('samples'):.0f} a second"
    round_trip = linked.report.get("round_trip_s")
    values["Answer takes"] = f"{1e3 * round_trip:.1f} ms at best" if round_trip is not None else ""
    return values


def link_values(report: dict) -> dict[str, str]:
    """What was counted."""
    if not report:
        return {}
    counts = counters_of(report)
    whole = counts["samples"] + counts["lost"]
    lost = f"{grouped(counts['lost'])} of {grouped(whole)} samples"
    values = {
        "Lost": f"{lost} ({100.0 * counts['lost'] / whole:.2g} %)" if counts["lost"] else lost,
        "Repeated": f"{grouped(counts['repeated'])} samples",
        "Damaged": f"{grouped(counts.get('frames_bad', 0))} messages of this connection",
        "Put right": f"{times(counts.get('frames_resyncs', 0))} after damage",
        "Too late": f"{grouped(counts['late_commands'])} commands",
        "Refused": f"{grouped(counts['refused'])} messages",
        "No position": f"{grouped(counts['not_closed'])} samples",
        "Cut off": times(counts["lost_links"]) if counts["lost_links"] else "never",
    }
    clock = report.get("clock")
    if clock and clock["blocks"]:
        values["Clock offset"] = f"{clock['offset_s']:+.4f} s, ± {1e6 * clock['residual_s']:.0f} µs"
        values["Clock drift"] = f"{1e6 * clock['drift']:+.0f} ppm" if clock["blocks"] >= 3 else ""
    return values
