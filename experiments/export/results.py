"""The results of a data folder: everything that was recorded there, as far as it is in the tables."""

import contextlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from core.control.controllers import Preset
from core.files import InputError
from core.path import build_path
from experiments.analysis.charts import Answer
from experiments.analysis.trials_table import TrialRow, read_table
from experiments.export.trial import answers_and_notes
from experiments.protocol import label
from experiments.session.files import STORED, TABLE, read_stored, rows_of, sessions_in


class Results(NamedTuple):
    """What a data folder holds."""

    folder: Path
    sessions: tuple[Path, ...] = ()
    rows: tuple[TrialRow, ...] = ()  # recordings are named from the folder
    answers: tuple[Answer, ...] = ()
    planned: dict[str, int] = {}  # participant -> trials of the plan
    controllers: dict[int, Preset] = {}
    labels: dict[int, str] = {}  # controller -> what stands under its boxes
    configurations: tuple[str, ...] = ()
    lengths: dict[int, float] = {}  # segment -> length of the path, m
    note: str = ""  # what every figure says
    protocol: str = ""  # its name
    problems: tuple[str, ...] = ()  # what could not be read


def read_results(folder: Path) -> Results:
    """Everything that stands in the tables of a data folder, of a study, or of one session; a bare table of trials too.

    What cannot be read is left out and named in `problems`. InputError if there is no such folder.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: {'is no folder' if folder.exists() else 'there is no such folder'}")
    with contextlib.suppress(InputError):  # it holds other files as well, maybe a table
        if sessions := sessions_in(folder):
            return _of_sessions(folder, sessions)
    if (folder / TABLE).exists():
        rows = tuple(read_table(folder / TABLE))
        numbers = sorted({row.controller for row in rows if isinstance(row.controller, int)})
        labels = {number: f"controller\n{number}" for number in numbers}
        return Results(folder, (), rows, labels=labels, configurations=_configurations(rows))
    return Results(folder)


def _of_sessions(folder: Path, sessions: Sequence[Path]) -> Results:
    rows: list[TrialRow] = []
    problems: list[str] = []
    planned: dict[str, int] = {}
    texts: dict[str, Path] = {}  # a protocol, as stored -> a session that follows it
    for session in sessions:
        place = Path(os.path.relpath(session, folder)).as_posix()
        try:
            rows += [row.seen_from(place) for row in sorted(rows_of(session), key=lambda row: row.run)]
        except InputError as error:
            problems.append(str(error))
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):  # `phd verify` names what is wrong with it
            about = json.loads((session / STORED).read_text(encoding="utf-8"))
            planned[str(about["participant"])] = len(about["plan"])
            texts.setdefault(json.dumps(about["protocol"], sort_keys=True), session)
    protocols = [read_stored(session).protocol for session in texts.values()]
    presets = {number: preset for one in reversed(protocols) for number, preset in one.controllers.items()}
    lengths = {
        number: build_path(path, f"path {number}").length
        for one in reversed(protocols)
        for number, path in one.paths.items()
    }
    if len(protocols) > 1:
        problems.append(f"The sessions follow {len(protocols)} different protocols: compare their results with care.")
    devices = dict.fromkeys(device.name for one in protocols for device in one.devices)
    return Results(
        folder,
        tuple(sessions),
        tuple(rows),
        tuple(_answers(sessions)),
        planned,
        presets,
        {number: label(preset.name) for number, preset in presets.items()},
        tuple(dict.fromkeys((*devices, *_configurations(rows)))),
        lengths,
        " / ".join(dict.fromkeys(one.note() for one in protocols)),
        " and ".join(dict.fromkeys(one.name for one in protocols)),
        tuple(problems),
    )


def _configurations(rows: Sequence[TrialRow]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(row.configuration for row in rows))


def _answers(sessions: Sequence[Path]) -> list[Answer]:
    return [
        Answer(a.participant, a.configuration, "", a.block, question, value)
        for a in answers_and_notes(sessions).answers
        for question, value in a.values.items()
    ]
