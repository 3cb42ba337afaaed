"""What the board on the bench has reported, in words and figures; and what in it is worth a look."""

import math
from collections import deque
from datetime import datetime

from app.ipc import messages as m
from app.window.widgets.preflight import told
from core.control.controllers import Preset
from core.device import Device
from core.device_interface import VELOCITY_NOISE_HZ, encoder_step
from core.mechanism import JOINTS
from experiments.plan import grouped
from experiments.protocol import Protocol

RECENT_S = 10.0  # what is counted as happening now
SAMPLE_HZ, LEAST_HZ = 1000.0, 990.0  # samples a second; fewer than the second are worth a word. Our choice
RESIDUAL_S, DRIFT = 1e-3, 200e-6  # our choice: a quartz drifts by less, a quiet USB port is ten times as regular
KNOWN_BLOCKS = 10  # seconds after which the clocks are judged: a slow start of the link looks like drift. Our choice
FELT_SHARE = 0.05  # of what the brakes can do, from where a noise may be felt. Our choice
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
    "board_time_back": ("Jumps back of the board's clock: {}.", "Its firmware must count microseconds in 64 bits."),
}
STATES = {
    "BOOT": "starting", "IDLE": "idle: waits for the limits", "READY": "ready: no current",
    "ACTIVE": "active: currents may flow", "FAULT": "fault: no current until it is reset",
}  # fmt: skip
COUNT, SPEED, FELT = "Encoder step", "Speed noise", "Force noise"
BOARD = ("Device", "Port", "Link", "Firmware", "Round trip", "Delay", "Clock offset", "Clock drift")
SENSORS = (*(f"Joint {joint}" for joint in JOINTS), "Handle", "Tip force", COUNT, SPEED, FELT)
#: name -> counters, as they are shown
LINK = {
    "Lost": "{lost} of {all} samples", "Repeated": "{repeated} samples",
    "Damaged": "{frames_bad} messages", "Gaps": "{frames_resyncs} after damage",
    "Too late": "{late_commands} commands", "Refused": "{refused} messages", "No position": "{not_closed} samples",
}  # fmt: skip
GROUPS = {"Board": BOARD, "Sensors": SENSORS, "Link since it was opened": tuple(LINK)}  # title -> names
READY_BOARD, BRAKES, ENCODERS, FORCE, SAMPLES = READINESS = "Board", "Brakes", "Encoders", "Force sensor", "Link"


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


def worth_a_look(status: m.DeviceStatus, rates: dict[str, float]) -> list[str]:
    """What does not keep trials from starting, but makes them worse, and what to do about it."""
    found, report, clock = [], status.report, status.report.get("clock", {})
    for name, (least, what, advice) in RISING.items():
        if rates.get(name, 0.0) > least and (status.homed or name != "not_closed"):
            found.append((what.format(rates[name]), advice))
    if rates and rates["samples"] < LEAST_HZ and rates["lost"] <= RISING["lost"][0]:
        found.append((f"Only {rates['samples']:.0f} of {SAMPLE_HZ:.0f} samples a second arrive.", BUSY))
    found += [(what.format(report[name]), advice) for name, (what, advice) in COUNTED.items() if report.get(name, 0)]
    uneven = clock.get("residual_s", 0.0) > RESIDUAL_S or abs(clock.get("drift", 0.0)) > DRIFT
    if uneven and clock["blocks"] >= KNOWN_BLOCKS:
        what = "The clocks of the board and of this computer run unevenly, so times are less exact."
        found.append((what, "Close other programs, and plug the board in without a hub."))
    return [" ".join(words) for words in found]


def readiness(snapshot: m.Snapshot, status: m.DeviceStatus | None, rates: dict[str, float]) -> dict[str, m.Check]:
    """What of READINESS is there, or what is wrong with it and what to do, in the order in which it is made ready."""
    reached = is_reached(status)
    found = {name: m.Check(name, m.WAITING, NOTHING) for name in READINESS}
    if status is not None and reached:
        board, state = status.board or status.device, status.report.get("state", "no fault")
        homed = f"homed{at(status.homed_at) or ' before this program began'}" if status.homed else "not homed yet"
        homed += ", kept by the board since" if status.homed and status.report.get("lost_links") else ""
        zeroed = f"zeroed{at(status.zeroed_at)}" if status.zeroed else "not zeroed yet"
        channels = f"{status.force_channels} channels, {zeroed}" if status.force_channels else "none"
        letters = " ".join(status.encoders)
        arrive = f"{rates['samples']:.0f} samples a second" if rates else "samples arrive"
        for name, good, text in (
            (READY_BOARD, True, f"{board} is connected"), (BRAKES, True, STATES.get(state, state)),
            (ENCODERS, status.homed, f"{letters}: {homed}"),
            (FORCE, status.zeroed or not status.force_channels, channels), (SAMPLES, True, arrive),
        ):  # fmt: skip
            found[name] = m.Check(name, m.GOOD if good else m.WAITING, text)
        if worse := worth_a_look(status, rates):
            found[SAMPLES] = m.Check(SAMPLES, m.CAUTION, "\n".join(worse))
    faulty = snapshot.brakes_off or (status is not None and status.fault)
    of_device = READY_BOARD if not reached else BRAKES if faulty else ENCODERS
    for check in snapshot.checks:  # the server's own, which says what keeps trials from starting
        name = {"Device": of_device, m.FORCE_SENSOR: FORCE if reached else ""}.get(check.name, "")
        if name and check.state != m.GOOD:
            short = name == READY_BOARD or check.state in (m.DUE, m.WAITING)
            found[name] = check._replace(text=check.text if short else told(check))
    return {name: check._replace(text=check.text[:1].upper() + check.text[1:]) for name, check in found.items()}


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


def figures_of(status: m.DeviceStatus, protocol: Protocol) -> dict[str, str]:
    """Everything that is known, by the names of BOARD, SENSORS and LINK."""
    report, reached = status.report, is_reached(status)
    figures = {"Device": status.device, "Port": status.port}
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
            figures["Tip force"] = f"{math.hypot(fx, fy):.1f} N   x {fx:z.1f}   y {fy:z.1f} N"
        figures |= quantised(status, protocol)
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
            figures["Clock drift"] = f"{1e6 * clock['drift']:+z.0f} ppm" if clock["blocks"] >= KNOWN_BLOCKS else ""
    return figures


def is_reached(status: m.DeviceStatus | None) -> bool:
    """Whether a device is connected and its samples arrive."""
    return status is not None and bool(status.device) and not status.problem


def at(when: float) -> str:
    """ " at 13:02" of a time (s since 1970); "" of none."""
    return f" at {datetime.fromtimestamp(when):%H:%M}" if when else ""


def quantised(status: m.DeviceStatus, protocol: Protocol) -> dict[str, str]:
    """What the encoders' steps do, in words; {}: it is not known."""
    device = next((device for device in protocol.devices if device.name == status.device), None)
    found = quantisation(device, status, protocol.controllers) if device else None
    if device is None or found is None:
        return {}
    gain, step, noise, force = found
    most = device.force_normalised_N
    felt = "can be felt" if force > FELT_SHARE * most else "too little to be felt"
    return {
        COUNT: f"{1e6 * step:.0f} µm at the handle",
        SPEED: f"{1e3 * noise:.2g} mm/s",
        FELT: f"{force:.1f} of {most:.0f} N at {grouped(gain)} N s/m: {felt}",
    }
