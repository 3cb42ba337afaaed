"""The columns of the tick log: each place of a row is declared once."""

import pytest

from core import tick_log
from core.tick_log import BENCH, BENCH_WIDTH, COLUMNS, WIDTH

pytestmark = pytest.mark.nojit


def test_every_place_of_a_row_belongs_to_one_column():
    single = [one for column in COLUMNS for one in column.spread()]
    shared = sorted(one.place for one in single if one.of != BENCH)
    bench = sorted(one.place for one in single if one.of == BENCH)
    assert shared == list(range(WIDTH)) and bench == list(range(WIDTH, BENCH_WIDTH))
    assert len({one.name for one in single}) == len(single)


def test_a_column_of_several_joints_names_each_of_them_at_its_place():
    current = next(column for column in COLUMNS if column.place == tick_log.CURRENT)
    spread = list(current.spread("EC"))
    assert [(one.name, one.place) for one in spread] == [
        ("current_E_A", tick_log.CURRENT + 1), ("current_C_A", tick_log.CURRENT + 3)
    ]  # fmt: skip
    assert "joint C" in spread[1].meaning and not any("{" in one.name + one.meaning for one in spread)
