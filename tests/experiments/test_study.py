"""A study from outside: what it leaves, that its recordings alone give it again, that it goes on after any end."""

import dataclasses
import json
import os
import re
import shutil
import sys
from collections import Counter
from pathlib import Path

import conclusions
import numpy as np
import pandas as pd
import pytest
from disks import Disk, flip_a_bit, full
from exports import rows as csv_rows
from msgspec.structs import replace
from protocols import PAPER, PEOPLE, assuming, protocol_of, short
from rows import read_rows, with_measures
from sessions import closed_session, crash_in_trial, files, new_session, of, run_trials, session_of

from app.cli import main
from core.files import InputError
from experiments.analysis.gap_reading import GAP, gap_sentence
from experiments.analysis.metrics import DRAWN, JUDGED, METRICS
from experiments.analysis.simulation_errors import STEP
from experiments.analysis.trials_table import COUNTED, as_table
from experiments.protocol import Protocol, load_protocol, protocol_from_json, protocol_to_json
from experiments.store.cells import cell
from experiments.store.files import hold_lock, pooled_rows, write_pooled_table
from experiments.store.journal import read_events
from experiments.store.recording import read_recording
from experiments.store.session import Session
from experiments.store.stored import read_stored
from experiments.store.study_plan import read_study
from experiments.store.verify import verify
from experiments.study.analyze import analyze
from experiments.study.gap_reading import gap_read_otherwise, with_gap_read_as
from experiments.study.helpers import helpers
from experiments.study.study import resume_study, run_study
from experiments.study.unrecorded import (
    BRAKES,
    DETECTED_M_S2,
    GAINS,
    person_of,
    simulation_errors,
    study_trials,
    vibrations,
    with_low_gain_found,
)
from experiments.trial.normals import Normals, normals
from experiments.trial.population import load_population
from experiments.trial.trial import NOISE_DRAWS

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
THREE = '["three-brake"]'  # devices, where one is enough: five trials an operator and path


@pytest.fixture
def study(whole_study: Path, tmp_path: Path) -> Path:
    """A copy to change."""
    return shutil.copytree(whole_study, tmp_path / "study")


def test_a_study_leaves_the_folders_names_and_columns_that_others_rely_on(whole_study):
    session = whole_study / "sub-01" / "ses-01"
    stored = read_stored(session)
    assert len(stored.plan) == 20 and len(stored.about["plan_sha256"]) == 64 and stored.about["seed"] == 4
    assert stored.protocol.text == short().text and stored.about["assumed"] is True
    assert stored.protocol.overrides == {"seed": 4}
    assert [device.name for device in stored.protocol.devices] == ["three-brake", "four-brake"]
    assert [entry.event.name for entry in read_events(session)][:2] == ["created", "trial begun"]
    assert sorted(p.name for p in (session / "trials").iterdir()) == [f"run-{k:03d}.parquet" for k in range(1, 21)]
    rows = csv_rows(whole_study / "trials.csv")
    assert list(rows[0])[: len(TABLE)] == TABLE and len(rows) == 20  # a new measure comes after them
    assert all((whole_study / row["recording"]).is_file() for row in rows)
    three = next(row for row in rows if row["configuration"] == "three-brake")
    assert list(read_recording(whole_study / three["recording"]).columns)[: len(ALSO_NAMED)] == ALSO_NAMED


def test_analyze_rebuilds_every_number_and_the_report_from_the_recordings_alone(study, tmp_path, capsys):
    before = {name: content for name, content in files(study).items() if not name.endswith(".parquet")}
    hidden = {path: path.with_suffix(".hidden") for path in (*study.rglob("trials.csv"), study / "study.db")}
    for path, elsewhere in hidden.items():
        path.rename(elsewhere)
    assert main(["analyze", str(study), "--out", str(tmp_path / "out"), "--json"]) == 0
    for path, elsewhere in hidden.items():
        elsewhere.rename(path)
    assert json.loads(capsys.readouterr().out)["trials"] == 20
    old, new = read_rows(study / "trials.csv"), read_rows(tmp_path / "out" / "trials.csv")
    for a, b in zip(old, new, strict=True):
        assert {**vars(a), "recording": ""} == {**vars(b), "recording": ""}
        assert (tmp_path / "out" / b.recording).resolve() == (study / a.recording).resolve()
    assert (tmp_path / "out" / "figures" / "boxplots.png").is_file()
    assert files(study).items() >= before.items()
    reports = [folder / "report" for folder in (study, tmp_path / "out")]
    assert len({(report / "findings.csv").read_bytes() for report in reports}) == 1
    headers = [(report / "report.md").read_text().split("## ")[0] for report in reports]
    assert headers[0] == headers[1] and "simulated operators (from-device population; changed after" in headers[0]


def test_the_table_is_the_one_of_operators_one_after_another_and_of_trials_without_recordings_bit_by_bit(tmp_path):
    (tmp_path / ".study.db.partial").write_text("{")  # here a study was hardly begun
    (tmp_path / ".study.db.partial-wal").write_text("{")
    (tmp_path / ".lock").touch()
    protocol, population = short(paths=1, seed="7", rules='"literal"', devices=THREE), load_population("tremulous")
    assert run_study(tmp_path, 2, protocol, population)["trials"] == 10
    rows = read_rows(tmp_path / "trials.csv")
    trials = [row for row, _ in study_trials(protocol, population, 2)]
    assert [row.participant for row in rows] == ["01"] * 5 + ["02"] * 5
    assert [dataclasses.replace(row, recording="") for row in rows] == trials
    few, _ = next(study_trials(protocol, population, 1, DRAWN))
    others = {metric.name: None for metric in METRICS if metric.name not in {one.name for one in DRAWN}}
    assert few == with_measures(trials[0], **others)


@pytest.mark.skipif(sys.platform != "linux", reason="where helpers are not forked they do not see the change")
def test_a_disk_that_is_full_for_one_operator_stops_all_and_the_study_goes_on_later(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        disk = Disk(patch)
        disk.refuses, disk.room, disk.only_folder = full, 12, tmp_path / "study" / "sub-02"
        with pytest.raises(OSError, match="participant 02; .* --resume"):
            run_study(tmp_path / "study", 2, short(paths=1, seed="6", devices=THREE), PEOPLE)
    summary = resume_study(tmp_path / "study", {})
    done = [row for row in read_rows(tmp_path / "study" / "trials.csv") if row.status == "done"]
    counts = [re.findall(r": (\d+)", summary[f"findings_{how}"]) for how in ("by_boxes", "within_participants")]
    assert [sum(map(int, found)) for found in counts] == [11, 11]
    assert len(done) == 10 and verify(tmp_path / "study")["faults"] == []


def test_no_trial_changes_the_draws_that_the_others_take_which_are_those_of_the_generator():
    first, _ = next(study_trials(short(seed="8"), load_population("average"), 1))
    key = 8, 1, first.path, first.repetition
    for drawn, seed in ((normals(*key), key), (Normals(3, 1), [3, 1])):
        generator = np.random.default_rng(np.random.SeedSequence(seed))
        expected = generator.standard_normal(6), generator.standard_normal((NOISE_DRAWS, 2))
        for _ in range(2):
            assert np.array_equal(drawn.standard_normal(6), expected[0])
            assert np.array_equal(drawn.standard_normal((NOISE_DRAWS, 2)), expected[1])


def test_a_killed_helper_is_an_error_that_says_how_to_go_on():
    with pytest.raises(OSError, match="--resume"), helpers(1) as beside:
        beside.pool.submit(os._exit, 1).result()


# ------------------------------------------------------------------------------------------------ analysed afterwards


def test_a_damaged_recording_is_left_out_and_its_boxes_alone_are_said_to_change(study, capsys):
    rows = read_rows(study / "trials.csv")
    lost = rows[4]
    flip_a_bit(study / "sub-01" / "ses-01" / "trials" / f"run-{lost.run:03d}.parquet")
    before = files(study)
    assert main(["analyze", str(study), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["trials"] == 19 and f"run-{lost.run:03d}" in said["left_out"][0]
    assert files(study).items() >= before.items()
    analyzed = read_rows(study / "analysis-1" / "trials.csv")
    assert [row.run for row in analyzed] == [row.run for row in rows if row is not lost]

    same_box = [r for r in rows if (r.controller, r.configuration) == (lost.controller, lost.configuration)]
    assert len(said["changed"]) == 3 and all(lost.configuration in line for line in said["changed"])
    assert f"{len(same_box)} -> {len(same_box) - 1} trials" in said["changed"][0]
    old = np.median([1e3 * r.value("path_error_m") for r in same_box])
    new = np.median([1e3 * r.value("path_error_m") for r in same_box if r.run != lost.run])
    medians = re.search(r"median (\S+) -> (\S+) mm \((.*)%\)", said["changed"][0])
    assert [float(number) for number in medians.groups()[:2]] == pytest.approx([old, new], rel=1e-3)
    assert float(medians[3]) == pytest.approx(100.0 * (new / old - 1.0), abs=0.06)


def test_what_is_excluded_or_redone_later_is_in_the_studys_table_and_a_stale_table_is_said_to_differ(study, tmp_path):
    session = Session.resume(study, "01", sync=False)
    runs = [row.run for row in session.rows[:2]]
    session.exclude(runs[0], "the participant sneezed")
    session.redo(runs[1], "the cable was caught")
    session.close()
    assert [row.status for row in pooled_rows(study) if row.run in runs] == ["excluded", "redone"]
    assert analyze(study, tmp_path / "fresh")["changed"] == []
    assert [fault["file"] for fault in verify(study)["faults"]] == ["trials.csv"]
    assert resume_study(study, {})["trials"] == 21 and verify(study)["faults"] == []


def interrupt(_: float) -> None:
    """Ctrl-C, as soon as there is progress."""
    raise KeyboardInterrupt


def test_an_analysis_that_is_interrupted_leaves_no_half_of_it(whole_study, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        analyze(whole_study, tmp_path / "out", progress=interrupt)
    assert not (tmp_path / "out").exists()


# --------------------------------------------------------------------------------------------- after a crash it goes on


def test_a_crashed_trial_is_kept_and_its_cell_is_run_again_under_the_next_free_number(tmp_path):
    with session_of(tmp_path, 2) as session:
        crash_in_trial(session)
        plan = session.plan
    session = Session.resume(tmp_path, "01", sync=False)
    assert session.plan == plan and [row.status for row in session.rows] == ["done", "done", "recovered"]
    again = session.next_planned()
    assert again.run == 61 and cell(again) == cell(plan[2])
    run_trials(session, 1)
    assert session.next_planned() == plan[3]  # then on in the order of the plan
    run_trials(session, 1)
    assert [row.run for row in read_rows(session.folder / "trials.csv")] == [1, 2, 3, 61, 4]
    session.close()
    assert verify(tmp_path)["faults"] == []
    energy = write_pooled_table(tmp_path).set_index("run")["energy_residual_J"].notna()
    assert set(energy[energy].index) == {1, 2, 61, 4}, "that of a trial that was cut off is not made up"


def test_a_session_without_a_crash_goes_on_as_it_was_stored_whatever_the_protocols_file_says_today(tmp_path):
    session = closed_session(tmp_path, 2, protocol=short(rules='"literal"'))
    again = Session.resume(tmp_path, "01", sync=False)
    assert again.next_planned() == session.plan[2] and again.person == session.person
    assert again.rows == session.rows and again.plan == session.plan and len(again.plan) == 20
    assert again.protocol.text == session.protocol.text and again.protocol.rules == "literal"
    assert again.protocol.note() == session.protocol.note() and again.protocol.paths == PAPER.paths
    assert [device.text for device in again.protocol.devices] == [device.text for device in PAPER.devices]
    with pytest.raises(InputError, match="is using this folder"):
        Session.resume(tmp_path, "01")
    again.close()
    with pytest.raises(InputError, match="exists already"):
        new_session(tmp_path)


@pytest.mark.parametrize("blind", [False, True])
def test_a_session_that_was_hardly_created_is_created_anew(tmp_path, blind):
    of(tmp_path).mkdir(parents=True)
    (of(tmp_path) / "session.db").touch()
    session = new_session(tmp_path, protocol=short(), blind=blind)
    assert session.next_planned().run == 1 and not list(session.folder.glob(".*.partial"))
    assert session.preset(session.plan[0]) in PAPER.controllers.values()
    session.close()
    Session.resume(tmp_path, "01", sync=False).close()


def high() -> Protocol:
    """10 trials an operator, the low gain of 500 N s/m."""
    return protocol_from_json({**protocol_to_json(short(paths=1, seed="5")), "overrides": {"low_gain": 500.0}}, "test")


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Path:
    """A study of three operators that was interrupted after a trial or two; the next one of the first crashed."""
    folder = tmp_path_factory.mktemp("begun") / "study"
    with pytest.raises(KeyboardInterrupt, match="--resume"):
        run_study(folder, 3, high(), PEOPLE, progress=interrupt)
    crash_in_trial(Session.resume(folder, "01", sync=False))
    return folder


@pytest.fixture
def interrupted(begun, tmp_path) -> Path:
    """A copy to go on with."""
    return shutil.copytree(begun, tmp_path / "study")


def test_an_interrupted_study_goes_on_with_what_it_was_begun_with_and_draws_what_is_not_whole(interrupted, capsys):
    before = files(interrupted)
    rows_before = {name: read_rows(interrupted / name) for name in before if name.endswith("ses-01/trials.csv")}
    asked = ["--seed", "5", "--operators", "3", "--low-gain", "500", "--rules", "settled"]  # what it was begun with
    assert main(["study", "--resume", "--out", str(interrupted), *asked, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["trials"], said["recovered"], said["low_gain_N_s_m"]) == (31, 1, 500.0)
    rows = read_rows(interrupted / "trials.csv")
    for participant in ("01", "02", "03"):
        plan = read_stored(interrupted / f"sub-{participant}" / "ses-01").plan
        planned = Counter((t.configuration, t.controller, t.path, t.block) for t in plan)
        counted = [row for row in rows if row.participant == participant and row.status in COUNTED]
        assert Counter((r.configuration, r.controller, r.path, r.block) for r in counted) == planned
    assert [(row.run, row.status) for row in rows if row.status not in COUNTED] == [(2, "recovered")]
    assert verify(interrupted)["faults"] == []
    after = files(interrupted)
    for name, content in before.items():  # nothing that was there has changed
        if name in rows_before:  # it gains rows, and columns that only these fill
            assert read_rows(interrupted / name)[: len(rows_before[name])] == rows_before[name]
        elif not name.endswith((".db", ".db-wal", ".db-shm")):
            assert after[name] == content

    assert resume_study(interrupted, {})["trials"] == 31 and files(interrupted) == after  # it is complete
    half = (interrupted / "figures").rename(interrupted / ".figures.partial")  # as a kill while it draws leaves it
    (half / "fig16_path_error.png").write_bytes(b"half")
    assert resume_study(interrupted, {})["trials"] == 31 and files(interrupted) == after

    theirs = [row for row, _ in study_trials(high(), PEOPLE, 3)]  # the study without a crash
    rows = [dataclasses.replace(row, recording="") for row in rows]
    assert [r for r in rows if r.participant == "03"] == [r for r in theirs if r.participant == "03"]
    assert rows[0] == theirs[0], "before the crash"


def test_what_is_asked_by_name_must_be_what_the_study_was_begun_with(interrupted, capsys):
    before = files(interrupted)
    for arguments, said in (
        (["displays"], "begun with another protocol (paper)"),
        (["--seed", "6"], "--seed: the study was begun with 5"),
        (["--operators", "2"], "--operators: the study was begun with 3"),
        (["--rules", "literal"], "--rules: the study was begun with settled"),
        (["--low-gain", "5"], "--low-gain: the study was begun with 500"),
        (["--device", "four-brake"], "--device: the study was begun with other devices"),
    ):
        assert main(["study", "--resume", "--out", str(interrupted), *arguments]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and said in error
    assert files(interrupted) == before


@pytest.mark.parametrize("there", ["none", "empty", "half", "damaged", "running"])
def test_a_folder_with_nothing_to_resume_is_refused_in_one_sentence(interrupted, tmp_path, capsys, there):
    folder = tmp_path / there
    if there != "none":
        folder.mkdir()
    if there == "half":
        (folder / ".study.db.partial").write_text("{")
    if there == "damaged":
        (folder / "study.db").write_text("no database")
    if there == "running":
        folder = interrupted
    before = files(folder)
    lock = hold_lock(folder) if there == "running" else None
    assert main(["study", "--resume", "--out", str(folder)]) == 2
    if lock:
        lock.release()
    assert capsys.readouterr().err.count("\n") == 1 and files(folder) == before and folder.exists() == (there != "none")


# ------------------------------------------------------------------------------ the low gain by the paper's rule


def test_the_low_gain_found_does_not_vibrate_the_next_one_does_and_another_world_has_another(tmp_path, capsys):
    unsettled = protocol_of(assuming('low_gain = "no vibration"', short(paths=1, devices=THREE).text))
    found = with_low_gain_found(unsettled, PEOPLE)
    low, without = found.controllers[5], vibrations(found, PEOPLE, found.controllers[1])
    step = GAINS.index(found.low_gain)
    added = [vibrations(found, PEOPLE, low.replaced(gain_N_s_m=GAINS[n])) - without for n in (step, step + 1)]
    assert added[0].max() <= DETECTED_M_S2**2 < added[1].max()
    slow = {"low_gain": "no vibration", "sensing": "encoders", "lag_factor": 0.2}
    about = {**protocol_to_json(unsettled), "overrides": {"assumptions": slow}}
    assert with_low_gain_found(protocol_from_json(about, "other"), PEOPLE).low_gain != found.low_gain

    with pytest.raises(InputError, match="find the number on simulated trials; here it must be given in N s/m"):
        new_session(tmp_path, protocol=unsettled)
    path, out = tmp_path / "mine.toml", tmp_path / "out"
    path.write_text(unsettled.text)
    asked = ["study", str(path), "--operators", "1", "--out", str(out)]
    with conclusions.error_bars():
        assert main([*asked, "--json"]) == 0
        analyze(out, tmp_path / "again")
    told = json.loads(capsys.readouterr().out)
    bars = [(folder / "report" / "simulation_errors.csv").read_bytes() for folder in (out, tmp_path / "again")]
    assert bars[0] == bars[1], "the error bars of the analysis are those of the study"
    assert told["low_gain_N_s_m"] == read_study(out).protocol.overrides["low_gain_found"] in GAINS
    assert "(no vibration; Table I prints 5)" in (out / "report" / "report.md").read_text()
    assert main([*asked, "--resume", "--low-gain", "no vibration"]) == 0
    assert main([*asked, "--resume", "--low-gain", "5"]) == 2
    assert "--low-gain: the study was begun with no vibration" in capsys.readouterr().err


# --------------------------------------------------------------------- what the report says of the study's own choices

HALF = short(paths=1)
FULL = protocol_of(assuming('gap_reading = "full"\nsensing = "encoders"', HALF.text))


@pytest.fixture(scope="module")
def people():
    return {f"{number:02d}": person_of(PEOPLE, HALF.seed, number) for number in (1, 2)}


@pytest.fixture
def gap_read():
    with conclusions.whole():
        yield gap_read_otherwise


@pytest.fixture(scope="module")
def trials() -> pd.DataFrame:
    found = as_table(row for row, _ in study_trials(HALF, PEOPLE, 2, JUDGED))
    return found[found["controller"] == GAP]


def test_a_gap_read_the_other_way_gives_the_trials_of_a_study_that_reads_it_so_to_the_last_digit(
    people, trials, gap_read
):
    """A person has one trial with the gap on each device, so what went before it is the same in both studies."""
    found = gap_read(FULL, people)
    assert (found.reading, found.gap_m, found.other_gap_m) == ("full", 0.0025, 0.005)
    for name in ("run", "configuration", *(metric.name for metric in JUDGED)):
        assert found.trials[name].tolist() == trials[name].tolist()
    assert with_gap_read_as("half", FULL).controllers[GAP].value("gap_m") == 0.005
    assert gap_read(load_protocol("obstacles"), people) is None


def test_the_other_reading_changes_the_trials_that_have_a_gap(people, trials, gap_read):
    found = gap_read(HALF, people)
    assert (found.reading, found.gap_m, found.other_gap_m) == ("half", 0.005, 0.0025)
    assert set(found.trials["controller"]) == {GAP} and len(found.trials) == 4
    assert not np.isclose(trials["mean_tip_force_N"].median(), found.trials["mean_tip_force_N"].median())
    sentence = gap_sentence(trials, found, False)
    assert "half the width of the band without control, 5 mm to each side" in sentence and "2.5 mm" in sentence


IDEAL = load_protocol(sensing="ideal")
IDEAL = replace(IDEAL, devices=IDEAL.devices[:1], blocks=1)


def test_the_integration_errs_little_and_most_where_brakes_switch_and_the_fidelity_counts_for_more():
    moved = simulation_errors(IDEAL, person_of(load_population("average"), IDEAL.seed, 1), "01")
    worst = {(one.controller, one.change): one.worst for one in moved if one.measure == "path_error_m"}
    assert worst[1, STEP] < 1e-10 and worst[4, STEP] > 1e3 * worst[1, STEP]
    for controller in (2, 4):
        assert worst[controller, STEP] < 1e-5 and worst[controller, BRAKES] > 10.0 * worst[controller, STEP]
