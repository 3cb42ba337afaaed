"""A trial's row of the table, from its recording alone."""

import os
from pathlib import Path

from core.errors import InputError
from core.path_file import build_path, path_from
from experiments.analysis.metrics import NO_METRICS, trial_metrics
from experiments.analysis.trials_table import COUNTED, TrialRow
from experiments.recording.recording import Recording

#: What a recording must say of its trial.
NEEDED = (
    "participant", "run", "block", "configuration", "controller", "segment", "repetition", "path",
)  # fmt: skip


def row_of(recording: Recording, folder: Path) -> TrialRow:
    """A trial's row, from its recording alone; `folder`: where the table that gets it stands.

    InputError: the recording does not say which trial it is of, or cannot be measured. A trial that does not count (it
    was cut short, say by a force that is not a number) then has a row without measures.
    """
    about, outcome = recording.metadata, recording.outcome
    for key in NEEDED:
        if key not in about:
            raise InputError(f"{recording.path}: the metadata lack {key}")
    if "status" not in outcome:
        raise InputError(f"{recording.path}: the end record lacks the status")
    where = f"{recording.path}: path"
    path = build_path(path_from(about["path"], where), where)
    metrics = NO_METRICS
    if recording.in_phase("move").any():
        try:
            metrics = trial_metrics(recording, path)
        except InputError:  # ticks are missing, or a sample is no number: then there is nothing to say of it
            if outcome["status"] in COUNTED:
                raise
    place = os.path.relpath(recording.path, folder).replace(os.sep, "/")
    return TrialRow(
        about["participant"], about["run"], about["block"], about["configuration"], about["controller"],
        about["segment"], about["repetition"], outcome["status"], recording=place,
        energy_residual_J=outcome.get("energy_residual_J"), energy_added_max_J=outcome.get("energy_added_max_J"),
    ).with_metrics(metrics)  # fmt: skip
