"""The measures on hand-made movements whose answers are known."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core import tick_log
from core.control import algorithm
from core.control import controllers as control
from core.files import InputError
from core.path import Arc, Polyline, build_path, line, point_at
from experiments.analysis import metrics
from experiments.analysis.findings import IN_BOXES
from experiments.analysis.movement import (
    along_path,
    amplitude_rms,
    amplitude_sum,
    mean_over_progress,
    sparc,
    tip_acceleration,
    weighted_amplitudes,
    without_ramp,
)
from experiments.analysis.statistics import MEASURES
from experiments.recording import Recording, Sensors, recording_of

ROOT = Path(__file__).resolve().parents[2]
USE_SDOF = control.DECISIONS.index("sdof A")

START, END = (-0.1, 0.4), (0.1, 0.4)
PATH = line(START, END)
MOVE_FROM, MOVE_TO = 1100, 5100  # ticks of `move` in a recording made below


def hand_made(x=None, y=None, braked="AEB", n=5200, **columns):
    """A recording of n ticks: 0.6 s approach, 0.5 s hold, then `move` along the path in 4 s, then `end`."""
    rows = np.zeros((n, tick_log.WIDTH))
    rows[:, tick_log.T] = np.arange(n) / 1000.0
    rows[:, tick_log.PHASE] = np.searchsorted([600, MOVE_FROM, MOVE_TO], np.arange(n), side="right")
    share = np.clip((np.arange(n) - MOVE_FROM) / (MOVE_TO - 1 - MOVE_FROM), 0.0, 1.0)
    rows[:, tick_log.TIP_X] = -0.1 + 0.2 * share if x is None else x
    rows[:, tick_log.TIP_Y] = 0.4 if y is None else y
    rows[:, tick_log.TIP_VX] = np.gradient(rows[:, tick_log.TIP_X], 1e-3)
    rows[:, tick_log.TIP_VY] = np.gradient(rows[:, tick_log.TIP_Y], 1e-3)
    for name, values in columns.items():
        rows[:, getattr(tick_log, name)] = values
    return recording_of(rows, braked)


def measured(recording, path=PATH):
    return SimpleNamespace(**metrics.trial_metrics(recording, path))


ARC = build_path(Arc((0.0, 0.3), 0.1, 150.0, 30.0), "arc")
CORNER = build_path(Polyline(((-0.1, 0.3), (0.0, 0.3), (0.0, 0.4))), "corner")
SHARES = np.linspace(0.0, 1.0, MOVE_TO - MOVE_FROM)


def moved(path, shares=SHARES, offset=0.0):
    """A recording whose tip in `move` is at these shares of the path, offset (m) to its left."""
    x, y, tx, ty = np.array([point_at(path, share * path.length) for share in shares]).T
    held = [np.pad(values, (MOVE_FROM, 5200 - MOVE_TO), "edge") for values in (x - offset * ty, y + offset * tx)]
    return hand_made(*held)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("path, longer", [(PATH, 0.0), (ARC, 0.03)], ids=["straight", "arc"])
def test_a_constant_offset_is_the_path_error_however_it_is_averaged(path, longer, side):
    result = measured(moved(path, SHARES**2, 0.003 * side), path)  # at any speed
    assert result.path_error_m == pytest.approx(0.003, rel=1e-9)
    assert result.path_error_time_m == pytest.approx(0.003, rel=1e-9)
    assert result.peak_error_m == pytest.approx(0.003, rel=1e-9)
    assert result.path_length_ratio == pytest.approx(1.0 + side * longer, rel=1e-5), "left of a clockwise arc: outside"
    assert result.duration_s == 3.999


@pytest.mark.parametrize("path", [PATH, ARC], ids=["straight", "arc"])
def test_way_gone_back_has_no_weight_and_error_over_progress_is_error_over_the_path(path):
    ticks = np.arange(MOVE_TO - MOVE_FROM)
    shares = np.interp(ticks, [0, 1500, 2000, 3999], [0.0, 0.5, 0.25, 1.0])
    offset = np.where(ticks <= 1500, 0.001, np.where(ticks <= 2666, 0.02, 0.003))  # 2666: half of the way again
    assert measured(moved(path, shares, offset), path).path_error_m == pytest.approx(0.002, rel=1e-2)


def test_dwelling_off_the_path_counts_over_time_and_not_over_progress():
    """Half of the way on the path in 1 s, 2 s of rest 4 mm off it, the other half on the path in 1 s."""
    ticks = np.arange(5200) - MOVE_FROM
    x = -0.1 + 0.2 * np.interp(ticks, [0, 1000, 3000, 3999], [0.0, 0.5, 0.5, 1.0])
    away = 0.4 + 0.004 * ((ticks > 1000) & (ticks < 3000))
    result = measured(hand_made(x=x, y=away))
    assert result.path_error_m == pytest.approx(0.0, abs=1e-12)
    assert result.path_error_time_m == pytest.approx(0.002, rel=1e-3)
    assert result.peak_error_m == pytest.approx(0.004, rel=1e-9)


@pytest.mark.parametrize("path", [PATH, CORNER], ids=["straight", "corner"])
def test_over_time_the_error_beyond_an_end_is_the_distance_from_that_end_and_not_from_the_line_beyond_it(path):
    """1 s at rest 2 cm before the start, on the line of the path, then along the path in 3 s."""
    ticks = np.arange(MOVE_TO - MOVE_FROM)
    shares = np.where(ticks < 1000, -0.02 / path.length, np.interp(ticks, [1000, 3999], [0.0, 1.0]))
    x, y = (np.array([point_at(path, max(share, 0.0) * path.length)[i] for share in shares]) for i in (0, 1))
    along = np.array(point_at(path, 0.0)[2:4])
    before = np.minimum(shares, 0.0)[:, np.newaxis] * path.length * along
    held = [np.pad(values, (MOVE_FROM, 5200 - MOVE_TO), "edge") for values in (x + before[:, 0], y + before[:, 1])]
    result = measured(hand_made(*held), path)
    assert result.path_error_m == pytest.approx(0.0, abs=1e-12)
    assert result.path_error_time_m == pytest.approx(0.02 / 4, rel=1e-3)


def test_round_a_corner_progress_runs_through_and_a_cut_corner_counts_with_its_length():
    exact = measured(moved(CORNER), CORNER)
    assert exact.peak_error_m == pytest.approx(0.0, abs=1e-12)
    assert exact.path_length_ratio == pytest.approx(1.0, rel=1e-3)
    way = np.linspace(0.0, 0.2, 8000)  # 8 mm before the corner straight to 8 mm behind it
    cut = np.interp(way, [0.0, 0.092, 0.108, 0.2], [-0.1, -0.008, 0.0, 0.0])
    tip = np.column_stack([cut, 0.3 + np.interp(way, [0.0, 0.092, 0.108, 0.2], [0.0, 0.0, 0.008, 0.1])])
    progress, deviation = along_path(tip, CORNER)
    assert progress[-1] == pytest.approx(CORNER.length) and np.all(np.diff(progress) >= 0.0)
    assert deviation.max() == pytest.approx(0.004, rel=1e-2)
    error = mean_over_progress(deviation, progress)
    assert error == pytest.approx(0.00024, rel=0.1), "2 mm on 8 mm of the 20 cm, up to 4 mm on a leap of 8 mm"
    away = np.array([-0.1, 0.3]) + 0.1 * np.linspace(0.0, 1.0, 4000)[:, None]  # straight to the end
    assert along_path(away, CORNER)[1].max() > 0.08, "so long a part was left out: the first leg counts on"


def test_force_is_averaged_over_time_and_over_progress():
    """10 N pushed for 2 s at rest, 2 N while moving for 2 s."""
    ticks = np.arange(5200) - MOVE_FROM
    x = -0.1 + 0.2 * np.interp(ticks, [0, 2000, 3999], [0.0, 0.0, 1.0])
    force = np.where(ticks < 2000, 10.0, 2.0)
    result = measured(hand_made(x=x, HAND_FX=0.6 * force, HAND_FY=-0.8 * force))
    assert result.mean_tip_force_N == pytest.approx(6.0, rel=1e-9)
    assert result.force_over_progress_N == pytest.approx(2.0, rel=2e-3)


def test_switches_are_changes_of_the_set_of_actuated_brakes_per_second():
    ticks = np.arange(5200)
    columns = {"CURRENT": np.where((ticks >= 2000) & (ticks < 3000), 0.3 + 1e-4 * ticks, 0.0)}
    result = measured(hand_made(**columns))  # on once, off once; a changing current is no switch
    assert result.switches_per_s == pytest.approx(2 / 3.999)
    recording = hand_made(**columns)
    recording.columns["current_E_A"][3000:] = 1.0  # the other brake takes over in the same tick: one change
    assert measured(recording).switches_per_s == pytest.approx(2 / 3.999)
    recording.columns["current_B_A"][:1100] = 1.0  # before `move`
    assert measured(recording).switches_per_s == pytest.approx(2 / 3.999)


def test_unreachable_share_counts_felt_ticks_without_a_brake_and_leaves_the_gap_out():
    decision = np.full(5200, USE_SDOF)
    decision[1100:2100] = algorithm.IN_GAP  # 1000 of 4000 ticks of move: not counted
    decision[2100:2400] = algorithm.RELEASE_NO_VALID
    decision[2400:2700] = algorithm.LOCK_NO_VALID
    force = np.full(5200, 5.0)
    force[2100:2200] = 0.4  # a hand that is not felt
    recording = hand_made(DECISION=decision, HAND_FX=force)
    assert measured(recording).unreachable_share == 500 / 3000
    uncontrolled = hand_made(DECISION=algorithm.NONE, HAND_FX=5.0)
    assert measured(uncontrolled).unreachable_share is None
    all_gap = hand_made(DECISION=algorithm.IN_GAP, HAND_FX=5.0)
    assert measured(all_gap).unreachable_share is None


def test_without_progress_the_measures_of_the_movement_are_empty_and_never_zero():
    for x in (np.full(5200, -0.1), -0.1 - 1e-5 * np.arange(5200), np.full(5200, -0.13)):
        result = measured(hand_made(x=x, HAND_FX=3.0, CURRENT=1.0))
        assert result.path_error_m is None and result.force_over_progress_N is None and result.sparc is None
        assert result.acceleration_dft_sum is None and result.path_length_ratio is None
        assert result.mean_tip_force_N == 3.0 and result.duration_s == 3.999


@pytest.mark.parametrize("name", ["tip_x_m", "hand_fy_N", "current_E_A", "tip_vx_m_s"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_missing_sample_is_refused_by_name(name, value):
    recording = hand_made()
    recording.columns[name][1234] = value
    with pytest.raises(InputError, match=f"{name}.*tick 1234"):
        measured(recording)


def test_missing_or_uneven_ticks_are_refused():
    recording = hand_made()
    for name in recording.columns:
        recording.columns[name] = np.delete(recording.columns[name], 2000)
    with pytest.raises(InputError, match="t_s.*tick 2000"):
        measured(recording)
    for shift, refused in ((5e-10, False), (2e-9, True), (np.nan, True)):
        recording = hand_made()
        recording.columns["t_s"][77] += shift
        if refused:
            with pytest.raises(InputError, match="t_s.*tick 77"):
                measured(recording)
        else:
            measured(recording)
    with pytest.raises(InputError, match="no ticks"):
        metrics.trial_metrics(Recording(Path("empty")), PATH)
    interrupted = hand_made()
    interrupted.columns["phase"][3000] = tick_log.HOLD
    with pytest.raises(InputError, match="interrupted"):
        measured(interrupted)


TONES = {
    "1 Hz": ([(1.0, 0.5)], 0.5, 0.5),
    "7 Hz": ([(7.0, 2.0)], 14.0, 14.0),
    "100 Hz": ([(100.0, 0.3)], 30.0, 30.0),
    "several add, none above 100 Hz": ([(2.0, 1.0), (30.0, 0.1), (101.0, 50.0)], 5.0, 13.0**0.5),
}


@pytest.mark.parametrize("tones, total, root", TONES.values(), ids=TONES)
def test_dft_sum_of_sinusoids_is_that_of_their_frequencies_times_amplitudes(tones, total, root):
    t = np.arange(3000) / 1000.0
    wave = sum(a * np.cos(2 * np.pi * f * t) for f, a in tones)
    for acceleration in (np.column_stack([wave, 0 * t]), np.column_stack([5.0 - 0.6 * wave, 0.8 * wave - 3.0])):
        assert amplitude_sum(weighted_amplitudes(acceleration)) == pytest.approx(total, rel=1e-9)
        assert amplitude_rms(weighted_amplitudes(acceleration)) == pytest.approx(root / 2**0.5, rel=1e-9)


def test_locked_and_released_ticks_are_counted_apart_and_not_without_a_controller():
    decisions = np.full(5200, USE_SDOF)
    decisions[1200:1600] = algorithm.LOCK_NO_VALID
    decisions[2000:2200] = algorithm.LOCK_BACK
    decisions[3000:3100] = algorithm.RELEASE_NO_VALID
    found = measured(hand_made(DECISION=decisions))
    assert (found.locked_share, found.released_share) == (600 / 4000, 100 / 4000)
    found = measured(hand_made(DECISION=np.full(5200, algorithm.NONE)))
    assert (found.locked_share, found.released_share) == (None, None)


@given(st.floats(-3.0, 3.0), st.integers(1, 40), st.floats(0.1, 2.0))
@settings(max_examples=30)
def test_a_ramp_adds_nothing_to_the_sum_without_it_and_its_jump_times_100_over_pi_to_the_sum_as_cut(jump, f, amplitude):
    """A vibration of whole periods over 2 s, which begins and ends alike, with a ramp laid over it."""
    t = np.arange(2001) / 1000.0
    wave = np.column_stack([amplitude * np.sin(2 * np.pi * f * t), 0.0 * t])
    ramp = jump * (t / 2.0)[:, None] * np.array([[0.6, -0.8]])
    calm, without = (amplitude_sum(weighted_amplitudes(without_ramp(a))) for a in (wave, wave + ramp))
    assert without == pytest.approx(calm, rel=1e-9)
    alone = amplitude_sum(weighted_amplitudes(ramp))
    assert alone == pytest.approx(100.0 / np.pi * abs(jump), rel=0.02, abs=1e-9)


def vibrating(frequency, amplitude=0.5):
    """A movement along the path with a vibration across it: its tip and its exact acceleration (m/s2)."""
    t = np.arange(5200) / 1000.0
    r = np.clip((t - 1.1) / 4.0, 0.0, 1.0)
    along = -0.1 + 0.2 * (10.0 * r**3 - 15.0 * r**4 + 6.0 * r**5)  # smooth: what the filter of 20 Hz shows is the wave
    wave = amplitude * np.cos(2 * np.pi * frequency * t)
    return hand_made(along, y=0.4 - wave / (2 * np.pi * frequency) ** 2, TIP_AY=wave)


def test_a_vibration_of_60_hz_is_seen_in_the_exact_acceleration_and_not_through_the_filter_of_20_hz():
    calm, slow, fast = measured(vibrating(60.0, 0.0)), measured(vibrating(5.0)), measured(vibrating(60.0))
    assert fast.acceleration_exact_dft_sum == pytest.approx(60.0 * 0.5, rel=1e-6)
    assert fast.acceleration_dft_sum - calm.acceleration_dft_sum < 0.05 * fast.acceleration_exact_dft_sum
    assert slow.acceleration_exact_dft_sum == pytest.approx(5.0 * 0.5, rel=1e-6)
    assert slow.acceleration_dft_sum == pytest.approx(slow.acceleration_exact_dft_sum, rel=0.05)


def test_a_real_device_without_an_accelerometer_has_no_exact_acceleration_and_is_judged_without_it():
    real = measured(replace(vibrating(60.0), sensors=Sensors("AB", 0)))
    assert real.acceleration_exact_dft_sum is None
    assert real.acceleration_dft_sum is not None
    assert "acceleration_exact_dft_sum" in MEASURES and "acceleration_exact_dft_sum" not in IN_BOXES
    assert set(IN_BOXES) < set(MEASURES)  # what judges the statements is compared in the statistics


def test_acceleration_of_the_tip_is_that_of_a_slow_motion_and_forgets_steps_of_an_encoder():
    t = np.arange(6000) / 1000.0
    w = 2 * np.pi * 1.0
    tip = np.column_stack([0.05 * np.sin(w * t), 0.3 + 0.02 * np.cos(w * t)])
    true = -w * w * (tip - (0.0, 0.3))
    inside = slice(500, 5500)
    assert tip_acceleration(tip)[inside] == pytest.approx(true[inside], abs=1e-3 * w * w * 0.05)
    coarse = np.round(tip / 20e-6) * 20e-6
    assert tip_acceleration(coarse)[inside] == pytest.approx(true[inside], abs=0.1)
    assert tip_acceleration(tip[:10]) is None


def test_sparc_agrees_with_monalysa():
    smoothness = pytest.importorskip("monalysa.quality.smoothness")
    generator = np.random.default_rng(5)
    for n in (150, 700, 1024, 4001):
        t = np.arange(n) / 1000.0
        bell = 30 * (t / 4) ** 2 * (1 - t / 4) ** 2 + 0.01
        for speed in (bell, np.abs(bell + 0.2 * generator.normal(size=n)), bell * (1 + 0.5 * np.sin(40 * t))):
            oracle, _, _ = smoothness.sparc(speed, fs=1000.0, padlevel=4, fc=10.0, amp_th=0.05)
            assert sparc(speed) == pytest.approx(oracle, rel=1e-9)
    assert sparc(np.zeros(100)) is None


def test_the_sparc_of_a_trial_is_that_of_the_speed_of_its_tip_in_the_movement():
    recording = moved(ARC, SHARES**2)
    speed = np.hypot(recording.column("tip_vx_m_s"), recording.column("tip_vy_m_s"))
    assert measured(recording, ARC).sparc == sparc(speed[recording.in_phase("move")])


def test_energy_per_metre_is_work_over_progress_and_chatter_counts_steps_of_current():
    currents = np.zeros((5200, 4))
    currents[1500:1600:10] = 0.3  # ten pulses of a tick: twenty steps
    currents[2000:4000] = np.linspace(0.0, 1.0, 2000)[:, None]  # a ramp follows
    currents[4000:] = 1.0
    columns = {name: currents[:, i] for i, name in enumerate(("a", "e", "b"))}
    recording = hand_made(ENERGY_HAND=np.arange(5200) * 1e-3, DECISION=USE_SDOF)
    for joint, name in zip("AEB", columns, strict=True):
        recording.columns[f"current_{joint}_A"] = columns[name]
    result = measured(recording)
    assert result.hand_energy_per_metre_J_m == pytest.approx(3.999 / 0.2)
    assert result.chatter_per_s == pytest.approx(3 * 20 / 3.999)


def test_of_a_controller_that_never_braked_shares_and_rates_are_0_and_without_control_none():
    names = ("chatter_per_s", "unreachable_share", "locked_share", "released_share")
    found = {}
    for kind in ("none", "reflect", None):  # None: a blind session names no controller
        recording = hand_made()
        recording.metadata.pop("preset", None)
        recording.metadata.update({} if kind is None else {"preset": {"name": "", "kind": kind}})
        found[kind] = {getattr(measured(recording), name) for name in names}
    assert found == {"none": {None}, "reflect": {0.0}, None: {None}}


def test_a_long_trial_has_the_same_digits_whatever_the_threads_of_the_machine():
    """OpenBLAS shares out a dot product over more than 10,000 ticks among threads: none is taken of ticks."""
    code = (
        "from experiments.analysis.movement import amplitude_rms, mean_over_progress; import numpy as np; "
        "r = np.random.default_rng(1); progress = np.cumsum(r.random(50_000)); "
        "print([(mean_over_progress(v, progress), amplitude_rms(v)) for v in r.random((5, 50_000))])"
    )
    found = {
        subprocess.run(
            [sys.executable, "-c", code], env=os.environ | {"OPENBLAS_NUM_THREADS": threads}, cwd=ROOT,
            capture_output=True, text=True, check=True,
        ).stdout
        for threads in ("1", "2", "4")
    }  # fmt: skip
    assert len(found) == 1 and found != {""}


def test_a_timeout_keeps_what_was_measured_over_the_progress_made():
    ticks = np.arange(5200) - MOVE_FROM
    x = -0.1 + 0.2 * np.clip(ticks / 3999, 0.0, 0.3)  # stuck after a third of the way
    y = 0.4 + np.where(ticks < 0.3 * 3999, 0.002, 0.02)
    result = measured(hand_made(x=x, y=y))
    assert result.path_error_m == pytest.approx(0.002, rel=1e-2)
    assert result.path_length_ratio == pytest.approx((0.06 + 0.018) / 0.2, rel=1e-2)


def test_a_trial_that_never_came_to_move_has_no_measures():
    recording = hand_made()
    recording.columns["phase"][:] = tick_log.HOLD
    assert metrics.trial_metrics(recording, PATH) == dict.fromkeys(metrics.BY_NAME)
