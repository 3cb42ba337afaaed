"""The paper's eleven statements, within people and by pooled boxes: data in which they hold, broken one at a time."""

import math
import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs
from protocols import study_data
from rows import with_measures
from scipy import stats
from sessions import files

from core.control.controllers import make_preset
from core.files import InputError
from experiments.analysis.findings import (
    CANNOT_TELL,
    CHANCE,
    DEPENDS,
    FAILS,
    HOLDS,
    IN_BOXES,
    STATEMENTS,
    PooledBox,
    box_findings,
    box_findings_of,
    findings,
    pooled_boxes,
)
from experiments.analysis.metrics import JUDGED
from experiments.analysis.report import write_report
from experiments.analysis.statistics import mean_interval, spreads, statistics
from experiments.analysis.trials_table import StudyData, TrialRow, as_table
from experiments.protocol import load_protocol
from experiments.study.unrecorded import study_trials
from experiments.trial.population import load_population

DEVICES = ("three-brake", "four-brake")
#: As the paper found them: path error (mm), its spread, force, acceleration.
PAPER = {
    1: (4.0, 0.5, 2.0, 10.0),
    2: (2.0, 0.5, 6.0, 60.0),
    3: (2.2, 0.1, 4.0, 40.0),
    4: (2.1, 0.4, 4.0, 40.0),
    5: (2.2, 0.5, 2.1, 10.5),
}


def study(people=12, devices=DEVICES, table=PAPER, wider=2.0, noise=0.02, seed=0):
    """Trials of people who differ by a few per cent; `wider`: the uncontrolled spread with four brakes over three."""
    generator = np.random.default_rng(seed)
    rows = []
    for p in range(1, people + 1):
        own = {measure: generator.lognormal(0.0, noise) for measure in ("error", "force", "acceleration")}
        for device in devices:
            for controller, (error, spread, force, acceleration) in table.items():
                spread *= wider if (device, controller) == ("four-brake", 1) else 1.0
                for i, away in enumerate((-1.5, -1.0, -0.5, 0.5, 1.0, 1.5)):
                    rows.append(
                        TrialRow(
                            f"{p:02}", len(rows) + 1, 1 + i % 3, device, controller, 1 + i % 2, 1 + i % 3, "done",
                            measures={
                                "path_error_m": 1e-3 * (own["error"] * error + away * spread),
                                "mean_tip_force_N": own["force"] * force,
                                "acceleration_dft_sum": own["acceleration"] * acceleration,
                                "acceleration_dft_sum_ramp_removed": 0.7 * own["acceleration"] * acceleration,
                                "duration_s": 3.0,
                            },
                        )
                    )  # fmt: skip
    return rows


def verdicts(rows):
    return {one.statement.number: one.verdict for one in findings(as_table(rows))}


def changed(rows, column, by, controller=None, device=None, participant=None):
    """The rows with one column times a factor, where they match."""
    return [
        with_measures(row, **{column: by * row.value(column)})
        if row.controller in ([controller] if controller else range(1, 6))
        and row.configuration in (device or row.configuration)
        and row.participant == (participant or row.participant)
        else row
        for row in rows
    ]


def test_all_eleven_hold_in_data_made_as_the_paper_found_them():
    assert [one.statement.number for one in findings(as_table(study()))] == list(range(1, 12))
    assert set(verdicts(study()).values()) == {HOLDS}


FORCES = ("mean_tip_force_N",)
ACCELERATIONS = ("acceleration_dft_sum", "acceleration_dft_sum_ramp_removed")
BROKEN = {
    "sdof-no-better-than-none": (1, ("path_error_m",), 2.1, 2, None),
    "low-gain-no-better-than-none": (2, ("path_error_m",), 1.9, 5, None),
    "gap-spreads-as-wide": (3, ("path_error_m",), 8.0, 3, None),
    "gap-no-smoother": (4, ACCELERATIONS, 1.5, 3, None),
    "gap-no-lighter": (5, FORCES, 1.5, 3, None),
    "gap-costs-accuracy": (6, ("path_error_m",), 1.3, 3, None),
    "low-gain-no-lighter": (7, FORCES, 2.0, 5, None),
    "low-gain-no-smoother": (7, ACCELERATIONS, 4.0, 5, None),
    "low-gain-less-accurate": (7, ("path_error_m",), 1.3, 5, None),
    "proportional-as-rough": (9, ACCELERATIONS, 2.5, 4, None),
    "four-brakes-more-accurate": (10, ("path_error_m",), 0.6, None, "four-brake"),
    "four-brakes-lighter": (10, FORCES, 0.8, None, "four-brake"),
    "four-brakes-spread-less-uncontrolled": (10, ("path_error_m",), 0.25, 1, "four-brake"),
    "sdof-improves-more": (11, ("path_error_m",), 0.3, 2, None),
}


@pytest.mark.parametrize("number, columns, by, controller, device", BROKEN.values(), ids=BROKEN)
def test_a_statement_that_the_data_contradict_does_not_hold(number, columns, by, controller, device):
    rows = study()
    for column in columns:
        rows = changed(rows, column, by, controller, device)
    assert verdicts(rows)[number] == FAILS


@pytest.mark.parametrize("column", ACCELERATIONS)
def test_two_sums_that_disagree_say_that_it_depends_on_the_cut_and_one_device_is_enough_to_contradict(column):
    found = findings(as_table(changed(study(), column, 2.0, 3)))[3]
    assert found.verdict == DEPENDS and found.statement.number == 4
    assert "As cut, it " in found.sentence and "Without the ramp, it " in found.sentence
    rows = study()
    for one in ACCELERATIONS:
        rows = changed(rows, one, 2.0, 3, "four-brake")
    found = findings(as_table(rows))[3]
    assert found.verdict == FAILS and "four-brake" in found.sentence


BOUNDS = {
    **{f"{mm} mm": (6, 3, (2.0 + mm, *PAPER[3][1:]), verdict) for mm, verdict in ((0.59, HOLDS), (0.61, FAILS))},
    **{
        f"{share:.0%}": (8, 5, (*PAPER[5][:2], share * PAPER[1][2], PAPER[1][3]), verdict)
        for share, verdict in ((0.71, HOLDS), (1.29, HOLDS), (0.69, FAILS), (1.31, FAILS))
    },
}


@pytest.mark.parametrize("number, controller, values, verdict", BOUNDS.values(), ids=BOUNDS)
def test_15_percent_of_the_uncontrolled_mean_may_be_given_up_and_30_are_similar(number, controller, values, verdict):
    assert verdicts(study(table={**PAPER, controller: values}, noise=1e-4))[number] == verdict


def test_a_reduction_too_small_to_matter_is_said_to_be_so_even_in_everyone_and_chance_is_none():
    """Force with gap 1 % lower in all, or lower or higher by person: no reduction; 60 % either way is open."""
    for lower, verdict in ((0.01, FAILS), (0.6, HOLDS)):
        found = findings(as_table(study(table={**PAPER, 3: (2.2, 0.1, (1.0 - lower) * 6.0, 40.0)})))[4]
        assert found.verdict == verdict and ("smaller than matters" in found.sentence) == (verdict == FAILS)
    for either_way, verdict in ((0.01, FAILS), (0.6, CANNOT_TELL)):
        rows = study(table={**PAPER, 3: (2.2, 0.1, 6.0, 40.0)})
        for p in range(1, 13):
            rows = changed(rows, "mean_tip_force_N", 1.0 + (-1) ** p * either_way, 3, None, f"{p:02}")
        assert verdicts(rows)[5] == verdict


def test_order_of_rows_names_of_people_units_of_force_and_trials_that_do_not_count_change_nothing():
    rows = changed(study(noise=0.3), "acceleration_dft_sum", 1.45, 3)
    before = [(one.verdict, ratios(one)) for one in findings(as_table(rows))]
    others = [replace(row, participant=f"p{row.participant}x") for row in rows]
    random.Random(1).shuffle(others)
    others = [with_measures(row, mean_tip_force_N=7.0 * row.value("mean_tip_force_N")) for row in others]
    for status in ("aborted", "redone", "recovered"):
        others.append(with_measures(replace(others[0], status=status), path_error_m=1.0, mean_tip_force_N=1e3))
    after = [(one.verdict, ratios(one)) for one in findings(as_table(others))]
    assert [verdict for verdict, _ in after] == [verdict for verdict, _ in before]
    for (_, now), (_, then) in zip(after, before, strict=True):
        assert now == pytest.approx(then)


def ratios(finding):
    """Every difference and interval of a finding, in units of U."""
    return [end for one in finding.evidence for end in one.found[1:]]


def test_a_missing_controller_or_device_is_named_and_nothing_is_said_about_it():
    without = [row for row in study() if row.controller != 3]
    found = findings(as_table(without))
    assert {n for n, v in verdicts(without).items() if v == CANNOT_TELL} == {1, 3, 4, 5, 6, 9, 10, 11}
    assert "No trials of 'SDOF with gap' on three-brake" in found[3].sentence
    one_device = findings(as_table([row for row in study() if row.configuration == "three-brake"]))
    assert [one.verdict for one in one_device] == [HOLDS] * 9 + [CANNOT_TELL, HOLDS]
    assert "on four-brake" in one_device[9].sentence
    assert {one.verdict for one in findings(as_table([]))} == {CANNOT_TELL}
    one_trial_each = [row for row in study(people=1, wider=1.0) if (row.path, row.repetition) == (1, 1)]
    assert findings(as_table(one_trial_each))[2].sentence == (
        "Path error without control does not vary, as that of a single trial."
    )


@pytest.mark.parametrize("status", ["timeout", "aborted"])
def test_a_controller_that_lets_few_reach_the_end_is_not_judged_by_how_far_they_came(status):
    """An aborted trial is one of a person who failed at the device."""
    rows = study()
    late = [replace(r, status=status) if r.controller == 3 and r.repetition == 1 else r for r in rows]
    found = findings(as_table(late))[4]
    assert found.verdict == CANNOT_TELL
    assert (
        "only 67 % of the trials of 'SDOF with gap' on three-brake reached the end"
        in found.sentence.lower().replace("sdof", "SDOF")
    )
    nothing = [with_measures(r, path_error_m=None) if r.controller == 3 else r for r in rows]
    assert "Nothing measured" in findings(as_table(nothing))[5].sentence


def test_few_people_decide_only_what_is_plain_among_them_and_one_person_nothing():
    rows = study(people=3)
    assert set(verdicts(rows).values()) == {HOLDS}
    assert {e.found.people for f in findings(as_table(rows)) for e in f.evidence} == {3}
    for column in FORCES:
        rows = changed(rows, column, 2.0, 3, None, "02")
    found = findings(as_table(rows))[4]
    assert found.verdict == CANNOT_TELL and "the interval is too wide" in found.sentence
    found = findings(as_table(study(people=1)))
    assert {one.verdict for one in found} == {CANNOT_TELL}
    assert all("one participant has no interval" in one.sentence and " to " not in one.sentence for one in found)


@given(st.lists(st.floats(-100, 100), min_size=2, max_size=14))
def test_the_interval_of_the_mean_is_students(differences):
    found = mean_interval(differences)
    if np.std(differences) > 1e-6:
        low, high = stats.ttest_1samp(differences, 0.0).confidence_interval(0.95)
        assert (found.low, found.high) == pytest.approx((low, high))
    assert found.middle == pytest.approx(np.mean(differences))


@pytest.fixture(scope="module")
def reports(tmp_path_factory) -> dict[int, Path]:
    """The folder of a report of so many people."""
    folder = tmp_path_factory.mktemp("reports")
    for people in (5, 6, 9):
        data = study_data(study(people, noise=0.2), note="settled rules, parameters assumed")
        warnings = write_report(data, folder / f"{people}")
        assert bool(warnings) == (people < 6)
    return {people: folder / f"{people}" for people in (5, 6, 9)}


@pytest.mark.parametrize("people", [5, 6, 9])
def test_the_report_says_for_whom_and_what_so_few_people_cannot_show(reports, people):
    """Below six they are a description. All differ the same way in every pair: a star where Holm over ten pairs allows
    it, else a sentence why not.
    """
    text = (reports[people] / "report.md").read_text()
    assert ("too few to claim any of this for others; read it as a description." in text) == (people < 6)
    smallest = stats.wilcoxon(np.arange(1.0, people + 1.0)).pvalue
    says = "On three-brake and four-brake no *, however they differ: the smallest p of Wilcoxon's test with "
    says += f"{people} participants is {smallest:.3g}, after Holm's correction for 10 pairs {10 * smallest:.2g}."
    assert (says in text) == ("no *" in text) == (people == 6)
    assert ("*" in text.split("## Against no control")[1].split("\n\nChange")[0]) == (people == 9)


def test_spread_is_the_mean_distance_of_a_persons_trials_from_the_line_in_the_box():
    rows = [row for row in study(people=2) if (row.controller, row.configuration) == (2, "four-brake")]
    middle = np.median([row.value("path_error_m") for row in rows])
    by_hand = np.mean([abs(row.value("path_error_m") - middle) for row in rows if row.participant == "02"])
    assert spreads(as_table(rows), "path_error_m")["02", "four-brake", 2] == pytest.approx(by_hand)


def test_the_report_has_its_tables_the_same_bytes_each_time_and_never_overwrites(reports, tmp_path):
    rows = study(5, noise=0.2)
    data = study_data(rows, note="settled rules, parameters assumed")
    write_report(data, tmp_path / "again")
    assert files(tmp_path / "again") == (written := files(reports[5]))
    tables = {f"{name}.csv" for name in ("by_path", "findings", "participant_means", "statistics")}
    assert written.keys() == {"report.md", *tables}
    page = written["report.md"].decode()
    assert "Settled rules, parameters assumed. 5 participants, 300 trials that count; all reached the end." in page
    assert all(f"| {s.number} | {s.text} | **" in page for s in STATEMENTS)
    assert len(page) < 14_000  # two pages
    (against_none,) = [line for line in page.splitlines() if line.startswith("| three-brake | SDOF |")]
    error, force, acceleration = (float(cell.split()[0]) for cell in against_none.split("|")[3:6])
    assert error < 0.0 < min(force, acceleration)  # SDOF: less error than none, more force, rougher

    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "report.md").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        write_report(data, tmp_path / "mine")
    assert files(tmp_path / "mine") == {"report.md": b"mine"}
    with pytest.raises(InputError, match="nothing to report"):
        write_report(study_data([replace(rows[0], status="aborted")]), tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_a_report_of_ones_own_experiment_compares_its_controllers_by_name_without_the_papers_statements(tmp_path):
    rows = [row for row in study(7, noise=0.2) if row.controller in (1, 2) and row.configuration == "three-brake"]
    presets = {1: make_preset("Soft guide", "sdof", {}), 2: make_preset("Free", "none", {})}
    write_report(StudyData(as_table(rows), presets, "guides", "note", "note", simulated=True), tmp_path)
    text = (tmp_path / "report.md").read_text()
    assert "the paper says" not in text and "Table I" not in text and not (tmp_path / "findings.csv").exists()
    wanted = "mean_tip_force_N", "hodges_lehmann", "three-brake"
    (found,) = [r for r in statistics(as_table(rows)) if (r.measure, r.statistic, r.configuration) == wanted]
    (line,) = [one for one in text.splitlines() if one.startswith("| mean tip force (N) | three-brake | ")]
    assert "Soft guide" in line and "Free" in line and line.endswith(f"| {found.p_holm:.3f} |")
    assert f"{found.value:+.2f} ({found.low:+.2f} to {found.high:+.2f})" in line


ERROR, FORCE, ROUGHNESS, WITHOUT_RAMP = IN_BOXES
#: As the paper's text has them: median and length of the box, of path error, force and roughness.
BOXED = {
    1: ((8.0, 2.0), (2.0, 0.4), (10.0, 2.0)),
    2: ((3.0, 1.2), (6.0, 1.0), (60.0, 9.0)),
    3: ((3.6, 0.5), (4.6, 1.0), (45.0, 9.0)),
    4: ((2.9, 1.3), (4.0, 0.5), (30.0, 5.0)),
    5: ((3.8, 1.1), (2.2, 0.4), (11.0, 2.0)),
}


def made(changes=(), wider=1.5, both=True):
    """Boxes on both devices; changes: (measure, controller, median, length[, devices]) in place of the paper's;
    both: a change of the sum as cut is one of that without the ramp.
    """
    boxes = {}
    for device in DEVICES:
        for controller, of_it in BOXED.items():
            for measure, (median, length) in zip(IN_BOXES, (*of_it, of_it[-1]), strict=True):
                length *= wider if (device, controller, measure) == ("four-brake", 1, ERROR) else 1.0
                boxes[measure, device, controller] = around(median, length)
    for measure, controller, median, length, *devices in changes:
        for device in devices or DEVICES:
            for one in (ROUGHNESS, WITHOUT_RAMP) if measure == ROUGHNESS and both else (measure,):
                boxes[one, device, controller] = around(median, length)
    return boxes


def around(median, length):
    return PooledBox(median - 0.5 * length, median, median + 0.5 * length)


def judged(boxes, bands=1.0):
    return {one.statement.number: one for one in box_findings(boxes, DEVICES, bands)}


def test_all_eleven_hold_in_boxes_as_the_papers_text_describes_them():
    found = judged(made())
    assert {one.verdict for one in found.values()} == {HOLDS} and len(found) == 11
    assert all(one.margin >= 0.0 for one in found.values())


#: statement, changes just inside the rule, changes just outside it, and the margin of the latter in units of U
BOX_BOUNDS = {
    "1: median less than the uncontrolled quartile, and mine beyond its own": (
        1, [(ERROR, 2, 3.0, 9.9)], [(ERROR, 2, 3.0, 10.4)], -0.2 / 8.0,
    ),
    "1: outside the uncontrolled box": (1, [(ERROR, 3, 6.49, 0.5)], [(ERROR, 3, 6.6, 0.5)], -0.1 / 8.0),
    "2: at either gain": (2, [(ERROR, 5, 6.4, 1.1)], [(ERROR, 5, 7.2, 1.1)], -0.7 / 8.0),
    "3: box shorter than every other's": (3, [(ERROR, 3, 3.6, 0.64)], [(ERROR, 3, 3.6, 0.8)], -0.05),
    "4: smoother": (4, [(ROUGHNESS, 3, 58.4, 9.0)], [(ROUGHNESS, 3, 59.0, 9.0)], -0.05),
    "5: lighter": (5, [(FORCE, 3, 5.69, 1.0)], [(FORCE, 3, 5.8, 1.0)], -0.05),
    "6: little accuracy": (6, [(ERROR, 3, 4.19, 0.5)], [(ERROR, 3, 4.6, 0.5)], -0.05),
    "7: little accuracy, either way": (7, [(ERROR, 5, 4.09, 1.1)], [(ERROR, 5, 1.3, 1.1)], -0.05),
    "7: lighter, boxes apart": (7, [(FORCE, 5, 3.69, 0.5)], [(FORCE, 5, 3.85, 0.5)], -0.075),
    "8: similar force": (8, [(FORCE, 5, 2.59, 0.4)], [(FORCE, 5, 2.7, 0.4)], -0.05),
    "8: similar smoothness": (8, [(ROUGHNESS, 5, 7.1, 2.0)], [(ROUGHNESS, 5, 6.5, 2.0)], -0.05),
    "9: mean of the two": (9, [(FORCE, 4, 7.79, 0.5)], [(FORCE, 4, 8.1, 0.5)], -0.075),
    "10: no gain": (10, [(ERROR, 4, -1.8, 1.3, "four-brake")], [(ERROR, 4, -2.3, 1.3, "four-brake")], -0.0125),
    "10: wider": (10, [(ERROR, 1, 8.0, 2.31, "four-brake")], [(ERROR, 1, 8.0, 2.2, "four-brake")], -0.05),
    "11: similar improvement": (11, [(ERROR, 4, 1.5, 1.3)], [(ERROR, 4, 1.0, 1.3)], -0.05),
}  # fmt: skip


@pytest.mark.parametrize("number, inside, outside, margin", BOX_BOUNDS.values(), ids=BOX_BOUNDS)
def test_each_rule_has_its_bound_and_knows_no_unit(number, inside, outside, margin):
    """Errors a thousand times smaller, forces seven times larger: the same margins."""
    assert judged(made(inside))[number].verdict == HOLDS
    found = judged(made(outside))[number]
    assert found.verdict == FAILS and found.margin == pytest.approx(margin, abs=1e-9)
    factor = {ERROR: 1e-3, FORCE: 7.0, ROUGHNESS: 1.0, WITHOUT_RAMP: 1.0}
    for changes in (inside, outside):
        boxes = made(changes)
        scaled = {cell: PooledBox(*(factor[cell[0]] * q for q in box)) for cell, box in boxes.items()}
        before, after = ([one.margin for one in judged(some).values()] for some in (boxes, scaled))
        assert after == pytest.approx(before, abs=1e-9)


@pytest.mark.parametrize("measure", [ROUGHNESS, WITHOUT_RAMP])
def test_where_the_two_sums_disagree_the_verdict_depends_on_how_the_cut_is_treated(measure):
    found = judged(made([(measure, 3, 59.0, 9.0)], both=False))
    assert {number for number, one in found.items() if one.verdict == DEPENDS} == {4}
    assert found[4].margins[measure == WITHOUT_RAMP] == found[4].margin == pytest.approx(-0.05)
    assert found[4].margins[measure == ROUGHNESS] >= 0.0
    assert all(word in found[4].sentence for word in ("As cut, ", "Without the ramp, ", "-10 %", "-150 %"))


def test_wider_bands_ask_more_of_a_difference_and_less_of_a_likeness():
    lighter, costlier = made([(FORCE, 3, 5.6, 1.0)]), made([(ERROR, 3, 4.4, 0.5)])
    assert [judged(lighter, bands)[5].verdict for bands in (0.5, 1.0, 2.0)] == [HOLDS, HOLDS, FAILS]
    assert [judged(costlier, bands)[6].verdict for bands in (0.5, 1.0, 2.0)] == [FAILS, FAILS, HOLDS]


def test_a_missing_box_leaves_its_statements_open_and_no_others_and_a_statement_must_hold_on_both_devices():
    boxes = made()
    del boxes[FORCE, "four-brake", 3]
    found = judged(boxes)
    assert {number for number, one in found.items() if one.verdict == CANNOT_TELL} == {5, 9, 10}
    assert math.isnan(found[5].margin) and "'SDOF with gap' on four-brake" in found[5].sentence
    one_device = box_findings({cell: box for cell, box in made().items() if cell[1] == "three-brake"}, DEVICES[:1])
    assert [one.verdict for one in one_device] == [HOLDS] * 9 + [CANNOT_TELL, HOLDS]
    found = judged(made([(FORCE, 3, 6.0, 1.0, "four-brake")]))[5]
    assert found.verdict == FAILS and "four-brake" in found.sentence


@pytest.mark.parametrize("status", ["timeout", "aborted"])
def test_boxes_pool_the_trials_of_everyone_that_reached_the_end(status):
    rows = study(people=3)
    boxes = {cell: box for cell, box in pooled_boxes(as_table(rows)).items() if cell[1:] == ("three-brake", 2)}
    errors = sorted(r.value("path_error_m") for r in rows if (r.configuration, r.controller) == ("three-brake", 2))
    assert boxes[ERROR, "three-brake", 2] == tuple(np.quantile(errors, (0.25, 0.5, 0.75))) and len(errors) == 18
    late = [replace(r, status=status) if r.controller == 3 and r.repetition == 1 else r for r in rows]
    found = {one.statement.number: one for one in box_findings_of(as_table(late))}
    assert found[5].verdict == CANNOT_TELL and "too few of its trials reached the end" in found[5].sentence


# ------------------------------------------------------------------------------------------------ held by chance

STUDIED = load_protocol()
POPULATIONS, PEOPLE, DRAWN = ("average", "from-device"), 3, 30


def shares_of(population: str, generator: np.random.Generator) -> np.ndarray:
    """How often each holds: three people without control, whose trials on a path change controllers at random."""
    same = structs.replace(STUDIED, controllers=dict.fromkeys(STUDIED.controllers, STUDIED.controllers[1]))
    tasks: dict[str, dict[tuple[str, int], list[TrialRow]]] = {}
    for row, _ in study_trials(same, load_population(population), PEOPLE, JUDGED):
        tasks.setdefault(row.participant, {}).setdefault((row.configuration, row.path), []).append(row)
    held = []
    for _ in range(DRAWN):
        rows = []
        for of_person in tasks.values():
            for task in of_person.values():
                controllers = generator.permutation([int(row.controller) for row in task])
                rows += [replace(row, controller=int(k)) for row, k in zip(task, controllers, strict=True)]
        held.append([finding.verdict == HOLDS for finding in box_findings_of(as_table(rows))])
    return np.mean(held, axis=0)


def test_each_statement_holds_by_chance_as_often_as_the_report_says():
    generator = np.random.default_rng(1)
    shares = np.array([shares_of(population, generator) for population in POPULATIONS])
    for (number, said), least, most in zip(CHANCE.items(), shares.min(axis=0), shares.max(axis=0), strict=True):
        for share, expected in ((least, said[0]), (most, said[1])):
            p = min(max(expected, 0.02), 0.98)
            # they share their people, so they tell less than as many independent ones
            assert abs(share - expected) < 4.0 * math.sqrt(p * (1.0 - p) / DRAWN) + 0.02, (number, share, said)
