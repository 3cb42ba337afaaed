"""kill -9 at random moments: nothing that was acknowledged is lost, everything is readable or recovered.

That ticks are in the file in time, and a cut file gives back every whole batch, is in test_recording.

Run as a script with a number of kills, it does as many and prints what it saw:
python tests/experiments/test_kill.py 200
"""

import sys
import tempfile
from collections import Counter
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[k] / place) for k, place in ((2, ""), (1, "support"))]

from killed_phd import KilledPhd

from experiments.analysis.trials_table import COUNTED, TrialRow
from experiments.recording.reader import read_recording
from experiments.session.files import cell, open_trials, read_stored, rows_of
from experiments.session.journal import journal_summary, read_events
from experiments.session.recover import recover
from experiments.session.verify import verify
from tests.support.rows import read_rows

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the processes to kill are forks")


def streams(folder: Path) -> dict[str, object]:
    """Name -> what can be read of each stream that has not become Parquet."""
    return {path.relative_to(folder).as_posix(): read_recording(path) for path in folder.rglob("run-*.arrows")}


def table(folder: Path) -> list[TrialRow]:
    path = folder / "sub-01" / "ses-01" / "trials.csv"
    return read_rows(path) if path.exists() else []


def check_after_kill(folder: Path, reference: Path | None) -> None:
    """What a kill left is named by verify; recovered, every tick that was in a file is there, and no fault is left.

    reference: the same study uninterrupted, if no earlier kill has touched this one: then all must be the same.
    """
    if not folder.exists() or not any(folder.glob("sub-*")):
        assert not folder.exists() or verify(folder)["faults"] == []
        return
    session = folder / "sub-01" / "ses-01"
    before, rows_before = streams(folder), table(folder)
    named = {fault["file"] for fault in verify(folder)["faults"]}
    for name, stream in before.items():
        assert stream.whole or name in named, f"{name} is not whole and verify does not say so"
        assert not [fault for fault in stream.damaged if not fault.startswith("header")], "a kill damages nothing"
    begun = journal_summary(session).begun
    done = recover(folder)
    assert not done["faults"] and not done["not_rescued"], done
    table_now = table(folder)  # it may have gained columns, too, that only its new rows fill
    assert table_now[: len(rows_before)] == rows_before, "a row that was there has changed"
    rows = {row.run: row for row in table_now}
    assert set(begun) <= set(rows), "a trial that was begun has no row"
    for name, stream in before.items():
        if stream.columns:
            kept = read_recording((folder / name).with_suffix(".parquet"))
            assert kept.whole and kept.rows == stream.rows
            assert all(np.array_equal(kept.columns[k], v, equal_nan=True) for k, v in stream.columns.items())
    for run, row in rows.items():
        if row.recording:
            kept = read_recording(session / row.recording)
            assert kept.whole
            if reference:
                true = read_recording(reference / "sub-01" / "ses-01" / "trials" / f"run-{run:03d}.parquet")
                now, then = kept.columns, true.columns
                assert all(np.array_equal(v, then[k][: kept.rows], equal_nan=True) for k, v in now.items())
    if reference:
        theirs = {row.run: row for row in read_rows(reference / "sub-01" / "ses-01" / "trials.csv")}
        assert all(row == theirs[run] for run, row in rows.items() if row.status in COUNTED)


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
    return len(open_trials(read_stored(session).plan, rows_of(session))) if (session / "session.json").exists() else 20


def trials_s(folder: Path) -> float:
    """How long the trials of a study took, from the first to the last."""
    first, last = (datetime.fromisoformat(read_events(folder / "sub-01" / "ses-01")[k].time) for k in (0, -1))
    return (last - first).total_seconds()


def kill_studies(phd: KilledPhd, place: Path, kills: int, reference: Path, seed: int) -> Counter:
    """Kill studies, resumed studies and recoveries at random moments until `kills` have hit: most while trials run,
    some while the figures are drawn."""
    generator = np.random.default_rng(seed)
    seen: Counter = Counter()
    chain, trial_s = 0, trials_s(reference) / 20
    while seen["kills"] < kills:
        folder, fresh = place / f"study-{chain}", True
        chain += 1
        start = [*phd.study, "--out", str(folder)]
        while True:
            resume = (folder / "study.json").exists()
            still_open = trials_open(folder)
            wait = generator.uniform(0.0, trial_s * still_open + 0.05)
            if seen["kills"] >= kills or (not still_open and generator.random() < 0.7):
                wait = 200.0
            ended = phd.run(wait, phd=["study", "--resume", "--out", str(folder)] if resume else start)
            if not ended["killed"]:
                assert ended["code"] == 0, ended
                break
            seen["kills"] += 1
            while seen["kills"] < kills and (folder / "study.json").exists() and generator.random() < 0.3:
                if phd.run(generator.uniform(0.0, 0.06), phd=["recover", str(folder)])["killed"]:
                    seen["kills"] += 1
            if generator.random() < 0.8:  # else the resumed study recovers by itself
                check_after_kill(folder, reference if fresh and not resume else None)
            fresh = fresh and not resume
        check_complete(folder)
        seen["studies completed after kills"] += 1
    return seen


@pytest.fixture(scope="module")
def phd():
    """A phd whose studies have 20 trials."""
    killed = KilledPhd(blocks=1)
    yield killed
    killed.close()


@pytest.fixture(scope="module")
def reference(phd, tmp_path_factory):
    """The study without a kill."""
    folder = tmp_path_factory.mktemp("reference") / "study"
    assert phd.run(250.0, phd=[*phd.study, "--out", str(folder)])["code"] == 0
    return folder


def test_a_killed_study_loses_nothing_and_goes_on(phd, reference, tmp_path):
    seen = kill_studies(phd, tmp_path, 4, reference, seed=11)
    assert seen["kills"] >= 4 and seen["studies completed after kills"] >= 1


if __name__ == "__main__":
    count, server = int(sys.argv[1]), KilledPhd(blocks=1)
    with tempfile.TemporaryDirectory() as name:
        whole = Path(name) / "reference"
        server.run(250.0, phd=[*server.study, "--out", str(whole)])
        print(dict(kill_studies(server, Path(name), count, whole, seed=1)))
    server.close()
