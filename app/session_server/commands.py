"""What a window asks for, done at the desk: each refusal is an InputError, and has changed nothing."""

import time
from collections.abc import Callable

from app.ipc import messages as m
from app.ipc.messages import HID, MOUSE, OPERATOR
from app.session_server.device_setup import Rigging
from app.session_server.practice import done_without, person_at
from app.session_server.session_progress import ANSWERS, BREAK_ENDED, NOTE, Sitting
from app.session_server.state import Desk
from core.errors import InputError
from experiments.plan import PlannedTrial
from experiments.session.files import other_protocol
from experiments.session.session import SENSOR, Session
from experiments.trial.population import load_population

#: hand -> in words
HANDS = {
    MOUSE: "the simulated device and the mouse",
    HID: "the simulated device and a six-axis device",
    OPERATOR: "the simulated device and a simulated operator",
    SENSOR: "a device on the bench",
}

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
        if desk.session is not None and not isinstance(intent, m.Leave):
            desk.keeping.fail(f"{error.filename or desk.session.folder}", error)
        else:
            desk.say(f"{error.filename or desk.setup.data_dir}: {error.strerror or error}", bad=True)


def _need(desk: Desk, *stages: str) -> None:
    if desk.stage not in stages:
        raise InputError(_REFUSALS.get(desk.stage) or desk.broken)


def _between(desk: Desk) -> Sitting:
    """The open session, while nothing runs."""
    if desk.sitting is None or desk.stage in (m.RUNNING, m.FAILED):
        raise InputError(desk.broken or _REFUSALS[m.RUNNING if desk.sitting else m.NO_SESSION])
    return desk.sitting


def _in_order(desk: Desk) -> Sitting:
    """The open session, while nothing runs and the disk has all of it."""
    sitting = _between(desk)
    if desk.keeping.undone:
        raise InputError(f"{desk.keeping.undone}.")
    return sitting


def _check(desk: Desk) -> None:
    for check in desk.snapshot().checks:
        if check.state in (m.BAD, m.WAITING):
            raise InputError(f"{check.name}: {check.advice or check.text}")


def _open(desk: Desk, intent: m.Open) -> None:
    _need(desk, m.NO_SESSION)
    setup, name = desk.setup, intent.participant
    if intent.resume:
        session = Session.resume(setup.data_dir, name, setup.sync)
    else:
        person, blind = person_at(setup, desk.protocol, name), intent.blind or None
        operators = load_population().operators if person else None
        hand = desk.device.hand
        session = Session(setup.data_dir, name, desk.protocol, person, setup.sync, blind, hand, operators)
    try:
        desk.keeping.take(Sitting(session))
    except BaseException:
        session.close()
        raise
    left, whole = len(session.plan) - session.settled, len(session.plan)
    which = "all" if left in (0, whole) else f"{left} of"
    come = f"{which} {whole} trials are {'to come' if left else 'over'}"
    said = f"Participant {name}: {come}."
    if without := done_without(setup, session.protocol):
        said += f" {without}"
    other = other_protocol(setup.data_dir, name, session.protocol)
    if other:
        said += f" Their protocol is not the one of participant {other}: file, devices or options have changed since."
    wrong = _wrong_hand(desk)
    desk.say(f"{said} {wrong}".strip(), bad=bool(other or wrong))


def _wrong_hand(desk: Desk) -> str:
    """Why no trials of the open session can be run on this bench; "": they can. Everything else can be done."""
    session, hand = desk.session, desk.device.hand
    if session is None or session.hand == hand:
        return ""
    begun = HANDS.get(session.hand, f"{session.hand!r}, which nobody knows here")  # a file that somebody has edited
    return f"It was begun with {begun}, this is {HANDS[hand]}: no trials, for they would not compare."


def _leave(desk: Desk, _: m.Leave) -> None:
    _between(desk)
    desk.keeping.leave()
    desk.look_for_participants()
    desk.say("")


def _start(desk: Desk, _: m.Start) -> None:
    if desk.sitting is None and desk.practice.tried:
        _practise(desk, m.Practice())
        return
    _need(desk, m.READY)
    assert desk.sitting is not None and desk.sitting.coming is not None
    if desk.sitting.paused_s is not None:
        raise InputError("The session is paused: resume it first.")
    _run(desk, desk.sitting.coming)


def _practise(desk: Desk, _: m.Practice) -> None:
    _need(desk, m.READY, m.NO_SESSION)
    if desk.sitting is not None:
        _run(desk, desk.sitting.session.next_practice())
        return
    if desk.device.real:
        desk.device.ready_device(desk.protocol)  # said before what it lacks: how to make it ready
    _check(desk)
    trial = desk.try_out()
    desk.runner.start(trial.planned, trial, None)
    desk.say("Practice: nothing is recorded.")


def _run(desk: Desk, planned: PlannedTrial) -> None:
    _check(desk)
    assert desk.session is not None
    if wrong := _wrong_hand(desk):
        raise InputError(wrong)
    trial, writer = desk.device.begin(desk.session, planned)
    desk.runner.start(planned, trial, writer)
    desk.say("")


def _abort(desk: Desk, intent: m.Abort) -> None:
    if desk.runner.run is not None:
        desk.runner.run.stop(intent.reason or "no reason given", decided=True)


def _redo(desk: Desk, intent: m.Redo) -> None:
    row = _in_order(desk).session.redo(intent.run, intent.reason)
    desk.keeping.changed(f"The trial of run {row.run} comes again; what was recorded is kept.")


def _skip(desk: Desk, intent: m.Skip) -> None:
    row = _in_order(desk).session.skip(intent.reason)
    desk.keeping.changed(f"Run {row.run} is left out." if row.block else "A practice trial is left out.")


def _pause(desk: Desk, intent: m.Pause) -> None:
    sitting, now = desk.sitting, time.monotonic()
    if sitting is None:
        raise InputError(_REFUSALS[m.NO_SESSION])
    if intent.on and sitting.paused_s is None:
        desk.keeping.write("paused")
        sitting.paused_s = now
    elif not intent.on and sitting.paused_s is not None:
        desk.keeping.write("resumed after a pause", seconds=round(now - sitting.paused_s, 1))
        sitting.paused_s = sitting.last_end_s = None


def _note(desk: Desk, intent: m.Note) -> None:
    sitting, text = desk.sitting, " ".join(intent.text.split())
    if sitting is None:
        raise InputError("There is no session yet to note this in.")
    if text:
        desk.keeping.write(NOTE, text=text)
        sitting.noted(text)


def _allow(desk: Desk, _: m.AllowBrakes) -> None:
    if desk.runner.run is not None:
        raise InputError("The trial is still ending; after it the brakes can be allowed again.")
    if desk.why_off:
        desk.device.allow(desk.presses)
        desk.look_at_brakes()


def _confirm(desk: Desk, _: m.Confirm) -> None:
    _need(desk, m.RERIG, m.BREAK)
    sitting = desk.sitting
    assert sitting is not None and sitting.coming is not None
    if desk.stage == m.RERIG:
        desk.device.confirm(sitting, desk.keeping.write)
    else:
        if (left := sitting.break_left_s()) > 0.0:
            raise InputError(f"The break lasts {left:.0f} s more.")
        desk.keeping.write(BREAK_ENDED, settled=sitting.session.settled)
        sitting.rested_at = sitting.session.settled
    sitting.last_end_s = None


def _rig(desk: Desk, intent: m.Rig) -> None:
    if not isinstance(desk.device, Rigging):
        raise InputError("The device is simulated: there is nothing to make ready.")
    sitting = _between(desk)  # whose journal keeps what was done
    if sitting.coming is None:
        raise InputError(_REFUSALS[m.FINISHED])
    desk.device.do(sitting, intent.step)


def _unblind(desk: Desk, intent: m.Unblind) -> None:
    _in_order(desk).session.unblind(intent.who)
    desk.keeping.changed("The key is open: controllers are shown from now on.")


def _answer(desk: Desk, intent: m.Answers) -> None:
    _need(desk, m.QUESTIONS)
    assert desk.sitting is not None and desk.sitting.asked_block is not None
    configuration, block = desk.sitting.asked_block
    desk.keeping.write(ANSWERS, configuration=configuration, block=block, values=dict(intent.values))
    desk.sitting.answered()
    desk.sitting.last_end_s = None


_ACTIONS: dict[type, Callable[[Desk, object], None]] = {
    m.Open: _open,
    m.Leave: _leave,
    m.Practice: _practise,
    m.Start: _start,
    m.Abort: _abort,
    m.Redo: _redo,
    m.Skip: _skip,
    m.Pause: _pause,
    m.Note: _note,
    m.AllowBrakes: _allow,
    m.Confirm: _confirm,
    m.Rig: _rig,
    m.Unblind: _unblind,
    m.Answers: _answer,
}  # type: ignore[dict-item]
