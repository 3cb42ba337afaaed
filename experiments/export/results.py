"""The results of a data folder: everything that was recorded there, as far as it is in the tables."""

import contextlib
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from core.control.controllers import Preset
from core.files import InputError
from core.path import build_path
from experiments.analysis.charts import AnswerSet, View
from experiments.analysis.metrics import Metric
from experiments.analysis.own_measures import own_metrics
from experiments.analysis.trials_table import (
    Controller,
    TrialRow,
    Trials,
    as_table,
    controllers_of,
    read_table,
)
from experiments.export.files import answers_and_notes
from experiments.protocol import Protocol, label
from experiments.store.files import (
    TABLE,
    Sessions,
    lost_recordings,
    planned_trials,
    refuse_no_folder,
    rows_of,
    sessions_in,
)
from experiments.store.journal import journal_summary
from experiments.store.stored import protocol_and_hand, read_stored


class Results(NamedTuple):
    """The results of a data folder."""

    folder: Path
    trials: Trials  # recordings are named from the folder
    sessions: tuple[Path, ...] = ()
    answers: tuple[AnswerSet, ...] = ()
    planned: dict[str, int] = {}  # participant -> trials of the plan
    controllers: dict[int, Preset] = {}
    labels: dict[Controller, str] = {}  # controller -> what stands under its boxes
    configurations: tuple[str, ...] = ()
    lengths: dict[int, float] = {}  # number of the path -> its length, m
    note: str = ""  # stands on every figure
    protocol: str = ""  # its name
    own: tuple[Metric, ...] = ()  # measures of the protocols' own files
    hands: tuple[str, ...] = ()  # what moved the handle, of `experiments.inputs`
    problems: tuple[str, ...] = ()  # what could not be read


def read_results(folder: Path) -> Results:
    """Everything that stands in the tables of a data folder, of a study, or of one session; a bare table of trials too.

    What cannot be read is left out and named in `problems`. InputError if there is no such folder.
    """
    refuse_no_folder(folder)
    with contextlib.suppress(InputError):  # it holds other files as well, maybe a table
        there = sessions_in(folder)
        if there.folders or there.left_out:
            return _of_sessions(folder, there)
    if (folder / TABLE).exists():
        trials = read_table(folder / TABLE)
        return Results(folder, trials, labels=_labels(trials), configurations=_configurations(trials))
    return Results(folder, as_table([]))


def _of_sessions(folder: Path, there: Sessions) -> Results:
    rows: list[TrialRow] = []
    sessions = there.folders
    problems = [*there.sentences(folder), *lost_recordings(sessions)]
    for session in sessions:
        place = Path(os.path.relpath(session, folder)).as_posix()
        with _noting(problems):
            rows += [row.in_folder(place) for row in sorted(rows_of(session), key=lambda row: row.run)]
    trials = as_table(rows)
    planned, protocols, hands = _plans_protocols_and_hands(sessions, problems)
    own: dict[str, Metric] = {}
    for protocol in protocols:
        with _noting(problems):
            own |= {metric.name: metric for metric in own_metrics(protocol)}
    presets = {number: preset for protocol in reversed(protocols) for number, preset in protocol.controllers.items()}
    lengths = {
        number: build_path(path, f"path {number}").length
        for protocol in reversed(protocols)
        for number, path in protocol.paths.items()
    }
    if len(protocols) > 1:
        problems.append(f"The sessions follow {len(protocols)} different protocols: compare their results with care.")
    devices = dict.fromkeys(device.name for protocol in protocols for device in protocol.devices)
    return Results(
        folder,
        trials,
        tuple(sessions),
        tuple(_answers(sessions)),
        planned,
        presets,
        _labels(trials) | {number: label(preset.name) for number, preset in presets.items()},
        tuple(dict.fromkeys((*devices, *_configurations(trials)))),
        lengths,
        " / ".join(dict.fromkeys(protocol.note() for protocol in protocols)),
        " and ".join(dict.fromkeys(protocol.name for protocol in protocols)),
        tuple(own.values()),
        hands,
        tuple(problems),
    )


def _plans_protocols_and_hands(
    sessions: Sequence[Path], problems: list[str]
) -> tuple[dict[str, int], list[Protocol], tuple[str, ...]]:
    """Participant -> trials of the plan; each protocol and each hand of the sessions, once. Adds to `problems`."""
    planned: dict[str, int] = {}
    hands: dict[str, None] = {}
    texts: dict[str, Path] = {}  # a protocol, as stored -> a session that follows it
    for session in sessions:
        with contextlib.suppress(InputError):  # `phd verify` names what is wrong
            planned[session.parent.name.removeprefix("sub-")] = planned_trials(session)
            protocol, hand = protocol_and_hand(session)
            texts.setdefault(json.dumps(protocol, sort_keys=True), session)
            hands[hand] = None
    protocols = []
    for session in texts.values():
        with _noting(problems):
            protocols.append(read_stored(session).protocol)
    return planned, protocols, tuple(hands)


@contextlib.contextmanager
def _noting(problems: list[str]) -> Iterator[None]:
    """Add an InputError to the problems, and go on."""
    try:
        yield
    except InputError as error:
        problems.append(str(error))


def _labels(trials: Trials) -> dict[Controller, str]:
    return {number: f"controller\n{number}" for number in controllers_of(trials) if isinstance(number, int)}


def _configurations(trials: Trials) -> tuple[str, ...]:
    return tuple(dict.fromkeys(trials["configuration"]))


def _answers(sessions: Sequence[Path]) -> list[AnswerSet]:
    """All answers; a controller stands as its code until the session is unblinded."""
    keys = {session.parent.name.removeprefix("sub-"): journal_summary(session).key or {} for session in sessions}
    answers, _ = answers_and_notes(sessions)
    return [a._replace(controller=keys[a.participant].get(str(a.controller), a.controller)) for a in answers]


class ResultsJob(NamedTuple):
    """A page of results, and the folder to write it into."""

    page: str  # of `charts`
    trials: Trials  # their recordings are named from the data folder
    answers: tuple[AnswerSet, ...]
    view: View
    note: str  # stands on every figure
    data_dir: Path
    sessions: tuple[Path, ...]  # whose answers and notes come along, or of which a report is written
    folder: Path  # must be new
    report: bool = False  # of each session, in place of figures and tables
