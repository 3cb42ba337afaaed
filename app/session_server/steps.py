"""The steps of a session between two trials: when each is due, what is to be done then, and which command ends it.

Declared once: the stage of a snapshot, the window's card and the printed plan read this table.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from app.ipc import messages as m
from experiments.plan import PlannedTrial, break_after
from experiments.protocol import Protocol

if TYPE_CHECKING:
    from app.session_server.session_progress import SessionProgress


class Step(NamedTuple):
    """One kind of step."""

    name: str  # the stage of the session while it is due
    due: "Callable[[SessionProgress], bool]"
    sentence: "Callable[[SessionProgress], str]"  # what is to be done; "": the step's page says it
    done_by: type  # the command that ends it
    planned: Callable[[Protocol, PlannedTrial, PlannedTrial, int, int], str]
    """Its line in the printed plan, "" where it is not due, between a trial and the next one of the plan; of the first
    one's configuration so many trials are then done and left.
    """


def _rerig(progress: "SessionProgress") -> str:
    assert progress.coming is not None
    device = progress.session.protocol.device(progress.coming.configuration)
    joints = " ".join(device.braked)
    return f"Next: {device.name} (brakes at {joints}). The device is simulated: there is nothing to change by hand."


def _break_line(protocol: Protocol, before: PlannedTrial, after: PlannedTrial, done: int, left: int) -> str:
    if protocol.breaks is None or not break_after(protocol, done, left):
        return ""
    return f"-- break of at least {protocol.breaks.least_s:g} s --"


#: in the order in which they come
STEPS = (
    Step(
        m.QUESTIONS,
        due=lambda progress: progress.asked_block is not None,
        sentence=lambda progress: "",
        done_by=m.Answers,
        planned=lambda protocol, before, after, done, left: "",  # the plan's head says "after each block"
    ),
    Step(
        m.RERIG,
        due=lambda progress: progress.coming is not None and progress.coming.configuration != progress.rigged,
        sentence=_rerig,
        done_by=m.Confirm,
        planned=lambda protocol, before, after, done, left: (
            f"re-rig to {after.configuration}" if after.configuration != before.configuration else ""
        ),
    ),
    Step(
        m.BREAK,
        due=lambda progress: progress.break_due,
        sentence=lambda progress: "A break: let go of the handle and rest.",
        done_by=m.Confirm,
        planned=_break_line,
    ),
)

BY_NAME = {step.name: step for step in STEPS}


def due_step(progress: "SessionProgress") -> Step | None:
    """The first step that is due; None: the next trial may start, or none is left."""
    return next((step for step in STEPS if step.due(progress)), None)


def ended_by(command: type) -> list[str]:
    """The stages that a command ends."""
    return [step.name for step in STEPS if step.done_by is command]


def planned_steps(protocol: Protocol, before: PlannedTrial, after: PlannedTrial, done: int, left: int) -> list[str]:
    """The lines of the printed plan between two trials."""
    lines = (step.planned(protocol, before, after, done, left) for step in STEPS)
    return [line for line in lines if line]
