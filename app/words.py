"""What the app says during a session: the participant's line in plain words, and the quiet line under it."""

from app.messages import Ended, Ticks
from core import row

PHASE_LINES = {
    row.APPROACH: ("Move to the start", "Bring the handle into the green ring"),
    row.HOLD: ("Hold", "Keep the handle still in the green ring"),
    row.MOVE: ("Go", "Follow the line to the orange ring"),
}
TAKE_IT = "Touch the white handle with the pointer to take hold of it"
ENDINGS = {"done": "Well done", "timeout": "Time is up", "aborted": "Stopped"}
FIRST = "Space starts the first trial"
NEXT = "Space starts the next trial"
ALL_DONE = "That was the last trial. Thank you."
PREPARING = "Preparing .. (on first use about half a minute)"
LOOP_DIED = "The control loop has stopped: brakes off, what was recorded is kept. Close this window."


def during(ticks: Ticks) -> tuple[str, str] | None:
    """The two lines while a trial runs; none once it has ended (how is said when its row is there)."""
    phase = int(ticks.rows[-1, row.PHASE])
    if phase == row.END:
        return None
    large, small = PHASE_LINES[phase]
    return large, TAKE_IT if phase == row.APPROACH and not ticks.taken else small


def changes_configuration(ended: Ended) -> bool:
    """Whether the next trial is on another device."""
    return ended.next is not None and ended.next.configuration != ended.row.configuration


def after(ended: Ended) -> tuple[str, str]:
    """The two lines after a trial."""
    large = ENDINGS.get(ended.row.status, "")
    if ended.next is None:
        return large, ALL_DONE
    if changes_configuration(ended):
        return large, f"Configuration changes to {ended.next.configuration} · Space continues"
    return large, NEXT


def for_experimenter(ended: Ended) -> str:
    """What the console says after a trial; empty: nothing to say."""
    said = []
    if ended.reason:
        said.append(f"Trial {ended.row.run} {ended.row.status}: {ended.reason}.")
    if ended.next is not None and changes_configuration(ended):
        said.append(f"Configuration changes to {ended.next.configuration}. Start continues.")
    return " ".join(said)
