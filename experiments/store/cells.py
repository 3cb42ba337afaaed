"""The cells of a plan: which of them have a result, and which trials are still to be run."""

from collections.abc import Iterable, Sequence

from experiments.analysis.trials_table import COUNTED, FINISHED, TrialRow
from experiments.plan import PlannedTrial


def cell(trial: PlannedTrial | TrialRow) -> tuple:
    """The cell of the plan that a trial fills, whatever its run number."""
    return trial.block, trial.configuration, trial.controller, trial.path, trial.repetition


def place(trial: PlannedTrial | TrialRow, plan: Sequence[PlannedTrial]) -> int:
    """The place (1 ..) in the plan of a trial, which may be a repetition with a run number of its own."""
    return next((number for number, planned in enumerate(plan, start=1) if cell(planned) == cell(trial)), trial.run)


NTH = ("", "", "second", "third", "fourth", "fifth", "sixth")  # try of a trial


def try_of(trial: PlannedTrial | TrialRow, rows: Sequence[TrialRow]) -> str:
    """ ", second try" of a trial that was tried before, among the rows of its session; "" of a first one."""
    return _nth_try(1 + sum(cell(row) == cell(trial) and row.run < trial.run for row in rows))


def _nth_try(number: int) -> str:
    if number == 1:
        return ""
    return f", {NTH[number]} try" if number < len(NTH) else f", try {number}"


def trial_name(trial: PlannedTrial | TrialRow, plan: Sequence[PlannedTrial], rows: Sequence[TrialRow]) -> str:
    """ "trial 4, second try", by the plan that the experimenter sees."""
    return f"trial {place(trial, plan)}{try_of(trial, rows)}" if trial.block else "practice"


def trial_names(rows: Iterable[TrialRow]) -> dict[tuple[str, int], str]:
    """Participant and run -> "trial 4, second try", of all rows of any sessions: the plan's runs are its trials."""
    tries: dict[tuple, list[TrialRow]] = {}
    for row in sorted(rows, key=lambda row: row.run):
        tries.setdefault((row.participant, cell(row)), []).append(row)
    return {
        (row.participant, row.run): f"trial {same[0].run}{_nth_try(number)}"
        for same in tries.values() for number, row in enumerate(same, start=1)
    }  # fmt: skip


def name_among(trial: TrialRow, rows: Iterable[TrialRow]) -> str:
    """ "trial 4, second try", among the rows of its session, which may lack it; "practice" of a practice trial."""
    if not trial.block:
        return "practice"
    return trial_names([*(row for row in rows if row.run != trial.run), trial])[trial.participant, trial.run]


def finished_cells(rows: Iterable[TrialRow]) -> tuple[set[tuple], set[tuple]]:
    """The cells of the plan that need no further trial, and those of them without a result."""
    rows = list(rows)
    finished = {cell(row) for row in rows if row.status in FINISHED}
    return finished, finished - {cell(row) for row in rows if row.status in COUNTED}


def open_trials(
    plan: tuple[PlannedTrial, ...], rows: list[TrialRow], postponed: Sequence[int] = ()
) -> list[PlannedTrial]:
    """The planned trials still to be run, in order; those of postponed runs come last in their configuration."""
    finished, _ = finished_cells(rows)
    waiting = [trial for trial in plan if cell(trial) not in finished]
    if postponed:
        cells = [cell(row) for run in postponed for row in rows if row.run == run]
        devices = list(dict.fromkeys(trial.configuration for trial in plan))
        turn = {last: place for place, last in enumerate(cells, start=1)}  # asked for twice: the later place
        waiting.sort(key=lambda trial: (devices.index(trial.configuration), turn.get(cell(trial), 0)))
    return waiting
