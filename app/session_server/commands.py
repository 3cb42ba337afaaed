"""What the window asks for, command by command: each refusal is an InputError, and has changed nothing."""

import time
from collections.abc import Callable

from app.ipc import messages as m
from app.ipc.messages import HID, MOUSE, OPERATOR
from app.session_server.practice import done_without, person_at
from app.session_server.session_progress import SessionProgress
from app.session_server.state import State
from app.session_server.steps import ended_by
from core.files import InputError
from experiments.plan import PlannedTrial
from experiments.session.files import other_protocol
from experiments.session.journal import ANSWERS, BREAK_ENDED, NOTE, PAUSED, RESUMED_AFTER_PAUSE
from experiments.session.session import Session
from experiments.trial.inputs import SENSOR
from experiments.trial.population import load_population

#: hand -> in words
HANDS = {
    MOUSE: "the simulated device and the mouse",
    HID: "the simulated device and a six-axis device",
    OPERATOR: "the simulated device and a simulated operator",
    SENSOR: "a device on the bench",
}


def do(state: State, command: object) -> None:
    """Do it, or say why not."""
    try:
        _ACTIONS[type(command)](state, command)
    except InputError as error:
        state.say(str(error), bad=True)
    except OSError as error:
        if state.session is not None and not isinstance(command, m.Leave):
            state.storage.fail(f"{error.filename or state.session.folder}", error)
        else:
            state.say(f"{error.filename or state.setup.data_dir}: {error.strerror or error}", bad=True)


def _need(state: State, *stages: str) -> None:
    if state.stage not in stages:
        raise InputError(state.broken or m.NOT_NOW[state.stage])


def _between(state: State) -> SessionProgress:
    """The open session, while nothing runs."""
    if state.progress is None or state.stage in (m.RUNNING, m.FAILED):
        raise InputError(state.broken or m.NOT_NOW[m.RUNNING if state.progress else m.NO_SESSION])
    return state.progress


def _in_order(state: State) -> SessionProgress:
    """The open session, while nothing runs and the disk has all of it."""
    progress = _between(state)
    if state.storage.undone:
        raise InputError(f"{state.storage.undone}.")
    return progress


def _need_no_hindrance(state: State) -> None:
    if why := state.broken or state.snapshot().why_not:
        raise InputError(why)


def _open(state: State, command: m.Open) -> None:
    _need(state, m.NO_SESSION)
    setup, name = state.setup, command.participant
    if command.resume:
        session = Session.resume(setup.data_dir, name, setup.sync)
    else:
        person, blind = person_at(setup, state.protocol, name), command.blind or None
        operators = load_population().operators if person else None
        hand = state.device.hand
        session = Session(setup.data_dir, name, state.protocol, person, setup.sync, blind, hand, operators)
    try:
        state.storage.take(SessionProgress(session))
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
    wrong = _wrong_hand(state)
    state.say(f"{said} {wrong}".strip(), bad=bool(other or wrong))


def _wrong_hand(state: State) -> str:
    """Why no trials of the open session can be run with this hand; "": they can. Everything else can be done."""
    session, hand = state.session, state.device.hand
    if session is None or session.hand == hand:
        return ""
    begun = HANDS.get(session.hand, f"{session.hand!r}, an unknown hand")  # session.json was edited
    return f"It was begun with {begun}, this is {HANDS[hand]}: no trials, for they would not compare."


def _leave(state: State, _: m.Leave) -> None:
    _between(state)
    state.storage.leave()
    state.look_for_participants()
    state.say("")


def _start(state: State, _: m.Start) -> None:
    if state.sandbox.on:
        state.sandbox.go()
        return
    if state.progress is None and state.practice.tried:
        _practise(state, m.Practice())
        return
    _need(state, m.READY)
    assert state.progress is not None and state.progress.coming is not None
    _run(state, state.progress.coming)


def _practise(state: State, _: m.Practice) -> None:
    _need(state, m.READY, m.NO_SESSION)
    if state.progress is not None:
        _run(state, state.progress.session.next_practice())
        return
    if state.device.real:
        state.device.ready_device(state.protocol)  # said before what it lacks: how to make it ready
    _need_no_hindrance(state)
    trial = state.try_out()
    state.runner.start(trial.planned, trial, None)
    state.say("Practice: nothing is recorded.")


def _try(state: State, command: m.Sandbox) -> None:
    if state.session is not None:
        raise InputError("A session is open: leave it before you try something out.")
    state.sandbox.want(command.settings)


def _end_try(state: State, _: m.EndSandbox) -> None:
    state.sandbox.leave()


def _run(state: State, planned: PlannedTrial) -> None:
    _need_no_hindrance(state)
    assert state.session is not None
    if wrong := _wrong_hand(state):
        raise InputError(wrong)
    trial, writer = state.device.begin(state.session, planned)
    state.runner.start(planned, trial, writer)
    state.say("")


def _abort(state: State, command: m.Abort) -> None:
    if state.runner.run is not None:
        state.runner.run.stop(command.reason or "no reason given", decided=True)


def _redo(state: State, command: m.Redo) -> None:
    row = _in_order(state).session.redo(command.run, command.reason)
    state.storage.changed(f"The trial of run {row.run} comes again; what was recorded is kept.")


def _skip(state: State, command: m.Skip) -> None:
    row = _in_order(state).session.skip(command.reason)
    state.storage.changed(f"Run {row.run} is left out." if row.block else "A practice trial is left out.")


def _pause(state: State, command: m.Pause) -> None:
    progress, now = state.progress, time.monotonic()
    if progress is None:
        raise InputError(m.NOT_NOW[m.NO_SESSION])
    if command.on and progress.paused_s is None:
        state.storage.write(PAUSED)
        progress.paused_s = now
    elif not command.on and progress.paused_s is not None:
        state.storage.write(RESUMED_AFTER_PAUSE, seconds=round(now - progress.paused_s, 1))
        progress.paused_s = progress.last_end_s = None


def _note(state: State, command: m.Note) -> None:
    progress, text = state.progress, " ".join(command.text.split())
    if progress is None:
        raise InputError("There is no session yet to note this in.")
    if text:
        state.storage.write(NOTE, text=text)
        progress.noted(text)


def _allow(state: State, _: m.AllowBrakes) -> None:
    if state.runner.run is not None:
        raise InputError("The trial is still ending; after it the brakes can be allowed again.")
    if state.why_off:
        state.device.allow(state.presses)
        state.look_at_brakes()


def _confirm(state: State, _: m.Confirm) -> None:
    _need(state, *ended_by(m.Confirm))
    progress = state.progress
    assert progress is not None and progress.coming is not None
    if state.stage == m.RERIG:
        state.device.confirm(progress, state.storage.write)
    else:
        if (left := progress.break_left_s()) > 0.0:
            raise InputError(f"The break lasts {left:.0f} s more.")
        state.storage.write(BREAK_ENDED, settled=progress.session.settled)
        progress.rested_at = progress.session.settled
    progress.last_end_s = None


def _rig(state: State, command: m.Rig) -> None:
    if not state.device.real:
        raise InputError("The device is simulated: there is nothing to make ready.")
    progress = _between(state)  # whose journal keeps what was done
    if progress.coming is None:
        raise InputError(m.NOT_NOW[m.FINISHED])
    state.device.do(progress, command.step)


def _unblind(state: State, command: m.Unblind) -> None:
    _in_order(state).session.unblind(command.who)
    state.storage.changed("The key is open: controllers are shown from now on.")


def _answer(state: State, command: m.Answers) -> None:
    _need(state, *ended_by(m.Answers))
    assert state.progress is not None and state.progress.asked_block is not None
    configuration, block = state.progress.asked_block
    state.storage.write(ANSWERS, configuration=configuration, block=block, values=dict(command.values))
    state.progress.answered()
    state.progress.last_end_s = None


_ACTIONS: dict[type, Callable[[State, object], None]] = {
    m.Open: _open,
    m.Leave: _leave,
    m.Practice: _practise,
    m.Sandbox: _try,
    m.EndSandbox: _end_try,
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
