"""A recording in memory: the ticks of one trial, their columns and their names (on the disk: `experiments.store`)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from core import tick_log
from core.control.controllers import DECISIONS
from core.files import InputError
from core.mechanism import JOINTS

NO_METADATA: Mapping[str, Any] = {}

#: Text columns -> the integer that stores a word's place.
TEXT_COLUMNS = {"phase": pa.int8(), "stuck": pa.int8(), "decision": pa.int16()}


class Sensors(NamedTuple):
    """The sensors of a device on the bench, whose raw signals are recorded too."""

    encoders: str  # letters of their joints, "AB"
    force_channels: int


@cache
def recording_columns(braked: str, sensors: Sensors | None = None) -> tuple[tuple[str, int], ...]:
    """(name, column of the tick log) of every column; `braked`: letters of the braked joints, as "AEB".

    sensors: of a device on the bench; None: it is simulated, and there are no raw signals.
    """
    if "".join(joint for joint in JOINTS if joint in braked) != braked:
        raise InputError(f"recording: braked joints {braked!r} must be letters out of {JOINTS}, in that order")
    here = (tick_log.BOTH, tick_log.BENCH if sensors else tick_log.SIMULATED)
    found: list[tick_log.Column] = []
    for column in tick_log.COLUMNS:
        if column.of in here:
            joints = sensors.encoders if sensors and column.place == tick_log.COUNT else braked
            found += column.spread(joints, range(1, 1 + sensors.force_channels) if sensors else ())
    return tuple((column.name, column.place) for column in found)


def column_words(decisions: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Text column -> its words; a column of the tick log holds a word's place here."""
    return {"phase": tick_log.PHASES, "stuck": tick_log.STUCK_LETTERS, "decision": tuple(decisions)}


@dataclass(frozen=True)
class Recording:
    """One trial as recorded. Text columns hold codes: `words[name][code]` is the text."""

    path: Path
    metadata: dict[str, Any] = field(default_factory=dict)  # as given to the writer
    outcome: dict[str, Any] = field(default_factory=dict)  # as given to its `close`
    braked: str = ""
    sensors: Sensors | None = None  # of a device on the bench
    columns: Mapping[str, np.ndarray] = field(default_factory=dict)  # each (rows,)
    words: dict[str, tuple[str, ...]] = field(default_factory=dict)
    complete: bool = False  # the end is there: nothing was cut off
    damaged: list[str] = field(default_factory=list)  # fails its checksum or is missing; its rows are left out

    @property
    def rows(self) -> int:
        return len(self.columns["t_s"]) if self.columns else 0

    @property
    def whole(self) -> bool:
        """Whether every recorded tick was read unchanged."""
        return self.complete and not self.damaged

    @property
    def faults(self) -> str:
        """Why it is not whole."""
        return "; ".join(self.damaged) or "cut off before its end"

    def column(self, name: str) -> np.ndarray:
        """One column (rows,). InputError if the recording has none of that name."""
        if name not in self.columns:
            raise InputError(f"{self.path}: there is no column {name} to read")
        return self.columns[name]

    def text(self, name: str) -> np.ndarray:
        """A text column as words (rows,), dtype object."""
        return np.array(self.words[name], dtype=object)[self.column(name)]

    def in_phase(self, phase: str) -> np.ndarray:
        """True at the ticks of one phase (rows,): approach, hold, move or end."""
        return self.column("phase") == self.words["phase"].index(phase)


def recording_of(
    rows: np.ndarray,
    braked: str,
    path: Path = Path(),
    decisions: tuple[str, ...] = DECISIONS,
    metadata: Mapping[str, Any] = NO_METADATA,
) -> Recording:
    """Ticks (n, tick_log.WIDTH) of a simulated device as a recording in memory."""
    columns = {
        name: rows[:, place].astype(TEXT_COLUMNS[name].to_pandas_dtype()) if name in TEXT_COLUMNS else rows[:, place]
        for name, place in recording_columns(braked)
    }
    about = dict(metadata)
    return Recording(path, about, braked=braked, columns=columns, words=column_words(decisions), complete=True)
