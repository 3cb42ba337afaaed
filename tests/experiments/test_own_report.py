"""The report of an experiment that is not the paper's: its controllers by name, none of the paper's statements."""

from pathlib import Path

from protocols import protocol_of

from experiments.analysis.report import write_report
from experiments.analysis.statistics import statistics
from experiments.analysis.trials_table import StudyData, as_table
from experiments.study.unrecorded import study_trials
from experiments.trial.population import load_population

GUIDES = """
name = "guides"
provenance = "assumed"
devices = ["three-brake"]
blocks = 2
[[path]]
number = 1
kind = "segment"
start_m = [-0.10, 0.40]
end_m = [0.10, 0.40]
[[controller]]
number = 1
name = "Soft guide"
kind = "sdof"
[[controller]]
number = 2
name = "Free"
kind = "none"
"""


def test_a_report_of_ones_own_experiment_compares_its_controllers_by_name(tmp_path: Path):
    protocol = protocol_of(GUIDES)
    trials = as_table(row for row, _ in study_trials(protocol, load_population(), 7))
    note = protocol.note()
    write_report(StudyData(trials, protocol.controllers, "guides", note, note, True), tmp_path)
    text = (tmp_path / "report.md").read_text()
    assert "the paper says" not in text and "Table I" not in text and not (tmp_path / "findings.csv").exists()
    assert "| path error (mm) | three-brake | Soft guide - Free | " in text and "## Against no control" in text
    wanted = "mean_tip_force_N", "hodges_lehmann", "three-brake"
    (found,) = [r for r in statistics(trials) if (r.measure, r.statistic, r.configuration) == wanted]
    (line,) = [one for one in text.splitlines() if one.startswith("| mean tip force (N) | three-brake | Soft")]
    assert f"{found.value:+.2f} ({found.low:+.2f} to {found.high:+.2f})" in line
    assert line.endswith(f"| {found.p_holm:.3f} |")
