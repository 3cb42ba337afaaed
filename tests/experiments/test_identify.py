"""`phd identify`: the numbers of a known brake come back from its current steps, with intervals that hold."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace as replace_struct
from refusals import refusal
from sessions import files
from synthetic_steps import BENCH, FALLING, RISING, SPEEDS, synthetic_steps, write_steps

from app.cli import main
from core.device_file import SHIPPED_FOLDER, BrakeFile, TimeConstant, parse_brake
from core.files import InputError
from experiments.identify.identification import ByHand, identify_steps
from experiments.identify.identify import brake_text, summary_of_fit
from experiments.identify.linear import fit_linear
from experiments.identify.step_response import Step, mean_step, read_steps, time_constant_of_step

BRAKE = parse_brake((SHIPPED_FOLDER / "mrb-2107-3.toml").read_text(), "brake")
QUIET = BENCH._replace(noise_N_m=0.0, ripple_N_m=0.0)
#: Coverage is counted over this many seeds: enough to see a wrong interval.
SEEDS = 16


def truth(brake: BrakeFile) -> np.ndarray:
    """k_1 .. k_5, then a_avg and a_1 .. a_6 rising and falling."""
    return np.array([*brake.k, brake.rise.a_avg_s, *brake.rise.a, brake.fall.a_avg_s, *brake.fall.a])


def numbers(steps: list[Step], **how) -> tuple[np.ndarray, np.ndarray]:
    """Values and half-widths, in the order of `truth`."""
    rows = identify_steps(steps, "steps.csv", ByHand(**how)).parameters()
    return np.array([row.value for row in rows]), np.array([row.half_width for row in rows])


@pytest.fixture(scope="module")
def quiet() -> list[Step]:
    return synthetic_steps(BRAKE, 1, QUIET, repeats=1)


def test_quiet_steps_give_back_the_brake(quiet):
    values, half_widths = numbers(quiet)
    assert values == pytest.approx(truth(BRAKE), rel=1e-4)
    assert np.all(half_widths <= 1e-4 * np.abs(values))
    rise = TimeConstant(a_avg_s=0.05, a=(0.02, -0.05, -0.01, 0.011, 0.002, 0.12))
    fall = TimeConstant(a_avg_s=0.04, a=(0.01, -0.03, -0.002, 0.006, 0.001, 0.09))
    k_5 = (2.0 - 4.0) * 0.4 + 0.5 - 0.4**2  # continuous at the knee
    other = replace_struct(BRAKE, k=(2.0, 0.5, 1.0, 4.0, k_5), knee_A=0.4, omega_0_rpm=4.0, rise=rise, fall=fall)
    steps = synthetic_steps(other, 1, QUIET, repeats=1)
    found = identify_steps(steps, "steps.csv", ByHand(knee_A=0.4))
    brake = parse_brake(brake_text(found, "it"), "it")
    assert found.omega_0_rpm == 4.0 and brake.knee_A == 0.4 and "given" in brake.provenance
    assert [row.value for row in found.parameters()] == pytest.approx(truth(other), rel=2e-4)


def test_95_percent_intervals_cover_the_truth_and_are_narrow_under_ripple_and_noise():
    found = [identify_steps(synthetic_steps(BRAKE, seed), "steps.csv") for seed in range(SEEDS)]
    values = np.array([[row.value for row in one.parameters()] for one in found])
    half_widths = np.array([[row.half_width for row in one.parameters()] for one in found])
    covered = np.mean(np.abs(values - truth(BRAKE)) <= half_widths, axis=0)
    # of 16 intervals that hold in 90 % of all cases, fewer than 12 do once in 60 times, fewer than 11 once in 300
    assert np.all(covered >= 11 / SEEDS), covered
    assert 0.92 <= covered.mean() <= 0.985
    assert [one.omega_0_rpm for one in found] == [8.0] * SEEDS
    names = [row.name for row in found[0].parameters()]
    narrow = [names.index(name) for name in ("k_3", "k_4", "k_5", "rise.a_avg", "fall.a_avg")]
    assert np.all(half_widths[:, narrow] <= 0.1 * np.abs(values[:, narrow]))
    brake = parse_brake(brake_text(found[0], 'my "brake"'), "brake")
    assert brake.name == 'my "brake"' and np.array(brake.k) == pytest.approx(found[0].gain.fit.values, rel=1e-4)
    k1, k2, k3, k4, k5 = brake.k
    assert k1 * 0.2 + k2 == pytest.approx(k3 * 0.04 + k4 * 0.2 + k5, abs=1e-8), "continuous at the knee"
    assert brake.rise.a == pytest.approx(found[0].constants["rise"].surface.values, rel=1e-5)


@pytest.mark.parametrize("a, drift", [(0.01, 0.0), (0.03, 0.5), (0.3, 0.5)])
def test_time_constant_does_not_depend_on_when_the_clock_starts_nor_on_a_straight_drift(a, drift):
    t = np.arange(4001) / 1000.0
    for late in (0.0, 0.013):
        step = Step(0.0, 0.5, 2.0, t, 2.0 - 1.5 * np.exp(-(t + late) / a) + drift * t)
        found, height = time_constant_of_step(step, 1.3 * a)
        assert found == pytest.approx(a, rel=1e-5)
        assert height == pytest.approx(-1.5 * math.exp(-late / a), rel=1e-4)


def in_other_units(steps: list[Step], t=1.0, current=1.0, speed=1.0, torque=1.0) -> list[Step]:
    """The same steps with numbers times these factors."""
    found = []
    for one in steps:
        currents = current * one.current_from, current * one.current_to
        found.append(Step(*currents, speed * one.speed_rpm, t * one.t, torque * one.torque))
    return found


OTHER_UNITS = {
    "milliseconds": ({"t": 1e3}, "t_s", "ms ("),
    "mN m": ({"torque": 1e3}, "torque_N_m", "mN m (5300 mN m = 5.3 N m)"),
    "rad/s": ({"speed": math.pi / 30.0}, "speed_rpm", "rad/s (6.7 rad/s = 64 rpm)"),
    "rev/s": ({"speed": 1.0 / 60.0}, "speed_rpm", "rev/s (1.07 rev/s = 64 rpm)"),
}


@pytest.mark.parametrize("factors, column, says", OTHER_UNITS.values(), ids=OTHER_UNITS)
def test_numbers_in_another_unit_give_a_warning_that_names_it_and_the_file_says_so(quiet, factors, column, says):
    found = identify_steps(in_other_units(quiet, **factors), "steps.csv")
    assert list(found.doubtful) == [column]
    (warning,) = found.warnings
    assert warning.startswith(f"{column}: ") and f"likely unit: {says}" in warning
    assert summary_of_fit(found)["warnings"] == [warning]
    text = brake_text(found, "mine")
    assert f"# Warning: {warning}" in text
    assert parse_brake(text, "brake").provenance.endswith(f"; doubtful units: {column}")


@pytest.mark.parametrize("top", [8.0, 16.0])
def test_omega_0_is_assumed_unless_two_speeds_show_the_flat_part(top):
    speeds = tuple(speed for speed in SPEEDS if speed <= top)
    steps = synthetic_steps(BRAKE, 2, speeds=speeds)
    found = identify_steps(steps, "steps.csv")
    text = brake_text(found, "mine")
    seen = top > BRAKE.omega_0_rpm
    assert found.omega_0_rpm == min(top, BRAKE.omega_0_rpm)
    assert found.flat_part_seen == seen == ("omega_0_rpm" not in found.assumed)
    assert found.omega_0_by.startswith("least squares" if seen else "assumed: the highest measured speed")
    (line,) = [line for line in text.splitlines() if line.startswith("omega_0_rpm")]
    assert ("# assumed: the highest measured speed" in line) == (not seen)
    assert any("omega_0_rpm" in warning for warning in found.warnings) == (not seen)


def test_the_file_calls_assumed_what_steps_do_not_show_and_nothing_else(quiet):
    for backlash, assumed in ((None, ["current_max_A", "knee_A", "floor_rpm", "backlash_deg"]), (0.5, [])):
        found = identify_steps(quiet, "steps.csv", ByHand(backlash_deg=backlash))
        assert found.warnings == []
        text, numbers = brake_text(found, "mine"), summary_of_fit(found)
        lines = [line.split(" = ")[0] for line in text.splitlines() if "# assumed: " in line]
        expected = assumed or ["current_max_A", "knee_A", "floor_rpm"]
        assert sorted(lines) == sorted(expected) == sorted(numbers["assumed"])
        given = [] if backlash is None else ["backlash_deg"]
        shown = "identified from steps.csv: k, rise, fall, omega_0_rpm" + "; given: backlash_deg" * len(given)
        brake = parse_brake(text, "brake")
        assert brake.provenance == f"{shown}; assumed: {', '.join(expected)}" and brake.assumed
        assert numbers["given"] == given
        marked = [*numbers["identified"], *given, *expected, "name", "provenance", "command_unit", "torque_table"]
        assert sorted(marked) == sorted(BrakeFile.__struct_fields__)


WITHOUT = {
    "no rising steps": (lambda s: not s.rising, "a_avg and a_1 to a_6 of Eq. (4), rise, .* no step to a higher"),
    "no falling steps": (lambda s: s.rising, "a_avg and a_1 to a_6 of Eq. (4), fall, .* no step to a lower"),
    "all fall to zero": (
        lambda s: s.rising or s.current_to == 0.0,
        "a_1, a_3 and a_5 of Eq. (4), fall, .* to 0 A at .* two currents at each of three speeds",
    ),
    "two slow speeds": (
        lambda s: s.speed_rpm >= 2.0,
        r"a_1, a_2, a_3, a_4, a_5 and a_6 of Eq. (4), rise, .*omega_0 = 8 rpm .* at 2 and 4 rpm only",
    ),
    "none fast": (lambda s: s.speed_rpm < 8.0, r"a_avg of Eq. (4), rise, .*omega_0 = 8 rpm and above no step"),
    "none below the knee": (lambda s: s.current_to > 0.0, r"k_1, k_2.* of Eq. \(2\) .*one of them below 0\.2 A"),
    "two currents only": (
        lambda s: s.current_to in (0.0, 0.2) or (s.current_to == 0.4 and s.rising),
        r"k_3, k_4 and k_5 of Eq. \(2\) .* to 0, 0\.2 and 0\.4 A only",
    ),
}


def kept(keep):
    """A change that leaves these steps alone."""
    return lambda step: step if keep(step) else None


#: What is done to each step (None: it is left out), and what the refusal says.
SPOILT = {name: (kept(keep), f"{says}") for name, (keep, says) in WITHOUT.items()} | {
    "cut off": (
        lambda s: replace(s, t=s.t[:400], torque=s.torque[:400]),
        r"at 0\.5 rpm cannot be identified: .* before its torque settles",
    ),
    "counted the other way": (lambda s: replace(s, torque=-s.torque), "the sensor counts the other way, turn the sign"),
    "zero too low": (lambda s: replace(s, torque=s.torque - 0.5), r"would be -0\.15 N m.* the torque sensor's zero is"),
    "two steps turned back": (
        lambda s: replace(s, speed_rpm=-2.0, torque=-s.torque) if s.speed_rpm == 2.0 else s,
        "speed_rpm: 0 steps are there both ways",
    ),
}


@pytest.mark.parametrize("spoil, says", SPOILT.values(), ids=SPOILT)
def test_steps_that_cannot_tell_a_number_or_show_no_brake_are_refused_with_the_reason(quiet, spoil, says):
    steps = [step for step in map(spoil, quiet) if step]
    with pytest.raises(InputError, match=says.replace("Eq. (4)", r"Eq\. \(4\)")) as refusal:
        identify_steps(steps, "steps.csv", ByHand(omega_0_rpm=8.0))
    assert str(refusal.value).startswith("steps.csv: ")


def test_steps_that_say_nothing_but_noise_never_become_a_brake():
    rng = np.random.default_rng(1)
    t = np.arange(2001) / 1000.0
    steps = [Step(*change, speed, t, rng.standard_normal(len(t))) for change in (*RISING, *FALLING) for speed in SPEEDS]
    with pytest.raises(InputError):
        brake_text(identify_steps(steps, "steps.csv"), "noise")


FAULTS = {
    "dead time": ({"dead_time_s": 0.005}, ["t_s: the torque begins to change 5 ms after"]),
    "drift": ({"drift_per_h": -0.1}, ["torque_N_m: from the first step to the last the torque changes by -1"]),
    "zero": ({"offset_N_m": 0.3, "turns_back": True}, ["torque_N_m: without torque the sensor reads 0."]),
    "none of them, turned back": ({"turns_back": True}, []),
}


@pytest.mark.parametrize("fault, says", FAULTS.values(), ids=FAULTS)
def test_what_a_brake_does_not_do_is_named_and_the_intervals_still_hold(fault, says):
    """Without its treatment each fault leaves at least 4 of 19 numbers outside, most of them far outside."""
    found = identify_steps(synthetic_steps(BRAKE, 3, BENCH._replace(**fault)), "steps.csv")
    assert len(found.warnings) == len(says)
    for warning, words in zip(found.warnings, says, strict=True):
        assert warning.startswith(words)
    intervals = [row.interval for row in found.parameters()]
    inside = [low <= one <= high for one, (low, high) in zip(truth(BRAKE), intervals, strict=True)]
    assert sum(inside) >= 17, inside


def test_transients_that_are_not_exponential_lose_their_intervals_in_table_json_and_file():
    """The current, and so the torque, follows with a lag of its own of 40 ms."""
    steps = []
    for step in synthetic_steps(BRAKE, 3, repeats=1):
        kernel = np.exp(-step.t / 0.04) * step.t[1] / 0.04
        before = np.full(len(step.t), BRAKE.torque_gain(step.current_from))
        lagged = np.convolve(np.concatenate([before, step.torque]), kernel / kernel.sum())[
            len(before) : 2 * len(before)
        ]
        steps.append(replace(step, torque=lagged))
    found = identify_steps(steps, "steps.csv")
    assert [warning for warning in found.warnings if "does not follow Eq. (3)" in warning]
    rows = {row["name"]: row for row in summary_of_fit(found)["parameters"]}
    assert rows["rise.a_avg"]["half_width"] is rows["rise.a_avg"]["low"] is None and rows["k_3"]["low"] is not None
    assert "# interval withheld" in brake_text(found, "lag")


def test_intervals_of_a_straight_line_are_scipys_or_wider_where_the_scatter_is_uneven():
    from scipy import stats

    reach = stats.t.ppf(0.975, 10)
    x = np.linspace(0.0, 3.0, 12)
    away = x - x.mean()
    leverage = 1.0 / 12 + away**2 / np.sum(away**2)
    wider = []
    for seed in range(20):
        y = 1.0 + 2.0 * x + np.random.default_rng(seed).standard_normal(12)
        fit = fit_linear(np.column_stack([x, np.ones(12)]), y, np.full(12, 7.0))  # a common weight changes nothing
        line = stats.linregress(x, y)
        assert fit.values == pytest.approx([line.slope, line.intercept])
        scatter = (y - line.intercept - line.slope * x) ** 2 / (1.0 - leverage)
        uneven = math.sqrt(np.sum((away / np.sum(away**2)) ** 2 * scatter))
        assert fit.half_widths[0] == pytest.approx(reach * max(line.stderr, uneven))
        wider.append(uneven > line.stderr)
    assert any(wider) and not all(wider)


def test_a_written_file_reads_back_with_rows_before_the_step_and_a_running_clock(tmp_path):
    steps = synthetic_steps(BRAKE, 2, speeds=(2.0, 8.0), changes=((0.0, 1.0),), repeats=2)
    write_steps(steps, tmp_path / "steps.csv")
    for step, again in zip(steps, read_steps(tmp_path / "steps.csv"), strict=True):
        assert again.key == step.key and np.array_equal(again.t, step.t)
        assert np.array_equal(again.torque, step.torque)
    rows = ["step_index,torque_N_m,t_s,current_from_A,current_to_A,speed_rpm,temperature_C"]
    rows += [f"0,{i},{(i - 5) / 100},0,1,2,20" for i in range(40)]  # five rows before the change
    rows += [f"1,{i},{7 + i / 100},0,1,2,20" for i in range(40)]  # the clock ran on
    (tmp_path / "more.csv").write_text("\n".join(rows) + "\n")
    first, second = read_steps(tmp_path / "more.csv")
    assert first.t == pytest.approx(np.arange(35) / 100) and first.torque[0] == 5.0
    assert second.t == pytest.approx(np.arange(40) / 100) and second.torque[0] == 0.0


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder that commands run in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_command_writes_a_brake_file_and_figures_and_never_overwrites(folder, quiet, capsys):
    write_steps(quiet, folder / "steps.csv")
    options = ["--figures", "figures", "--name", "MR 1", "--omega-0", "8", "--backlash-deg", "0"]
    assert main(["identify", "steps.csv", "--out", "mine.toml", "--json", *options]) == 0
    told = json.loads(capsys.readouterr().out)
    brake = parse_brake(Path("mine.toml").read_text(), "mine.toml")
    assert brake.name == told["brake"] == "MR 1" and brake.omega_0_rpm == told["omega_0_rpm"] == 8.0
    assert brake.backlash_deg == 0.0
    for row, value in zip(told["parameters"], truth(BRAKE), strict=True):
        assert row["low"] <= row["value"] <= row["high"] and row["value"] == pytest.approx(value, rel=1e-4)
    assert len(told["residuals"]) == 80
    names = {path.stem[:5] for path in Path("figures").iterdir()}
    assert names == {"fig06", "fig07", "fig08"} and len(told["figures"]) == 10
    assert all(Path(path).stat().st_size > 1000 for path in told["figures"])
    before = files(folder)
    assert "mine.toml: exists already" in refusal(capsys, "identify", "steps.csv", "--out", "mine.toml")
    options = ["--out", "other.toml", "--figures", "figures"]
    assert "fig06_torque_gain.png: exists already" in refusal(capsys, "identify", "steps.csv", *options)
    assert files(folder) == before
    assert main(["identify", "steps.csv"]) == 0 and "k_5" in capsys.readouterr().out and files(folder) == before


HEADER = "t_s,current_from_A,current_to_A,speed_rpm,torque_N_m,step_index\n"
WRONG_FILES = {
    "a scene": ('device = "three-brake"\nduration_s = 2.0\n', "line 1: the header lacks t_s, .*step_index"),
    "standing shaft": (HEADER + "0,0,1,0,1,0\n", "line 2: speed_rpm must not be 0"),
    "time falls": (HEADER + "0,0,1,2,1,0\n1,0,1,2,1,0\n0.5,0,1,2,1,0\n", "line 4: t_s must rise within a step"),
    "few rows": (
        HEADER + "0,0,1,2,1,0\n1,0,1,2,1,0\n",
        "step_index 0, 0 to 1 A at 2 rpm: has 2 rows after",
    ),
}


@pytest.mark.parametrize("text, words", WRONG_FILES.values(), ids=WRONG_FILES)
def test_a_wrong_file_gives_one_sentence_exit_2_and_nothing_written(folder, capsys, text, words):
    Path("steps.csv").write_text(text)
    told = refusal(capsys, "identify", "steps.csv", "--out", "mine.toml", "--figures", "figures")
    assert re.search(rf"steps\.csv: {words}", told), told
    assert [path.name for path in folder.iterdir()] == ["steps.csv"]


@pytest.mark.parametrize("speed", [1.0, 16.0])
def test_steps_at_one_speed_give_the_torque_and_a_constant_time_constant_and_say_what_is_not_seen(
    speed, folder, capsys
):
    steps = synthetic_steps(BRAKE, 4, BENCH, speeds=(speed,))
    write_steps(steps, folder / "steps.csv")
    assert main(["identify", "steps.csv", "--out", "one.toml"]) == 0
    assert f"all steps are at {speed:g} rpm, so a_1 to a_6 of Eq. (4) are not seen" in capsys.readouterr().err
    brake = parse_brake((folder / "one.toml").read_text(), "one.toml")
    for constant, true in ((brake.rise, BRAKE.rise), (brake.fall, BRAKE.fall)):
        own = [true.below_omega_0(current, math.log2(speed)) if speed < 8.0 else true.a_avg_s for current in (0.0, 1.0)]
        assert 0.9 * min(own) < constant.a_avg_s < 1.1 * max(own)
        assert constant.below_omega_0(0.7, -2.0) == constant.a_avg_s
    for current in (0.0, 0.4, 1.0):
        assert brake.torque_gain(current) == pytest.approx(BRAKE.torque_gain(current), abs=0.2), "the ripple"


def test_the_averaged_step_is_the_mean_of_its_repeats_also_on_different_clocks():
    t = np.linspace(0.0, 1.0, 101)
    repeats = [Step(0.0, 1.0, 2.0, t, 1.0 * t), Step(0.0, 1.0, 2.0, t[:81], 3.0 * t[:81])]
    late = t[:-1] + 0.005
    repeats.append(Step(0.0, 1.0, 2.0, late, 5.0 * late))
    mean = mean_step(repeats)
    assert mean.repeats == 3 and mean.t[0] >= 0.005 and mean.t[-1] <= 0.8
    assert mean.torque == pytest.approx(3.0 * mean.t)
