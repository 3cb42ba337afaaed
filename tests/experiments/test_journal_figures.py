"""Figures for a journal: 3.5 or 7 inches wide, text of 7 to 9 points at that size, as text, and none over another."""

import re

import matplotlib
import pytest
from matplotlib.text import Text
from test_boxplots import LABELS, NOTE, study, view_of

from core.device import load_device
from experiments.analysis.chart_figures import draw
from experiments.analysis.metrics import DRAWN
from experiments.analysis.sheet import COLUMN_IN, PAGE_IN, STYLE, figure_bytes
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


@pytest.mark.usefixtures("fine_prints")
def test_text_is_text_in_svg_and_fonts_in_pdf():
    figure = draw(as_table(study(1)), NOTE, view_of(LABELS), [DRAWN[0]], COLUMN_IN)
    svg = figure_bytes(figure, "svg").decode()
    assert "<text" in svg and "Path error (mm)" in svg and NOTE.split()[0] in svg
    pdf = figure_bytes(figure, "pdf")
    assert set(re.findall(rb"/Subtype /(Type[0-9])\b", pdf)) == {b"Type0"}
