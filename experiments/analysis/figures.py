"""The look of figures for print: white ground, one typeface, controllers' colours, the same bytes each time."""

import io
from typing import Any

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

TEXT, QUIET, LINE = "#1c2228", "#5b6672", "#d9dee4"

#: Controller -> its name under a box; Table I of the paper.
CONTROLLER_LABELS = {
    1: "None",
    2: "SDOF",
    3: "SDOF,\ngap",
    4: "Proportional,\nhigh gain",
    5: "Proportional,\nlow gain",
}

#: The screen's palette, darker where it would fade on white paper; told apart without colour by place and label.
CONTROLLER_COLOURS = {1: "#6f7b87", 2: "#d98200", 3: "#c9a11a", 4: "#2f7fc4", 5: "#6cb0e6"}

PNG_DPI = 200
FORMATS = ("png", "svg", "pdf")

STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
    "font.size": 9.0,
    "axes.edgecolor": QUIET,
    "axes.labelcolor": TEXT,
    "axes.linewidth": 0.8,
    "text.color": TEXT,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": TEXT,
    "ytick.labelcolor": TEXT,
    "svg.hashsalt": "phd",  # else SVG names its clip paths at random
    "svg.fonttype": "path",
    "pdf.fonttype": 42,  # text stays text, which publishers ask for
}

#: What each format would otherwise stamp with the time of drawing.
_NO_DATE: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure without a window; draw on it inside `matplotlib.rc_context(STYLE)`."""
    figure = Figure(figsize=(width_in, height_in), facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def figure_bytes(figure: Figure, form: str) -> bytes:
    """The figure as "png", "svg" or "pdf"; the same figure gives the same bytes."""
    sink = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(sink, format=form, dpi=PNG_DPI, metadata=_NO_DATE[form])
    return sink.getvalue()
