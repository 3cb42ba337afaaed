"""A measure in a file of one's own: everywhere a shipped one is, and where it fails the trial stays and it is said."""

import json
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from own_files import FREE, MEASURE, PROTOCOL, measures_of, own_experiment

import phd
from core.files import InputError
from core.path import build_path, path_from
from experiments.analysis.chart_figures import draw
from experiments.analysis.charts import POOLED, View, charts
from experiments.analysis.own_measures import metrics_in, own_metrics
from experiments.analysis.trials_table import measure
from experiments.export.export import export
from experiments.export.results import read_results
from experiments.protocol import load_protocol
from experiments.store.blind import blinded
from experiments.store.recording import read_recording
from experiments.store.verify import verify
from experiments.study.analyze import analyze
from experiments.study.replay import replay
from experiments.study.study import run_study
from experiments.trial.population import load_population
from tests.support.rows import read_rows

FAILS = """

def failing(movement):
    if (movement.column("decision") == "damped").any():
        return 1 / 0
    return float("nan")


MEASURES += (Measure("failing", "Failing", "", failing),)
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A study with two measures of its own that are right and one that fails; its files are gone."""
    folder = tmp_path_factory.mktemp("own measure")
    file = own_experiment(folder, f'measure = "my_measure.py"\n{PROTOCOL}{FREE}', my_measure=MEASURE + FAILS)
    protocol = load_protocol(file)
    summary = run_study(folder / "study", 1, protocol, load_population())
    shutil.copytree(folder / "study", folder / "kept")
    (folder / "my_measure.py").unlink()
    return SimpleNamespace(folder=folder, out=folder / "study", protocol=protocol, summary=summary)


def test_it_has_its_column_its_chart_its_lines_in_the_report_and_its_unit_in_a_frame(study):
    trials = phd.load_trials(study.out)
    late = trials["late_error_mm"]
    assert trials.attrs["units"]["late_error_mm"] == "mm" and trials["hard_push_share"].between(0.0, 1.0).all()
    assert ((late > 0.0) & (late <= 1e3 * trials["peak_error_m"])).all()
    report = (study.out / "report/report.md").read_text()
    assert "| Late error (mm) |" in report and "late_error_mm" in (study.out / "report/statistics.csv").read_text()
    assert "late_error_mm" in (study.out / "report/participant_means.csv").read_text().splitlines()[0]
    results = read_results(study.out)
    assert [metric.name for metric in results.own] == ["late_error_mm", "hard_push_share", "failing"]
    view = View(results.configurations, results.labels, measures=results.own)
    shown = charts(POOLED, results.trials, view)
    assert sorted(point.y for point in shown[0].points) == sorted(late) and not shown[2].points
    drawn = draw(results.trials, "", view, results.own, 9.0)
    assert [axes.get_title(loc="left") for axes in drawn.axes] == ["Late error (mm)", "Hard push", "Failing"]
    boxes = phd.boxes(trials, "late_error_mm")
    assert boxes.loc[(1, "three-brake"), "median"] == trials.query("controller == 1")["late_error_mm"].median()
    assert "late_error_mm" in set(phd.statistics(trials)["measure"])


def test_where_it_fails_the_trial_stays_its_cell_is_empty_and_it_is_counted_and_said(study):
    rows = read_rows(study.out / "trials.csv")
    assert len(rows) == 2 and all(row.status == "done" and "failing" not in row.own for row in rows)
    assert "failing" not in (study.out / "trials.csv").read_text()
    said = study.summary["warnings"]
    assert "Failing has no value in 2 of 2 trials that count." in said
    line = MEASURE.count("\n") + 5
    assert f"my_measure.py: failing: line {line}: ZeroDivisionError: division by zero, in 1 trial." in said
    assert "my_measure.py: failing: answered nan, which is no finite number, in 1 trial." in said
    assert "Failing has no value in 2 of 2 trials" in (study.out / "report/report.md").read_text()


def test_the_recordings_alone_give_the_same_table_and_verify_tells_a_changed_cell(study):
    found = analyze(study.out, study.folder / "again")
    before, again = (read_rows(folder / "trials.csv") for folder in (study.out, study.folder / "again"))
    assert [row.own for row in again] == [row.own for row in before]
    assert any("ZeroDivisionError" in warning for warning in found["warnings"]) and found["changed"] == []
    assert verify(study.out)["faults"] == []
    table = study.folder / "kept/sub-01/ses-01/trials.csv"
    value = repr(read_rows(table)[0].own["late_error_mm"])
    table.write_text(table.read_text().replace(value, "7.25"))
    assert any("was edited" in fault["fault"] for fault in verify(study.folder / "kept")["faults"])
    measures = replay(study.out / read_rows(study.out / "trials.csv")[0].recording)["metrics"]
    assert measures["late_error_mm"]["change"] == 0.0


def test_an_export_describes_it_and_a_blind_table_hides_it(study):
    export(study.out, {"csv": study.folder / "csv", "bids": study.folder / "bids"})
    columns = json.loads((study.folder / "csv/columns.json").read_text())["trials.csv"]
    wanted = "largest distance from the path in its last third"
    assert columns["late_error_mm"] == {"unit": "mm", "description": wanted}
    assert json.loads((study.folder / "bids/scans.json").read_text())["late_error_mm"]["Units"] == "mm"
    header, first = (study.folder / "bids/sub-01/ses-01/sub-01_ses-01_scans.tsv").read_text().splitlines()[:2]
    cells = dict(zip(header.split("\t"), first.split("\t"), strict=True))
    row = next(row for row in read_rows(study.out / "trials.csv") if row.participant == "01")
    assert float(cells["late_error_mm"]) == row.own["late_error_mm"] and cells["failing"] == "n/a"
    assert blinded(type(row)(**{**vars(row), "controller": "K1"})).own == {}


@pytest.mark.parametrize("text, wanted", [
    ("x = (", "my_measure.py: cannot be run: line 1: SyntaxError"),
    ("import sys; sys.exit(3)", "line 1: SystemExit: 3"),
    ("import no_such_library", "line 1: ModuleNotFoundError"),
    ("MEASURES = 3", "must have MEASURES"),
    (MEASURE.replace('"late_error_mm"', '"late error"'), "letters .a to z., digits and _, not 'late error'"),
    (MEASURE.replace('"late_error_mm"', '"path_error_m"'), "path_error_m is a column that tables have already"),
    (MEASURE.replace('"hard_push_share"', '"late_error_mm"'), "two measures have the same name"),
    (MEASURE.replace('"mm"', "3"), "title, unit and meaning must be text"),
    (MEASURE.replace("late_error, ", "late_error(None), "), "AttributeError"),
    (MEASURE.replace("late_error, ", "1.0, "), "of must be a function"),
    (MEASURE.replace('above 5 N")', 'above 5 N", better="least")'), "better must be one of lower, higher"),
    (MEASURE.replace('above 5 N")', 'above 5 N", 1.5)'), "decimals must be a whole number"),
])  # fmt: skip
def test_a_file_that_declares_no_measures_is_refused_in_a_sentence(text: str, wanted: str):
    with pytest.raises(InputError, match=wanted) as refused:
        metrics_in(measures_of("my_measure", text))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("answer, wanted", [
    ("'much'", "answered no number .str 'much'."),
    ("True", "answered no number"),
    ("np.zeros(3)", "answered no number .ndarray"),
    ("np.inf", "answered inf, which is no finite number"),
    ("10**400", "OverflowError|no finite number"),
    ("m.column('nothing')", "has no column 'nothing'; it has t_s"),
    ("np.float32(0.5)", ""),
])  # fmt: skip
def test_an_answer_that_is_no_finite_number_is_said(study, answer: str, wanted: str):
    text = f"{MEASURE}\nMEASURES = (Measure('a', 'A', '', lambda m: {answer}),)\n"
    recording = read_recording(study.out / read_rows(study.out / "trials.csv")[0].recording)
    path = build_path(path_from(recording.metadata["path_shape"], "path"), "path")
    measured, failed = measure(recording, path, (), metrics_in(measures_of("odd", text)))
    assert re.search(wanted, failed.get("a", "")) and (measured == {}) == bool(wanted)
    assert wanted or (measured == {"a": 0.5} and isinstance(measured["a"], float) and not failed)


def test_two_protocols_may_have_files_of_one_name_with_other_texts(tmp_path: Path):
    made = []
    for name, unit in (("a", "mm"), ("b", "cm")):
        (tmp_path / name).mkdir()
        text = MEASURE.replace('"mm"', f'"{unit}"')
        made.append(
            load_protocol(own_experiment(tmp_path / name, f'measure = "my_measure.py"\n{PROTOCOL}', my_measure=text))
        )
    assert [own_metrics(protocol)[0].unit for protocol in made] == ["mm", "cm"]
