"""The device page's figures in words: board, sensors, link."""

import math
from datetime import datetime
from typing import TYPE_CHECKING

from app.window.device_words import STATES, Rates, counters_of, times
from app.window.words import grouped
from core.mechanism import JOINTS

if TYPE_CHECKING:
    from app.ipc.messages import Linked


def board_values(linked: "Linked") -> dict[str, str]:
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


def sensor_values(linked: "Linked", rates: Rates) -> dict[str, str]:
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
