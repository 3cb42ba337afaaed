"""What the screens say: the participant in plain words, the experimenter in short sentences."""

from collections.abc import Sequence
from typing import NamedTuple

from app.ipc import messages as m
from app.ipc.messages import MOUSE
from app.window.painting import theme
from core import tick_log
from experiments.analysis.trials_table import TrialRow
from experiments.plan import PlannedTrial


class Said(NamedTuple):
    """What the participant reads: one large line, a quiet one under it."""

    large: str
    small: str = ""


PHASES = {
    tick_log.APPROACH: Said("Move to the start", f"Bring the {theme.HANDLE_NAME} dot into the green circle"),
    tick_log.HOLD: Said("Hold", "Keep still in the green circle"),
    tick_log.MOVE: Said("Go", "Follow the line to the orange circle"),
}
TAKE_IT = f"Touch the {theme.HANDLE_NAME} dot with the pointer to take hold of it"
ENDINGS = {
    "done": "Well done", "timeout": "Time is up", "aborted": "Stopped", "recovered": "Stopped", "stopped": "Stopped",
    "redone": "Once more", "skipped": "Let us go on", "excluded": "Let us go on",
}  # fmt: skip
ENDED = Said("", "The next one starts in a moment")
WELCOME = Said("Welcome", "We start in a moment")
PREPARING = Said("One moment", "Everything is being made ready")
BREAK = Said("Take a break", "Rest your hand")
CHANGE = Said("One moment", "The device is made ready")
STOPPED = Said("Stopped", "One moment, please")
QUESTIONS = Said("A few questions")
FINISHED = Said("Thank you", "That was the last one")
FAILED = Said("Please wait", "Someone is coming to help")
SLOWER, FASTER = "A little slower next time", "A little faster next time"

#: The mouse on one screen: the person who moves also starts.
SPACE_NEXT, SPACE_FIRST = "Space starts the next trial", "Space starts the first trial"

#: .. whose view lies over the console.
ALLOW_KEY, CONSOLE_KEY = "B lets the brakes act again", "F11 shows the console"

SERVER_DIED = (
    "The session server has stopped: brakes off, what was recorded is kept. "
    "Close this window, start again and resume the session."
)
CELL = ("configuration", "block", "segment", "controller", "repetition")  # what makes two trials the same


def moving(phase: int, taken: bool) -> Said | None:
    """What is said during a trial; none once it has ended (how is said when its row is there)."""
    said = PHASES.get(phase)
    if said is not None and not taken:
        return said._replace(small=TAKE_IT)
    return said


def between(snapshot: m.Snapshot, opened: m.Opened | None, own_start: bool = False) -> Said:
    """What is said while no trial runs. own_start: the person who reads it has the space bar."""
    fixed = {
        m.PREPARING: PREPARING, m.NO_SESSION: WELCOME, m.RERIG: CHANGE, m.BREAK: BREAK, m.QUESTIONS: QUESTIONS,
        m.FINISHED: FINISHED, m.FAILED: FAILED,
    }  # fmt: skip
    if snapshot.stage in fixed or snapshot.paused:
        said = fixed.get(snapshot.stage, BREAK)
        first = feedback(snapshot, opened) if said in (CHANGE, BREAK, FINISHED) else ""
        return said._replace(small=" · ".join(filter(None, (first, said.small))))
    if snapshot.brakes_off:
        return STOPPED
    blocked = bool(snapshot.why_not)
    if not snapshot.rows or snapshot.practice:
        small = STOPPED.small if blocked else SPACE_FIRST if own_start else WELCOME.small
        return Said("Practice" if snapshot.practice else WELCOME.large, small)
    return after(snapshot.rows[-1], opened, own_start, blocked)


def with_keys(said: Said, snapshot: m.Snapshot) -> Said:
    """What is said while no trial runs to somebody who has no console beside it: which keys lead on."""
    allow = ALLOW_KEY if snapshot.brakes_off and snapshot.stage != m.FAILED else ""
    waits = said.small if not allow or said.small != STOPPED.small else ""  # nobody else comes
    return said._replace(small=" · ".join(filter(None, (waits, allow, CONSOLE_KEY))))


def practised(snapshot: m.Snapshot, own_start: bool = True) -> Said:
    """What is said after a practice trial; of one that was ended early the server says why."""
    large = STOPPED.large if snapshot.said else ENDINGS["done"]
    return Said(large, "Space: another one · Esc: back" if own_start and not snapshot.why_not else "")


def after(trial: TrialRow, opened: m.Opened | None, own_start: bool = False, blocked: bool = False) -> Said:
    """What is said after a trial: how it went, and what the protocol gives back. blocked: the next cannot start yet."""
    parts = given_back(trial, opened)
    if own_start and not blocked:
        parts.append(SPACE_NEXT)
    return Said(ENDINGS[trial.status], " · ".join(parts) or (STOPPED if blocked else ENDED).small)


def feedback(snapshot: m.Snapshot, opened: m.Opened | None) -> str:
    """What the protocol gives back of the newest trial, where something else is said after it; "": nothing."""
    return " · ".join(given_back(snapshot.rows[-1], opened)) if snapshot.rows else ""


def given_back(trial: TrialRow, opened: m.Opened | None) -> list[str]:
    """Feedback and cue after a trial, as far as the protocol gives them and the trial was done."""
    if opened is None or trial.status != "done":
        return []
    parts = []
    if opened.feedback == "time" and trial.duration_s is not None:
        parts.append(f"{trial.duration_s:.1f} seconds")
    if opened.feedback == "error" and trial.path_error_m is not None:
        parts.append(f"{1e3 * trial.path_error_m:.1f} mm from the line on average")
    if opened.cues is not None and trial.duration_s is not None:
        shortest, longest = opened.cues
        parts += [SLOWER] if trial.duration_s < shortest else [FASTER] if trial.duration_s > longest else []
    return parts


# ---------------------------------------------------------------------------------------------- for the experimenter


def cell(planned: PlannedTrial, opened: m.Opened, blind: bool) -> str:
    """Controller and path of a planned trial; the controller is left out of a blind console."""
    path = f"path {planned.segment}"
    return path if blind else f"{controller_name(planned.controller, opened)} · {path}"


def describe(planned: PlannedTrial, opened: m.Opened, blind: bool) -> str:
    """A planned trial in words."""
    return f"{planned.configuration} · {cell(planned, opened, blind)}"


def controller_name(controller: int | str, opened: m.Opened) -> str:
    """The name of a controller of the protocol; a blind session's code stays as it is."""
    return controller if isinstance(controller, str) else opened.controllers[controller].name


def where(snapshot: m.Snapshot, opened: m.Opened) -> str:
    """The line under the participant's name: which trial, of what."""
    if snapshot.stage == m.RUNNING and snapshot.practice:
        return "Practice · counts nowhere"
    planned = snapshot.running or snapshot.coming
    if not opened.participant or planned is None:
        over = f"All {len(opened.plan)} trials are done · " if snapshot.stage == m.FINISHED else ""
        return f"{over}protocol {opened.protocol}" if over else f"Protocol {opened.protocol}"
    if planned.block == 0:
        return f"Practice · {describe(planned, opened, snapshot.blind)}"
    at = f"Trial {place(planned, opened.plan)} of {len(opened.plan)}"
    return f"{at} · block {planned.block} · {planned.configuration}"


def place(planned: PlannedTrial, plan: Sequence[PlannedTrial]) -> int:
    """The place (1 ..) in the plan of a trial, which may be a repetition with a run number of its own."""
    return next((i for i, one in enumerate(plan, start=1) if same_cell(one, planned)), planned.run)


def same_cell(a: PlannedTrial | TrialRow, b: PlannedTrial | TrialRow) -> bool:
    """Whether two trials are of one cell of the plan."""
    return all(getattr(a, field) == getattr(b, field) for field in CELL)


def minutes(seconds: float | None) -> str:
    """About how long: "about 14 min left"; empty while that is unknown."""
    if seconds is None:
        return ""
    return f"about {max(round(seconds / 60.0), 1)} min left"


def clock(seconds: float) -> str:
    """2:05 for 125 s."""
    whole = max(int(seconds + 0.999), 0)
    return f"{whole // 60}:{whole % 60:02d}"


def grouped(number: int) -> str:
    """A whole number with thin gaps between thousands."""
    return f"{number:,}".replace(",", "\u202f")


def size(count: int) -> str:
    """Bytes as kB, MB or GB."""
    for unit, least in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= least:
            return f"{count / least:.1f} {unit}"
    return f"{count} bytes"


def hand_is_mouse(opened: m.Opened | None) -> bool:
    """Whether the pointer is the hand (until it is known what is, yes: the pointer does nothing then)."""
    return opened is None or opened.hand == MOUSE
