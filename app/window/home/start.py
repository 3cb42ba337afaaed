"""The session that Home would start, and what keeps it from starting."""

import contextlib
import tomllib
from pathlib import Path
from typing import NamedTuple

from app.ipc import messages as m
from app.window.widgets.words import LEAVE, as_sentence
from core.files import InputError
from experiments.plan import counted, make_plan, plan_summary, print_trials, refuse_no_label
from experiments.protocol import Protocol, load_protocol
from experiments.store.files import free_participant
from experiments.store.overview import SessionOverview
from experiments.store.stored import read_stored


class Loaded(NamedTuple):
    """A protocol that can be run, and what Home says of it."""

    protocol: Protocol
    sentence: str  # of its [about]; "": it says none
    summary: str
    trials: int  # of a participant
    participant: str  # that was asked for, else the first without a session; "": none is left


def load(setup: m.Setup) -> Loaded:
    """The protocol of a setup. InputError if it cannot be run."""
    protocol = load_protocol(
        setup.protocol, devices=setup.devices, rules=setup.rules, low_gain=setup.low_gain, seed=setup.seed
    )
    protocol.refuse_unknown_low_gain()
    participant = setup.participant or proposed(setup.data_dir, protocol)
    sentence = tomllib.loads(protocol.text).get("about", {}).get("sentence", "")
    return Loaded(protocol, sentence, plan_summary(protocol), len(make_plan(protocol, "1")), participant)


def title_of(path: str) -> str:
    """What a protocol file calls itself; one that cannot be read, the name of the file."""
    with contextlib.suppress(OSError, ValueError):
        if name := str(tomllib.loads(Path(path).read_text(encoding="utf-8")).get("name", "")):
            return f"{name[0].upper()}{name[1:]}"
    return Path(path).name


def proposed(data_dir: Path, protocol: Protocol) -> str:
    """The first participant without a session; "": none is left."""
    with contextlib.suppress(InputError):
        return free_participant(data_dir, protocol.participants)
    return ""


def planned_trials(protocol: Protocol, participant: str, blind: bool, found: SessionOverview | None) -> str:
    """The plan of a participant's session, by its own protocol where it is there; in codes if it is blind."""
    if found is not None:
        if found.declined:
            return ""
        stored = read_stored(found.folder)
        protocol, blind = stored.protocol, stored.about["blind"]
    return print_trials(protocol, participant, blind)


class Wanted(NamedTuple):
    """The session that is asked for."""

    participant: str  # as typed
    found: SessionOverview | None  # the participant's session in the data folder
    loaded: Loaded | InputError | None  # the chosen protocol, or why it cannot be run; None: being read
    operators: int  # simulated operators whose study the data folder holds
    form_problems: list[str]  # what is still to be done in the form, a sentence each
    consent_due: bool = False  # the participant is asked first whether they take part ..
    agreed: bool = False  # .. and has said so
    no_board: str = ""  # why the board that was chosen is not there, a sentence; "": it is, or none was chosen


def start_blockers(wanted: Wanted, is_open: str, snapshot: m.Snapshot, real_device: bool) -> list[str]:
    """Why the session cannot start or go on, a sentence each; []: it can.

    is_open: the participant whose session is open. snapshot: with the checks of the chosen setup.
    """
    found: list[str] = []
    label = wanted.participant
    if is_open:
        pass  # nothing is asked of another one
    elif wanted.found is not None:
        declined = f"Participant {label} does not take part. Name another participant."
        found = [declined if wanted.found.declined else wanted.found.problem]
    elif wanted.loaded is None:
        found = ["Loading …"]
    else:
        found = label_blockers(label) or new_session_blockers(wanted)
    return list(filter(None, [*found, session_blocker(is_open, wanted.no_board, snapshot, real_device)]))


def label_blockers(label: str) -> list[str]:
    """Why this is no participant's label; []: it is one."""
    if not label:
        return ["Name the participant."]
    try:
        refuse_no_label(label)
    except InputError as problem:
        return [as_sentence(str(problem))]
    return []


def new_session_blockers(wanted: Wanted) -> list[str]:
    """Why no session of a new participant can begin with this protocol in this folder."""
    if wanted.operators:
        study = f"a study of {counted(wanted.operators, 'simulated operator')}"
        return [f"This folder holds {study}, which takes no other session. Choose another folder in the settings."]
    if not isinstance(wanted.loaded, Loaded):
        return ["This protocol cannot be run."]
    known = wanted.loaded.protocol.participants
    if known and wanted.participant not in known:
        return [f"The protocol's participants are {', '.join(known)}."]
    return wanted.form_problems


def session_blocker(is_open: str, no_board: str, snapshot: m.Snapshot, real_device: bool) -> str:
    """Why no session at all can be opened; "": nothing stands in the way. no_board: as in `Wanted`."""
    if is_open:
        return f"The session of {is_open} is open: close it to open or choose another. {LEAVE}"
    if snapshot.stage == m.PREPARING:
        return "Waiting for the session server and its control loop to start …"
    if no_board or snapshot.stage == m.FAILED:  # else the start begins with another session server
        return no_board
    return snapshot.session_blocker(real_device)


def summary_of(wanted: Wanted) -> str:
    """What the chosen protocol is, or that a session goes on by another one, its own; "": it is being read."""
    loaded, found = wanted.loaded, wanted.found
    if not isinstance(loaded, Loaded):
        return str(loaded or "")
    if found is not None and found.protocol not in ("", loaded.protocol.name):
        return f"Participant {wanted.participant} goes on by their own protocol, {found.protocol}."
    said = loaded.sentence.removesuffix(".")
    return "\n".join(filter(None, (f"{said[:1].upper()}{said[1:]}", loaded.summary.replace(" min", "\u00a0min"))))


def standing_of(wanted: Wanted) -> str:
    """How far the participant's session is."""
    if not wanted.participant:
        return ""
    if wanted.found is None:
        return "new participant, agreed to take part" if wanted.agreed else "new participant"
    if wanted.found.declined:
        return "does not take part"
    return f"{wanted.found.done} of {wanted.found.planned} done, {wanted.found.protocol} protocol"


def start_text(wanted: Wanted, is_open: str) -> str:
    """What the button does, in words."""
    label, found = wanted.participant, wanted.found
    trials = wanted.loaded.trials if isinstance(wanted.loaded, Loaded) else 0
    if is_open:
        return f"Go to the session   {is_open}"
    if found is None and wanted.consent_due and label:
        return f"Ask {label} for consent"
    if found is None:
        return f"Start session   {label} · {counted(trials, 'trial')}" if label and trials else "Start session"
    if found.declined:
        return "Start session"
    if found.complete:
        return f"Open session   {label} · complete"
    return f"Resume session   {label} · {counted(found.planned - found.done, 'trial')} left"
