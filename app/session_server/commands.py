"""The commands of the window: one table, a line for each command."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

from app.ipc import messages as m
from app.session_server.device_setup import RealSetup, person_at
from app.session_server.preflight import ignored_features
from app.session_server.session_progress import SessionProgress
from app.session_server.state import ServerState
from app.session_server.steps import STEPS, due_step, ended_by
from core.files import InputError
from experiments.inputs import INPUTS
from experiments.plan import PlannedTrial, counted, refuse_no_label
from experiments.store.consent import ConsentAnswer
from experiments.store.files import refuse_study
from experiments.store.journal import NOTE, PAUSED, RESUMED_AFTER_PAUSE
from experiments.store.session import Participant, Session
from experiments.store.stored import other_protocol
from experiments.trial.population import load_population


def do(state: ServerState, command: object) -> None:
    """Do a command, or show the experimenter why not; a refused command changes nothing."""
    rule = COMMANDS[type(command)]
    try:
        if why := refusal(state, rule):
            raise InputError(why)
        state.clear_refusal()
        if rule.waits:
            state.announce_wait(rule.waits)
        rule.action(state, command)
    except InputError as error:
        state.notify(str(error), bad=True)
    except OSError as error:
        if (progress := state.storage.progress) is not None and not isinstance(command, m.Leave):
            state.storage.fail(f"{error.filename or progress.session.folder}", error)
        else:
            state.notify(f"{error.filename or state.setup.data_dir}: {error.strerror or error}", bad=True)


def refusal(state: ServerState, rule: "CommandRule") -> str:
    """Why the table does not allow a command now; "": it does."""
    if rule.session and state.storage.progress is None:
        return state.broken or m.NOT_NOW[m.NO_SESSION]
    if rule.stages and state.stage not in rule.stages:
        return state.broken or state.snapshot().stage_refusal
    if rule.stored:
        state.storage.check_folder()
    return f"{state.storage.not_written}." if rule.stored and state.storage.not_written else ""


def _open(state: ServerState, command: m.Open) -> None:
    setup, name, hand = state.setup, command.participant, state.device.hand
    on_event = state.lsl.mark if state.lsl else None
    if command.resume:
        session = Session.resume(setup.data_dir, name, setup.sync, on_event)
    else:
        refuse_no_label(name)
        refuse_study(setup.data_dir)
        operator = person_at(setup, state.protocol, name)
        blind = (command.blind or None) if operator is None else False
        population = load_population().operators if operator else None
        consent = ConsentAnswer(*command.consent) if command.consent else None
        who = Participant(name, hand, operator, population, command.form, consent)
        session = Session(setup.data_dir, who, state.protocol, blind, setup.sync, on_event)
        if consent and not consent.agreed:
            session.close()
            state.notify(f"Participant {name} does not take part. Nothing but this answer is recorded.")
            return
    try:
        state.storage.set_session(SessionProgress(session))
    except BaseException:
        session.close()
        raise
    if isinstance(state.device, RealSetup):
        state.device.write_ready(state.storage.write)
    left, whole = len(session.plan) - session.finished_count, len(session.plan)
    if not left:
        notice = [f"Participant {name}: all {counted(whole, 'trial')} are done."]
    elif left == whole:
        notice = [f"Participant {name}: {counted(whole, 'trial')} to run."]
    else:
        notice = [f"Participant {name}: {left} of {counted(whole, 'trial')} left."]
    if command.resume:
        notice.append(f"The session goes on by its own protocol, {session.protocol.name}.")
    notice.append(session.repaired.sentence())
    notice.append(ignored_features(setup, session.protocol))
    if other := other_protocol(setup.data_dir, name, session.protocol):
        notice.append(f"The protocol differs from that of participant {other} in file, devices or options.")
    notice.append(wrong := _wrong_hand(state, session))
    state.notify(" ".join(filter(None, notice)), bad=bool(wrong))


def _wrong_hand(state: ServerState, session: Session) -> str:
    """Why this hand cannot run the session's trials; "": it can. Every other command works."""
    if session.hand == state.device.hand:
        return ""
    begun = INPUTS.get(session.hand)  # None: the database was edited
    begun_with = begun.begun_with if begun else f"{session.hand!r}, an unknown hand"
    now = INPUTS[state.device.hand].begun_with
    return (
        f"This session was begun with {begun_with}, and now there is {now}. No trials can be run, because they could "
        "not be compared with the earlier ones."
    )


def _leave(state: ServerState, _: m.Leave) -> None:
    state.storage.leave()
    state.notify("")


def _start(state: ServerState, _: m.Start) -> None:
    if state.sandbox.on:
        state.sandbox.start_pass(state.broken or state.snapshot().trial_blocker)
    elif state.storage.progress is None:
        raise InputError(m.NOT_NOW[m.NO_SESSION])
    elif (coming := state.storage.open.coming) is None:
        raise InputError(m.NOT_NOW[m.FINISHED])
    else:
        _run(state, state.storage.open.session, coming)


def _set_sandbox(state: ServerState, command: m.SetSandbox) -> None:
    if state.storage.progress is not None:
        raise InputError("A session is open. Leave it before you use Try.")
    state.sandbox.apply(command.settings)


def _run(state: ServerState, session: Session, planned: PlannedTrial) -> None:
    if why := state.broken or state.snapshot().trial_blocker or _wrong_hand(state, session):
        raise InputError(why)
    trial, writer = state.device.begin(session, planned)
    state.runner.start(trial, writer, state.lsl.begin(planned.run) if state.lsl else None)
    state.notify("")


def _abort(state: ServerState, command: m.Abort) -> None:
    if state.runner.run is not None:
        state.runner.run.stop(command.reason or "no reason given", decided=True)
        state.runner.run.again = command.again


def _redo(state: ServerState, command: m.Redo) -> None:
    row = state.storage.open.session.redo(command.run, command.reason)
    state.storage.update_next(f"{state.storage.open.name_of(row)} is repeated next; its recording is kept.")


def _exclude(state: ServerState, command: m.Exclude) -> None:
    row = state.storage.open.session.exclude(command.run, command.reason)
    name = state.storage.open.name_of(row)
    state.storage.update_next(f"{name} is excluded from the results; its recording is kept.")


def _skip(state: ServerState, command: m.Skip) -> None:
    row = state.storage.open.session.skip(command.reason)
    state.storage.update_next(f"{state.storage.open.name_of(row)} is skipped.")


def _pause(state: ServerState, command: m.Pause) -> None:
    since_s = state.storage.open.paused_s
    if command.on and since_s is None:
        state.storage.write(PAUSED)
    elif not command.on and since_s is not None:
        state.storage.write(RESUMED_AFTER_PAUSE, seconds=round(time.perf_counter() - since_s, 1))


def _note(state: ServerState, command: m.Note) -> None:
    if text := " ".join(command.text.split()):
        state.storage.write(NOTE, text=text)


def _allow(state: ServerState, _: m.AllowBrakes) -> None:
    if state.runner.run is not None:
        raise InputError("The trial is still ending. Turn the brakes on after it.")
    if state.why_off:
        state.device.allow(state.presses)
        state.journal_brakes()


def _end_step(state: ServerState, command: m.Confirm | m.Answers) -> None:
    progress = state.storage.open
    if (due := due_step(progress, state.device)) is not None:
        due[0].end(progress, state.device, state.storage.write, command)
        progress.last_end_s = None


def _prepare_device(state: ServerState, command: m.PrepareDevice) -> None:
    if not isinstance(state.device, RealSetup):
        raise InputError("The device is simulated: there is nothing to make ready.")
    if (progress := state.storage.progress) is not None and progress.coming is None:
        raise InputError(m.NOT_NOW[m.FINISHED])
    state.device.do(progress, command.step, command.sure)


def _unblind(state: ServerState, command: m.Unblind) -> None:
    state.storage.open.session.unblind(command.who)
    state.storage.update_next("The key is open: controllers are shown from now on.")


class CommandRule(NamedTuple):
    """When a command can be done, and what does it."""

    action: Callable[[ServerState, Any], None]  # InputError: it cannot be done
    stages: tuple[str, ...] = ()  # at which it can be done; none: at any
    session: bool = True  # a session must be open
    stored: bool = False  # everything must be on the disk
    waits: str = ""  # what the experimenter reads while a slow disk keeps the command waiting


#: Stages of an open session in which no trial runs.
IDLE = (m.PREPARING, m.READY, *(step.name for step in STEPS), m.FINISHED)

COMMANDS = {
    m.Open: CommandRule(_open, (m.NO_SESSION,), session=False, waits="the session is opened"),
    m.Leave: CommandRule(_leave, IDLE, waits="the session is closed"),
    m.SetSandbox: CommandRule(_set_sandbox, session=False),
    m.BringBack: CommandRule(lambda state, _: state.sandbox.bring_back(), session=False),
    m.EndSandbox: CommandRule(lambda state, _: state.sandbox.leave(), session=False),
    m.Start: CommandRule(_start, (m.READY, m.NO_SESSION), session=False, stored=True, waits="the trial is opened"),
    m.Abort: CommandRule(_abort, session=False),
    m.Redo: CommandRule(_redo, IDLE, stored=True, waits="the journal is written"),
    m.Exclude: CommandRule(_exclude, IDLE, stored=True, waits="the journal is written"),
    m.Skip: CommandRule(_skip, IDLE, stored=True, waits="the journal is written"),
    m.Pause: CommandRule(_pause, waits="the journal is written"),
    m.Note: CommandRule(_note, waits="the journal is written"),
    m.AllowBrakes: CommandRule(_allow, session=False),
    m.Confirm: CommandRule(_end_step, ended_by(m.Confirm), waits="the journal is written"),
    m.Answers: CommandRule(_end_step, ended_by(m.Answers), waits="the answers are written"),
    m.PrepareDevice: CommandRule(_prepare_device, (m.NO_SESSION, *IDLE), session=False),
    m.Unblind: CommandRule(_unblind, IDLE, stored=True, waits="the journal is written"),
}
