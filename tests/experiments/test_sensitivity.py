"""Sensitivity: each sample is the study that `phd study` runs; what decides is found."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from refusals import refusal

from core.files import InputError
from core.workspace import tip_is_free
from experiments.analysis.findings import IN_BOXES, LEAST_FINISHED, STATEMENTS, box_findings_of
from experiments.analysis.metrics import JUDGED
from experiments.analysis.trials_table import as_table
from experiments.protocol import load_protocol
from experiments.sensitivity.changed_files import within_reach
from experiments.sensitivity.indices import dependent_pairs, find_indices
from experiments.sensitivity.judged import boxes_of, judge, read_trials, wilson
from experiments.sensitivity.ranges import AssumptionRange, load_ranges
from experiments.sensitivity.report import Judgement, report_files
from experiments.sensitivity.run import SensitivityRun, run_sensitivity
from experiments.study.unrecorded import study_trials
from experiments.trial.population import load_population

RANGES = """
name = "small"
protocol = "small.toml"
operators = 1
[rules]
choices = ["settled", "literal"]
source = "two readings"
[assumptions.low_gain]
low = 5.0
high = 1000.0
log = true
source = "Table I"
label = "low gain (N s/m)"
settled_by = "the authors' code"
[operator_factor.stiffness]
low = 0.5
high = 2.0
source = "assumed"
[operator.movement_s]
low = 1.0
high = 1.5
source = "assumed"
[device."mass.joint_C_kg"]
low = 0.0
high = 1.4
source = "assumed"
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    """A ranges file and its protocol: 10 trials a world."""
    folder = tmp_path_factory.mktemp("ranges")
    text = load_protocol("paper").text
    cut = text[: text.index("[[path]]\nnumber = 2")] + text[text.index("[[controller]]") :]
    (folder / "small.toml").write_text(
        cut.replace("blocks = 3", "blocks = 1").replace('name = "paper"', 'name = "small"')
    )
    (folder / "ranges.toml").write_text(RANGES)
    return folder / "ranges.toml"


@pytest.fixture(scope="module")
def whole(small, tmp_path_factory) -> Path:
    """Three samples, run in one go."""
    out = tmp_path_factory.mktemp("sensitivity") / "out"
    run_sensitivity(SensitivityRun(load_ranges(small), 3), out)
    return out


def test_the_rows_of_a_sample_are_the_trials_of_a_study_with_its_values_and_seed_and_judged_as_those(small, whole):
    ranges = load_ranges(small)
    sample = SensitivityRun(ranges, 3).samples()[1]
    study = ranges.study(sample.values, sample.seed)
    assert (study.protocol.rules, study.protocol.seed) == (sample.values["rules"], sample.seed)
    assert study.protocol.low_gain == sample.values["assumptions.low_gain"]
    trials = [row for row, _ in study_trials(study.protocol, study.populations[0], 1)]
    ours = pd.read_csv(whole / "sensitivity.csv").query("sample == 2")
    assert ours[["configuration", "controller", "path"]].values.tolist() == [
        [row.configuration, row.controller, row.path] for row in trials
    ]
    for metric in JUDGED:
        assert ours[metric.name].tolist() == [float(f"{row.value(metric.name):.6g}") for row in trials]
    with pytest.raises(InputError, match="sensitivity was begun with another n"):
        run_sensitivity(SensitivityRun(ranges, 5), whole, resume=True)
    judged = judge(read_trials(whole / "sensitivity.csv"), ("three-brake", "four-brake"), 1)
    assert judged.holds.iloc[1].tolist() == [one.verdict == "holds" for one in box_findings_of(as_table(trials))]


def test_every_range_reaches_the_study(small):
    ranges = load_ranges(small)
    usual, (people,) = ranges.study({}, 3)
    values = {
        "operator_factor.stiffness": 2.0, "operator.movement_s": 1.25, "device.mass.joint_C_kg": 0.25,
        "device_factor.geometry.L_[EC]D_m": 1.1, "device_factor.geometry.base_[AB]_m": 0.5,
        "device_factor.mass.??.mass_kg": 2.0, "path.1.angle_deg": 30.0, "path.1.length_m": 0.1,
        "rules": "literal", "assumptions.low_gain": 33.0, "assumptions.torque_factor": 0.5,
    }  # fmt: skip
    changed, (others,) = ranges.study(values, 3)
    assert (changed.rules, changed.low_gain, usual.rules, usual.low_gain) == ("literal", 33.0, "settled", 500.0)
    one, other = (some.draw(np.random.default_rng(1)) for some in (people, others))
    for name in ("stiffness_along_N_m", "stiffness_across_N_m"):
        assert getattr(other, name) == pytest.approx(2.0 * getattr(one, name))
    assert other.movement_s == 1.25 and other.mass_kg == one.mass_kg
    three, four = changed.devices[0].file, changed.devices[1].file
    assert four.mass.joint_C_kg == 0.25 and three.mass.joint_C_kg == 0.0  # the three-brake device has no mass at C
    assert four.geometry.L_ED_m == pytest.approx(0.33528) and four.geometry.L_AE_m == 0.2794
    assert four.geometry.base_A_m[0] == pytest.approx(-0.0381)
    rod = changed.devices[1].mechanism.arm_1
    assert (rod.length_2, changed.devices[1].file.mass.ED.mass_kg) == (pytest.approx(0.33528), 0.6)
    path = changed.paths[1]
    assert math.dist(path.start_m, path.end_m) == pytest.approx(0.1, abs=1e-5)
    assert np.add(path.start_m, path.end_m) / 2 == pytest.approx([0.0, 0.4], abs=1e-5)
    gains = [p.assumptions.applied_to(p.devices[0]).brake_files["A"] for p in (usual, changed)]
    for current in (0.0, 0.1, 0.7):
        a, b = (brake.torque_gain(current) for brake in gains)
        assert b - 0.35 == pytest.approx(0.5 * (a - 0.35), abs=1e-12)


def test_a_path_out_of_reach_moves_to_the_middle_and_is_shortened_until_all_devices_reach_it():
    devices = load_protocol("paper").devices
    middle, generator = np.array([0.0, 0.4]), np.random.default_rng(1)
    moved = shortened = 0
    for _ in range(12):
        asked = dict(
            zip(("x_m", "y_m", "length_m", "angle_deg"), generator.uniform((-0.5, 0.1, 0.1, -90), (0.5, 0.7, 0.9, 90)),
                strict=True)
        )  # fmt: skip
        start, end = within_reach(devices, asked, middle)
        places = np.linspace(start, end, 400)
        assert all(tip_is_free(device.mechanism, *places.T).all() for device in devices)
        angle = math.degrees(math.atan2(end[1] - start[1], end[0] - start[0]))
        assert angle == pytest.approx(asked["angle_deg"], abs=math.degrees(1e-6 / math.dist(start, end)))  # ends in um
        moved += not np.allclose((start + end) / 2, (asked["x_m"], asked["y_m"]), atol=1e-5)
        shortened += math.dist(start, end) < asked["length_m"] - 1e-5
    assert moved > 3 and shortened > 1
    inside = within_reach(devices, {"x_m": 0.01, "y_m": 0.38, "length_m": 0.1, "angle_deg": 0.0}, middle)
    assert inside == pytest.approx(np.array([[-0.04, 0.38], [0.06, 0.38]]))


def test_one_value_is_the_same_in_all_samples(small, tmp_path):
    (tmp_path / "small.toml").write_bytes((small.parent / "small.toml").read_bytes())
    (tmp_path / "alone.toml").write_text(
        'name = "alone"\nprotocol = "small.toml"\noperators = 1\n'
        '[population]\nvalue = "steady"\nsource = "x"\n'
        '[assumptions.lag_factor]\nvalue = 3.0\nsource = "x"\nlabel = "lag"\n'
        '[operator_factor.skill]\nvalue = 0.5\nsource = "x"\n'
    )
    ranges = load_ranges(tmp_path / "alone.toml")
    assert not ranges.ranges and ranges.shares(3, 1).shape == (3, 0)
    protocol, (people,) = ranges.study({}, 3)
    assert protocol.assumptions.lag_factor == 3.0 and people.name == "steady"
    usual = load_population("steady").draw(np.random.default_rng(1))
    assert people.draw(np.random.default_rng(1)) == usual._replace(skill=0.5 * usual.skill)
    first, second = SensitivityRun(ranges, 2).samples()
    assert first.seed != second.seed and first.values == second.values == {}


WRONG = {
    "no source": (RANGES.replace('source = "Table I"\n', ""), "source"),
    "upside down": (RANGES.replace("low = 5.0", "low = 5000.0"), "low (5000) must be less than high (1000)"),
    "log of zero": (RANGES.replace("low = 5.0", "low = 0.0"), "low must be greater than 0 where log is true"),
    "value that cannot be": (RANGES.replace("low = 1.0\nhigh = 1.5", "value = -1.0"), "movement_s: -1.0 cannot"),
    "unknown rules": (RANGES.replace('"literal"', '"magic"'), "rules: 'magic' cannot be"),
    "path that is none": (RANGES + '[path."3.x_m"]\nvalue = 0.1\nsource = "x"', "path.3.x_m: there is no such number"),
}  # fmt: skip


@pytest.mark.parametrize("text, says", WRONG.values(), ids=WRONG)
def test_a_wrong_ranges_file_is_one_sentence_and_nothing_is_written(small, tmp_path, capsys, text, says):
    (tmp_path / "small.toml").write_bytes((small.parent / "small.toml").read_bytes())
    (tmp_path / "ranges.toml").write_text(text)
    assert says in refusal(capsys, "sensitivity", tmp_path / "ranges.toml", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_shipped_ranges_can_be_run_and_say_what_they_rest_on():
    ranges = load_ranges("paper")
    assert ranges.operators == 3 and len(ranges.ranges) >= 30 and all(of.source for of in ranges.ranges.values())
    assert {"path.1.x_m", "assumptions.torque_factor", "device_factor.mass.??.mass_kg"} <= set(ranges.ranges)


def test_values_spread_over_a_range_evenly_and_over_its_logarithm_where_asked(small):
    ranges = load_ranges(small)
    drawn = [ranges.values(shares) for shares in ranges.shares(200, 1)]
    gains = np.array([one["assumptions.low_gain"] for one in drawn])
    assert abs(np.mean(gains < math.sqrt(5.0 * 1000.0)) - 0.5) < 0.01
    times = np.array([one["operator.movement_s"] for one in drawn])
    assert 1.0 <= times.min() and times.max() <= 1.5 and abs(np.mean(times < 1.25) - 0.5) < 0.01
    assert sum(one["rules"] == "literal" for one in drawn) == 100


def made_samples(n: int = 600) -> tuple[dict[str, AssumptionRange], np.ndarray, pd.DataFrame]:
    """Statement 1 is decided by the second range, 2 by the first and third together, 3 by chance, the others hold."""
    ranges = {name: AssumptionRange(source="made", low=0.0, high=1.0) for name in "abcd"}
    generator = np.random.default_rng(1)
    shares = generator.random((n, 4))
    holds = np.ones((n, 11), dtype=bool)
    holds[:, 0] = shares[:, 1] > 0.7
    holds[:, 1] = (shares[:, 0] > 0.5) & (shares[:, 2] > 0.5)
    holds[:, 2] = generator.random(n) > 0.4
    return ranges, shares, pd.DataFrame(holds, columns=range(1, 12))


def test_indices_are_the_true_shares_of_the_variance_and_nothing_stands_out_by_chance():
    ranges, shares, holds = made_samples()
    found = find_indices(ranges, shares, holds)
    assert found.first.loc[1, "b"] > 0.85 and found.first.loc[1, ["a", "c", "d"]].abs().max() < 0.05
    for name in "ac":  # Var(E[y | a]) / Var(y) = (1/4)^2 / (1/4 * 3/4)
        assert abs(found.first.loc[2, name] - 1.0 / 3.0) < 1.5 * found.half_width.loc[2, name] < 0.15
    assert found.first.loc[4:].isna().all(axis=None)  # all samples agree
    counts = {(number, name) for number, row in found.counts.iterrows() for name, yes in row.items() if yes}
    assert counts == {(1, "b"), (2, "a"), (2, "c")}
    settled = found.settled(holds)
    assert settled.index[0] == "b" and settled.sum() <= 1.0 and settled["d"] == 0.0


def test_pairs_that_exclude_each_other_are_found_and_independent_ones_are_not():
    generator = np.random.default_rng(1)
    holds = pd.DataFrame(generator.random((1000, 11)) < 0.3, columns=range(1, 12))
    assert dependent_pairs(holds) == []
    holds[8] = ~holds[2] & (generator.random(1000) < 0.4)
    (pair,) = dependent_pairs(holds)
    assert (pair.first, pair.second, pair.together) == (2, 8, 0)
    assert pair.expected == pytest.approx(1000 * holds[2].mean() * holds[8].mean())


def made_trials(n: int, people: int = 3) -> pd.DataFrame:
    """Studies whose five controllers do nothing: people and trials differ, by a fifth and a quarter."""
    place = ["sample", "configuration", "controller", "participant", "path", "repetition"]
    levels = [range(1, n + 1), ("three-brake", "four-brake"), range(1, 6), range(1, people + 1), (1, 2), (1, 2, 3)]
    trials = pd.MultiIndex.from_product(levels, names=place).to_frame(index=False)
    generator = np.random.default_rng(1)
    of_people = generator.normal(0.0, 0.2, (n, people))[trials["sample"] - 1, trials["participant"] - 1]
    for measure in IN_BOXES:
        trials[measure] = np.exp(of_people + generator.normal(0.0, 0.25, len(trials)))
    return trials


def test_trials_drawn_anew_without_control_differ_as_those_of_controllers_that_do_nothing():
    n = 80
    judged = judge(made_trials(n), ("three-brake", "four-brake"), 1)
    made, drawn = judged.holds.mean(), judged.chance.mean()
    assert 0.05 < made[10] < 0.5 < made[6] < 0.98  # worth comparing
    for number, p in made.items():
        assert abs(p - drawn[number]) < 3.0 * math.sqrt((p * (1 - p) + drawn[number] * (1 - drawn[number])) / n) + 0.02


def test_the_report_says_what_decides_and_what_to_measure_first(small, tmp_path):
    ranges, trials = load_ranges(small), made_trials(40, 1)
    shares = ranges.shares(40, 1)
    worse = (trials["controller"] == 3) & (shares[trials["sample"] - 1, 0] >= 0.5)
    trials.loc[trials["controller"] == 3, "path_error_m"] *= 0.5
    trials.loc[worse, "path_error_m"] *= 4.0
    trials.to_csv(tmp_path / "sensitivity.csv", index=False)
    files, summary = report_files(tmp_path / "sensitivity.csv", ranges, shares, 1)
    page = files["report.md"].decode()
    assert page.startswith("# Sensitivity: small\n\n40 samples of the ranges 'small', seed 1") and "$" not in page
    assert "| **rules " in page and summary["measure_first"] == "rules"
    assert {"overview.png", "decided-by.png", "samples.csv", "indices.csv"} <= files.keys()
    found = Judgement(tmp_path / "sensitivity.csv", ranges, shares, 1)
    for statement in STATEMENTS:
        share = 100.0 * found.holds[statement.number].mean()
        assert f"| {statement.number} | {statement.text} | **{share:.1f} %** (" in page


def test_the_interval_of_a_share_is_wilsons_and_holds_the_share():
    low, high = wilson(5, 20)
    assert (float(low), float(high)) == pytest.approx((0.1119, 0.4687), abs=1e-3)
    for n in range(1, 200):
        holding = np.arange(n + 1)
        low, high = wilson(holding, n)
        assert np.all(low <= holding / n) and np.all(holding / n <= high)


def test_mixed_people_are_one_of_each_population_in_turn(small, tmp_path):
    (tmp_path / "small.toml").write_bytes((small.parent / "small.toml").read_bytes())
    (tmp_path / "mixed.toml").write_text(
        'name = "mixed"\nprotocol = "small.toml"\noperators = 3\n'
        '[population]\nchoices = ["average", "steady", "mixed"]\nsource = "x"\n'
    )
    study = load_ranges(tmp_path / "mixed.toml").study({"population": "mixed"}, 1)
    assert [population.name for population in study.populations] == ["average", "steady"]


def test_a_box_needs_nine_trials_of_ten_that_reached_the_end():
    trials = made_trials(2)
    assert LEAST_FINISHED == 0.9
    of_cell = trials.query("sample == 1 and configuration == 'four-brake' and controller == 3").index
    trials.loc[of_cell[:2], list(IN_BOXES)] = math.nan  # 2 of 18
    boxes = boxes_of(trials)
    assert (IN_BOXES[0], "four-brake", 3) not in boxes[1] and (IN_BOXES[0], "four-brake", 3) in boxes[2]
    trials.loc[of_cell[:1], list(IN_BOXES)] = 1.0
    values = trials.loc[of_cell, IN_BOXES[0]].dropna()
    assert boxes_of(trials)[1][IN_BOXES[0], "four-brake", 3] == tuple(np.quantile(values, (0.25, 0.5, 0.75)))


def test_a_sample_without_trials_holds_nothing(whole, tmp_path):
    trials = pd.concat([read_trials(whole / "sensitivity.csv"), pd.DataFrame({"sample": [4]})])
    judged = judge(trials, ("three-brake", "four-brake"), 1)
    assert not judged.holds.iloc[3].any() and judged.cannot_tell.iloc[3].all() and len(judged.holds) == 4
