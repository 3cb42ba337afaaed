"""Figures: their numbers by other ways, what stands on them, what a journal takes, what brakes can do where."""

import itertools
import math
import re
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from devices import BRAKE_TEXT, FOUR, THREE
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.cbook import boxplot_stats
from matplotlib.collections import PathCollection
from matplotlib.colors import to_hex
from matplotlib.text import Text
from protocols import study_data
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from app.cli import main
from core.device import build_device, load_device
from core.files import InputError
from core.workspace import free_tips, held_in_any_direction, tip_is_free
from experiments.analysis.by_path import by_path, by_path_table
from experiments.analysis.chart_figures import TIMEOUT_COLOUR, draw, draw_boxplots
from experiments.analysis.charts import View, box_statistics
from experiments.analysis.error_against_force import joined, marks_of
from experiments.analysis.force_figure import draw_error_against_force
from experiments.analysis.metrics import DRAWN, FIGURES
from experiments.analysis.sheet import COLUMN_IN, PAGE_IN, STYLE, figure_bytes
from experiments.analysis.trials_table import TrialRow, as_table
from experiments.paper_figures import pictures
from experiments.paper_figures.control import five_forces
from experiments.paper_figures.directions import (
    achievable_span,
    gaps,
    mean_unachievable,
    worst_unachievable,
)
from experiments.paper_figures.displays import displays, measure_display
from experiments.paper_figures.maps import least_across, mean_across, pushes_of, worst_across
from experiments.paper_figures.workspace import workspace_of
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


@pytest.mark.usefixtures("fine_prints")
def test_text_is_text_in_svg_and_fonts_in_pdf():
    figure = draw(as_table(study(1)), NOTE, view_of(LABELS), [DRAWN[0]], COLUMN_IN)
    svg = figure_bytes(figure, "svg").decode()
    assert "<text" in svg and "Path error (mm)" in svg and NOTE.split()[0] in svg
    pdf = figure_bytes(figure, "pdf")
    assert set(re.findall(rb"/Subtype /(Type[0-9])\b", pdf)) == {b"Type0"}


DEVICES = {bar.name: bar for bar in (THREE, FOUR)}
devices = pytest.mark.parametrize("bar", DEVICES.values(), ids=DEVICES)
lines_of_force = st.lists(st.floats(0.0, math.pi), min_size=1, max_size=5)


@given(lines_of_force)
def test_worst_and_mean_are_those_over_all_directions_of_velocity(lines):
    velocities = (np.arange(720) + 0.5) * math.pi / 360.0
    spans = [achievable_span(lines, v) for v in velocities]
    left = [2.0 * math.pi - (high - low) for low, high in spans]
    assert all(-0.5 * math.pi <= low <= high <= 0.5 * math.pi for low, high in spans), "all oppose the velocity"
    # the grid of velocities may miss a narrow range of them: every one stays below the worst, and most meet it
    assert max(left) <= worst_unachievable(lines) + 1e-9
    if gaps(lines).max() > 0.01:
        assert max(left) == pytest.approx(float(worst_unachievable(lines)))
    assert np.mean(left) == pytest.approx(float(mean_unachievable(lines)), abs=0.03)


@devices
def test_the_workspace_drawn_is_where_the_tip_is_free_on_one_side_of_the_singular_positions(bar):
    workspace = workspace_of(bar.device.mechanism)
    x, y = np.meshgrid(workspace.x[::7], workspace.y[::7])
    free, inside = tip_is_free(bar.device.mechanism, x, y), workspace.room[::7, ::7] > 0.0
    assert np.any(inside) and np.all(free[inside])
    for tip in np.column_stack((x[free & ~inside], y[free & ~inside])):
        assert bar.sines(tip)[2] * workspace.side < 0.0
    assert bar.is_open(np.array(workspace.home), 0.5)


def test_only_the_display_with_two_brakes_finds_no_valid_one_and_holds_least():
    protocol = load_protocol()
    found = {device.name: measure_display(device, protocol) for device in displays(protocol)}
    two = found.pop("er-two-brake")
    assert 0.1 < two.unreachable.mean() < 0.3
    assert sorted(found) == ["four-brake", "pter", "three-brake"]
    assert found["pter"].widest_gap.max() < 0.8 * found["four-brake"].widest_gap.max()
    assert found["pter"].holds.min() > found["four-brake"].holds.min()
    for other in found.values():
        assert not other.unreachable.any()
        assert other.holds.min() > 1.4 * two.holds.min()
        assert other.widest_gap.max() < two.widest_gap.min()
        assert np.median(other.path_error) < 0.7 * np.median(two.path_error)


def test_the_five_forces_give_the_papers_influence_matrix_and_the_coupling_one_is_chosen():
    example = five_forces()
    assert example.influence.tolist() == [[1, 0, -1, -1, -1], [-1, -1, -1, 0, 1]]
    assert np.all(example.directions @ np.array(example.v) < 0.0), "every brake opposes the motion"
    assert example.selected == 0 and example.ranks == [3, 2, 1, 0, 0]


ASSUMED = build_device('provenance = "assumed"\n' + FOUR.text, {"test-brake": BRAKE_TEXT}, "own")


SLOW = "fig11", "passive_master", "stopping_distance"  # simulated


def words(figure) -> str:
    """All that is written under a figure."""
    return " ".join(text.get_text() for text in figure.texts)


def test_there_is_every_figure_and_what_rests_on_assumed_parameters_says_so_and_what_does_not_does_not():
    of_both = [picture.name.split("_")[0] for picture in pictures([THREE.device, FOUR.device])]
    assert {int(number) for name in of_both for number in re.findall(r"\d\d", name)} == {1, *range(4, 15)}
    free = {"fig01_unachievable_directions", "fig12_velocity_field", "fig14_proportional_selection"}
    measured = {"measured": re.sub(r'provenance = "assumed"', 'provenance = "bench"', BRAKE_TEXT)}
    text = 'provenance = "bench"\n' + re.sub('"test-brake"', '"measured"', THREE.text)
    with matplotlib.rc_context(STYLE):
        for picture in pictures([ASSUMED]):
            figure = picture.draw()
            assert ("Assumed parameters: " in words(figure)) == (picture.name not in free), picture.name
            texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]
            assert {text.get_fontsize() for text in texts} <= {7.0, 7.5, 8.0, 9.0}, "what a journal takes"
            assert figure.get_figwidth() in (COLUMN_IN, PAGE_IN)
        for picture in pictures([build_device(text, measured, "own")]):
            if picture.name not in ("displays", "scooter", *free) and not picture.name.startswith(SLOW):
                assert "ssumed" not in words(picture.draw()), picture.name


SHIPPED = ["er-two-brake", "three-brake", "four-brake", "pter"]


def poses(device, count, seed=3):
    tips = free_tips(device.mechanism)
    return tips[np.random.default_rng(seed).choice(len(tips), count)]


def on_the_lesser_side(pushes, direction):
    """The force across a motion at one tip, by linear programming over the torques of the brakes."""
    force = -(np.sign(pushes.rows[:, :, 0] @ direction)[:, None] * pushes.pull[:, :, 0])
    left = np.array([-direction[1], direction[0]])
    bounds = list(zip(pushes.low, pushes.high, strict=True))
    sides = [-linprog(-force @ (sign * left), bounds=bounds).fun for sign in (1.0, -1.0)]
    return max(min(sides), 0.0)


@pytest.mark.parametrize("as_acceleration", [False, True])
@pytest.mark.parametrize("name", SHIPPED)
def test_what_brakes_can_do_across_a_motion_is_that_of_linear_programming(name, as_acceleration):
    device = load_device(name)
    for x, y in poses(device, 2):
        pushes = pushes_of(device, np.array([x]), np.array([y]), as_acceleration)
        found = []
        for angle in np.linspace(0.0, 2.0 * math.pi, 11):
            direction = np.array([math.cos(angle), math.sin(angle)])
            found.append(on_the_lesser_side(pushes, direction))
            assert least_across(pushes, direction[:, None])[0] == pytest.approx(found[-1], abs=1e-9)
        angles = np.linspace(0.0, math.pi, 5_001)
        many = pushes._replace(rows=np.repeat(pushes.rows, len(angles), 2), pull=np.repeat(pushes.pull, len(angles), 2))
        everywhere = least_across(many, np.array([np.cos(angles), np.sin(angles)]))
        worst, size = worst_across(pushes)[0], np.hypot(*pushes.pull[:, :, 0].T) @ pushes.high
        assert worst <= everywhere.min() + 1e-9 and everywhere.min() - worst <= 2e-4 * size
        assert mean_across(pushes)[0] == pytest.approx(everywhere.mean(), abs=5e-3 * size)


@pytest.mark.parametrize("name", SHIPPED)
def test_the_force_of_a_full_lock_is_the_largest_circle_in_its_zonotope_and_half_of_it_is_had_across_any_motion(name):
    device = load_device(name)
    for x, y in poses(device, 2):
        pushes = pushes_of(device, np.array([x]), np.array([y]))
        rows, torque = pushes.rows[:, :, 0], pushes.high
        corners = np.array(np.meshgrid(*([[-1.0, 1.0]] * len(rows)))).reshape(len(rows), -1).T * torque @ rows
        sides = ConvexHull(corners).equations  # a . f + b <= 0, |a| = 1
        circle = linprog((0.0, 0.0, -1.0), np.column_stack((sides[:, :2], np.ones(len(sides)))), -sides[:, 2],
                         bounds=[(None, None), (None, None), (0.0, None)])  # fmt: skip
        held = held_in_any_direction(rows, torque)
        assert held == pytest.approx(-circle.fun)
        for angle in np.linspace(0.1, 3.0, 9):  # both sides together are the width of the zonotope
            left = np.array([-math.sin(angle), math.cos(angle)])
            assert np.abs(rows @ left) @ torque >= held * (1.0 - 1e-12)


def test_two_brakes_leave_a_direction_open_everywhere_and_lines_without_a_gap_of_90_degrees_none():
    """The argument of the paper's Fig. 1: the share of the workspace with a direction in which one side has nothing."""
    open_share = {}
    for name in SHIPPED:
        device = load_device(name)
        pushes = pushes_of(device, *poses(device, 300).T)._replace(low=np.zeros(len(device.braked)))
        lines = np.arctan2(pushes.rows[:, 1], pushes.rows[:, 0]).T
        is_open = worst_across(pushes) < 1e-9
        assert is_open.tolist() == (gaps(lines).max(axis=-1) >= 0.5 * math.pi).tolist()
        open_share[name] = is_open.mean()
    assert open_share["er-two-brake"] == 1.0 and open_share["pter"] == 0.0
    assert open_share["three-brake"] > open_share["four-brake"] > 0.0


def test_a_map_is_drawn_alone(tmp_path, capsys):
    asked = "figures", "--map", "force", "--device", "er-two-brake", "--out", str(tmp_path / "maps")
    assert main(list(asked)) == 0
    assert sorted(path.name for path in (tmp_path / "maps").iterdir()) == ["map_force.pdf", "map_force.png"]
    assert "er-two-brake" in capsys.readouterr().out
