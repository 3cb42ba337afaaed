"""Statistics against enumeration by hand and laws; how far the order of controllers depends on definitions."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded import record, ticks
from rows import with_measures
from scipy import stats

from core import tick_log
from core.tick_log import PHASES
from experiments.analysis.movement import amplitude_sum, tip_acceleration, weighted_amplitudes, without_ramp
from experiments.analysis.report_sentences import sentences
from experiments.analysis.sensitivity import (
    SMOOTHNESS,
    Smoothness,
    dft_sum,
    hann,
    kendall_tau,
    sensitivity,
    ticks_moving,
)
from experiments.analysis.statistics import (
    LEAST_PEOPLE,
    MEASURES,
    POOLED,
    STATISTICS,
    friedman,
    holm,
    median_interval,
    pairs,
    rank_biserial,
    rank_biserial_interval,
    shift_interval,
    signed_rank_distribution,
    signed_rank_p,
    statistics,
)
from experiments.analysis.trials_table import TrialRow, as_table
from experiments.store.recording import read_recording

DEVICES = ("three-brake", "four-brake")


def study(people=6, error=lambda row: 1e-3 * row.controller, duration=lambda row: 3.0, seed=0):
    """Trials in a shuffled order, four repetitions a task; path error and duration as functions of the trial."""
    generator = np.random.default_rng(seed)
    rows = []
    for p in range(1, people + 1):
        run = 0
        for device in DEVICES if p % 2 else DEVICES[::-1]:
            tasks = [(k, s, r) for k in range(1, 6) for s in (1, 2) for r in range(1, 5)]
            for i in generator.permutation(len(tasks)):
                run += 1
                controller, path, repetition = tasks[i]
                row = TrialRow(f"{p:02}", run, repetition, device, controller, path, repetition, "done")
                row = with_measures(row, duration_s=duration(row))
                rows.append(with_measures(row, path_error_m=error(row), mean_tip_force_N=float(generator.lognormal())))
    return rows


def table_of(data):
    """(controllers, people) as the functions take it."""
    return {k + 1: {f"{p:02}": float(v) for p, v in enumerate(of_people)} for k, of_people in enumerate(data)}


def only(results, **wanted):
    (found,) = [r for r in results if all(getattr(r, key) == value for key, value in wanted.items())]
    return found


thousandths = st.tuples(st.integers(1, 10_000), st.sampled_from([-1, 1]))
samples = st.lists(thousandths, min_size=6, max_size=9, unique_by=lambda one: one[0]).map(
    lambda found: [sign * size / 1000 for size, sign in found]
)


@given(samples)
@settings(max_examples=20)
def test_the_signed_rank_p_is_the_share_of_all_sign_patterns_at_least_as_far_out(values):
    differences = np.array(values)
    ranks = stats.rankdata(np.abs(differences))
    sums = np.array([np.dot(signs, ranks) for signs in product((0, 1), repeat=len(ranks))])
    mine = ranks[differences > 0].sum()
    far = np.mean(np.abs(sums - ranks.sum() / 2) >= abs(mine - ranks.sum() / 2) - 1e-9)
    assert signed_rank_p(differences) == pytest.approx(far)
    counts = np.bincount(sums.astype(int), minlength=int(ranks.sum()) + 1) / len(sums)
    assert signed_rank_distribution(len(values)) == pytest.approx(counts)


@given(samples)
@settings(max_examples=25)
def test_a_shift_lies_in_the_interval_when_the_test_cannot_reject_it(values):
    """Just inside either end the signed-rank test of the shifted values gives p > 5 %, just outside p <= 5 %."""
    data = np.array(values)
    _, middle, low, high = shift_interval(data)
    i, j = np.triu_indices(len(data))
    assert middle == pytest.approx(np.median((data[i] + data[j]) / 2))
    for end, inward in ((low, 1.0), (high, -1.0)):
        inside, outside = data - (end + 1e-7 * inward), data - (end - 1e-7 * inward)
        if high - low > 1e-6:
            assert signed_rank_p(inside) > 0.05
        assert signed_rank_p(outside) <= 0.05


@given(samples)
@settings(max_examples=25)
def test_rank_biserial_is_the_share_of_positive_pairwise_means_less_that_of_negative_ones(values):
    data = np.array(values)
    i, j = np.triu_indices(len(data))
    assert rank_biserial(data) == pytest.approx(np.mean(np.sign(np.round((data[i] + data[j]) / 2, 9))), abs=1e-9)
    assert rank_biserial(-data) == pytest.approx(-rank_biserial(data))
    assert rank_biserial(np.append(data, 0.0)) == pytest.approx(rank_biserial(data))
    assert rank_biserial(np.abs(data)) == 1.0
    low, high = rank_biserial_interval(rank_biserial(data), len(data))
    assert -1.0 <= low <= rank_biserial(data) <= high <= 1.0 and low < high
    assert rank_biserial_interval(rank_biserial(-data), len(data)) == pytest.approx((-high, -low))


@pytest.mark.parametrize("people", [6, 12])
def test_the_interval_of_a_rank_biserial_correlation_leaves_0_out_in_at_most_5_percent_of_no_difference(people):
    """1,500 groups without a difference; all the same way is no certainty."""
    groups = np.random.default_rng(people).normal(size=(1500, people))
    found = np.array([rank_biserial_interval(rank_biserial(group), people) for group in groups])
    wrong = np.mean((found[:, 0] > 0.0) | (found[:, 1] < 0.0))
    assert wrong <= 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / len(groups))
    low, high = rank_biserial_interval(1.0, people)
    assert 0.0 < low < 0.9 and high == 1.0


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_holm_never_makes_p_smaller_keeps_its_order_and_is_bonferroni_for_the_smallest(chances):
    adjusted = holm(chances)
    assert all(p <= q <= 1.0 for p, q in zip(chances, adjusted, strict=True))
    order = np.argsort(chances, kind="stable")
    assert np.all(np.diff(np.array(adjusted)[order]) >= 0.0)
    assert adjusted[order[0]] == min(1.0, len(chances) * min(chances))
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02]), "by hand"


@given(st.integers(1, 80))
def test_the_interval_of_the_median_covers_it_95_times_in_100_and_is_the_shortest_that_does(n):
    """Of values 1..n: from k to n + 1 - k misses the median with twice the chance of under k heads in n throws."""
    people, _, low, high = median_interval(np.random.default_rng(n).permutation(n) + 1.0)
    assert people == n
    if n >= LEAST_PEOPLE:
        k = int(low)
        assert high == n + 1 - k
        assert 2.0 * stats.binom.cdf(k - 1, n, 0.5) <= 0.05 < 2.0 * stats.binom.cdf(k, n, 0.5)
    else:
        assert (low, high) == (-np.inf, np.inf) and 2.0 * stats.binom.cdf(0, n, 0.5) > 0.05


def test_friedman_by_hand_its_ends_and_with_ties_as_kendalls_tau_by_scipy():
    """12 / (n k (k + 1)) sum R^2 - 3 n (k + 1) without ties; all agree: W = 1; a Latin square: 0."""
    data = np.random.default_rng(3).normal(size=(5, 9))
    ranks = stats.rankdata(data, axis=0).sum(axis=1)
    found = friedman("m", "d", table_of(data))
    chi = 12.0 / (9 * 5 * 6) * np.sum(ranks**2) - 3 * 9 * 6
    assert found[0].value == pytest.approx(chi) and found[1].value == pytest.approx(chi / (9 * 4))
    assert found[0].p == pytest.approx(stats.chi2.sf(chi, 4))
    same = friedman("m", "d", table_of(np.tile(np.arange(5.0)[:, None], 8)))
    assert same[1].value == pytest.approx(1.0)
    square = friedman("m", "d", table_of([[1, 2, 3], [2, 3, 1], [3, 1, 2]]))
    assert square[0].value == pytest.approx(0.0) and square[0].p is None
    assert friedman("m", "d", table_of(np.ones((5, 8)))) == []
    data = np.random.default_rng(4).integers(0, 4, (5, 8)).astype(float)
    found, theirs = friedman("m", "d", table_of(data)), stats.friedmanchisquare(*data)
    assert found[0].value == pytest.approx(theirs.statistic) and found[0].p == pytest.approx(theirs.pvalue)
    for first, second in zip(data, data[1:], strict=False):
        assert kendall_tau(first, second) == pytest.approx(stats.kendalltau(first, second).statistic)
    assert kendall_tau(data[0], np.ones(8)) is None


def test_a_participant_counts_once_however_many_trials_they_made():
    rows = study(people=6)
    extra = [replace(rows[0], run=1000 + i) for i in range(50)]
    wanted = dict(
        test="mean", measure="path_error_m", configuration=rows[0].configuration, first=f"{rows[0].controller}"
    )
    before, after = (only(statistics(as_table(r)), **wanted) for r in (rows, rows + extra))
    assert (after.people, after.value) == (6, pytest.approx(before.value))


@pytest.mark.parametrize("people", [5, 6])
def test_below_six_people_there_is_no_p_and_no_interval(people, tmp_path):
    results = statistics(as_table(study(people, error=lambda row: 1e-3 * row.controller * (1 + 0.01 * row.run))))
    claims = [r for r in results if (r.p, r.p_holm, r.low, r.high) != (None,) * 4]
    assert bool(claims) == (people >= 6) and len(results) > 50


@pytest.mark.parametrize("percent", [0.0, 3.0])
def test_a_trend_over_trials_is_found_whatever_differs_between_controllers_and_devices(percent):
    """An error that changes by a share of its task's value per trial, among tasks that differ up to tenfold."""

    def error(row):
        task = 1.0 * row.controller * (2.0 if row.configuration == "four-brake" else 1.0)
        return task + percent / 1000.0 * row.run * 4.5

    found = only(statistics(as_table(study(people=6, error=error))), test="trend", measure="path_error_m")
    mean = np.mean([error(row) for row in study(people=1)])
    assert found.value == pytest.approx(4.5 * percent / mean, abs=1e-9)
    assert found.low <= found.value <= found.high


def test_error_adjusted_for_speed_is_the_same_where_speed_alone_makes_the_difference():
    """1 mm a doubling of speed; controller 5 is moved at half the speed of the others and looks 1 mm more accurate."""
    speeds = np.random.default_rng(9).lognormal(0.0, 0.2, 10_000)

    def duration(row):
        return float((2.0 if row.controller == 5 else 1.0) / speeds[97 * row.run + int(row.participant)])

    results = statistics(as_table(study(6, lambda row: 5e-3 - 1e-3 * np.log2(row.value("duration_s")), duration)))
    slope = only(results, statistic="m_per_doubling")
    assert slope.value == pytest.approx(1e-3) and slope.low == pytest.approx(1e-3) and slope.high == pytest.approx(1e-3)
    assert only(results, statistic="correlation").value == pytest.approx(1.0)
    for device in DEVICES:
        of_it = [r for r in results if r.configuration == device]
        raw = {r.first: r.value for r in of_it if r.statistic == "mean_error"}
        adjusted = {r.first: r.value for r in of_it if r.statistic == "error_at_common_speed"}
        assert raw["1"] - raw["5"] > 0.7e-3
        assert np.ptp(list(adjusted.values())) < 1e-12
    (said,) = [sentence for sentence in sentences(results) if sentence.startswith("Twice the speed")]
    assert "path error +1.00 (" in said and "slow trials do look accurate" in said


def test_trials_that_ran_out_of_time_say_nothing_about_speed_and_uncounted_ones_nothing_at_all():
    rows = study(people=3)
    late = [with_measures(replace(r, status="timeout"), duration_s=30.0) if r.run == 7 else r for r in rows]
    whole = statistics(as_table(rows))
    plain = [r for r in whole if r.test == "speed" and r.statistic != "mean_error"]
    assert [
        r.value for r in statistics(as_table(late)) if r.test == "speed" and r.statistic == "doublings_above_own_mean"
    ] == [pytest.approx(r.value) for r in plain if r.statistic == "doublings_above_own_mean"]
    for status in ("excluded", "timeout"):
        other = with_measures(replace(rows[0], status=status), path_error_m=9.0, duration_s=0.1)
        more = [replace(other, run=900 + i) for i in range(5)]
        trials = as_table(rows + more)
        assert statistics(trials) == whole and (statistics(trials, timeouts=True) != whole) == (status == "timeout")


def test_every_pair_of_controllers_and_every_measure_is_there():
    results = statistics(as_table(study()))
    for device in (*DEVICES, POOLED):
        of_it = [
            r
            for r in results
            if (r.configuration, r.measure, r.statistic) == (device, "path_error_m", "hodges_lehmann")
        ]
        assert len(of_it) == 10
        for r in of_it:  # controller k has an error of k mm in everyone
            assert (r.value, r.low, r.high) == pytest.approx((1e-3 * (int(r.first) - int(r.second)),) * 3)
            assert r.p_holm == pytest.approx(min(1.0, 10 * r.p))
    assert {r.measure for r in results} <= set(MEASURES)
    assert {r.statistic for r in results} <= STATISTICS.keys()


def test_definitions_that_order_the_controllers_alike_agree_and_a_reversed_one_is_named():
    rows = [
        with_measures(
            r,
            path_error_time_m=2.0 * r.value("path_error_m"),
            peak_error_m=1.0 - r.value("path_error_m"),
            sparc=-1.0 * r.controller,
            acceleration_dft_sum=float(r.controller),
            acceleration_weighted_rms_m_s2=r.controller**2.0,
        )
        for r in study(people=3)
    ]
    results = sensitivity(as_table(rows))
    by = {(r.measure, r.configuration): r for r in results}
    assert by["path_error_m", "four-brake"].first == "1 < 2 < 3 < 4 < 5"
    assert by["path_error_time_m", "four-brake"].value == pytest.approx(1.0)
    assert by["peak_error_m", "four-brake"].value == pytest.approx(-1.0)
    assert by["sparc", "three-brake"].value == pytest.approx(1.0)  # nearer 0 is smoother
    said = " ".join(sentences(results))
    assert "No control and SDOF, no control and SDOF with gap, " in said and "change places by peak error." in said
    assert "The same by acceleration rms; SPARC." in said


def test_smoothness_by_other_definitions_starts_from_the_metrics_own(tmp_path):
    """With the metrics' own filter, weights and range it is the metrics' value; each variant is another one."""
    n = 1200
    rows = ticks(n)
    t = np.arange(n) / 1000.0
    rows[:, tick_log.TIP_X], rows[:, tick_log.TIP_Y] = 0.1 * np.sin(3.0 * t), 0.4 + 0.001 * np.sin(90.0 * t)
    rows[:, tick_log.PHASE] = np.where((t > 0.1) & (t < 1.1), PHASES.index("move"), PHASES.index("end"))
    rows[:, tick_log.TIP_AX] = np.sin(900.0 * t)
    path = record(tmp_path, rows)
    move = (t > 0.1) & (t < 1.1)
    own = amplitude_sum(weighted_amplitudes(tip_acceleration(rows[:, [tick_log.TIP_X, tick_log.TIP_Y]])[move]))
    exact = amplitude_sum(weighted_amplitudes(rows[move][:, [tick_log.TIP_AX, tick_log.TIP_AY]]))
    assert dft_sum(read_recording(path), Smoothness()) == pytest.approx(own, rel=1e-9)
    assert dft_sum(read_recording(path), Smoothness(cutoff_hz=None)) == pytest.approx(exact, rel=1e-12)
    trial = replace(study(people=1)[0], controller=1, recording=f"trials/{path.name}")
    trial = with_measures(trial, acceleration_dft_sum=own)
    recording = read_recording(tmp_path / trial.recording)
    found = {name: dft_sum(recording, how) for name, how in SMOOTHNESS.items()}
    assert len({round(value, 6) for value in (*found.values(), own)}) == len(SMOOTHNESS) + 1
    assert dft_sum(recording, Smoothness(window=without_ramp)) == amplitude_sum(
        weighted_amplitudes(without_ramp(tip_acceleration(rows[:, [tick_log.TIP_X, tick_log.TIP_Y]])[move]))
    )


def test_a_hann_window_keeps_the_mean_square_of_a_steady_vibration_and_the_reaction_is_the_first_millimetre(tmp_path):
    """A tip that rests for 0.4 s of a movement of 1 s, pushed by 1 N, then moves at 100 mm/s, pushed by 3 N."""
    t = np.arange(1000) / 1000.0
    wave = np.column_stack([np.sin(2 * np.pi * 20.0 * t), np.cos(2 * np.pi * 20.0 * t)])
    assert np.mean(hann(wave) ** 2) == pytest.approx(np.mean(wave**2))
    rows = ticks(1000)
    rows[:, tick_log.PHASE] = PHASES.index("move")
    rows[:, tick_log.TIP_X], rows[:, tick_log.TIP_Y] = 0.1 * np.maximum(t - 0.3995, 0.0), 0.4
    rows[:, tick_log.HAND_FX], rows[:, tick_log.HAND_FY] = np.where(t > 0.4, 3.0, 1.0), 0.0
    path = record(tmp_path, rows)
    assert ticks_moving(read_recording(path))[0] == 410
    trial = replace(study(people=1)[0], controller=1, recording=f"trials/{path.name}")
    trial = with_measures(trial, duration_s=0.999, mean_tip_force_N=2.199)
    results = sensitivity(as_table([trial]), lambda name: read_recording(tmp_path / name))
    assert {r.statistic for r in results} <= STATISTICS.keys()
    found = {r.measure: r.value for r in results if r.test == "reaction"}
    assert found["mean_tip_force_N"] == pytest.approx(3.0 / 2.199) and found["duration_s"] == pytest.approx(
        0.589 / 0.999
    )
    (said,) = [sentence for sentence in sentences(results) if "1 mm" in sentence]
    assert "41 % of the movement" in said and "mean tip force +36 %" in said


def test_how_rough_a_controller_is_is_its_median_over_that_of_no_control_by_each_definition_on_each_device():
    rows = [
        with_measures(
            row, acceleration_dft_sum=2.0 * row.controller, acceleration_exact_dft_sum=float(row.controller) ** 2
        )
        for row in study(people=2)
    ]
    found = {
        (r.configuration, r.measure, r.first, r.second): r.value
        for r in sensitivity(as_table(rows))
        if r.test == "roughness"
    }
    for device in {row.configuration for row in rows}:
        assert found[device, "acceleration_dft_sum", "4", "1"] == 4.0
        assert found[device, "acceleration_exact_dft_sum", "4", "1"] == 16.0
    assert not any(measure == "sparc" for _, measure, _, _ in found)  # nearer 0 is smoother: no ratio


def test_pooled_needs_both_devices_of_a_person():
    rows = study(people=5)
    some = [r for r in rows if not (r.participant == "03" and r.configuration == "four-brake")]
    assert (
        only(statistics(as_table(some)), test="mean", measure="path_error_m", configuration=POOLED, first="2").people
        == 4
    )
    one = [r for r in rows if r.configuration == "four-brake"]
    assert {r.configuration for r in statistics(as_table(one))} == {"four-brake", "all"}


@pytest.mark.parametrize(
    ("differences", "differ", "missing"),
    [([0.0] * 5 + [1.0], 1, ""), ([0.0] * 8, 0, ""), ([1.0, 2.0, 0.0], 2, "3 of the 6 people")],
)
def test_a_difference_of_zero_beside_a_correlation_of_one_names_how_many_pairs_differ(differences, differ, missing):
    people = [f"{n}" for n in range(len(differences))]
    table = {1: dict(zip(people, differences, strict=True)), 2: dict.fromkeys(people, 0.0)}
    shift, correlation = pairs("path_error_m", "three-brake", table)
    assert shift.differ == correlation.differ == differ
    assert missing in shift.missing and bool(shift.missing) == (shift.p is None)
    if differ == 1:
        assert (shift.value, correlation.value) == (0.0, 1.0)
