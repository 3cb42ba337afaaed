"""Which trial comes next in a session: practice, the plan, and what has to be done again."""

from pathlib import Path

from core.control.controllers import Preset
from core.errors import InputError
from experiments.analysis.trials_table import TrialRow
from experiments.plan import PlannedTrial, break_after, practice_trial
from experiments.protocol import Protocol
from experiments.session.files import PRACTICE, open_trials, runs_used
from experiments.trial.operator import Person


class SessionOrder:
    """A session's plan against what was run of it."""

    participant: str
    protocol: Protocol
    person: Person | None
    folder: Path
    plan: tuple[PlannedTrial, ...]
    rows: list[TrialRow]
    blind: bool  # whether the controllers still stand as codes
    _key: dict[str, int]  # code -> controller, of a session that was begun blind
    _practised: dict[str, int]  # configuration -> practice trials done or skipped

    def next_planned(self) -> PlannedTrial | None:
        """The first trial of the plan that is not settled, or the practice that comes before it; None: all are.

        It takes the next free run number if its own is used up, by a crash or because it is done again: same cell of
        the plan, another recording. A simulated operator does not practise.
        """
        waiting = open_trials(self.plan, self.rows)
        if not waiting:
            return None
        due = self._practised.get(waiting[0].configuration, 0) < self.protocol.practice_trials
        if due and self.person is None and not self._begun(waiting[0].configuration):
            return self.next_practice()
        used = runs_used(self.folder) | {row.run for row in self.rows}
        if waiting[0].run not in used:
            return waiting[0]
        return waiting[0]._replace(run=max(used | {trial.run for trial in self.plan}) + 1)

    def _begun(self, configuration: str) -> bool:
        return any(row.configuration == configuration for row in self.rows)

    def next_practice(self) -> PlannedTrial:
        """A practice trial (block 0) in the configuration that comes next, due or not. InputError if nothing comes."""
        waiting = open_trials(self.plan, self.rows)
        if not waiting:
            raise InputError("all trials of the plan are done, there is nothing to practise for")
        configuration = waiting[0].configuration
        number = self._practised.get(configuration, 0) + 1
        planned = practice_trial(self.protocol, self.participant, configuration, number, bool(self._key))
        run = max(runs_used(self.folder, PRACTICE), default=0) + 1
        controller = planned.controller if self.blind else self._number(planned)
        return planned._replace(run=run, controller=controller)

    @property
    def settled(self) -> int:
        """How many trials of the plan are settled."""
        return len(self.plan) - len(open_trials(self.plan, self.rows))

    @property
    def break_due(self) -> bool:
        """Whether a break of the protocol comes before the next trial."""
        waiting = open_trials(self.plan, self.rows)
        if not waiting:
            return False
        here = waiting[0].configuration
        left = sum(trial.configuration == here for trial in waiting)
        return break_after(self.protocol, sum(trial.configuration == here for trial in self.plan) - left, left)

    def _number(self, planned: PlannedTrial) -> int:
        controller = planned.controller
        return self._key[controller] if isinstance(controller, str) else controller

    def preset(self, planned: PlannedTrial) -> Preset:
        """The controller of a trial, in a blind session too: not to be shown then."""
        return self.protocol.controllers[self._number(planned)]
