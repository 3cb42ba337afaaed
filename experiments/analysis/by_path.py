"""Medians and quartiles path by path: two paths that differ are badly told by one box of both."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

from experiments.analysis.charts import QUARTILE_METHOD, disambiguate_codes
from experiments.analysis.metrics import JUDGED, Metric
from experiments.analysis.report_tables import markdown_table, with_unit
from experiments.analysis.statistics import MEASURES
from experiments.analysis.trials_table import Controller, Trials, own_columns, to_compare

if TYPE_CHECKING:
    import pandas as pd

NAME: Final = "by_path.csv"
CELL = ["configuration", "path", "controller"]


def by_path(trials: Trials, names: Mapping[Controller, str], timeouts: bool = False) -> "pd.DataFrame":
    """A row a device, path, controller and measure that some trial has, in the measure's unit.

    timeouts: trials whose time was up count as well.
    """
    import pandas as pd

    counted = disambiguate_codes(to_compare(trials, timeouts))
    measures = [*MEASURES, *own_columns(trials)]
    long = counted.melt(CELL, [name for name in measures if name in counted], "measure").dropna(subset="value")
    order = {name: at for at, name in enumerate(measures)}
    rows = []
    for (device, path, controller, measure), cell in long.groupby([*CELL, "measure"], sort=False):
        q1, median, q3 = cell["value"].quantile([0.25, 0.5, 0.75], interpolation=QUARTILE_METHOD)
        name = controller if isinstance(controller, str) else names.get(controller, f"controller {controller}")
        rows.append((device, path, controller, " ".join(name.split()), measure, len(cell), median, q1, q3))
    rows.sort(key=lambda row: (row[1], isinstance(row[2], str), row[2], order[row[4]]))
    columns = ["configuration", "path", "controller", "controller_name", "measure", "trials", "median", "q1", "q3"]
    return pd.DataFrame(rows, columns=columns)


def by_path_table(found: "pd.DataFrame", own: Sequence[Metric]) -> str:
    """The same in Markdown, a column for each measure that the controllers are judged by; "" for one path."""
    if found["path"].nunique() < 2:
        return ""
    metrics = (*JUDGED, *own)
    lines = []
    for place, cell in found.groupby(["path", "configuration", "controller_name"], sort=False):
        of_measure = cell.set_index("measure")
        cells = []
        for metric in metrics:
            numbers = of_measure.loc[metric.name, ["median", "q1", "q3"]] if metric.name in of_measure.index else ()
            median, *ends = (
                (f"{metric.scale * value:.{metric.decimals}f}" for value in numbers) if len(numbers) else ("",)
            )
            cells.append(f"{median} ({' to '.join(ends)})" if ends else "")
        lines.append((*place, *cells))
    return markdown_table(("path", "device", "controller", *map(with_unit, metrics)), lines)
