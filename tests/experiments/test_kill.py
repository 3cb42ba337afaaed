"""kill -9 at random moments: nothing that was acknowledged is lost, and the session goes on.

That ticks are committed in time is in test_recording.
"""

import sys
from collections import Counter
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from killed_phd import KilledPhd

from experiments.analysis.trials_table import COUNTED
from experiments.recording import Recording
from experiments.store.cells import cell, open_trials
from experiments.store.files import STUDY, is_half_created, recordings_in, rows_of
from experiments.store.journal import BEGUN, journal_summary, read_events
from experiments.store.recording import read_recording
from experiments.store.session import Session
from experiments.store.stored import read_stored
from experiments.store.verify import verify
from tests.support.rows import read_rows

TRIALS = 10  # of a study

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the processes to kill are forks")


def kept_by(folder: Path) -> dict[Path, Recording]:
    """Every recording that can be read, from its file or the database."""
    session = folder / "sub-01" / "ses-01"
    return {path: read_recording(path) for path in recordings_in(session)} if not is_half_created(session) else {}


def check_after_kill(folder: Path, reference: Path | None) -> None:
    """A kill damages nothing and names what it cut off; opened, every tick that was there is there, and no fault.

    reference: the same study uninterrupted, if no earlier kill has touched this one: then all must be the same.
    """
    session = folder / "sub-01" / "ses-01"
    if not folder.exists() or is_half_created(session):
        return
    before, rows_before, events_before = kept_by(folder), rows_of(session), read_events(session)
    named = {fault["file"] for fault in verify(folder)["faults"]}
    for path, recording in before.items():
        assert not recording.damaged, "a kill damages nothing"
        assert recording.whole or path.relative_to(folder).as_posix() in named, (
            "it was cut off and verify does not say so"
        )
    assert not journal_summary(session).faults
    opened = Session.resume(folder, "01", sync=False)
    opened.close()
    assert not opened.repaired.not_repaired
    assert {fault["file"] for fault in verify(folder)["faults"]} <= {"trials.csv"}, "the pooled table is the study's"
    rows = {row.run: row for row in rows_of(session)}
    assert list(rows.values())[: len(rows_before)] == rows_before, "a row that was there has changed"
    assert read_events(session)[: len(events_before)] == events_before, "an event that was there has changed"
    begun = {entry.about["run"] for entry in read_events(session) if entry.event is BEGUN}
    assert begun <= set(rows), "a trial that was begun has no row"
    for path, recording in before.items():
        kept = read_recording(path)
        assert kept.whole and kept.rows == recording.rows
        assert all(np.array_equal(kept.columns[k], v, equal_nan=True) for k, v in recording.columns.items())
    if reference:
        theirs = {row.run: row for row in rows_of(reference / "sub-01" / "ses-01")}
        assert all(row == theirs[run] for run, row in rows.items() if row.status in COUNTED)
        for path in before:
            now, then = read_recording(path).columns, read_recording(reference / path.relative_to(folder)).columns
            assert all(np.array_equal(v, then[k][: len(v)], equal_nan=True) for k, v in now.items())


def check_complete(folder: Path) -> None:
    """Every cell of the plan is settled exactly once, whatever happened on the way."""
    session = folder / "sub-01" / "ses-01"
    rows = read_rows(folder / "trials.csv")
    settled = Counter(cell(row) for row in rows if row.status in COUNTED)
    assert settled == Counter(cell(trial) for trial in read_stored(session).plan)
    assert {row.status for row in rows} <= {*COUNTED, "recovered"} and len({row.run for row in rows}) == len(rows)
    assert verify(folder)["faults"] == [] and (folder / "figures" / "boxplots.png").exists()


def trials_open(folder: Path) -> int:
    """How many trials of the plan are not settled."""
    session = folder / "sub-01" / "ses-01"
    return len(open_trials(read_stored(session).plan, rows_of(session))) if not is_half_created(session) else TRIALS


def trials_s(folder: Path) -> float:
    """How long the trials of a study took, from the first to the last."""
    first, last = (datetime.fromisoformat(read_events(folder / "sub-01" / "ses-01")[k].time) for k in (0, -1))
    return (last - first).total_seconds()


def kill_studies(phd: KilledPhd, place: Path, kills: int, reference: Path, seed: int) -> Counter:
    """Kill studies and resumed studies at random moments until `kills` have hit: most while trials run,
    some while the figures are drawn."""
    generator = np.random.default_rng(seed)
    seen: Counter = Counter()
    chain, trial_s = 0, trials_s(reference) / TRIALS
    while seen["kills"] < kills:
        folder, fresh = place / f"study-{chain}", True
        chain += 1
        start = [*phd.study, "--out", str(folder)]
        while True:
            resume = (folder / STUDY).exists()
            still_open = trials_open(folder)
            wait = generator.uniform(0.0, trial_s * still_open + 0.05)
            if seen["kills"] >= kills or (not still_open and generator.random() < 0.7):
                wait = 200.0
            ended = phd.run(wait, phd=["study", "--resume", "--out", str(folder)] if resume else start)
            if not ended["killed"]:
                assert ended["code"] == 0, ended
                break
            seen["kills"] += 1
            if generator.random() < 0.8:  # else the resumed study closes it by itself
                check_after_kill(folder, reference if fresh and not resume else None)
            fresh = fresh and not resume
        check_complete(folder)
        seen["studies completed after kills"] += 1
    return seen


@pytest.fixture(scope="module")
def phd():
    """A phd whose studies have 10 trials."""
    killed = KilledPhd()
    yield killed
    killed.close()


@pytest.fixture(scope="module")
def reference(phd, tmp_path_factory):
    """The study without a kill."""
    folder = tmp_path_factory.mktemp("reference") / "study"
    assert phd.run(250.0, phd=[*phd.study, "--out", str(folder)])["code"] == 0
    return folder


def test_a_killed_study_loses_nothing_and_goes_on(phd, reference, tmp_path):
    seen = kill_studies(phd, tmp_path, 3, reference, seed=11)
    assert seen["kills"] >= 3 and seen["studies completed after kills"] >= 1
