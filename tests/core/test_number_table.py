"""The one reader of tables in CSV files: what is a number, what is a table, and what a refusal says."""

import warnings

import numpy as np
import pytest

from core.files import InputError, StrangeInput
from core.number_table import number, number_table
from core.ranges import FORCE, PLACE

NEEDED = ("t_s", "fx_N")


def read(text, optional=()):
    return number_table(text, "it.csv", NEEDED, optional)


@pytest.mark.parametrize(
    "cell", ["0_5", "1_000", "", " ", "1 000", "0x10", "1d5", "٣", "１", "1,5", "1.5N", "--1", "."]
)
def test_what_python_or_a_spreadsheet_takes_for_a_number_need_not_be_one(cell):
    with pytest.raises(ValueError):
        number(cell)


@pytest.mark.parametrize("cell", ["1", "+1", "-.5", "1.", "1e3", "1E-3", " 2 "])
def test_numbers_of_every_usual_writing_are_read(cell):
    assert number(cell) == float(cell) == read(f"t_s,fx_N\n{cell},0\n").values[0, 0]


def test_columns_come_by_name_in_the_order_that_was_asked_for_and_others_are_not_read():
    table = read('"note","fx_N", t_s\nleft,2,1\n"a, b",4,3\n', None)
    assert table.columns == NEEDED and np.array_equal(table.values, [[1.0, 2.0], [3.0, 4.0]])


def test_a_refused_row_is_named_by_its_line_past_empty_ones():
    table = read("t_s,fx_N\n\n\n0,1\n\n1,1\n")
    assert [table.line(row) for row in range(2)] == [4, 6]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("t_s,fx_N\n", "has no rows"),
        ("\nt_s,fx_N\n0,1\n", "line 1: the header lacks t_s, fx_N$"),
        ("t_s\n0\n", "line 1: the header lacks fx_N; it names t_s$"),
        ("t_s,fx_N,fx_N\n0,1,2\n", "line 1: the header names fx_N twice"),
        ("t_s,fx_N,\n0,1,\n", "line 1: column 3 has no name"),
        ("t_s,fx_N,fz_N\n0,1,2\n", "line 1: the header names fz_N, but may name t_s, fx_N only"),
        ("t_s;fx_N\n0;1\n", "line 1: has semicolons between the columns: save with commas, and with points"),
        ("t_s\tfx_N\n0\t1\n", "line 1: has tabs between the columns"),
        ("t_s,fx_N\n0;1\n", r"line 2: has 1 values, the header names 2 \(semicolons between"),
        ("t_s,fx_N\n0,0,1,5\n", r"line 2: has 4 values, the header names 2 \(decimal commas: save with points\)"),
        ("t_s,fx_N\n0,0.5,1\n", "line 2: has 3 values, the header names 2$"),
        ('t_s,fx_N\n0,"1,5"\n', r"line 2: fx_N must be a number, not '1,5' \(decimal commas: save with points\)"),
        ("t_s,fx_N\n0,1\n1,0_5\n", "line 3: fx_N must be a number, not '0_5'"),
        ("t_s,fx_N\n0,1\n\n1,nan\n", "line 4: fx_N must be finite, not nan"),
        ('t_s,fx_N\n0,1\n1,"2\n', "line 3: is no line of a CSV file"),
    ],
)
def test_what_is_no_table_of_numbers_is_refused_with_line_column_and_habit(text, says):
    with pytest.raises(InputError, match=f"^it.csv: {says}"):
        read(text)


@pytest.mark.parametrize(("last", "likely"), [(1000.0, "1000 ms"), (1e6, "1e+06 us"), (15.0, None), (1.0, None)])
def test_a_clock_that_outlasts_its_scene_by_far_is_warned_of_with_the_likely_unit(last, likely):
    table = read(f"t_s,fx_N\n0,1\n{last},2\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", StrangeInput)
        table.check_times(1.0, longer=20.0)
    said = f"it.csv: t_s ends at {last:g} s, the scene at 1 s; if {likely} is meant, write seconds"
    assert [str(warning.message) for warning in caught] == ([said] if likely else [])


@pytest.mark.parametrize(("quantity", "value", "likely"), [(FORCE, 5e3, "write 5$"), (PLACE, 360.0, "write 0.36$")])
def test_a_column_in_a_smaller_unit_is_warned_of_with_the_number_to_write(quantity, value, likely):
    table = read(f"t_s,fx_N\n0,0\n1,{value}\n")
    with pytest.warns(StrangeInput, match=f"it.csv: line 3: fx_N = .*is strange.*{likely}"):
        table.check_range("fx_N", quantity)
