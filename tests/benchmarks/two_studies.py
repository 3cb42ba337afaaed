"""The paper's study by default and with the numbers as printed: in how many of ten studies each statement holds.

python -m tests.benchmarks.two_studies       a minute or two; draws docs/two-studies.png
"""

import textwrap
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

import phd
from experiments.analysis.findings import HOLDS, STATEMENTS, box_findings_of
from experiments.analysis.sheet import BLUE, LINE, PAGE_IN, PALE, SMALL, STYLE, figure_bytes, plain, sheet, title
from experiments.analysis.trials_table import complete

PICTURE = Path(__file__).resolve().parents[2] / "docs" / "two-studies.png"
SEEDS = range(1, 11)
SETTINGS: dict[str, dict[str, Any]] = {
    "default": {},
    "printed": {"population": "average", "low_gain": 5.0, "sensing": "ideal"},
}


def studies_that_hold(**settings: Any) -> np.ndarray:
    """In how many of the ten studies of three people each statement holds, judged by boxes (11,)."""
    studies = (phd.run_study("paper", operators=3, seed=seed, n_jobs=-1, **settings) for seed in SEEDS)
    return np.sum([[found.verdict == HOLDS for found in box_findings_of(complete(one))] for one in studies], axis=0)


def picture(counts: dict[str, np.ndarray]) -> bytes:
    """PNG: two bars for each statement."""
    total = len(STATEMENTS) * len(SEEDS)
    note = (
        "Ten studies (seeds 1 to 10) of three simulated people each, judged by boxes as the paper judges. Dark: by "
        "default (people of from-device, encoders, low gain 500 N s/m). Pale: --population average --sensing ideal "
        f"--low-gain 5. Together {counts['default'].sum()} and {counts['printed'].sum()} of {total}. Settled rules; "
        "the gap is the half-width; parameters assumed."
    )
    with matplotlib.rc_context(STYLE):
        figure, ((axes,),) = sheet(note, (PAGE_IN, 4.6), (3.1, 0.2, 0.3, 0.35))
        places = np.arange(len(STATEMENTS))
        for shift, name, colour in ((-0.19, "default", BLUE), (0.19, "printed", PALE)):
            axes.barh(places + shift, counts[name], 0.34, color=colour, zorder=2)
            for place, count in zip(places, counts[name], strict=True):
                axes.text(count + 0.1, place + shift, f"{count}", va="center", fontsize=SMALL)
        title(axes, "Studies of ten in which it holds")
        names = [textwrap.fill(f"{one.number}  {one.text}", 50) for one in STATEMENTS]
        axes.set(xlim=(0.0, 10.6), yticks=places, yticklabels=names, xticks=range(0, 11, 2))
        axes.invert_yaxis()
        axes.tick_params(axis="y", labelsize=SMALL, length=0)
        plain(axes, grid=False)
        axes.grid(axis="x", color=LINE, linewidth=0.6)
        return figure_bytes(figure, "png")


def main() -> None:
    counts = {name: studies_that_hold(**settings) for name, settings in SETTINGS.items()}
    for statement, *both in zip(STATEMENTS, *counts.values(), strict=True):
        print(f"{statement.number:2} {statement.text}: {both[0]} of 10 by default, {both[1]} as printed")
    PICTURE.write_bytes(picture(counts))


if __name__ == "__main__":
    main()
