"""What concludes a study, its box plots and error bars, takes longer than its trials: most tests do without."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from experiments.analysis.chart_figures import draw_boxplots
from experiments.analysis.findings import why_no_findings
from experiments.study.unrecorded import simulation_errors


def _leave_files(_table, folder: Path, *_what: object, **_options: object) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "boxplots.png").touch()


@contextlib.contextmanager
def _concluding(draw, errors, gap: bool = False) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for module in ("study", "analyze"):
            patch.setattr(f"experiments.study.{module}.draw_boxplots", draw)
        patch.setattr("experiments.study.unrecorded.simulation_errors", errors)
        refusal = why_no_findings if gap else lambda *_: "it is left out"
        patch.setattr("experiments.study.gap_reading.why_no_findings", refusal)
        yield


def left_out() -> contextlib.AbstractContextManager[None]:
    """Box plots are empty files, reports have no error bars."""
    return _concluding(_leave_files, lambda *_: [])


def error_bars() -> contextlib.AbstractContextManager[None]:
    """Reports have their error bars and the gap read the other way, box plots are empty files."""
    return _concluding(_leave_files, simulation_errors, gap=True)


def drawn() -> contextlib.AbstractContextManager[None]:
    """Box plots are drawn, reports have no error bars."""
    return _concluding(draw_boxplots, lambda *_: [])


def whole() -> contextlib.AbstractContextManager[None]:
    """Box plots, error bars and the gap read the other way, as people get them."""
    return _concluding(draw_boxplots, simulation_errors, gap=True)
