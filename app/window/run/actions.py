"""What the experimenter can do now: the buttons of the Run page, and their keys, all ask this one place."""

from typing import NamedTuple

from app.ipc import messages as m
from experiments.analysis.trials_table import COUNTED, TRIED, TrialRow
from experiments.plan import PlannedTrial

BETWEEN = (m.READY, m.RERIG, m.BREAK, m.FINISHED)  # stages between two trials, except the questions


class Actions(NamedTuple):
    """What can be done, and to which trial."""

    start: bool = False
    pause: bool = False  # or resume
    leave: bool = False
    note: bool = False
    redo: TrialRow | None = None  # the trial on the card, else the last one that can be repeated
    exclude: TrialRow | None = None  # the trial on the card
    skip: PlannedTrial | None = None  # the next trial
    abort: PlannedTrial | None = None  # the running trial

    def of(self, action: str) -> TrialRow | PlannedTrial | None:
        """The trial to which this can be done: "redo", "exclude", "skip", "abort"; None: it cannot."""
        return getattr(self, action)


def possible(snapshot: m.Snapshot, on_card: TrialRow | None, waiting: bool) -> Actions:
    """What can be done now. waiting: the server has not answered the last command yet: nothing but a note."""
    note = snapshot.stage not in (m.PREPARING, m.NO_SESSION, m.FAILED)
    if waiting:
        return Actions(note=note)
    ready = snapshot.stage == m.READY and snapshot.coming is not None
    writes = snapshot.stage in BETWEEN and not snapshot.not_written
    trials = (on_card,) if on_card is not None else tuple(reversed(snapshot.rows))
    return Actions(
        start=ready and writes and not snapshot.trial_blocker,
        pause=ready or snapshot.stage == m.RUNNING,
        leave=snapshot.can_leave,
        note=note,
        # one that was repeated has been; one that was cut short comes again by itself
        redo=next((row for row in trials if row.status in TRIED), None) if writes else None,
        exclude=on_card if writes and on_card is not None and on_card.status in COUNTED else None,
        skip=snapshot.coming if ready and writes and not snapshot.practice else None,
        abort=snapshot.running if snapshot.stage == m.RUNNING else None,
    )
