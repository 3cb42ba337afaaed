"""`phd analyze` of folders that a crash or a bad disk has touched: what it leaves out, and what that changes."""

import json
import re
import shutil

import numpy as np
import pytest
from disks import flip_a_bit
from protocols import PEOPLE, short
from sessions import crash_in_trial, files, session_of

from app.cli import main
from experiments.store import session as sessions
from experiments.store.files import pooled_rows, write_pooled_table
from experiments.store.session import Session
from experiments.store.verify import verify
from experiments.study.analyze import analyze
from experiments.study.study import resume_study, run_study
from tests.support.rows import read_rows


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """20 trials of one operator."""
    out = tmp_path_factory.mktemp("analyze") / "study"
    run_study(out, 1, short(seed="6"), PEOPLE)
    return out


def spoil(folder, run):
    flip_a_bit(folder / "sub-01" / "ses-01" / "trials" / f"run-{run:03d}.parquet")


def test_a_damaged_recording_is_left_out_and_its_boxes_alone_are_said_to_change(study, tmp_path, capsys):
    folder = shutil.copytree(study, tmp_path / "copy")
    rows = read_rows(folder / "trials.csv")
    lost = rows[4]
    spoil(folder, lost.run)
    before = files(folder)
    assert main(["analyze", str(folder), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["trials"] == 19 and f"run-{lost.run:03d}" in said["left_out"][0]
    assert files(folder).items() >= before.items()
    analyzed = read_rows(folder / "analysis-1" / "trials.csv")
    assert [row.run for row in analyzed] == [row.run for row in rows if row is not lost]

    same_box = [r for r in rows if (r.controller, r.configuration) == (lost.controller, lost.configuration)]
    assert len(said["changed"]) == 3 and all(lost.configuration in line for line in said["changed"])
    old = np.median([1e3 * r.value("path_error_m") for r in same_box])
    new = np.median([1e3 * r.value("path_error_m") for r in same_box if r.run != lost.run])
    counts, medians = f"{len(same_box)} -> {len(same_box) - 1} trials", re.search(
        r"median (\S+) -> (\S+) mm \((.*)%\)", said["changed"][0]
    )  # fmt: skip
    assert counts in said["changed"][0]
    assert float(medians[1]) == pytest.approx(old, rel=1e-3) and float(medians[2]) == pytest.approx(new, rel=1e-3)
    assert float(medians[3]) == pytest.approx(100.0 * (new / old - 1.0), abs=0.06)


def test_what_is_excluded_or_redone_later_is_in_the_studys_table_and_a_stale_table_is_said_to_differ(study, tmp_path):
    folder = shutil.copytree(study, tmp_path / "study")
    session = Session.resume(folder, "01", sync=False)
    runs = [row.run for row in session.rows[:2]]
    session.exclude(runs[0], "the participant sneezed")
    session.redo(runs[1], "the cable was caught")
    session.close()
    assert [row.status for row in pooled_rows(folder) if row.run in runs] == ["excluded", "redone"]
    assert analyze(folder, tmp_path / "fresh")["changed"] == []
    assert [fault["file"] for fault in verify(folder)["faults"]] == ["trials.csv"]
    assert resume_study(folder, {})["trials"] == 21 and verify(folder)["faults"] == []


def test_the_energy_of_a_trial_that_was_cut_off_is_not_made_up(tmp_path):
    with session_of(tmp_path, 1) as session:
        crash_in_trial(session)
    sessions.Session.resume(tmp_path, "01", sync=False).close()
    assert list(write_pooled_table(tmp_path)["energy_residual_J"].notna()) == [True, False]


def test_an_analysis_that_is_interrupted_leaves_no_half_of_it(study, tmp_path, monkeypatch):
    def interrupted(data, folder, **_):
        folder.mkdir()
        raise KeyboardInterrupt

    monkeypatch.setattr("experiments.study.analyze.draw_boxplots", interrupted)
    with pytest.raises(KeyboardInterrupt):
        analyze(study, tmp_path / "out")
    assert not (tmp_path / "out").exists()
