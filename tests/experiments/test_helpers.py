"""A study on several processes is the one that a single process would run."""

import errno
import os
import sys

import pytest
from protocols import PEOPLE, short

from experiments.analysis.trials_table import read_table
from experiments.session.verify import verify
from experiments.study import study as studies
from experiments.study.helpers import helpers
from experiments.study.study import resume_study, run_study
from experiments.study.unrecorded import study_trials


def test_the_table_is_the_one_of_operators_one_after_another(tmp_path):
    protocol = short(paths=1, seed="6")
    assert run_study(tmp_path / "study", 3, protocol, PEOPLE)["trials"] == 30
    rows = read_table(tmp_path / "study" / "trials.csv")
    alone = list(study_trials(protocol, PEOPLE, 3))
    assert [row.participant for row in rows] == ["01"] * 10 + ["02"] * 10 + ["03"] * 10
    assert [{name: getattr(row, name) for name in one.measures} for row, one in zip(rows, alone, strict=True)] == [
        one.measures for one in alone
    ]


@pytest.mark.skipif(sys.platform != "linux", reason="where helpers are not forked they do not see the change")
def test_a_disk_that_is_full_for_one_operator_stops_all_and_the_study_goes_on_later(tmp_path, monkeypatch):
    real = studies.Run.run_ticks

    def run_ticks(self, trial, writer):
        if writer.path.parts[-4] == "sub-02":
            raise OSError(errno.ENOSPC, "No space left on device")
        real(self, trial, writer)

    with monkeypatch.context() as patch, pytest.raises(OSError, match="participant 02; .* --resume"):
        patch.setattr(studies.Run, "run_ticks", run_ticks)
        run_study(tmp_path / "study", 3, short(paths=1, seed="6"), PEOPLE)
    summary = resume_study(tmp_path / "study", {})
    done = [row for row in read_table(tmp_path / "study" / "trials.csv") if row.status == "done"]
    assert len(done) == 30 and summary["recovered"] == 1 and verify(tmp_path / "study")["faults"] == []


def test_a_killed_helper_is_an_error_that_says_how_to_go_on():
    with pytest.raises(OSError, match="--resume"), helpers(1) as beside:
        beside.pool.submit(os._exit, 1).result()
