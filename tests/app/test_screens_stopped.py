"""What the windows say of trials that were cut short, and of a plan that ends without a result for each trial."""

import pytest
from fake_client import PLAN, opened, ready, result
from screens import Screens, visible_texts

from app.ipc import messages as m
from app.window.painting import theme
from app.window.plan_grid import MARKS
from experiments.analysis.trials_table import STATUSES


def test_every_status_has_its_colour_and_all_but_done_a_mark() -> None:
    assert set(theme.STATUS) == set(STATUSES) and set(MARKS) == set(STATUSES) - {"done"}
    assert len(set(MARKS.values())) == len(MARKS)


def test_a_trial_that_was_cut_short_is_marked_counts_as_open_and_comes_next(screens: Screens) -> None:
    rows = (result(PLAN[0]), result(PLAN[1], "stopped"))
    again = PLAN[1]._replace(run=61)
    console = screens.hear(opened(), ready(2, rows=rows, coming=again, said="Run 2: the board. It comes again."))
    grid = screens.run.panel.grid
    assert grid.statuses[2] == "stopped" and grid.marked == 2 and "1 of 60 done" in screens.run.panel.done.text()
    assert screens.run.panel.start.isEnabled() and "comes again" in " ".join(visible_texts(console))
    assert screens.run.centre.large.text() == "Stopped"


def test_the_end_of_the_plan_says_how_many_trials_have_no_result(screens: Screens) -> None:
    rows = [*map(result, PLAN)]
    console = screens.hear(opened(), m.Snapshot(m.FINISHED, tuple(rows)))
    assert "no result" not in " ".join(visible_texts(console))
    screens.hear(opened(), ready(1))
    rows[3], rows[7] = result(PLAN[3], "aborted"), result(PLAN[7], "skipped")
    rows += [result(PLAN[7]._replace(run=61), "done")]  # it was done after all
    console = screens.hear(opened(), m.Snapshot(m.FINISHED, tuple(rows)))
    assert f"1 of {len(PLAN)} trials have no result" in " ".join(visible_texts(console))


@pytest.mark.parametrize(
    ("status", "offered"), [("done", True), ("aborted", True), ("stopped", False), ("recovered", False)]
)
def test_only_a_trial_that_does_not_come_again_by_itself_is_offered_to_be_redone(
    screens: Screens, status: str, offered: bool
) -> None:
    screens.hear(opened(), ready(1, rows=(result(PLAN[0], status),)))
    assert screens.run.panel.redo.isEnabled() == offered
