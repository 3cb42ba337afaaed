"""Box plots of a protocol of one's own: names fit, one trial is told apart by its square, no number of the paper's."""

import re

import pytest
from matplotlib.figure import Figure

from experiments.analysis.boxplots import DRAWN, _draw, draw_boxplots
from experiments.analysis.figures import CONTROLLER_LABELS
from experiments.analysis.trials_table import TrialRow
from experiments.protocol import label

LONG = {1: label("None"), 2: label("A wall of the softest kind that there is, with a gap on either of its sides")}
BOTH = ("three-brake", "four-brake")


def trials(count: int) -> list[TrialRow]:
    return [
        TrialRow("01", 1, 1, device, controller, 1, 1, "done", path_error_m=0.001 * (i + controller),
                 mean_tip_force_N=1.0, acceleration_dft_sum=2.0)
        for device in BOTH for controller in (1, 2) for i in range(count)
    ]  # fmt: skip


def drawn(rows: list[TrialRow], labels: dict) -> Figure:
    import experiments.analysis.boxplots as module

    figures = []

    def kept(figure, *rest):
        figures.append(figure)
        _draw(figure, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_draw", kept)
        patch.setattr(module, "figure_bytes", lambda figure, form: b"")
        import tempfile

        with tempfile.TemporaryDirectory() as folder:
            draw_boxplots(rows, folder, "a note", BOTH, DRAWN[:1], labels)
    return figures[0]


def test_the_longest_name_of_a_controller_ends_above_the_footnote() -> None:
    figure = drawn(trials(3), LONG)
    renderer = figure.canvas.get_renderer()
    figure.draw(renderer)
    names = [text.get_window_extent(renderer) for text in figure.axes[0].texts]
    foot = [text.get_window_extent(renderer) for text in figure.texts]
    assert len(names) > 5 and min(name.y0 for name in names) > max(line.y1 for line in foot)


def test_one_trial_is_a_square_filled_or_open_as_the_legend_says() -> None:
    figure = drawn(trials(1), LONG)
    squares = [line for line in figure.axes[0].lines if line.get_marker() == "s"]
    faces = [square.get_markerfacecolor() for square in squares]
    assert len(squares) == 4 and faces.count("white") == 2 and not figure.axes[0].patches
    foot = " ".join(text.get_text() for text in figure.texts)
    assert "1 trial a box" in foot and "square" in foot
    assert not [line for line in drawn(trials(2), LONG).axes[0].lines if line.get_marker() == "s"]


@pytest.mark.parametrize(("protocol", "first"), [("paper", "fig16_path_error"), ("mine", "path_error")])
def test_only_the_papers_own_figures_have_its_figures_numbers(tmp_path, protocol: str, first: str) -> None:
    written = draw_boxplots(
        trials(1), tmp_path / "out", "a note", BOTH, DRAWN[:1], CONTROLLER_LABELS, protocol=protocol
    )
    assert {path.stem for path in written} == {first, "boxplots"}
    assert bool(re.match("fig", first)) == (protocol == "paper")
