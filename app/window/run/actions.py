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
    redo: TrialRow | None = None  # the trial on the card, else the last one
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
    runs = snapshot.stage == m.RUNNING and not snapshot.brakes_off  # else it is stopping
    last = on_card or (snapshot.rows[-1] if snapshot.rows else None)
    return Actions(
        start=ready and writes and not snapshot.trial_blocker,
        pause=ready or runs,
        leave=snapshot.can_leave,
        note=note,
        # one that was repeated has been; one that was cut short comes again by itself
        redo=last if writes and last is not None and last.status in TRIED else None,
        exclude=on_card if writes and on_card is not None and on_card.status in COUNTED else None,
        skip=snapshot.coming if ready and writes and not snapshot.practice else None,
        abort=snapshot.running if runs else None,
    )
