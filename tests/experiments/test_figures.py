"""Figures: the numbers of boxes and marks by other ways, what stands on a figure, and what a journal takes."""

import itertools
import math
import re
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.cbook import boxplot_stats
from matplotlib.collections import PathCollection
from matplotlib.colors import to_hex
from matplotlib.text import Text
from protocols import study_data

from core.device import load_device
from core.files import InputError
from experiments.analysis.by_path import by_path, by_path_table
from experiments.analysis.chart_figures import TIMEOUT_COLOUR, draw, draw_boxplots
from experiments.analysis.charts import View, box_statistics
from experiments.analysis.error_against_force import joined, marks_of
from experiments.analysis.force_figure import draw_error_against_force
from experiments.analysis.metrics import DRAWN, FIGURES
from experiments.analysis.sheet import COLUMN_IN, PAGE_IN, STYLE, figure_bytes
from experiments.analysis.trials_table import TrialRow, as_table
from experiments.paper_figures import pictures
from experiments.protocol import label, load_protocol
from tests.support.rows import with_measures

NOTE = "Settled rules, low gain 5 N s/m, parameters assumed."
LABELS = {number: label(preset.name) for number, preset in load_protocol().controllers.items()}
BOTH = ("three-brake", "four-brake")
LONG = {1: label("No control"), 2: label("A wall of the softest kind that there is, with a gap on either of its sides")}
finite = st.floats(-1e6, 1e6).map(lambda value: round(value, 6))


def view_of(labels, **more):
    return View(BOTH, labels, colours={number: number - 1 for number in labels}, **more)


def study(participants=3, blocks=(1, 2, 3), paths=(1, 2), controllers=range(1, 6)):
    generator = np.random.default_rng(0)
    return [
        TrialRow(
            f"{p:02}", 1, block, configuration, controller, path, block, "done",
            measures={
                "path_error_m": 1e-3 * float(generator.lognormal()),
                "mean_tip_force_N": float(generator.lognormal()),
                "acceleration_dft_sum": 100.0 * float(generator.lognormal()),
            },
        )
        for p in range(1, participants + 1)
        for configuration in BOTH
        for block in blocks
        for controller in controllers
        for path in paths
    ]  # fmt: skip


@given(st.lists(finite, min_size=1, max_size=40))
def test_a_box_is_the_one_that_matplotlib_would_draw_and_holds_every_value(values):
    """matplotlib.cbook.boxplot_stats(values, whis=1.5), which also uses NumPy's linear quartiles."""
    box, (oracle,) = box_statistics(values), boxplot_stats(values, whis=1.5)
    assert (box.median, box.q1, box.q3) == pytest.approx((oracle["med"], oracle["q1"], oracle["q3"]), abs=1e-9)
    assert (box.low, box.high) == pytest.approx((oracle["whislo"], oracle["whishi"]), abs=1e-9)
    assert box.outliers == pytest.approx(sorted(oracle["fliers"]))
    assert box.low <= box.q1 <= box.median <= box.q3 <= box.high
    assert sum(box.low <= value <= box.high for value in values) + len(box.outliers) == len(values) == box.n


@pytest.mark.parametrize("timeouts", [False, True])
def test_a_figure_says_how_many_trials_it_leaves_out_and_crosses_those_that_timed_out(timeouts):
    rows = study(controllers=(1, 2))
    rows[:3] = [replace(rows[i], status=status) for i, status in enumerate(("timeout", "timeout", "excluded"))]
    figure, foot = drawn(rows, timeouts=timeouts)
    where = "in the boxes" if timeouts else "crosses above the scale, not in the boxes"
    assert f"2 trials timed out: {where}. 1 trial excluded by the experimenter" in foot
    crosses = [
        place for marks in figure.axes[0].collections if isinstance(marks, PathCollection)
        for place in marks.get_offsets() if to_hex(marks.get_edgecolor()[0]) == TIMEOUT_COLOUR
    ]  # fmt: skip
    assert len(crosses) == (0 if timeouts else 2)


@pytest.mark.parametrize("paths", [(), (1, 2)])
def test_panels_stand_apart_and_everything_is_on_the_page(paths):
    shown, view = as_table(study(blocks=(1,))), view_of(LABELS)
    for figure in (draw(shown, NOTE, view, DRAWN[:2], 12.0, paths), draw_error_against_force(shown, NOTE, view)):
        panels, page = [axes.get_position() for axes in figure.axes], figure.get_tightbbox()
        assert not any(one.overlaps(other) for one, other in itertools.combinations(panels, 2))
        width, height = figure.get_size_inches()
        assert min(page.x0, page.y0) >= 0.0 and page.x1 <= width and page.y1 <= height


def test_a_study_leaves_each_figure_in_three_formats_and_the_same_bytes_every_time(tmp_path):
    rows = study()
    paths = draw_boxplots(study_data(rows, NOTE), tmp_path / "a")
    names = {metric.figure for metric in FIGURES} | {"error_against_force"}
    assert names >= {"fig16_path_error", "fig17_tip_force", "fig18_acceleration_dft_sum"}  # the paper's
    wanted = {f"{name}.{form}" for name in names for form in ("png", "svg", "pdf")} | {
        "boxplots.png",
        "boxplots_by_path.png",
    }
    assert {path.name for path in paths} == {path.name for path in (tmp_path / "a").iterdir()} == wanted
    figure = draw(as_table(rows), NOTE, view_of(LABELS), DRAWN[:1], 6.4)
    for path in paths:
        if path.stem == FIGURES[0].figure:
            assert path.read_bytes() == figure_bytes(figure, path.suffix[1:]), path.name
        kind = {"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}[path.suffix[1:]]
        assert path.read_bytes().startswith(kind)
        assert not re.search(rb"20\d\d-\d\d-\d\d|CreationDate|<dc:date>", path.read_bytes()), path.name

    with pytest.raises(InputError, match="exists already"):
        draw_boxplots(study_data(rows, NOTE), tmp_path / "a")
    with pytest.raises(InputError, match="no trials"):
        draw_boxplots(study_data([]), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def drawn(rows, **more):
    """Path error: the figure, and all that stands under it."""
    figure = draw(as_table(rows), NOTE, view_of(LONG, **more), DRAWN[:1], 6.4)
    return figure, " ".join(text.get_text() for text in figure.texts)


def marks(axes):
    """Of the points: marker's corners, face and place."""
    return [
        (len(points.get_paths()[0].vertices), to_hex(points.get_facecolors()[0]), tuple(place))
        for points in axes.collections if isinstance(points, PathCollection) for place in points.get_offsets()
    ]  # fmt: skip


def test_a_row_is_the_median_and_the_quartiles_of_a_device_a_path_a_controller_and_a_measure():
    trials = as_table(study(controllers=(1, 4)))
    found = by_path(trials, LABELS)
    assert len(found) == len(BOTH) * 2 * 2 * 3, "devices, paths, controllers, measures that have a value"
    for row in found.itertuples():
        place = trials["configuration"].eq(row.configuration) & trials["path"].eq(row.path)
        values = trials[place & trials["controller"].eq(row.controller)][row.measure]
        assert (row.median, row.q1, row.q3) == pytest.approx(tuple(values.quantile([0.5, 0.25, 0.75])))
        assert row.trials == len(values) == 9
    assert set(found["controller_name"]) == {"No control", "Proportional, high gain"}
    table = by_path_table(found, ())
    assert "path error (mm)" in table and "Proportional, high gain" in table and table.count("\n") == 1 + 8
    assert by_path_table(by_path(trials[trials["path"] == 1], LABELS), ()) == ""


def test_codes_of_blind_sessions_are_not_pooled_over_their_participants():
    coded = as_table(study(2, controllers=(1,))).assign(controller="K1")
    assert set(by_path(coded, LABELS)["controller"]) == {"P01 K1", "P02 K1"}


def test_a_mark_holds_median_and_quartiles_of_each_controller_on_each_device():
    trials = as_table(study())
    marks = marks_of(trials, view_of(LABELS))
    assert [(mark.controller, mark.configuration) for mark in marks] == list(itertools.product(range(1, 6), BOTH))
    for mark in marks:
        cell = trials[(trials["controller"] == mark.controller) & (trials["configuration"] == mark.configuration)]
        for box, column, scale in ((mark.error, "path_error_m", 1e3), (mark.force, "mean_tip_force_N", 1.0)):
            expected = scale * cell[column].quantile([0.25, 0.5, 0.75])
            assert (box.q1, box.median, box.q3) == pytest.approx(tuple(expected))
        assert mark.smoothness == pytest.approx(cell["acceleration_dft_sum"].median())
        assert f"{mark.error.median:.3g}" in mark.text and mark.configuration in mark.text
    assert [(a.controller, b.controller) for a, b in joined(marks)] == [(k, k) for k in range(1, 6)]


def test_a_controller_without_an_error_above_zero_or_without_a_measure_has_no_mark_and_smoothness_may_be_missing():
    rows = study(1, controllers=(1, 2, 3))
    changed = {1: {"path_error_m": 0.0}, 2: {"mean_tip_force_N": None}, 3: {"acceleration_dft_sum": None}}
    marks = marks_of(as_table(with_measures(row, **changed[row.controller]) for row in rows), view_of(LABELS))
    assert {mark.controller for mark in marks} == {3} and all(math.isnan(mark.smoothness) for mark in marks)


SLOW = ("displays", "fig11", "passive_master", "stopping_distance")  # simulated
QUICK = [p for p in pictures([load_device("four-brake")]) if not p.name.startswith(SLOW)]


def texts_of(figure):
    return [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]


@pytest.mark.parametrize("picture", QUICK, ids=[picture.name for picture in QUICK])
def test_the_papers_figures_have_a_width_and_text_that_a_journal_takes(picture):
    with matplotlib.rc_context(STYLE):
        figure = picture.draw()
    assert figure.get_figwidth() in (COLUMN_IN, PAGE_IN)
    assert {text.get_fontsize() for text in texts_of(figure)} <= {7.0, 7.5, 8.0, 9.0}


@pytest.mark.usefixtures("fine_prints")
def test_text_is_text_in_svg_and_fonts_in_pdf():
    figure = draw(as_table(study(1)), NOTE, view_of(LABELS), [DRAWN[0]], COLUMN_IN)
    svg = figure_bytes(figure, "svg").decode()
    assert "<text" in svg and "Path error (mm)" in svg and NOTE.split()[0] in svg
    pdf = figure_bytes(figure, "pdf")
    assert set(re.findall(rb"/Subtype /(Type[0-9])\b", pdf)) == {b"Type0"}
