"""Figures for a journal: 3.5 or 7 inches wide, text of 7 to 9 points at that size, as text, and none over another."""

import itertools
import re
from pathlib import Path

import matplotlib
import pytest
from matplotlib.text import Text
from protocols import study_data
from refusals import refusal
from test_boxplots import LABELS, NOTE, study, view_of

from app.cli import main
from core.device import load_device
from experiments.analysis.chart_figures import JOURNAL, SCREEN, draw, draw_boxplots
from experiments.analysis.metrics import BY_NAME, DRAWN
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


@pytest.mark.parametrize(("metrics", "width"), [([DRAWN[2]], COLUMN_IN), (DRAWN, PAGE_IN)])
def test_box_plots_for_a_journal_have_no_text_outside_or_over_another(metrics, width):
    rows = study()
    figure = draw(as_table(rows), NOTE, view_of(LABELS), [BY_NAME[metric.name] for metric in metrics], width)
    with matplotlib.rc_context(STYLE):
        figure.draw_without_rendering()
    shown = texts_of(figure)
    assert all(7.0 <= text.get_fontsize() <= 9.0 for text in shown)
    level = [text.get_window_extent() for text in shown if not text.get_rotation()]
    assert not [pair for pair in itertools.combinations(level, 2) if pair[0].overlaps(pair[1])]
    page = figure.bbox.padded(1.0)
    for box in (text.get_window_extent() for text in shown):
        assert page.contains(*box.min) and page.contains(*box.max)


@pytest.mark.usefixtures("fine_prints")
def test_text_is_text_in_svg_and_fonts_in_pdf():
    figure = draw(as_table(study(1)), NOTE, view_of(LABELS), [DRAWN[0]], COLUMN_IN)
    svg = figure_bytes(figure, "svg").decode()
    assert "<text" in svg and "Path error (mm)" in svg and NOTE.split()[0] in svg
    pdf = figure_bytes(figure, "pdf")
    assert set(re.findall(rb"/Subtype /(Type[0-9])\b", pdf)) == {b"Type0"}


def test_a_journal_gets_all_measures_beside_each_other_in_every_format(tmp_path):
    paths = draw_boxplots(study_data(study(1), NOTE), tmp_path / "out", purpose=JOURNAL)
    beside = {path.suffix for path in paths if path.stem == "boxplots"}
    assert beside == {".png", ".svg", ".pdf"}
    with pytest.raises(KeyError):
        draw_boxplots(study_data(study(1)), tmp_path / "other", purpose="poster")


def test_a_study_and_its_analysis_draw_what_was_asked_for_and_a_sweep_refuses(tmp_path, monkeypatch, capsys):
    asked = []
    for verb, module in (("run_study", "study"), ("analyze", "analyze")):
        monkeypatch.setattr(f"experiments.study.{module}.{verb}", lambda *a, **_: asked.append(a[4]) or {"in_doubt": 0})
    main(["study", "--operators", "1", "--figures", JOURNAL, "--out", str(tmp_path / "a")])
    main(["study", "--operators", "1", "--out", str(tmp_path / "b")])
    main(["analyze", str(tmp_path), "--figures", JOURNAL])
    assert asked == [JOURNAL, SCREEN, JOURNAL]
    sweep = Path(__file__).parents[2] / "docs/examples/sweeps/low-gain.toml"
    asked_wrongly = "study", "--sweep", str(sweep), "--figures", JOURNAL, "--out", str(tmp_path / "c")
    assert "--figures" in refusal(capsys, *asked_wrongly)
