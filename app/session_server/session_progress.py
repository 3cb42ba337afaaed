"""How far an open session is: what comes, what stands on the bench, and what is due before the next trial."""

import statistics
import time
from datetime import UTC, datetime

from app.ipc import messages as m
from app.ipc.messages import OPERATOR
from app.session_server.steps import due_step
from experiments.analysis.trials_table import COUNTED, SETTLED
from experiments.plan import PlannedTrial
from experiments.session.files import cell, open_trials
from experiments.session.journal import ANSWERS, BREAK_ENDED, ENDED, NOTE, read_events
from experiments.session.session import Session

MOST_NAMED = 8  # trials in one sentence


class SessionProgress:
    """An open session, and where it stands between two trials."""

    def __init__(self, session: Session) -> None:
        """Take it up; what its journal says of earlier days is not asked for again."""
        self.session = session
        self.coming: PlannedTrial | None = None
        self.paused_s: float | None = None  # since when
        self.last_end_s: float | None = None  # of a trial; None: what comes next is not one trial's length away
        self.rest_from_s = time.monotonic()  # when the last trial ended
        self.rested_at = -1  # trials that were settled when the last break ended
        self.notes: list[str] = []
        self._answered: set[tuple[str, int]] = set()
        self._lengths: list[float] = []  # s, from the end of one trial to the end of the next
        for event, at, about in read_events(session.folder):
            if event is ENDED:
                self.rest_from_s = time.monotonic() - _seconds_since(at)
            elif event is BREAK_ENDED:
                self.rested_at = about["settled"]
            elif event is NOTE:
                self._add_note(datetime.fromisoformat(at).astimezone(), about["text"])
            elif event is ANSWERS:
                self._answered.add((about["configuration"], about["block"]))
        if self.break_left_s() <= 0.0:  # it has passed while the session was closed, or there is none
            self.rested_at = session.settled
        self.look_ahead()
        self.rigged = self.coming.configuration if self.coming else ""  # the configuration that stands on the bench

    def look_ahead(self) -> None:
        """A trial has been added, skipped or marked: what comes now."""
        session = self.session
        self.coming, self._settled, self._break_due = session.next_planned(), session.settled, session.break_due
        self.asked_block = self._block_to_ask()

    @property
    def tip(self) -> m.Point:
        """Where the handle stands in the configuration that comes, m."""
        configuration = self.coming.configuration if self.coming else self.rigged
        tip = self.session.simulation(configuration or self.session.protocol.devices[0].name).state["tip"][0]
        return float(tip[0]), float(tip[1])

    @property
    def break_due(self) -> bool:
        """Whether a break comes before the next trial, and has not been ended."""
        return self._break_due and self._settled != self.rested_at

    @property
    def stage(self) -> str:
        """What the session waits for."""
        if (step := due_step(self)) is not None:
            return step.name
        return m.READY if self.coming is not None else m.FINISHED

    def wait_for(self) -> str:
        """What is to be done now, in one sentence; "": nothing."""
        step = due_step(self)
        return step.sentence(self) if step else ""

    def break_left_s(self) -> float:
        """How long the break lasts at least, from now."""
        breaks = self.session.protocol.breaks
        return max(0.0, breaks.least_s - (time.monotonic() - self.rest_from_s)) if breaks else 0.0

    def without_valid_trial(self) -> str:
        """At the end of the plan: its trials that have no result, in one sentence; "" before, or if all have one."""
        session = self.session
        if self.coming is not None:
            return ""
        newest = {cell(row): row.status for row in session.rows if row.status in SETTLED}
        valid = {cell(row) for row in session.rows if row.status in COUNTED}
        without = [
            f"{number} ({newest[cell(trial)]})"
            for number, trial in enumerate(session.plan, start=1) if cell(trial) not in valid
        ]  # fmt: skip
        if not without:
            return ""
        named = ", ".join(without[:MOST_NAMED]) + (", .." if len(without) > MOST_NAMED else "")
        return f"The plan is done, but {len(without)} of its {len(session.plan)} trials have no result: {named}."

    def seconds_left(self) -> float | None:
        """Of the whole session, from the trials so far; None: not known yet."""
        if not self._lengths:
            return None
        return statistics.median(self._lengths) * (len(self.session.plan) - self._settled)

    def trial_ended(self) -> None:
        """Count the time since the one before."""
        now = time.monotonic()
        if self.last_end_s is not None:
            self._lengths.append(now - self.last_end_s)
        self.last_end_s = self.rest_from_s = now

    def noted(self, text: str) -> None:
        """A note has been written."""
        self._add_note(datetime.now(), text)

    def answered(self) -> None:
        """The questions after a block have been answered."""
        assert self.asked_block is not None
        self._answered.add(self.asked_block)
        self.asked_block = self._block_to_ask()

    def _add_note(self, at: datetime, text: str) -> None:
        self.notes.append(f"{at:%H:%M} {text}")

    def _block_to_ask(self) -> tuple[str, int] | None:
        """Configuration and block of the first finished block whose questions wait; left out where all was skipped."""
        session = self.session
        if not session.protocol.questionnaire.on or session.hand == OPERATOR:  # there is no person to answer
            return None
        still_open = {(trial.configuration, trial.block) for trial in open_trials(session.plan, session.rows)}
        over = {(row.configuration, row.block) for row in session.rows if row.status != "skipped"}
        waiting = over - still_open - self._answered
        return next((block for trial in session.plan if (block := (trial.configuration, trial.block)) in waiting), None)


def _seconds_since(at: str) -> float:
    """By the clock of the machine, which may have been set meanwhile: never less than none."""
    return max(0.0, (datetime.now(UTC) - datetime.fromisoformat(at)).total_seconds())
