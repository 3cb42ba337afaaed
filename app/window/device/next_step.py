"""What comes next on the Device page: one sentence on what there is to do, and the button that does it."""

from collections.abc import Mapping
from typing import NamedTuple

from app.ipc import messages as m
from app.window.device.figures import BRAKES, ENCODERS, FORCE, READY_BOARD, is_reached
from experiments.protocol import home_of

ALLOW = "allow"  # in place of a step: currents may flow again


class Step(NamedTuple):
    """A step that makes the device ready, in words."""

    again: str  # the button of its row
    title: str  # the button that does it
    needs: str  # what a person does first; {}: where the jig is


#: step -> its words
STEPS = {
    m.CONNECT: Step("Reconnect …", "Reconnect the board", "The connection is closed and made again."),
    m.HOME: Step(
        "Start homing …", "Start homing the encoders", "Hold the handle in its jig at {}, then press the button."
    ),
    m.ZERO: Step(
        "Start zeroing …",
        "Start zeroing the force sensor",
        "Take your hand off the handle, then press the button. It takes one second.",
    ),
}
#: row -> the step that makes it ready
STEP_OF = {READY_BOARD: m.CONNECT, ENCODERS: m.HOME, FORCE: m.ZERO}


class NextStep(NamedTuple):
    """What the page says first."""

    title: str
    text: str
    step: str = m.DONE  # that the button asks for; DONE: there is no button
    button: str = ""


def next_step(
    found: Mapping[str, m.Check], opened: m.Opened, snapshot: m.Snapshot, status: m.DeviceStatus | None
) -> NextStep:
    """What there is to do next, after why a step was refused. found: what is ready, by row."""
    if snapshot.step != m.DONE:
        return NextStep(m.WAITS[snapshot.step], "One moment: do not touch the handle.")
    step = _next(found, opened, snapshot, status)
    return step._replace(text=f"{snapshot.notice} {step.text}") if snapshot.notice_bad else step


def _next(
    found: Mapping[str, m.Check], opened: m.Opened, snapshot: m.Snapshot, status: m.DeviceStatus | None
) -> NextStep:
    if why := why_no_step(opened, snapshot):
        return NextStep("Nothing to do here now", why)
    due = next((name for name, check in found.items() if check.state not in (m.GOOD, m.CAUTION)), "")
    if not due:
        go = "Start the session on Home, or try the device." if not opened.participant else "The Run page goes on."
        doubt = next((name for name, check in found.items() if check.state == m.CAUTION), "")
        return NextStep(f"Ready, but see {doubt}" if doubt else "Ready", go)
    if due == READY_BOARD:  # it is looked for all the time
        return NextStep(f"{due}: {found[due].text.lower()}", found[due].advice)
    text = found[due].text
    if due == BRAKES and snapshot.can_allow:
        return NextStep("Next: turn the brakes on", text, ALLOW, "Turn brakes on")
    if due not in STEP_OF or STEP_OF[due] not in possible(opened, snapshot, status):
        return NextStep(f"{due}: not ready yet", text)
    step = STEP_OF[due]
    title = STEPS[step].title
    return NextStep(f"Next: {title[0].lower()}{title[1:]}", needs_of(step, opened, snapshot, status), step, title)


def possible(opened: m.Opened, snapshot: m.Snapshot, status: m.DeviceStatus | None) -> set[str]:
    """The steps that can be taken now."""
    if why_no_step(opened, snapshot) or snapshot.step != m.DONE:
        return set()  # one at a time
    if status is None or not is_reached(status) or status.fault:
        return {m.CONNECT}
    return {m.CONNECT, m.HOME, *([m.ZERO] if status.force_channels else [])}


def why_no_step(opened: m.Opened, snapshot: m.Snapshot) -> str:
    """Why no step can be taken now, one sentence; "": one can."""
    if opened.participant and snapshot.coming is None:
        return "All trials of the plan are done."
    between = snapshot.stage in (m.READY, m.NO_SESSION) or snapshot.card is not None
    return "" if between else "The device is made ready between two trials."


def needs_of(step: str, opened: m.Opened, snapshot: m.Snapshot, status: m.DeviceStatus | None) -> str:
    """What a person does before a step."""
    x, y = jig_of(opened, snapshot, status)
    return STEPS[step].needs.format(f"x = {1e3 * x:.0f} mm, y = {1e3 * y:.0f} mm")


def jig_of(opened: m.Opened, snapshot: m.Snapshot, status: m.DeviceStatus | None) -> m.Point:
    """Where the jig holds the handle, m: for the coming trial; before a session, of the connected device."""
    devices = opened.protocol.devices
    wanted = snapshot.coming.configuration if snapshot.coming is not None else status.device if status else ""
    return home_of(next((device for device in devices if device.name == wanted), devices[0]), opened.protocol.paths)
