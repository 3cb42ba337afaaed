"""The steps of a session between two trials: when each is due, what is to be done then, and which command ends it.

Declared once: the stage and the card of a snapshot, the commands and the printed plan read this table.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from app.ipc import messages as m
from app.ipc.messages import Card
from core.files import InputError
from experiments.plan import PlannedTrial, break_after
from experiments.protocol import Protocol
from experiments.session.journal import ANSWERS, BREAK_ENDED, CONTROLLER_ANSWERS

if TYPE_CHECKING:
    from app.session_server.session_progress import SessionProgress

Write = Callable[..., None]  # an event and its fields, into the journal


class Step(NamedTuple):
    """One kind of step."""

    name: str  # the stage of the session while it is due
    due: "Callable[[SessionProgress], Card | None]"  # what is to be done; None: it is not due
    ended_by: type  # the command that ends it
    end: "Callable[[SessionProgress, Write, Any], None]"  # what that command does; InputError: it is not over yet
    planned: Callable[[Protocol, PlannedTrial, PlannedTrial, int, int], str]
    """Its line in the printed plan, "" where it is not due, between a trial and the next one of the plan; of the first
    one's configuration so many trials are then done and left.
    """


def _questions(progress: "SessionProgress") -> Card | None:
    if progress.asked is None:
        return None
    return Card("Questions", "The participant answers them on the other screen.", "")


def _answer(progress: "SessionProgress", write: Write, command: m.Answers) -> None:
    assert progress.asked is not None
    configuration, block, controller = progress.asked
    values = dict(command.values)
    if controller:
        write(CONTROLLER_ANSWERS, configuration=configuration, controller=controller, values=values)
    else:
        write(ANSWERS, configuration=configuration, block=block, values=values)


def _break(progress: "SessionProgress") -> Card | None:
    if not progress.break_due:
        return None
    return Card("Break", "A break: let go of the handle and rest.", wait_s=float(math.ceil(progress.break_left_s())))


def _end_break(progress: "SessionProgress", write: Write, _: m.Confirm) -> None:
    if (left := progress.break_left_s()) > 0.0:
        raise InputError(f"The break lasts {left:.0f} s more.")
    write(BREAK_ENDED, settled=progress.session.settled)


def _break_line(protocol: Protocol, before: PlannedTrial, after: PlannedTrial, done: int, left: int) -> str:
    if protocol.breaks is None or not break_after(protocol, done, left):
        return ""
    return f"-- break of at least {protocol.breaks.least_s:g} s --"


#: in the order in which they come
STEPS = (
    Step(
        m.QUESTIONS,
        due=_questions,
        ended_by=m.Answers,
        end=_answer,
        planned=lambda protocol, before, after, done, left: "",  # the plan's head says "after each block"
    ),
    Step(
        m.RERIG,
        due=lambda progress: progress.device.card(progress),
        ended_by=m.Confirm,
        end=lambda progress, write, _: progress.device.confirm(progress, write),
        planned=lambda protocol, before, after, done, left: (
            f"re-rig to {after.configuration}" if after.configuration != before.configuration else ""
        ),
    ),
    Step(m.BREAK, due=_break, ended_by=m.Confirm, end=_end_break, planned=_break_line),
)


def ended_by(command: type) -> tuple[str, ...]:
    """The stages that a command ends."""
    return tuple(step.name for step in STEPS if step.ended_by is command)


def planned_steps(protocol: Protocol, before: PlannedTrial, after: PlannedTrial, done: int, left: int) -> list[str]:
    """The lines of the printed plan between two trials."""
    lines = (step.planned(protocol, before, after, done, left) for step in STEPS)
    return [line for line in lines if line]
