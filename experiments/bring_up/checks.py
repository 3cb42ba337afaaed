"""How each step is judged, but the brakes' (`brakes_in_motion`). Every limit is our choice and stands here."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from core.faults import cause
from core.mechanism import JOINTS
from experiments.bring_up.step import SHARE, Currents, Finding, Observed, Point

RATE = 0.02  # most that the board's time runs apart from this computer's, over two seconds
STILL_COUNTS = 4  # most that an encoder moves while nobody touches the handle
OFFSET_SHARE = 0.03  # of its largest current: most that an amplifier measures without current
TURNED_RAD = math.radians(8.0)
HELD_SHARE = 0.5  # most that the joint that is held moves, of the one that is turned
JIG_M = 0.002
NOISE_N = 0.1  # standard deviation
PUSHED_N, PUSHED_TICKS = 2.0, 150
AXIS_RAD = math.radians(35.0)
ON_S = 0.3  # of each current step without a hand
GAIN_SHARE = 0.05
RISE_SHARE = 0.25  # of the brake's shortest time constant: most that its current may take
OVERSHOOT = 0.1
OTHERS_SHARE = 0.25  # of the step: most that another amplifier measures meanwhile
WATCHDOG_S, SILENT_S = 0.05, 0.12
GONE_TICKS, FLOW_TICKS = 50, 300
LOST_SHARE, LATE_S, LATEST_S = 1e-3, 0.003, 0.04
MOVING_M_S = 0.05

# ----------------------------------------------------------------------------------------------- no hand, no current


def judge_board(observed: Observed) -> Finding:
    """The board says what it is, and its clock runs as fast as this computer's."""
    about = observed.about
    board_s = 1e-6 * np.diff(observed.column("board_us").astype(float))
    ticks = np.diff(observed.column("sequence"))
    came_s = observed.rows[-1].came_s - observed.rows[0].came_s
    apart = float(np.sum(board_s)) / came_s - 1.0
    limits = ", ".join(f"{JOINTS[i]} {observed.largest[i]:g} A" for i in observed.braked)
    saw = (
        f"{about.get('board') or 'a board without a number'}, firmware {about.get('firmware', 'unknown')}, protocol "
        f"{about.get('protocol', 'unknown')}; limits {limits}; "
        f"{1e3 * float(np.sum(board_s)) / float(np.sum(ticks)):.3f} ms a tick, its clock {100.0 * apart:+.1f} %"
    )
    if abs(apart) > RATE:
        return Finding(False, saw, "Correct the board's clock: crystal and PLL settings of its firmware.")
    return Finding(True, saw, figures={"clock_apart": apart})


def judge_quiet(observed: Observed) -> Finding:
    """Encoders that stand still, and amplifiers that measure nothing without current."""
    counts, measured = observed.column("counts"), observed.column("current").mean(axis=0)
    moved = dict(zip(observed.about["encoders"], np.ptp(counts, axis=0).tolist(), strict=True))
    wrong = {JOINTS[i]: measured[i] for i in observed.braked if abs(measured[i]) > OFFSET_SHARE * observed.largest[i]}
    saw = "encoders moved by " + ", ".join(f"{joint} {n}" for joint, n in moved.items()) + " counts; amplifiers "
    saw += "measure " + ", ".join(f"{JOINTS[i]} {1e3 * measured[i]:.0f}" for i in observed.braked) + " mA"
    figures = {"encoders_moved_counts": moved, "current_offset_A": measured.tolist()}
    restless = [joint for joint, n in moved.items() if n > STILL_COUNTS]
    if restless:
        advice = f"Look at plug, shield and termination of encoder {' and '.join(restless)}: it counts noise."
        return Finding(False, saw, advice, figures)
    if wrong:
        advice = f"Set the zero of the current measurement of {' and '.join(wrong)} in the firmware, or mend it."
        return Finding(False, saw, advice, figures)
    return Finding(True, saw, figures=figures)


# ------------------------------------------------------------------------------------------------------- the sensors

#: joint -> the link that is turned, the link that is held, the joint that then stands still
LINKS = {"A": ("AE", "BC", "B"), "E": ("ED", "AE", "A"), "B": ("BC", "AE", "A"), "C": ("CD", "BC", "B")}


def has_turned(observed: Observed) -> bool:
    """Whether any joint has turned far enough to judge its encoder."""
    return max(map(abs, observed.turned().values())) > TURNED_RAD


def judge_encoder(joint: str) -> Callable[[Observed], Finding]:
    """The encoder of the joint that was turned counts, upwards, and the one of the held joint does not."""
    held = LINKS[joint][2]

    def judge(observed: Observed) -> Finding:
        turned = observed.turned()
        saw = "turned by " + ", ".join(f"{name} {math.degrees(angle):+.1f}" for name, angle in turned.items()) + " deg"
        figures = {"turned_rad": turned}
        other = max(turned, key=lambda name: abs(turned[name]))
        if abs(turned[other]) <= TURNED_RAD:
            advice = f"Look at plug and supply of encoder {joint}: it does not count."
        elif other != joint and abs(turned[joint]) < HELD_SHARE * abs(turned[other]):
            advice = (
                f"If you turned {joint} and held {held}: encoder {other} counts in its place. Exchange their "
                f"plugs; if {other} rightly moved, encoder {joint} is dead: look at its plug and supply."
            )
        elif turned[joint] < 0.0:
            advice = f"Encoder {joint} counts down: exchange its two channels, or change its sign in the firmware."
        elif abs(turned.get(held, 0.0)) > HELD_SHARE * turned[joint]:
            advice = f"Joint {held} moved as well: hold it still, and repeat."
        else:
            return Finding(True, saw, figures=figures)
        return Finding(False, saw, advice, figures)

    return judge


def judge_hole(place: Point) -> Callable[[Observed], Finding]:
    """The encoders put the handle where the hole of the jig is (m)."""

    def judge(observed: Observed) -> Finding:
        tip = observed.column("tip").mean(axis=0)
        closed = bool(observed.column("closed").all())
        off = math.dist(tip, place)
        saw = f"the handle reads x = {1e3 * tip[0]:.1f} mm, y = {1e3 * tip[1]:.1f} mm, {1e3 * off:.1f} mm off"
        if closed and off <= JIG_M:
            return Finding(True, saw, figures={"off_m": off})
        advice = (
            "Check the counts per revolution (decoding at four edges, gears), the couplings and the link lengths in "
            "the device file; then home again."
        )
        return Finding(False, saw, advice, {"off_m": off})

    return judge


def judge_zero(observed: Observed) -> Finding:
    """The force sensor is quiet while nobody touches the handle."""
    force = observed.column("hand_force")
    spread = force.std(axis=0)
    saw = f"noise {spread[0]:.3f} N along x, {spread[1]:.3f} N along y (standard deviation)"
    figures = {"zero": observed.about.get("zero"), "noise_N": spread.tolist()}
    if float(spread.max()) > NOISE_N:
        advice = "Look at shield and ground of the sensor's cable, and keep it away from the brakes' wires."
        return Finding(False, saw, advice, figures)
    return Finding(True, saw, figures=figures)


def pushed(observed: Observed) -> np.ndarray:
    """(n, 2) N: the forces of the push."""
    force = observed.column("hand_force")
    return force[np.hypot(force[:, 0], force[:, 1]) > PUSHED_N]


def has_pushed(observed: Observed) -> bool:
    """Whether the handle was pushed for long enough in the last second."""
    return len(pushed(observed.part(-1000, None))) >= PUSHED_TICKS


def judge_push(direction: Point, words: str) -> Callable[[Observed], Finding]:
    """The measured force has the direction of the push; words: that direction for the person."""

    def judge(observed: Observed) -> Finding:
        force = pushed(observed)
        if len(force) < PUSHED_TICKS:
            advice = f"Push harder, {words}. If you did: look at the sensor's cable, and at the unit of its counts."
            return Finding(False, "no push was seen", advice)
        x, y = force.mean(axis=0).tolist()
        along, across = x * direction[0] + y * direction[1], x * direction[1] - y * direction[0]
        saw = f"the hand's force reads {x:+.1f} N along x, {y:+.1f} N along y"
        figures = {"force_N": [x, y]}
        if math.hypot(along, across) * math.cos(AXIS_RAD) <= along:
            return Finding(True, saw, figures=figures)
        axis = "x" if direction[0] else "y"
        if math.hypot(along, across) * math.cos(AXIS_RAD) <= -along:
            advice = f"The {axis} axis is inverted: exchange the wires of its bridge, or its sign in the calibration."
        else:
            advice = "The axes are turned: correct [sensing] force.rotation_rad in the device file, or the wiring."
        return Finding(False, saw, advice, figures)

    return judge


# ----------------------------------------------------------------------------------------------- currents, no hand


def in_turn(t: float, largest: np.ndarray, on_s: float = ON_S, times: int = 1) -> Currents:
    """The currents (A) at t (s): each brake in turn gets 10 % for `on_s`, then none for as long, `times` times."""
    number, rest = divmod(t, 2.0 * on_s)
    braked, turn = np.flatnonzero(largest), int(number) // times
    currents = np.zeros(4)
    if turn < len(braked) and rest < on_s:
        currents[braked[turn]] = SHARE * largest[braked[turn]]
    return tuple(currents.tolist())  # type: ignore[return-value]


def all_on(t: float, largest: np.ndarray) -> Currents:
    """10 % for all brakes, A, at any time."""
    return tuple((SHARE * largest).tolist())


class CurrentStep(NamedTuple):
    """What the current of one brake did after its command, and what the others did meanwhile."""

    delay_ticks: int  # from the sample before the command to the first one that shows half of it
    rise_s: float  # from 10 to 90 %
    overshoot: float  # share of the step
    gain: float  # of the second half, measured over asked
    others: float  # the largest that another amplifier measured on average, share of the step


def current_step(observed: Observed, i: int) -> CurrentStep:
    """The first step of the current of brake i."""
    asked = np.array([row.asked[i] for row in observed.rows])
    begin = int(np.argmax(asked > 0.0))
    on = np.flatnonzero(asked > 0.0)
    ticks, measured = observed.column("sequence")[on], observed.column("current")[on]
    share = measured[:, i] / asked[begin]
    late = share[len(share) // 2 :]
    gain = float(late.mean())
    filtered = np.convolve(share, np.ones(3) / 3.0, mode="same")  # of the noise of single samples
    tenth, most = (int(np.argmax(share > level * gain)) for level in (0.1, 0.9))
    half = int(np.argmax(share > 0.5 * gain))
    if gain < 0.1:
        tenth = most = half = 0
    others = [abs(float(measured[len(on) // 2 :, j].mean())) / asked[begin] for j in observed.braked if j != i]
    return CurrentStep(
        int(ticks[half] - ticks[0]) + 1, 1e-3 * float(ticks[most] - ticks[tenth]),
        float(filtered.max()) / gain - 1.0 if gain > 0.1 else 0.0, gain, max(others, default=0.0),
    )  # fmt: skip


def judge_currents(observed: Observed) -> Finding:
    """Each amplifier gives its own brake the current that was asked for, in time and without overshoot."""
    brakes, figures, words = observed.device.brakes, {}, []
    wrong: list[str] = []
    for i in observed.braked:
        joint, found = JOINTS[i], current_step(observed, i)
        longest = RISE_SHARE * min(float(brakes.rise[i, 0]), float(brakes.fall[i, 0]))
        figures[joint] = found._asdict() | {"rise_limit_s": longest}
        words.append(
            f"{joint} {100.0 * found.gain:.0f} %, rise {1e3 * found.rise_s:.0f} ms, overshoot "
            f"{100.0 * max(found.overshoot, 0.0):.0f} %, after {found.delay_ticks} ticks"
        )
        if found.others > OTHERS_SHARE:
            wrong.append(f"Current for {joint} is measured elsewhere: exchange the current-sensing wires.")
        elif found.overshoot > OVERSHOOT:
            wrong.append(f"Lower the gains of the current loop of {joint}: it overshoots.")
        elif abs(found.gain - 1.0) > GAIN_SHARE:
            wrong.append(f"Set the gain of amplifier {joint}, or look at its brake's plug: it gives a wrong current.")
        elif found.rise_s > longest:
            wrong.append(
                f"Make the current loop of {joint} quicker: the model's brake takes its current at once, so at most "
                f"{1e3 * longest:.0f} ms (a quarter of its time constant)."
            )
    return Finding(not wrong, "; ".join(words), " ".join(wrong), figures)


def judge_watchdog(observed: Observed) -> Finding:
    """Currents are gone within 50 ms of the last command, by the board's own clock, and it says why."""
    board_s = 1e-6 * observed.column("board_us").astype(float)
    echo, measured = observed.column("echo"), observed.column("current")
    advice = "Do not put a hand to the handle: the firmware's watchdog does not act. It must be mended first."
    latched = next((k for k, row in enumerate(observed.rows) if row.sample.fault), 0)
    if not latched:
        return Finding(False, "the board has latched no fault", advice)
    newest = max(k for k in range(latched) if k == 0 or echo[k] != echo[k - 1])  # command before that
    flowing = (measured[:, observed.braked] > 0.5 * SHARE * observed.largest[observed.braked]).any(axis=1)
    until = float(board_s[np.flatnonzero(flowing)[-1]] - board_s[newest]) if flowing.any() else 0.0
    fault = observed.rows[latched].sample.fault
    saw = f"currents flowed for {1e3 * until:.0f} ms after the last command; {fault}"
    if board_s[latched] - board_s[latched - 1] > WATCHDOG_S:
        saw = f"no samples came while this computer was silent; afterwards {fault}"
    figures = {"flowed_s": until, "fault": str(fault)}
    if until > WATCHDOG_S + 0.005:
        return Finding(False, saw, advice, figures)
    return Finding(True, saw, figures=figures)


def brakes_without(observed: Observed) -> list[bool]:
    """Of each brake whether its current has been gone for the last ticks."""
    measured = observed.part(-GONE_TICKS, None).column("current")
    return [bool((measured[:, i] < 0.3 * SHARE * observed.largest[i]).all()) for i in observed.braked]


def have_flowed(observed: Observed) -> bool:
    """Whether every brake had its current at first: else nothing is known of what took it off."""
    flowed = observed.part(None, FLOW_TICKS).column("current").max(axis=0)
    return all(flowed[i] > 0.8 * SHARE * observed.largest[i] for i in observed.braked)


def are_gone(observed: Observed) -> bool:
    """Whether no brake has had current for the last ticks."""
    return len(observed.rows) > GONE_TICKS and all(brakes_without(observed))


def are_there(observed: Observed) -> bool:
    """Whether the currents flow as asked."""
    measured = observed.part(-GONE_TICKS, None).column("current").mean(axis=0)
    return len(observed.rows) > GONE_TICKS and all(
        measured[i] > 0.8 * SHARE * observed.largest[i] for i in observed.braked
    )


def judge_stop(observed: Observed) -> Finding:
    """The emergency stop takes the current off every brake, although it is asked for."""
    gone = brakes_without(observed)
    if not have_flowed(observed):
        advice = "Release the stop, press start, and repeat; press it after the step has asked for it, not before."
        return Finding(False, "no current flowed before the stop was pressed", advice)
    names = [JOINTS[i] for i, none in zip(observed.braked, gone, strict=True) if not none]
    reported = observed.rows[-1].sample.fault == cause("emergency-stop")
    if not names:
        saw = "no brake has current, though 10 % are asked for; the board "
        saw += (
            "reports the stop, and takes off the currents too: measure that every amplifier has lost its supply"
            if reported
            else "does not report the stop"
        )
        return Finding(True, saw, figures={"reported": reported})
    advice = f"Put the supply of the amplifier of {', '.join(names)} behind the contacts of the emergency stop."
    if len(names) == len(gone):
        return Finding(False, "every brake keeps its current", f"{advice} If you did not press it: repeat.")
    return Finding(False, f"{', '.join(names)} still has current", advice)


def judge_supply(observed: Observed) -> Finding:
    """All brakes have current again once the stop is released."""
    if are_there(observed):
        return Finding(True, "all brakes have their 10 % again")
    return Finding(False, "the currents have not come back", "Press the supply's start button; look at its relay.")


# ------------------------------------------------------------------------------------------------------ the time


def judge_latency(observed: Observed) -> Finding:
    """Samples that were lost, and how much later than the quickest the others came."""
    ticks = observed.column("sequence")
    lost = int(ticks[-1] - ticks[0]) + 1 - len(ticks)
    late = np.array([row.came_s for row in observed.rows]) - 1e-6 * observed.column("board_us").astype(float)
    late -= late.min()
    share, most = float(np.mean(late > LATE_S)), float(late.max())
    p50, p99 = (1e3 * float(np.quantile(late, q)) for q in (0.5, 0.99))
    saw = (
        f"{len(ticks)} samples, {lost} lost; later than the quickest: half by {p50:.2f} ms, 1 % by {p99:.1f} ms, one "
        f"by {1e3 * most:.1f} ms"
    )
    figures = {"samples": len(ticks), "lost": lost, "late_share": share, "latest_s": most}
    if (round_trip := observed.about.get("round_trip_s")) is not None:
        figures["round_trip_s"] = round_trip
        saw += f"; there and back at least {1e3 * round_trip:.2f} ms"
    if lost > LOST_SHARE * len(ticks):
        return Finding(False, saw, "Use a shorter, shielded cable, away from the brakes' wires.", figures)
    if share > 0.01 or most > LATEST_S:
        advice = "Plug the board into the computer itself (no hub), close other programs; phd doctor says what else."
        return Finding(False, saw, advice, figures)
    return Finding(True, saw, figures=figures)


def moves(observed: Observed) -> bool:
    """Whether the handle has moved for half a second."""
    speeds = np.hypot(*observed.part(-500, None).column("velocity").T)
    return len(observed.rows) > 500 and float(np.mean(speeds > MOVING_M_S)) > 0.8
