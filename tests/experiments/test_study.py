"""The study from outside: what it leaves, that it repeats, and what it refuses."""

import dataclasses
import errno
import json
import os
import re
import sys
from pathlib import Path

import conclusions
import numpy as np
import pytest
from exports import rows as csv_rows
from protocols import PEOPLE, short

from app.cli import main
from experiments.analysis.metrics import DRAWN, METRICS
from experiments.protocol import Protocol, protocol_from_json, protocol_to_json
from experiments.store.journal import read_events
from experiments.store.recording import read_recording
from experiments.store.stored import read_stored
from experiments.store.verify import verify
from experiments.study import study as studies
from experiments.study.helpers import helpers
from experiments.study.study import resume_study, run_study
from experiments.study.unrecorded import study_trials
from experiments.trial.normals import Normals, normals
from experiments.trial.population import load_population
from experiments.trial.trial import NOISE_DRAWS
from tests.support.rows import read_rows, with_measures

ALSO_NAMED = [
    "t_s", "phase", "tip_x_m", "tip_y_m", "tip_vx_m_s", "tip_vy_m_s", "tip_ax_m_s2", "tip_ay_m_s2", "hand_fx_N",
    "hand_fy_N", "current_A_A", "current_E_A", "current_B_A", "torque_A_N_m", "torque_E_N_m", "torque_B_N_m", "stuck",
    "decision", "lateness_us", "energy_hand_J", "energy_brakes_J", "energy_kinetic_J", "energy_stops_J",
]  # fmt: skip
TABLE = (
    "participant,run,block,configuration,controller,path,repetition,status,path_error_m,path_error_time_m,"
    "mean_tip_force_N,acceleration_dft_sum,acceleration_weighted_rms_m_s2,force_over_progress_N,duration_s,"
    "peak_error_m,path_length_ratio,sparc,switches_per_s,unreachable_share,recording,energy_residual_J,"
    "energy_added_max_J,acceleration_exact_dft_sum,locked_share,released_share,acceleration_dft_sum_ramp_removed"
).split(",")


def seeded(seed: int) -> Protocol:
    """10 trials, the seed given beside the file."""
    return protocol_from_json({**protocol_to_json(short(paths=1)), "overrides": {"seed": seed}}, "test")


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Path:
    """One operator's study."""
    out = tmp_path_factory.mktemp("studies") / "one"
    with conclusions.error_bars():
        run_study(out, 1, seeded(4), PEOPLE)
    return out


def test_a_study_leaves_the_folders_names_and_columns_that_others_rely_on(study):
    session = study / "sub-01" / "ses-01"
    stored = read_stored(session)
    assert len(stored.plan) == 10 and len(stored.about["plan_sha256"]) == 64 and stored.about["seed"] == 4
    assert stored.protocol.text == short(paths=1).text and stored.about["assumed"] is True
    assert stored.protocol.overrides == {"seed": 4}
    assert [device.name for device in stored.protocol.devices] == ["three-brake", "four-brake"]
    assert [entry.event.name for entry in read_events(session)][:2] == ["created", "trial begun"]
    assert sorted(p.name for p in (session / "trials").iterdir()) == [f"run-{k:03d}.parquet" for k in range(1, 11)]
    rows = csv_rows(study / "trials.csv")
    assert list(rows[0])[: len(TABLE)] == TABLE and len(rows) == 10  # a new measure comes after them
    for row in rows:
        assert (study / row["recording"]).is_file()
    three = next(row for row in rows if row["configuration"] == "three-brake")
    assert list(read_recording(study / three["recording"]).columns)[: len(ALSO_NAMED)] == ALSO_NAMED


def test_analyze_rebuilds_every_number_and_figure_from_the_recordings_alone(study, tmp_path, capsys):
    before = {p: p.read_bytes() for p in study.rglob("*") if p.is_file() and p.suffix != ".parquet"}
    hidden = {path: path.with_suffix(".hidden") for path in (*study.rglob("trials.csv"), study / "study.db")}
    for path, elsewhere in hidden.items():
        path.rename(elsewhere)
    try:
        with conclusions.error_bars():
            assert main(["analyze", str(study), "--out", str(tmp_path / "out"), "--json"]) == 0
    finally:
        for path, elsewhere in hidden.items():
            elsewhere.rename(path)
    assert json.loads(capsys.readouterr().out)["trials"] == 10
    old, new = read_rows(study / "trials.csv"), read_rows(tmp_path / "out" / "trials.csv")
    for a, b in zip(old, new, strict=True):
        assert a.in_folder("x") != a and {**vars(a), "recording": ""} == {**vars(b), "recording": ""}
        assert (tmp_path / "out" / b.recording).resolve() == (study / a.recording).resolve()
    assert (tmp_path / "out" / "figures" / "boxplots.png").is_file()
    assert {p: p.read_bytes() for p in before} == before
    bars = [(folder / "report" / "simulation_errors.csv").read_bytes() for folder in (study, tmp_path / "out")]
    assert bars[0] == bars[1]
    headers = [(folder / "report" / "report.md").read_text().split("## ")[0] for folder in (study, tmp_path / "out")]
    assert headers[0] == headers[1] and "simulated operators (from-device population; changed after" in headers[0]


def test_the_table_is_the_one_of_operators_one_after_another_and_of_trials_without_recordings_bit_by_bit(tmp_path):
    protocol, population = short(paths=1, seed="7", rules='"literal"'), load_population("tremulous")
    assert run_study(tmp_path / "study", 2, protocol, population)["trials"] == 20
    rows = read_rows(tmp_path / "study" / "trials.csv")
    trials = [row for row, _ in study_trials(protocol, population, 2)]
    assert [row.participant for row in rows] == ["01"] * 10 + ["02"] * 10
    assert [dataclasses.replace(row, recording="") for row in rows] == trials
    few, _ = next(study_trials(protocol, population, 1, DRAWN))
    drawn = {metric.name for metric in DRAWN}
    others = {metric.name: None for metric in METRICS if metric.name not in drawn}
    assert few == with_measures(trials[0], **others)


@pytest.mark.skipif(sys.platform != "linux", reason="where helpers are not forked they do not see the change")
def test_a_disk_that_is_full_for_one_operator_stops_all_and_the_study_goes_on_later(tmp_path, monkeypatch):
    real = studies.StudyRun.run_ticks

    def run_ticks(self, trial, writer):
        if writer.database.path.parts[-3] == "sub-02":
            raise OSError(errno.ENOSPC, "No space left on device")
        real(self, trial, writer)

    with monkeypatch.context() as patch, pytest.raises(OSError, match="participant 02; .* --resume"):
        patch.setattr(studies.StudyRun, "run_ticks", run_ticks)
        run_study(tmp_path / "study", 2, short(paths=1, seed="6"), PEOPLE)
    summary = resume_study(tmp_path / "study", {})
    done = [row for row in read_rows(tmp_path / "study" / "trials.csv") if row.status == "done"]
    counts = [re.findall(r": (\d+)", summary[f"findings_{how}"]) for how in ("by_boxes", "within_participants")]
    assert [sum(map(int, found)) for found in counts] == [11, 11] and counts[0] != counts[1]
    assert len(done) == 20 and summary["recovered"] == 1 and verify(tmp_path / "study")["faults"] == []


def test_no_trial_changes_the_draws_that_the_others_take_which_are_those_of_the_generator():
    first, _ = next(study_trials(short(seed="8"), load_population("average"), 1))
    key = 8, 1, first.path, first.repetition
    generator = np.random.default_rng(np.random.SeedSequence(key))
    kept = normals(*key)
    for size in (6, (NOISE_DRAWS, 2)):
        assert np.array_equal(kept.standard_normal(size), generator.standard_normal(size))
    drawn = Normals(3, 1)
    generator = np.random.default_rng(np.random.SeedSequence([3, 1]))
    expected = generator.standard_normal(6), generator.standard_normal((100, 2))
    for _ in range(2):
        assert np.array_equal(drawn.standard_normal(6), expected[0])
        assert np.array_equal(drawn.standard_normal((100, 2)), expected[1])


def test_a_killed_helper_is_an_error_that_says_how_to_go_on():
    with pytest.raises(OSError, match="--resume"), helpers(1) as beside:
        beside.pool.submit(os._exit, 1).result()
