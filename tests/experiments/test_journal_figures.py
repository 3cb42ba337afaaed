"""Figures for a journal: 3.5 or 7 inches wide, text of 7 to 9 points at that size, as text, and none over another."""

import re

import matplotlib
import pytest
from matplotlib.text import Text
from test_boxplots import LABELS, NOTE, study, view_of

from core.device import load_device
from experiments.analysis.chart_figures import draw
from experiments.analysis.metrics import DRAWN
from experiments.analysis.sheet import COLUMN_IN, PAGE_IN, STYLE, figure_bytes, sheet
from experiments.analysis.trials_table import as_table
from experiments.paper_figures import pictures

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


def test_the_axes_of_a_sheet_stand_as_far_from_its_edges_and_apart_as_is_asked():
    figure, axes = sheet("words", (7.0, 5.0), (0.6, 0.2, 0.5, 0.3), (2, 2), between_in=(0.7, 0.4), inside=True)
    width, height = figure.get_size_inches()
    (upper, right), (lower, _) = [[one.get_position() for one in row] for row in axes]
    gaps = upper.x0, 1.0 - right.x1, right.x0 - upper.x1
    assert [width * gap for gap in gaps] == pytest.approx([0.6, 0.2, 0.7])
    assert [height * gap for gap in (1.0 - upper.y1, upper.y0 - lower.y1)] == pytest.approx([0.3, 0.4])
    assert height * (upper.y1 - lower.y0) == pytest.approx(5.0), "its height is that of the axes with their gap"


@pytest.mark.usefixtures("fine_prints")
def test_text_is_text_in_svg_and_fonts_in_pdf():
    figure = draw(as_table(study(1)), NOTE, view_of(LABELS), [DRAWN[0]], COLUMN_IN)
    svg = figure_bytes(figure, "svg").decode()
    assert "<text" in svg and "Path error (mm)" in svg and NOTE.split()[0] in svg
    pdf = figure_bytes(figure, "pdf")
    assert set(re.findall(rb"/Subtype /(Type[0-9])\b", pdf)) == {b"Type0"}
