"""The charts of results: each trial a point, the same for screen and print; who is in a box and who is not."""

from dataclasses import replace

import numpy as np
import pytest
from fake_client import PLAN, result
from protocols import PAPER, short
from sessions import new_session, run_trials

from core.files import InputError
from core.path import build_path
from experiments.analysis.charts import (
    LEAST_IN_A_BOX,
    ORDER,
    PERSON,
    POOLED,
    QUESTIONS,
    SPEED,
    AnswerSet,
    View,
    charts,
    left_out,
    legend,
)
from experiments.analysis.movement import along_path
from experiments.analysis.trials_table import as_table
from experiments.atomic_files import first_free
from experiments.export.results import ResultsJob, read_results
from experiments.export.results_files import write_results
from experiments.inputs import OPERATOR
from experiments.store.cells import trial_names
from experiments.store.recording import read_recording
from experiments.store.stored import read_stored
from experiments.study.playback import device_of, read_playback
from tests.support.rows import with_measures, write_rows

DEVICES = ("three-brake", "four-brake")
VIEW = View(DEVICES, {number: f"controller {number}" for number in range(1, 6)}, {1: 0.2, 2: 0.25})
VIEW = VIEW._replace(colours={number: number - 1 for number in range(1, 6)})


def study():
    """Three participants' sixty trials."""
    generator = np.random.default_rng(1)
    return [
        replace(result(trial, error=1e-3 * (trial.controller + generator.random())), participant=who)
        for who in ("01", "02", "03")
        for trial in PLAN
    ]


@pytest.mark.parametrize("page", [POOLED, PERSON, ORDER, SPEED])
def test_every_trial_that_is_done_is_a_point_on_every_page(page):
    rows = study()
    for chart in charts(page, as_table(rows), VIEW):
        assert len(chart.points) == 180 and not chart.timeouts and not chart.others
        assert all(chart.span[0] <= point.x <= chart.span[1] for point in chart.points)
    error = charts(page, as_table(rows), VIEW)[0]
    assert sorted(point.y for point in error.points) == pytest.approx(
        sorted(1e3 * row.value("path_error_m") for row in rows)
    )
    again = charts(page, as_table(rows), VIEW)
    assert again == charts(page, as_table(rows), VIEW)  # the places are fixed: the screen's are the print's


def test_a_trial_whose_time_was_up_is_a_cross_and_flattens_no_box_unless_it_is_asked_into_them():
    rows = study()
    rows[3] = with_measures(replace(rows[3], status="timeout"), path_error_m=0.065)
    chart = charts(POOLED, as_table(rows), VIEW)[0]
    assert [point.row for point in chart.timeouts] == [rows[3]] and chart.highest < 7.0
    assert max(at.box.high for at in chart.boxes) < 7.0
    assert left_out(as_table(rows)) == "1 trial timed out: crosses above the scale, not in the boxes."
    asked = VIEW._replace(timeouts=True)
    chart = charts(POOLED, as_table(rows), asked)[0]
    assert not chart.timeouts and chart.highest == pytest.approx(65.0)
    assert left_out(as_table(rows), timeouts=True) == "1 trial timed out: in the boxes."
    speed = charts(SPEED, as_table(rows), asked)[0]
    assert len(speed.points) == 179 and not speed.timeouts  # it did not come to the end: it has no mean speed
    assert left_out(as_table(rows), *asked.timeouts_on(speed)) == "1 trial timed out: not shown."


def test_what_does_not_count_is_grey_and_in_no_box():
    rows = study()
    rows[0] = with_measures(replace(rows[0], status="excluded"), path_error_m=0.5)
    rows[1] = with_measures(replace(rows[1], status="redone"), path_error_m=0.5)
    chart = charts(POOLED, as_table(rows), VIEW)[0]
    assert [point.row for point in chart.others] == rows[:2]
    assert "Grey: trials that do not count." in legend(chart, VIEW)
    assert sum(at.box.n for at in chart.boxes) == len(chart.points) == 178
    assert "1 trial excluded by the experimenter" in left_out(as_table(rows))


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A session of twenty trials: three run, of which one was repeated and one excluded, and one note."""
    folder = tmp_path_factory.mktemp("analyse") / "data"
    session = new_session(folder, protocol=short())
    run_trials(session, 3)
    session.redo(1, "looked away")
    session.exclude(2, "the participant sneezed")
    session.note("asked to move a little slower")
    session.close()
    return folder


def test_a_data_folder_a_session_and_a_bare_table_can_all_be_looked_at(data, tmp_path):
    whole, one = read_results(data), read_results(data / "sub-01" / "ses-01")
    assert list(whole.trials["status"]) == ["redone", "excluded", "done"] and whole.planned == {"01": 20}
    assert whole.controllers and whole.lengths[1] > 0.0 and "assumed" in whole.note and not whole.problems
    assert whole.hands == (OPERATOR,) == one.hands
    for results in (whole, one):
        assert all((results.folder / name).exists() for name in results.trials["recording"])
    write_rows(tmp_path / "trials.csv", study())
    bare = read_results(tmp_path)
    assert len(bare.trials) == 180 and bare.labels[3] == "controller\n3" and bare.configurations == DEVICES
    assert read_results(tmp_path / "..").trials.empty and pytest.raises(InputError, read_results, tmp_path / "none")


def test_an_export_holds_what_is_seen_named_for_its_content_and_never_writes_over_anything(tmp_path):
    trials = as_table(study()[:60])
    job = ResultsJob(ORDER, trials, (), VIEW, "a note", tmp_path, (), first_free(tmp_path, "results"))
    assert write_results(job) == 11
    there = {path.name for path in job.folder.iterdir()}
    assert {f"path_error_by_run.{form}" for form in ("png", "svg", "pdf")} <= there and not any(
        "fig" in one for one in there
    )
    with pytest.raises(InputError, match="is not empty"):
        write_results(job)
    assert first_free(tmp_path, "results").name == "results-2" and {path.name for path in job.folder.iterdir()} == there


def test_a_recorded_trial_is_looked_at_with_its_row_and_its_distance_from_the_path(data):
    path = data / "sub-01" / "ses-01" / "trials" / "run-003.parquet"
    trial, recording = read_playback(path), read_recording(path)
    assert (
        trial.title == "participant 01, trial 3"
        and trial.row.run == 3
        and len(trial.error) == len(trial.ticks) == len(trial.t)
    )
    moving = ~np.isnan(trial.error)
    tip = np.column_stack([recording.columns[name] for name in ("tip_x_m", "tip_y_m")])[moving]
    away = along_path(tip, build_path(PAPER.paths[trial.row.path], "path"))[1]
    assert np.abs(trial.error[moving][1:] - away[:-1]).max() < 40e-6  # m: seen a tick late, in whole counts
    assert trial.controllers[trial.row.controller] == trial.controller and not trial.blind
    with pytest.raises(InputError, match="its session has no device 'seven-brake'"):
        device_of(replace(recording, metadata={"configuration": "seven-brake"}), read_stored(path.parents[1]))


def test_a_repeated_trial_keeps_the_name_of_the_first_on_charts_and_in_the_report():
    rows = study()[:60]
    again = [replace(rows[3], run=61), replace(rows[3], run=62)]
    named = trial_names([*again, *rows])
    assert named["01", 4] == "trial 4" and named["01", 61] == "trial 4, second try"
    assert named["01", 62] == "trial 4, third try" and named["01", 60] == "trial 60"
    chart = charts(ORDER, as_table([*rows, *again]), VIEW._replace(trials=named))[0]
    assert sum(" · trial 4, second try · " in point.text for point in chart.points) == 1


def test_answers_stand_by_question_and_device():
    answers = [
        AnswerSet(f"{n:02d}", device, 1, 0, {"effort": 5.0 * n, "mental_demand": 5.0 * n}, "")
        for n in range(6) for device in DEVICES
    ]  # fmt: skip
    (chart,) = charts(QUESTIONS, as_table(study()), VIEW, answers)
    assert [text for _, text in chart.ticks] == ["effort", "mental\ndemand"] and len(chart.points) == 24
    assert {at.box.median for at in chart.boxes} == {12.5} and charts(QUESTIONS, as_table(study()), VIEW) == []
    assert [at.look for at in sorted(chart.boxes)] == [0, 1, 0, 1]  # the first device stands first
    after = [answer._replace(controller=1 + n % 2, block=0) for n, answer in enumerate(answers)]
    (chart,) = charts(QUESTIONS, as_table(study()), VIEW, after)
    assert {point.controller for point in chart.points} == {1, 2}
    assert chart.points[0].text == "Participant 00 · after controller 1 on three-brake · 0"


def test_fewer_than_five_trials_have_no_box():
    rows = [row for row in study() if row.controller == 2 and row.configuration == "three-brake"]
    for count in (LEAST_IN_A_BOX - 1, LEAST_IN_A_BOX):
        chart = charts(POOLED, as_table(rows[:count]), VIEW)[0]
        assert len(chart.points) == count and len(chart.boxes) == (count == LEAST_IN_A_BOX)
    assert "Boxes need at least 5 trials." in legend(charts(POOLED, as_table(rows[:4]), VIEW)[0], VIEW)


def test_a_curve_over_the_runs_is_the_median_of_those_around_each():
    rows = [with_measures(row, path_error_m=1e-3 * row.run) for row in study() if row.participant == "01"]
    curve = dict(charts(ORDER, as_table(rows), VIEW)[0].curve)
    assert curve[30.0] == pytest.approx(30.0) and curve[1.0] == pytest.approx(3.5)
