"""What every column of a recording and of trials.csv means, and its unit: for the readers of an export."""

from typing import NamedTuple

from core import tick_log
from core.control.controllers import DECISIONS
from core.files import InputError
from experiments.analysis.metrics import METRICS
from experiments.analysis.trials_table import STATUSES


class Column(NamedTuple):
    """One column. unit: "" for text, numbers without a unit and counts."""

    unit: str
    description: str


_PHASES = (
    "brakes off, the hand moves to the start",
    "the hand waits at the start, brakes off",
    "the movement along the path: every measure is taken here",
    "after the movement, brakes off",
)

#: What the ticks of a recording hold.
RECORDING: dict[str, Column] = {
    one.name: Column(one.unit, one.meaning) for column in tick_log.COLUMNS for one in column.spread()
}

#: What trials.csv holds, one row a trial. Measures are over the phase `move`; an empty cell: nothing to measure.
TRIALS: dict[str, Column] = {
    "participant": Column("", "label of the participant"),
    "run": Column("", "number of the trial in its session"),
    "block": Column("", "block within the configuration"),
    "configuration": Column("", "name of the device"),
    "controller": Column("", "controller by its number in Table I, or by its code while the session is blind"),
    "segment": Column("", "number of the path"),
    "repetition": Column("", "how often this cell of the plan has come, from 1"),
    "status": Column("", "how the trial ended"),
    **{metric.name: Column(metric.unit, metric.meaning) for metric in METRICS},
    "recording": Column("", "file of the recording, relative to this file"),
    "energy_residual_J": Column("J", "what the energy ledger of the trial leaves unexplained"),
    "energy_added_max_J": Column("J", "the most energy that any brake added in a step: must be none"),
}

#: The scales of the questionnaire after a block, 0 to 100.
SCALES: dict[str, Column] = {
    "mental_demand": Column("", "NASA-TLX mental demand, 0 very little to 100 very much"),
    "physical_demand": Column("", "NASA-TLX physical demand, 0 very little to 100 very much"),
    "temporal_demand": Column("", "NASA-TLX temporal demand, 0 not at all hurried to 100 very hurried"),
    "performance": Column("", "NASA-TLX performance, 0 followed the lines perfectly to 100 not at all"),
    "effort": Column("", "NASA-TLX effort, 0 very little to 100 very hard"),
    "frustration": Column("", "NASA-TLX frustration, 0 not at all to 100 very irritated or discouraged"),
    "smoothness": Column("", "how the movement felt, 0 smooth to 100 jerky"),
}

#: What questionnaire.csv holds, one row for each block that was asked about.
QUESTIONNAIRE: dict[str, Column] = {
    "participant": TRIALS["participant"],
    "configuration": TRIALS["configuration"],
    "block": TRIALS["block"],
    **SCALES,
    "time": Column("", "when it was answered, UTC, ISO 8601"),
}

#: What notes.csv holds, one row a note.
NOTES: dict[str, Column] = {
    "time": Column("", "when it was written, UTC, ISO 8601"),
    "participant": Column("", "in whose session"),
    "text": Column("", "what the experimenter wrote"),
}

PHASE_LEVELS: dict[str, str] = dict(zip(tick_log.PHASES, _PHASES, strict=True))

STATUS_MEANINGS = {
    "done": "the end of the path was reached",
    "timeout": "the time was up before the end; measures are over the progress made",
    "aborted": "ended by the experimenter, or (a simulated operator) unfit to go on; does not count",
    "stopped": "cut short by a fault, by the brakes-off or with the app; does not count, its trial is run again",
    "redone": "run again later, for a reason; kept, does not count",
    "recovered": "cut off by a crash, rescued; does not count",
    "skipped": "not run, for a reason",
    "excluded": "taken out of every result by the experimenter, for a reason; kept, does not count",
}
STATUS_LEVELS: dict[str, str] = {status: STATUS_MEANINGS[status] for status in STATUSES}

#: How the words of the column `decision` are to be read.
DECISION_READING = (
    "off: brakes off outside the movement; none: controller 1; gap: inside the band without control; "
    "release / lock: no or full current on all brakes, and why; "
    "sdof J / prop J: the brake at joint J is used, by the SDOF or the proportional rule. All words: "
    + "; ".join(DECISIONS)
)


def recording_column(name: str) -> Column:
    """What a column of a recording means. InputError if it is not described."""
    if name not in RECORDING:
        raise InputError(f"recording: column {name} is not described, it cannot be exported")
    return RECORDING[name]


def trials_column(name: str) -> Column:
    """What a column of trials.csv means. InputError if it is not described."""
    if name not in TRIALS:
        raise InputError(f"trials table: column {name} is not described, it cannot be exported")
    return TRIALS[name]
