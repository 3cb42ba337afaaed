"""The data dictionary of an export: what every column means, and its unit."""

from core import tick_log
from core.control.controllers import DECISIONS
from core.files import InputError
from experiments.analysis.trials_table import DICTIONARY, Column

#: What the ticks of a recording hold.
RECORDING = {
    one.name: Column(one.meaning, one.unit) for column in tick_log.COLUMNS for one in column.spread()
}  # fmt: skip

#: The scales of the questionnaire after a block, 0 to 100.
SCALES = {
    "mental_demand": Column("NASA-TLX mental demand, 0 very little to 100 very much"),
    "physical_demand": Column("NASA-TLX physical demand, 0 very little to 100 very much"),
    "temporal_demand": Column("NASA-TLX temporal demand, 0 not at all hurried to 100 very hurried"),
    "performance": Column("NASA-TLX performance, 0 followed the lines perfectly to 100 not at all"),
    "effort": Column("NASA-TLX effort, 0 very little to 100 very hard"),
    "frustration": Column("NASA-TLX frustration, 0 not at all to 100 very irritated or discouraged"),
    "smoothness": Column("how the movement felt, 0 smooth to 100 jerky"),
}

#: What questionnaire.csv holds besides the scales, one row for each block that was asked about.
QUESTIONNAIRE = {
    **{name: DICTIONARY[name] for name in ("participant", "configuration", "block", "controller")},
    "time": Column("when it was answered, UTC, ISO 8601"),
}

#: What notes.csv holds, one row a note.
NOTES = {
    "time": Column("when it was written, UTC, ISO 8601"),
    "participant": Column("in whose session"),
    "text": Column("what the experimenter wrote"),
}

PHASE_LEVELS = {
    "approach": "brakes off, the hand moves to the start",
    "hold": "the hand waits at the start, brakes off",
    "move": "the movement along the path: every measure is taken here",
    "end": "after the movement, brakes off",
}

#: How the words of the column `decision` are to be read.
DECISION_READING = (
    "off: brakes off outside the movement; none: controller 1; gap: inside the band without control; "
    "release / lock: no or full current on all brakes, and why; "
    "sdof J / prop J: the brake at joint J is used, by the SDOF or the proportional rule. All words: "
    + "; ".join(DECISIONS)
)


def recording_column(name: str, command_unit: str = "A") -> Column:
    """What a column of a recording means. InputError if it is not described: another version wrote it.

    command_unit: of what was commanded to the brakes, where it was no current.
    """
    if name not in RECORDING:
        raise InputError(f"recording: column {name} is not described, it cannot be exported")
    column = RECORDING[name]
    if column.unit == "A" and command_unit != "A":
        meaning = column.meaning.replace("current", f"value ({command_unit})", 1)
        return column._replace(meaning=meaning, unit=command_unit)
    return column


def scale_column(name: str) -> Column:
    """What a scale of the questionnaire means; one of another version is only named."""
    return SCALES.get(name) or Column(f"answer on the scale {name}, 0 to 100")
