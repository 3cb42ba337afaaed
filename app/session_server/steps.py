"""The steps of a session between two trials: when each is due, what is to be done then, and which command ends it.

Declared once: the stage and the card of a snapshot and the commands read this table. What the printed plan has
between two trials stands in `experiments.plan.steps_between`.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from app.ipc import messages as m
from app.ipc.messages import StepCard
from app.session_server.device_setup import RealSetup, SimulatedSetup, Write
from app.session_server.session_progress import SessionProgress
from core.files import InputError
from experiments.store.journal import ANSWERS, BREAK_ENDED, CONTROLLER_ANSWERS

DeviceSetup = SimulatedSetup | RealSetup


class SessionStep(NamedTuple):
    """One kind of step between two trials."""

    name: str  # the stage of the session while it is due
    due: Callable[[SessionProgress, DeviceSetup], StepCard | None]  # its card; None: it is not due
    ended_by: type  # the command that ends it
    #: does that command; InputError: the step is not over yet
    end: Callable[[SessionProgress, DeviceSetup, Write, Any], None]


def _questions(progress: SessionProgress, _: DeviceSetup) -> StepCard | None:
    if progress.questions_due is None:
        return None
    return StepCard("Questions", "The participant answers them on the other screen.", "")


def _answer(progress: SessionProgress, _: DeviceSetup, write: Write, command: m.Answers) -> None:
    assert progress.questions_due is not None
    configuration, block, controller = progress.questions_due
    values = dict(command.values)
    if controller:
        write(CONTROLLER_ANSWERS, configuration=configuration, controller=controller, values=values)
    else:
        write(ANSWERS, configuration=configuration, block=block, values=values)


def _break(progress: SessionProgress, _: DeviceSetup) -> StepCard | None:
    if not progress.break_due:
        return None
    return StepCard(
        "Break", "A break: let go of the handle and rest.", wait_s=float(math.ceil(progress.break_left_s()))
    )


def _end_break(progress: SessionProgress, _: DeviceSetup, write: Write, _command: m.Confirm) -> None:
    if (left := progress.break_left_s()) > 0.0:
        raise InputError(f"The break lasts {left:.0f} s more.")
    write(BREAK_ENDED, settled=progress.session.finished_count)


#: in the order in which they come
STEPS = (
    SessionStep(m.QUESTIONS, due=_questions, ended_by=m.Answers, end=_answer),
    SessionStep(
        m.RERIG,
        due=lambda progress, device: device.card(progress),
        ended_by=m.Confirm,
        end=lambda progress, device, write, _: device.confirm(progress, write),
    ),
    SessionStep(m.BREAK, due=_break, ended_by=m.Confirm, end=_end_break),
)


def due_step(progress: SessionProgress, device: DeviceSetup) -> tuple[SessionStep, StepCard] | None:
    """The first due step and its card; None: the next trial may start, or none is left."""
    return next(((step, card) for step in STEPS if (card := step.due(progress, device)) is not None), None)


def stage_of(progress: SessionProgress, device: DeviceSetup) -> str:
    """The stage of an open session between two trials."""
    if (due := due_step(progress, device)) is not None:
        return due[0].name
    return m.READY if progress.coming is not None else m.FINISHED


def ended_by(command: type) -> tuple[str, ...]:
    """The stages that a command ends."""
    return tuple(step.name for step in STEPS if step.ended_by is command)
