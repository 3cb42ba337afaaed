"""Box plots: the numbers of a box against other ways to get them, and the files that a study leaves."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.cbook import boxplot_stats

from core.files import InputError
from experiments.analysis.boxplots import DRAWN, Box, box_statistics, boxes, draw_boxplots
from experiments.analysis.trials_table import TrialRow

NOTE = "Settled rules, low gain 5 N s/m, parameters assumed."
finite = st.floats(-1e6, 1e6).map(lambda value: round(value, 6))


def study(participants=3, seed=0):
    generator = np.random.default_rng(seed)
    return [
        TrialRow(
            f"{p:02}", 1, block, configuration, controller, segment, block, "done",
            path_error_m=1e-3 * float(generator.lognormal()),
            mean_tip_force_N=float(generator.lognormal()),
            acceleration_dft_sum=100.0 * float(generator.lognormal()),
        )
        for p in range(1, participants + 1)
        for configuration in ("three-brake", "four-brake")
        for block in (1, 2, 3)
        for controller in range(1, 6)
        for segment in (1, 2)
    ]  # fmt: skip


@given(st.lists(finite, min_size=1, max_size=40))
@settings(max_examples=80)
def test_a_box_is_the_one_that_matplotlib_would_draw(values):
    """matplotlib.cbook.boxplot_stats(values, whis=1.5), which also uses NumPy's linear quartiles."""
    box, (oracle,) = box_statistics(values), boxplot_stats(values, whis=1.5)
    assert box.count == len(values)
    assert (box.median, box.q1, box.q3) == pytest.approx((oracle["med"], oracle["q1"], oracle["q3"]), abs=1e-9)
    assert (box.low, box.high) == pytest.approx((oracle["whislo"], oracle["whishi"]), abs=1e-9)
    assert box.outliers == pytest.approx(sorted(oracle["fliers"]))


def test_a_box_by_hand():
    """1..9, 30: positions 0.25 * 9 = 2.25, 4.5, 6.75 between the sorted values; reach 1.5 * 4.5 = 6.75 to 14.5."""
    values = [30.0, 9, 1, 8, 2, 7, 3, 6, 4, 5]
    assert box_statistics(values) == Box(10, 5.5, 3.25, 7.75, 1.0, 9.0, (30.0,))
    assert box_statistics([2.0]) == Box(1, 2.0, 2.0, 2.0, 2.0, 2.0, ())


@given(st.lists(finite, min_size=1, max_size=30))
def test_box_whiskers_and_outliers_hold_every_value_in_order(values):
    box = box_statistics(values)
    assert box.low <= box.q1 <= box.median <= box.q3 <= box.high
    assert sum(box.low <= value <= box.high for value in values) + len(box.outliers) == len(values)
    reach = 1.5 * (box.q3 - box.q1) * (1 + 1e-12)
    assert all(value > box.q3 + 0.999 * reach or value < box.q1 - 0.999 * reach for value in box.outliers)
    assert box.high <= box.q3 + reach and box.low >= box.q1 - reach


@pytest.mark.parametrize("values", [[], [1.0, math.nan], [math.inf]])
def test_a_box_of_nothing_or_of_no_number_is_refused(values):
    with pytest.raises(ValueError, match="box"):
        box_statistics(values)


def test_a_study_of_three_has_18_trials_in_each_of_10_boxes():
    rows = study()
    found = boxes(rows, "path_error_m", ("three-brake", "four-brake"), 1e3)
    assert len(found) == 10 and {box.count for box in found.values()} == {18}
    by_hand = [1e3 * row.path_error_m for row in rows if (row.controller, row.configuration) == (4, "four-brake")]
    assert found[4, "four-brake"].median == pytest.approx(np.median(by_hand))


def test_a_trial_that_was_not_done_is_in_no_box_and_a_timed_out_one_only_if_asked_for():
    rows = study()
    for i, status in ((0, "timeout"), (2, "aborted"), (4, "redone"), (6, "excluded")):
        rows[i] = replace(rows[i], status=status, path_error_m=0.065)
    assert [rows[i].controller for i in (0, 2, 4, 6)] == [1, 2, 3, 4]
    found = boxes(rows, "path_error_m", ("three-brake", "four-brake"))
    assert [found[controller, "three-brake"].count for controller in (1, 2, 3, 4, 5)] == [17, 17, 17, 17, 18]
    assert max(max(box.high, *box.outliers, 0.0) for box in found.values()) < 0.065
    asked = boxes(rows, "path_error_m", ("three-brake", "four-brake"), timeouts=True)
    assert asked[1, "three-brake"].count == 18 and 0.065 in asked[1, "three-brake"].outliers
    assert {key: box for key, box in asked.items() if key != (1, "three-brake")}.items() <= found.items()


@pytest.mark.parametrize("timeouts", [False, True])
def test_a_figure_says_how_many_trials_it_leaves_out(tmp_path, timeouts):
    rows = study()
    rows[:3] = [replace(rows[i], status=status) for i, status in enumerate(("timeout", "timeout", "excluded"))]
    draw_boxplots(rows, tmp_path, NOTE, metrics=DRAWN[:1], timeouts=timeouts)
    text = " ".join(re.findall(r"<!-- (.*?) -->", (tmp_path / "fig16_path_error.svg").read_text()))
    where = "in the boxes" if timeouts else "crosses above the scale, not in the boxes"
    assert f"2 trials timed out: {where}. 1 trial excluded by the experimenter" in text


def test_a_study_leaves_each_figure_in_three_formats_and_the_same_bytes_every_time(tmp_path):
    rows = study()
    paths = draw_boxplots(rows, tmp_path / "a", NOTE)
    names = ("fig16_path_error", "fig17_tip_force", "fig18_acceleration_dft_sum")
    wanted = {f"{name}.{form}" for name in names for form in ("png", "svg", "pdf")} | {"boxplots.png"}
    assert {path.name for path in paths} == {path.name for path in (tmp_path / "a").iterdir()} == wanted
    draw_boxplots(rows, tmp_path / "b", NOTE)
    for path in paths:
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name
        kind = {"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}[path.suffix[1:]]
        assert path.read_bytes().startswith(kind)
        assert not re.search(rb"20\d\d-\d\d-\d\d|CreationDate|<dc:date>", path.read_bytes()), path.name

    with pytest.raises(InputError, match="exists already"):
        draw_boxplots(rows, tmp_path / "a", NOTE)


def test_every_figure_says_what_it_shows_and_with_what_it_was_made(tmp_path):
    """matplotlib leaves each text beside its outlines in the SVG, as a comment."""
    rows = study()
    draw_boxplots(rows, tmp_path / "even", NOTE, metrics=DRAWN[:1])
    draw_boxplots(rows[1:], tmp_path / "uneven", NOTE, metrics=DRAWN[:1])
    for folder, trials in (("even", "18 trials a box"), ("uneven", "Under each box")):
        text = " ".join(re.findall(r"<!-- (.*?) -->", (tmp_path / folder / "fig16_path_error.svg").read_text()))
        for words in (trials, "'linear'", "1.5 box lengths", "Path error (mm)", NOTE, "three-brake", "four-brake"):
            assert words in text, words


def test_nothing_to_draw_is_said_before_a_file_is_written(tmp_path):
    with pytest.raises(InputError, match="no trials"):
        draw_boxplots([], tmp_path / "out", NOTE)
    assert not (tmp_path / "out").exists()


def test_a_measure_without_a_single_value_is_drawn_empty(tmp_path):
    rows = [replace(row, mean_tip_force_N=None) for row in study(participants=1)]
    assert len(draw_boxplots(rows, tmp_path, NOTE, metrics=DRAWN[1:2])) == 4
