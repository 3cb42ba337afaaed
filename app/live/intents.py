"""What a window asks for, done at the desk: each refusal is an InputError, and has changed nothing."""

import time
from collections.abc import Callable
from datetime import datetime

import numpy as np

from app.live import messages as m
from app.live.before_protocol import Session
from app.live.desk import Desk
from core.errors import InputError
from experiments.operator import Person, draw_person
from experiments.plan import PlannedTrial, participant_index

#: stage -> why an intent that does not fit it is refused
_REFUSALS = {
    m.PREPARING: "The bench is still being prepared.",
    m.NO_SESSION: "No session is open.",
    m.READY: "A session is open.",
    m.RUNNING: "A trial is running.",
    m.RERIG: "The device must be re-rigged first.",
    m.BREAK: "There is a break first.",
    m.QUESTIONS: "The questions after the block come first.",
    m.FINISHED: "All trials of the plan are done.",
}


def do(desk: Desk, intent: object) -> None:
    """Do it, or say why not."""
    try:
        _ACTIONS[type(intent)](desk, intent)
    except InputError as error:
        desk.say(str(error), bad=True)
    except OSError as error:
        desk.say(f"{error.filename or desk.setup.data_dir}: {error.strerror or error}", bad=True)


def _need(desk: Desk, *stages: str) -> None:
    if desk.stage not in stages:
        raise InputError(_REFUSALS.get(desk.stage) or desk.broken)


def _session(desk: Desk) -> Session:
    """The session, while nothing runs."""
    if desk.session is None or desk.stage in (m.RUNNING, m.FAILED):
        raise InputError(desk.broken or _REFUSALS[m.RUNNING if desk.session else m.NO_SESSION])
    return desk.session


def _check(desk: Desk) -> None:
    for check in desk.snapshot().checks:
        if check.state in (m.BAD, m.WAITING):
            raise InputError(f"{check.name}: {check.advice or check.text}")


def _person(desk: Desk, participant: str) -> Person | None:
    """The simulated operator that has this participant's place, if one moves the handle."""
    if desk.setup.hand != "operator":
        return None
    assert desk.protocol is not None
    seeds = np.random.SeedSequence([desk.protocol.seed, participant_index(participant)])
    return draw_person(np.random.default_rng(seeds))


def _open(desk: Desk, intent: m.Open) -> None:
    _need(desk, m.NO_SESSION)
    setup, name = desk.setup, intent.participant
    assert desk.protocol is not None
    if intent.resume:
        session = Session.resume(setup.data_dir, name, setup.sync)
    else:
        person = _person(desk, name)
        session = Session(setup.data_dir, name, desk.protocol, person, setup.sync, intent.blind or None)
    desk.session, desk.protocol = session, session.protocol
    desk.look_ahead()
    desk.rigged = desk.coming.configuration if desk.coming else ""
    desk.rested_at, desk.rest_from_s = session.settled, time.monotonic()
    desk.say(f"Participant {name}: {session.settled} of {len(session.plan)} trials are settled.")


def _start(desk: Desk, _: m.Start) -> None:
    if desk.session is None and desk.practised:
        _practise(desk, m.Practice())
        return
    _need(desk, m.READY)
    if desk.paused_s is not None:
        raise InputError("The session is paused: resume it first.")
    assert desk.coming is not None
    _run(desk, desk.coming)


def _practise(desk: Desk, _: m.Practice) -> None:
    _need(desk, m.READY, m.NO_SESSION)
    if desk.session is not None:
        _run(desk, desk.session.next_practice())
        return
    _check(desk)
    assert desk.protocol is not None
    turn, controllers, segments = desk.practised, sorted(desk.protocol.controllers), sorted(desk.protocol.paths)
    planned = PlannedTrial(
        0, 0, desk.protocol.devices[0].name,
        controllers[turn % len(controllers)], segments[turn % len(segments)], turn + 1,
    )  # fmt: skip
    desk.runner.start(planned, desk.practice_trial(planned), None)
    desk.practised += 1
    desk.say("Practice: nothing is recorded.")


def _run(desk: Desk, planned: PlannedTrial) -> None:
    _check(desk)
    assert desk.session is not None
    trial, writer = desk.session.begin(planned)
    desk.runner.start(planned, trial, writer)
    desk.say("")


def _abort(desk: Desk, intent: m.Abort) -> None:
    if desk.runner.run is not None:
        desk.runner.run.stop(intent.reason or "no reason given")


def _redo(desk: Desk, intent: m.Redo) -> None:
    row = _session(desk).redo(intent.run, intent.reason)
    desk.changed(f"The trial of run {row.run} comes again; what was recorded is kept.")


def _skip(desk: Desk, intent: m.Skip) -> None:
    row = _session(desk).skip(intent.reason)
    desk.changed(f"Run {row.run} is left out.")


def _pause(desk: Desk, intent: m.Pause) -> None:
    now = time.monotonic()
    if intent.on and desk.paused_s is None:
        desk.write("paused")
        desk.paused_s = now
    elif not intent.on and desk.paused_s is not None:
        desk.write("resumed after a pause", seconds=round(now - desk.paused_s, 1))
        desk.paused_s = desk.last_end_s = None


def _note(desk: Desk, intent: m.Note) -> None:
    if desk.session is None:
        raise InputError("There is no session yet to note this in.")
    session, text = desk.session, " ".join(intent.text.split())
    if text:
        desk.beside(lambda: session.note(text))
        desk.notes.append(f"{datetime.now():%H:%M} {text}")


def _allow(desk: Desk, _: m.AllowBrakes) -> None:
    if desk.runner.run is not None:
        raise InputError("The trial is still ending; after it the brakes can be allowed again.")
    if desk.why_off:
        desk.write("brakes allowed")
        desk.ring.allow()
        desk.why_off = ""


def _confirm(desk: Desk, _: m.Confirm) -> None:
    _need(desk, m.RERIG, m.BREAK)
    assert desk.session is not None and desk.coming is not None
    if desk.stage == m.RERIG:
        desk.write("re-rigged", configuration=desk.coming.configuration)
        desk.rigged = desk.coming.configuration
    else:
        breaks = desk.session.protocol.breaks
        left = breaks.least_s - (time.monotonic() - desk.rest_from_s)
        if left > 0.0:
            raise InputError(f"The break lasts {left:.0f} s more.")
        desk.write("break ended")
        desk.rested_at = desk.session.settled
    desk.last_end_s = None


def _unblind(desk: Desk, intent: m.Unblind) -> None:
    _session(desk).unblind(intent.who)
    desk.changed("The key is open: controllers are shown from now on.")


def _answer(desk: Desk, intent: m.Answers) -> None:
    _need(desk, m.QUESTIONS)
    assert desk.asked_block is not None
    configuration, block = desk.asked_block
    desk.write("answers", configuration=configuration, block=block, values=dict(intent.values))
    desk.asked_block = None


_ACTIONS: dict[type, Callable[[Desk, object], None]] = {
    m.Open: _open,
    m.Practice: _practise,
    m.Start: _start,
    m.Abort: _abort,
    m.Redo: _redo,
    m.Skip: _skip,
    m.Pause: _pause,
    m.Note: _note,
    m.AllowBrakes: _allow,
    m.Confirm: _confirm,
    m.Unblind: _unblind,
    m.Answers: _answer,
}  # type: ignore[dict-item]
