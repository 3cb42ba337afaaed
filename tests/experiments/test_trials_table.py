"""trials.csv: the promised columns, the same bytes for the same rows, nothing lost on the way back."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_client import PLAN, movement, result
from hypothesis import given
from hypothesis import strategies as st

from core import tick_log
from core.files import InputError
from experiments.analysis.metrics import METRICS
from experiments.analysis.punctuality import Punctuality
from experiments.analysis.trials_table import (
    COLUMNS,
    TrialRow,
    as_rows,
    as_table,
    read_table,
    table_bytes,
    trial_flags,
)
from tests.support.rows import read_rows, with_measures, write_rows

PROMISED = (
    "participant, run, block, configuration, controller, path, repetition, status, path_error_m, "
    "path_error_time_m, mean_tip_force_N, acceleration_dft_sum, acceleration_weighted_rms_m_s2, "
    "force_over_progress_N, duration_s, peak_error_m, path_length_ratio, sparc, switches_per_s, "
    "unreachable_share, recording, energy_residual_J, energy_added_max_J"
).split(", ")

ROW = TrialRow("01", 7, 1, "three-brake", 2, 1, 1, "done", recording="trials/run-007.parquet")
MEASURES = [metric.name for metric in METRICS]
FULL = with_measures(
    ROW, **{name: 0.1 * k for k, name in enumerate(MEASURES)}, energy_residual_J=-1e-9, energy_added_max_J=0.0
)


@given(st.tuples(*[st.none() | st.floats(allow_nan=False, allow_infinity=False)] * len(MEASURES)))
def test_every_double_comes_back_and_the_same_rows_give_the_same_bytes(values):
    row = with_measures(ROW, **dict(zip(MEASURES, values, strict=True)))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trials.csv"
        path.write_bytes(table_bytes(as_table([row, ROW])))
        back = read_rows(path)
        assert back == [row, ROW] and table_bytes(as_table(back)) == path.read_bytes()


def test_an_existing_table_is_replaced_only_when_asked_and_a_recording_is_seen_from_where_it_stands(tmp_path):
    path = tmp_path / "trials.csv"
    write_rows(path, [FULL])
    with pytest.raises(InputError, match="exists already"):
        write_rows(path, [ROW])
    assert read_rows(path) == [FULL]
    write_rows(path, [ROW], replacing=True)
    assert read_rows(path) == [ROW]
    with pytest.raises(InputError, match="cannot be written"):
        write_rows(tmp_path / "no folder" / "trials.csv", [ROW])
    assert ROW.in_folder("sub-01/ses-01").recording == "sub-01/ses-01/trials/run-007.parquet"
    assert TrialRow("01", 1, 1, "x", 1, 1, 1, "aborted").in_folder("sub-01").recording == ""


def test_later_columns_are_passed_over_but_not_thrown_away_and_earlier_tables_are_read_with_empty_cells(tmp_path):
    path = tmp_path / "trials.csv"
    lines = table_bytes(as_table([FULL])).decode().splitlines()
    path.write_text(f"{lines[0]},energy\n{lines[1]},0.5\n")
    assert read_rows(path) == [with_measures(FULL, energy=0.5)], "a number is a measure of a file of one's own"
    path.write_text(f"{lines[0]},remark\n{lines[1]},well\n")
    assert read_rows(path) == [FULL]
    before = PROMISED.index("energy_residual_J")
    path.write_text(
        "".join(
            ",".join(line.split(",")[:before]) + "\n" for line in table_bytes(as_table([FULL])).decode().splitlines()
        )
    )
    later = dict.fromkeys(COLUMNS[before:])
    assert read_rows(path) == [replace(with_measures(FULL, **later), controller_name=None)]


def test_a_table_has_every_column_with_its_type_and_a_participant_is_text(tmp_path):
    write_rows(tmp_path / "trials.csv", [ROW, replace(FULL, run=8, controller="K2")])
    trials = read_table(tmp_path / "trials.csv")
    assert list(trials) == list(COLUMNS) and list(trials["participant"]) == ["01", "01"]
    assert list(trials["controller"]) == [2, "K2"] and list(trials["run"]) == [7, 8]
    assert list(trials["path_error_m"].isna()) == [True, False] and trials["sparc"].dtype == float
    assert as_rows(trials) == read_rows(tmp_path / "trials.csv")
    assert table_bytes(trials[trials["run"] == 7]) == table_bytes(as_table([ROW]))


@pytest.mark.parametrize(
    "spoil, word",
    [
        (lambda text: text.replace("participant", "person"), "first line"),
        (lambda text: text.replace(",7,", ",seven,"), "trials.csv: line 2: run = 'seven' is not a number"),
        (lambda text: text.replace(",0.1,", ",nan,"), "trials.csv: line 2: path_error_time_m = 'nan' is not a number"),
        (lambda text: text.replace("done", "finished"), "status"),
        (lambda text: text + "01,8\n", "line 3"),
    ],
)
def test_a_spoilt_table_is_refused_by_line_and_column(tmp_path, spoil, word):
    path = tmp_path / "trials.csv"
    path.write_text(spoil(table_bytes(as_table([FULL])).decode()))
    with pytest.raises(InputError, match=word):
        read_rows(path)


@pytest.mark.parametrize(
    ("missed", "late_us", "usable"),
    [(0, 0.0, True), (10, 20e3, True), (11, 2e3, False), (1, 20.1e3, False)],
)
def test_a_trial_is_usable_while_few_ticks_of_its_movement_are_missed_and_none_by_much(missed, late_us, usable) -> None:
    ticks = movement(1, "AEB", 1.0)
    ticks[:, tick_log.LATENESS_US] = 0.0
    ticks[:missed, tick_log.LATENESS_US] = late_us
    late = Punctuality().plus(ticks[:600]).plus(ticks[600:])
    assert (late.ticks, late.missed, late.latest_us, late.usable) == (1000, missed, late_us, usable)
    assert trial_flags(result(PLAN[0]), ticks) == ([] if usable else [late.words])
    ticks[:, tick_log.PHASE] = tick_log.APPROACH
    assert Punctuality().plus(ticks).usable and Punctuality().plus(ticks).words == ""


def test_a_hand_that_let_the_handle_go_in_the_movement_is_flagged_with_how_often() -> None:
    row, ticks = result(PLAN[0]), movement(1, "AEB", 1.0)
    ticks[:, tick_log.ARM_FORCE_MAX] = 40.0
    assert trial_flags(row, ticks) == []
    assert trial_flags(replace(row, failed={"a": "my.py: a: no"}), None) == [
        "my.py: a: no: the trial has no such measure"
    ]
    ticks[200:300, tick_log.ARM_FORCE_MAX] = 0.0
    (flag,) = trial_flags(row, ticks)
    assert "left the picture once" in flag
    ticks[500:, tick_log.ARM_FORCE_MAX] = 0.0
    assert "2 times" in trial_flags(row, ticks)[0]
    before_it = np.copy(ticks)
    before_it[:, tick_log.PHASE] = tick_log.APPROACH  # harmless there
    assert trial_flags(row, before_it) == []
