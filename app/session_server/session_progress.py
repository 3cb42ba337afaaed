"""How far an open session is: which trial comes, and which step is due before it."""

import statistics
import time
from datetime import UTC, datetime
from typing import Any, NamedTuple

from experiments.analysis.trials_table import COUNTED, FINISHED, TrialRow
from experiments.inputs import is_person
from experiments.plan import TRIAL_S, PlannedTrial, time_left_s
from experiments.store.cells import cell, open_trials, trial_name
from experiments.store.journal import (
    ANSWERS,
    BREAK_ENDED,
    CONTROLLER_ANSWERS,
    ENDED,
    NOTE,
    PAUSED,
    RESUMED_AFTER_PAUSE,
    Event,
    read_events,
)
from experiments.store.session import Session

MOST_NAMED = 8  # trials in one sentence
PACED = 3  # trials whose lengths are a pace: the first ones are slow


class QuestionSubject(NamedTuple):
    """The subject of the questions: a block or a controller of a configuration."""

    configuration: str
    block: int = 0
    controller: int | str = 0  # a code in a blind session


class SessionProgress:
    """An open session and its state between two trials."""

    def __init__(self, session: Session) -> None:
        """Read the journal: what was done on an earlier day is not asked again. A pause ended with the session."""
        self.session = session
        self.coming: PlannedTrial | None = None
        self.last_end_s: float | None = None  # end of the last trial; None: a pause or a step has come since
        self.newest_line: dict[str, dict[str, Any]] = {}  # event -> its newest line of the journal: what a step reads
        self.notes: list[str] = []
        self._rest_from_s = time.perf_counter()  # when the last trial ended
        self.newest: TrialRow | None = None  # row of the newest trial since the session was opened
        self._answered: set[QuestionSubject] = set()
        self._lengths: list[float] = []  # s, from the end of one trial to the end of the next
        for event, at, about in read_events(session.folder):
            self.apply_event(event, at, about)
        self.paused_s: float | None = None  # since when
        if self.break_left_s() <= 0.0:  # it has passed while the session was closed, or there is none
            self.newest_line[BREAK_ENDED.name] = {"settled": session.finished_count}
        self.update_next()
        self.rigged = self.coming.configuration if self.coming else ""  # the configuration of a simulated device

    def apply_event(self, event: Event, at: str, about: dict[str, Any]) -> None:
        """Apply a line of the journal, new or of an earlier day (ISO time)."""
        self.newest_line[event.name] = about
        if event is ENDED:
            since_s = (datetime.now(UTC) - datetime.fromisoformat(at)).total_seconds()
            self._rest_from_s = time.perf_counter() - max(0.0, since_s)  # a clock that was set back: the whole break
        elif event is NOTE:
            self.notes.append(f"{datetime.fromisoformat(at).astimezone():%H:%M} {about['text']}")
        elif event is ANSWERS:
            self._answered.add(QuestionSubject(about["configuration"], block=about["block"]))
            self.questions_due = self._next_questions()
        elif event is CONTROLLER_ANSWERS:
            self._answered.add(QuestionSubject(about["configuration"], controller=about["controller"]))
            self.questions_due = self._next_questions()
        elif event is PAUSED:
            self.paused_s = time.perf_counter()
        elif event is RESUMED_AFTER_PAUSE:
            self.paused_s = self.last_end_s = None

    def name_of(self, trial: PlannedTrial | TrialRow) -> str:
        """For the experimenter, by the plan that they see: "Trial 12, second try"."""
        name = trial_name(trial, self.session.plan, self.session.rows) if trial.block else "the practice trial"
        return f"{name[0].upper()}{name[1:]}"

    def update_next(self) -> None:
        """Find the next trial after one was added, skipped or marked."""
        session = self.session
        self.coming, self._finished, self._break_due = session.next_planned(), session.finished_count, session.break_due
        self.questions_due = self._next_questions()

    @property
    def break_due(self) -> bool:
        """Whether a break is due and has not been ended."""
        rested_at = self.newest_line.get(BREAK_ENDED.name, {}).get("settled")  # trials that were settled when it ended
        return self._break_due and self._finished != rested_at

    def break_left_s(self) -> float:
        """The least time that the break still lasts."""
        breaks = self.session.protocol.breaks
        return max(0.0, breaks.least_s - (time.perf_counter() - self._rest_from_s)) if breaks else 0.0

    def without_valid_trial(self) -> str:
        """At the end of the plan: which trials have no result, in one sentence; "": not at the end, or none."""
        session = self.session
        if self.coming is not None:
            return ""
        newest = {cell(row): row.status for row in session.rows if row.status in FINISHED}
        valid = {cell(row) for row in session.rows if row.status in COUNTED}
        without = [
            f"{number} ({newest[cell(trial)]})"
            for number, trial in enumerate(session.plan, start=1) if cell(trial) not in valid
        ]  # fmt: skip
        if not without:
            return ""
        named = ", ".join(without[:MOST_NAMED]) + (", .." if len(without) > MOST_NAMED else "")
        have = "has" if len(without) == 1 else "have"
        return f"The plan is done, but {len(without)} of its {len(session.plan)} trials {have} no result: {named}."

    def seconds_left(self) -> float:
        """Estimated time of the rest of the session, at the median pace of its trials; before some at the assumed."""
        session = self.session
        pace_s = statistics.median(self._lengths) if len(self._lengths) >= PACED else TRIAL_S
        return time_left_s(session.protocol, session.plan, open_trials(session.plan, session.rows), pace_s)

    def trial_ended(self, row: TrialRow) -> None:
        """Note when a trial ended, and how long it took."""
        now = time.perf_counter()
        self.newest = row
        if self.last_end_s is not None:
            self._lengths.append(now - self.last_end_s)
        self.last_end_s = self._rest_from_s = now

    def _next_questions(self) -> QuestionSubject | None:
        """The first finished block or controller with open questions; None: there is none."""
        session, questionnaire = self.session, self.session.protocol.questionnaire
        if not questionnaire.on or not is_person(session.hand):  # there is no person to answer
            return None

        def part(trial: PlannedTrial | TrialRow) -> QuestionSubject:
            if questionnaire.each == "controller":
                return QuestionSubject(trial.configuration, controller=trial.controller)
            return QuestionSubject(trial.configuration, block=trial.block)

        still_open = set(map(part, open_trials(session.plan, session.rows)))
        over = {part(row) for row in session.rows if row.status != "skipped" and row.block}
        waiting = over - still_open - self._answered
        return next((part(trial) for trial in session.plan if part(trial) in waiting), None)
