"""Worlds: each is the study that `phd study` runs; one table whatever ran where; the report names what decides."""

import json
import math
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from exports import rows
from refusals import refusal

from app.cli import main
from core.files import InputError
from experiments.analysis.findings import CANNOT_TELL, HOLDS, LEAST_FINISHED, STATEMENTS
from experiments.analysis.metrics import JUDGED
from experiments.analysis.trials_table import as_rows
from experiments.protocol import load_protocol
from experiments.session.files import write_pooled_table
from experiments.study import jobs
from experiments.study.study import run_study
from experiments.trial.population import load_population
from experiments.worlds.indices import effective_counts, find_indices
from experiments.worlds.pictures import wilson
from experiments.worlds.ranges import AssumptionRange, load_ranges
from experiments.worlds.report import Judgement, report_files, where_it_holds
from experiments.worlds.table import Verdicts, Worlds, columns, judge, read_worlds
from experiments.worlds.worlds import WorldsRun, run_worlds, worlds_of

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
    """Two worlds, two people each in turn, run in one go."""
    out = tmp_path_factory.mktemp("worlds") / "out"
    run_worlds(WorldsRun(load_ranges(small), 2, triples=2), out)
    return out


TWICE = ["--n", "2", "--triples", "2"]


def lines(out: Path) -> list[dict[str, str]]:
    return rows(out / "worlds.csv")


def table(out: Path) -> list[str]:
    return (out / "worlds.csv").read_text().splitlines()


def is_row_of(line: dict[str, str], study: Path) -> None:
    """A study has the trials of a world's row, digit by digit."""
    trials = as_rows(write_pooled_table(study))
    for metric in JUDGED:
        for device in ("three-brake", "four-brake"):
            for controller in range(1, 6):
                found = [
                    trial.value(metric.name)
                    for trial in sorted(trials, key=lambda trial: (trial.participant, trial.segment, trial.repetition))
                    if (trial.configuration, trial.controller) == (device, controller)
                ]
                assert line[f"{metric.name}:{device}:{controller}"] == " ".join(f"{value:.6g}" for value in found)


def test_a_row_is_the_study_of_the_same_assumptions_and_seed(small, whole, tmp_path):
    ranges = load_ranges(small)
    for world, line in list(zip(worlds_of(ranges, 2, 1, 2), lines(whole), strict=True))[1:2]:
        protocol, population = ranges.study(world.values, world.seed)
        assert protocol.low_gain == world.values["assumptions.low_gain"] and protocol.seed == int(line["seed"])
        assert protocol.rules == line["rules"]
        run_study(tmp_path / f"{world.number}", 1, protocol, population)
        is_row_of(line, tmp_path / f"{world.number}")


def test_triples_share_their_worlds_assumptions_and_the_first_are_those_of_a_run_with_one(small, whole):
    ranges = load_ranges(small)
    alone, both = worlds_of(ranges, 3, 1), worlds_of(ranges, 3, 1, 2)
    assert [(one.world, one.triple) for one in both] == [(1, 1), (1, 2), (2, 1), (2, 2), (3, 1), (3, 2)]
    assert [one.number for one in both] == [1, 2, 3, 4, 5, 6] and len({one.seed for one in both}) == 6
    assert [one.seed for one in both[::2]] == [one.seed for one in alone]
    assert all(one.values == other.values for one, other in zip(both[::2], both[1::2], strict=True))
    found = lines(whole)
    assert [(line["world"], line["triple"]) for line in found] == [("1", "1"), ("1", "2"), ("2", "1"), ("2", "2")]


def test_every_assumption_reaches_the_study(small):
    ranges = load_ranges(small)
    usual, people = ranges.study({}, 3)
    values = {"operator_factor.stiffness": 2.0, "operator.movement_s": 1.25, "device.mass.joint_C_kg": 0.25}
    changed, others = ranges.study({**values, "rules": "literal", "assumptions.low_gain": 33.0}, 3)
    assert (changed.rules, changed.low_gain, usual.rules, usual.low_gain) == ("literal", 33.0, "settled", 5.0)
    one, other = (some.draw(np.random.default_rng(1)) for some in (people, others))
    for name in ("stiffness_along_N_m", "stiffness_across_N_m"):
        assert getattr(other, name) == pytest.approx(2.0 * getattr(one, name))
    assert other.movement_s == 1.25 and other.mass_kg == one.mass_kg
    assert "joint_C_kg = 0.25" in changed.devices[1].text and "joint_C_kg = 1.4" in usual.devices[1].text
    assert usual.devices[0].text == changed.devices[0].text  # the three-brake device has no mass at C


def test_one_value_is_the_same_in_all_worlds_and_no_column_and_people_alone_may_differ(small, tmp_path):
    folder = small.parent
    (folder / "alone.toml").write_text(
        'name = "alone"\nprotocol = "small.toml"\noperators = 1\n'
        '[population]\nvalue = "steady"\nsource = "x"\n'
        '[assumptions.lag_factor]\nvalue = 3.0\nsource = "x"\nlabel = "lag"\n'
        '[operator_factor.skill]\nvalue = 0.5\nsource = "x"\n'
    )
    ranges = load_ranges(folder / "alone.toml")
    assert not ranges.ranges and ranges.drawn(3, 1).shape == (3, 0)
    protocol, people = ranges.study({}, 3)
    assert protocol.assumptions.lag_factor == 3.0 and people.name == "steady"
    usual = load_population("steady").draw(np.random.default_rng(1))
    assert people.draw(np.random.default_rng(1)) == usual._replace(skill=0.5 * usual.skill)
    assert ranges.study({"assumptions.lag_factor": 2.0}, 3)[0].assumptions.lag_factor == 2.0
    summary = run_worlds(WorldsRun(ranges, 2), tmp_path / "out")
    rows = lines(tmp_path / "out")
    assert list(rows[0])[:4] == ["world", "triple", "seed", "path_error_m:three-brake:1"]
    assert rows[0]["seed"] != rows[1]["seed"]
    report = tmp_path / "out" / "report"
    page = (report / "report.md").read_text()
    assert "The same in all: population steady, lag 3.0, skill 0.5." in page and "## What decides each" not in page
    assert summary["measure_first"].startswith("no assumption") and (report / "overview.png").exists()
    assert not (report / "indices.csv").exists()


def test_the_nearest_world_is_left_as_files_that_a_study_runs_to_the_same_trials(small, whole, monkeypatch):
    report, ranges = whole / "report", load_ranges(small)
    nearest = Judgement(table(whole), ranges, ranges.drawn(2, 1)).nearest
    command = next(one for one in (report / "nearest.toml").read_text().splitlines() if "phd study" in one)
    assert command.removeprefix("#   ") in (report / "report.md").read_text()
    monkeypatch.chdir(report)
    assert main(command.split()[2:]) == 0
    is_row_of(lines(whole)[2 * nearest], report / "nearest")
    shutil.rmtree(report / "nearest")


def test_an_interrupted_run_goes_on_to_the_same_table_byte_for_byte_and_runs_only_what_is_missing(
    small, whole, tmp_path, capsys
):
    """What a kill leaves of a sweep, parts and all, is in test_sweep."""
    cut, parts = tmp_path / "cut", (whole / "worlds.csv").read_bytes().splitlines(keepends=True)[1:]
    (cut / "parts").mkdir(parents=True)
    (cut / "worlds.json").write_bytes((whole / "worlds.json").read_bytes())
    for number in (1, 3, 4):
        (cut / "parts" / f"{number:06d}.csv").write_bytes(parts[number - 1])
    assert main(["worlds", str(small), *TWICE, "--out", str(cut), "--resume", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["already_done"] == 3
    assert (cut / "worlds.csv").read_bytes() == (whole / "worlds.csv").read_bytes()
    for name in ("report.md", "overview.png"):
        assert (cut / "report" / name).read_bytes() == (whole / "report" / name).read_bytes()
    with pytest.raises(InputError, match="worlds was begun with another n"):
        run_worlds(WorldsRun(load_ranges(small), 5, triples=2), cut, resume=True)


def test_without_a_cluster_to_run_on_nothing_is_written(small, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "dask.distributed", None)
    assert main(["worlds", str(small), "--n", "2", "--cluster", "tcp://x:1", "--out", str(tmp_path / "out")]) == 2
    assert "--cluster: needs dask.distributed" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_neither_the_number_of_cores_nor_the_order_changes_a_digit(small, whole, monkeypatch):
    monkeypatch.setattr(jobs, "cores", lambda: 1)
    ranges = load_ranges(small)
    backwards = [world.run().rows for world in reversed(worlds_of(ranges, 2, 1, 2))]
    assert (whole / "worlds.csv").read_bytes().split(b"\n", 1)[1] == b"".join(reversed(backwards))
    assert [f"{world.seed}" for world in worlds_of(ranges, 2, 2)] != [line["seed"] for line in lines(whole)][::2]


WRONG = {
    "no range": (RANGES.split("[rules]")[0], "holds no range"),
    "unknown key": (RANGES.replace("settled_by", "settles"), "settles"),
    "no source": (RANGES.replace('source = "Table I"\n', ""), "source"),
    "upside down": (RANGES.replace("low = 5.0", "low = 5000.0"), "low (5000) must be less than high (1000)"),
    "log of zero": (RANGES.replace("low = 5.0", "low = 0.0"), "low must be greater than 0 where log is true"),
    "half a range": (RANGES.replace("high = 1000.0\n", ""), "must hold value, or low and high, or choices"),
    "value and range": (RANGES.replace("high = 1000.0", "high = 9.0\nvalue = 7.0"), "must hold value, or low and"),
    "log of one value": (RANGES.replace("low = 5.0\nhigh = 1000.0", "value = 5.0"), "log is for low and high alone"),
    "same choices": (RANGES.replace('"literal"', '"settled"'), "choices must differ"),
    "value that cannot be": (RANGES.replace("low = 1.0\nhigh = 1.5", "value = -1.0"), "movement_s: -1.0 cannot"),
    "rules by numbers": (RANGES.replace('choices = ["settled", "literal"]', "low = 0\nhigh = 1"), "must hold choices"),
    "population by numbers": (RANGES + '[population]\nlow = 0\nhigh = 1\nsource = "x"', "unknown population"),
    "one choice": (RANGES.replace(', "literal"]', "]"), "rules.choices"),
    "unknown rules": (RANGES.replace('"literal"', '"magic"'), "rules: 'magic' cannot be"),
    "unknown assumption": (RANGES.replace("assumptions.low_gain", "assumptions.speed"), "speed: there is no such"),
    "assumption out of bounds": (RANGES.replace("low = 5.0", "low = -5.0").replace("log = true", ""), "low_gain"),
    "unknown number of operators": (RANGES.replace("operator.movement_s", "operator.joy"), "joy: there is no such"),
    "operator out of bounds": (RANGES.replace("high = 1.5", "high = 1500.0"), "operator.movement_s: 1500.0 cannot be"),
    "factor out of bounds": (RANGES.replace("high = 2.0", "high = 2e4"), "stiffness: 20000.0 cannot be"),
    "unknown number of devices": (RANGES.replace("joint_C_kg", "joint_D_kg"), "mass.joint_D_kg: there is no"),
    "unknown protocol": (RANGES.replace('"small.toml"', '"large"'), "unknown protocol 'large'"),
    "unknown population": (RANGES + '[population]\nchoices = ["average", "kings"]\nsource = "x"', "kings"),
}  # fmt: skip


@pytest.mark.parametrize("text, says", WRONG.values(), ids=WRONG)
def test_a_wrong_ranges_file_is_one_sentence_and_nothing_is_written(small, tmp_path, capsys, text, says):
    (tmp_path / "small.toml").write_bytes((small.parent / "small.toml").read_bytes())
    (tmp_path / "ranges.toml").write_text(text)
    assert says in refusal(capsys, "worlds", tmp_path / "ranges.toml", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_other_controllers_than_the_papers_have_no_statements_to_judge(small, tmp_path, capsys):
    text = (small.parent / "small.toml").read_text().replace("gap_m = 0.005", "gap_m = 0.0")
    (tmp_path / "small.toml").write_text(text)
    (tmp_path / "ranges.toml").write_text(RANGES)
    assert main(["worlds", str(tmp_path / "ranges.toml"), "--out", str(tmp_path / "out")]) == 2
    assert "not those of the paper's Table I" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_the_shipped_ranges_can_be_run_and_say_what_they_rest_on():
    ranges = load_ranges("paper")
    assert ranges.operators == 3 and len(ranges.ranges) >= 15
    assert all(one.source and one.settled_by and one.label for one in ranges.ranges.values())


def test_values_spread_over_a_range_evenly_and_over_its_logarithm_where_asked(small):
    ranges = load_ranges(small)
    drawn = [ranges.values(shares) for shares in ranges.drawn(200, 1)]
    gains = np.array([one["assumptions.low_gain"] for one in drawn])
    assert abs(np.mean(gains < math.sqrt(5.0 * 1000.0)) - 0.5) < 0.01
    times = np.array([one["operator.movement_s"] for one in drawn])
    assert 1.0 <= times.min() and times.max() <= 1.5 and abs(np.mean(times < 1.25) - 0.5) < 0.01
    assert sum(one["rules"] == "literal" for one in drawn) == 100


def made_worlds(n: int = 1000, triples: int = 1) -> tuple[dict[str, AssumptionRange], np.ndarray, np.ndarray]:
    """Statement 1 is decided by the second assumption, 2 by the first and third together, 3 by the people, 4 by both of
    the first two (which alone say nothing), the others always hold.
    """
    ranges = {name: AssumptionRange(source="made", low=0.0, high=1.0) for name in "abcd"}
    generator = np.random.default_rng(1)
    shares = generator.random((n, 4))
    holds = np.ones((n, triples, len(STATEMENTS)), dtype=bool)
    holds[..., 0] = shares[:, 1:2] > 0.7
    holds[..., 1] = ((shares[:, 0] > 0.5) & (shares[:, 2] > 0.5))[:, np.newaxis]
    holds[..., 2] = generator.random((n, triples)) > 0.4
    holds[..., 3] = ((shares[:, 0] > 0.5) ^ (shares[:, 1] > 0.5))[:, np.newaxis]
    return ranges, shares, holds


def test_indices_find_what_decides_and_what_would_settle_most():
    ranges, shares, holds = made_worlds()
    found = find_indices(ranges, shares, holds)
    first, half = found.split.first, found.half_width.first
    within = 1.0 - 0.125 * 0.6 * 0.4 / 0.21  # 0.7 lies inside a part, whose variance the means do not see
    assert abs(first[0, 1] - within) < 1.5 * half[0, 1] < 0.1 and np.abs(first[0, [0, 2, 3]]).max() < 0.03
    for j in (0, 2):  # Var(E[y | a]) / Var(y) = (1/4)^2 / (1/4 * 3/4)
        assert abs(first[1, j] - 1.0 / 3.0) < 1.5 * half[1, j] < 0.15
    assert np.isnan(first[4:]).all()  # all worlds agree
    assert found.clear[0].tolist() == [False, True, False, False]
    assert found.clear[1].tolist() == [True, False, True, False] and not found.clear[2:].any()
    settled = found.settled(holds)
    assert np.argmax(settled) == 1 and settled.sum() <= 1.0 and settled[3] == 0.0
    rare = np.arange(1000) < 9
    verdicts = np.column_stack([rare, ~rare])[:, np.newaxis]
    assert (
        not find_indices(ranges, shares, verdicts).any
        and not find_indices(ranges, shares, verdicts).settled(verdicts).any()
    )
    assert not find_indices({}, np.empty((1000, 0)), holds).any


def test_several_triples_a_world_split_interplay_from_people():
    ranges, shares, holds = made_worlds(400, 5)
    of = find_indices(ranges, shares, holds).split
    assert of.people[[0, 1, 3]] == pytest.approx([0.0, 0.0, 0.0]) and of.people[2] == pytest.approx(1.0, abs=0.03)
    assert of.interplay[1] == pytest.approx(1.0 / 3.0, abs=0.08) and of.interplay[3] == pytest.approx(1.0, abs=0.05)
    assert np.nan_to_num(of.alone + of.interplay + of.people - 1.0) == pytest.approx(0.0)
    one = find_indices(ranges, shares, holds[:, :1]).split
    assert np.isnan(one.people).all() and np.isnan(one.interplay).all() and one.rest[1] == pytest.approx(0.33, abs=0.08)


def test_the_report_says_with_which_choice_and_in_which_half_of_a_range_a_statement_holds():
    shares = np.linspace(0.0, 0.999, 1000)
    gain = AssumptionRange(source="made", low=1.0, high=100.0, log=True)
    assert where_it_holds(gain, shares, shares > 0.75) == "up to 10 0.0 %, above 50 %"
    rules = AssumptionRange(source="made", choices=("settled", "literal", "both"))
    assert where_it_holds(rules, shares, shares < 1.1 / 3.0) == "settled 100 %, literal 10 %, both 0.0 %"


def test_a_study_lacks_the_sum_of_its_negative_margins_and_one_for_what_cannot_be_told():
    margins = np.array([[0.5, -0.25, -0.5], [math.nan, 2.0, 0.0]])
    assert Verdicts(np.empty((2, 3)), margins).short.tolist() == [0.75, 1.0]


def made_table(people: int, n: int = 200) -> Worlds:
    """Studies whose five controllers do nothing: people and trials differ, by a fifth and a quarter."""
    cells = [(m.name, d, k) for m in JUDGED for d in ("three-brake", "four-brake") for k in range(1, 6)]
    generator = np.random.default_rng(1)
    of_people = generator.normal(0.0, 0.2, (n, 1, people, 1, 1))
    values = np.exp(of_people + generator.normal(0.0, 0.25, (n, len(cells), people, 2, 3)))
    return Worlds(1, np.arange(n), cells, values.reshape(n, len(cells), -1))


def test_trials_drawn_anew_without_control_differ_as_those_of_controllers_that_do_nothing():
    worlds, devices = made_table(3), ("three-brake", "four-brake")
    made, drawn = judge(worlds, devices), judge(worlds.without_controllers(3 * 2, 1), devices)
    assert 0.05 < made.holds[:, 9].mean() < 0.5 < made.holds[:, 5].mean() < 0.98  # worth comparing
    for statement in range(11):
        p, q = made.holds[:, statement].mean(), drawn.holds[:, statement].mean()
        assert abs(p - q) < 3.0 * math.sqrt((p * (1.0 - p) + q * (1.0 - q)) / 200.0) + 0.02


def test_a_worlds_triples_in_the_same_boxes_are_a_study_of_all_their_people(small, whole):
    worlds = read_worlds(table(whole))
    assert worlds.triples == 2 and worlds.values.shape == (4, 40, 1)
    pooled = worlds.pooled()
    assert np.array_equal(pooled.values[1], np.hstack([worlds.values[2], worlds.values[3]]))
    assert np.array_equal(worlds.pooled(slice(1, None)).values, worlds.values[1::2])
    assert pooled.seeds.tolist() == worlds.seeds[::2].tolist()


def test_boxes_are_those_of_the_study_and_there_is_none_where_too_few_reached_the_end(whole, tmp_path):
    worlds = read_worlds(table(whole))
    assert set(worlds.boxes()[0]) == set(worlds.cells)
    values = np.arange(40.0).reshape(1, 2, 20)
    values[0, 0, :2] = values[0, 1, :3] = math.nan
    assert LEAST_FINISHED == 0.9
    (boxes,) = worlds._replace(cells=worlds.cells[:2], values=values).boxes()
    assert list(boxes) == worlds.cells[:1] and boxes[worlds.cells[0]].median == np.median(values[0, 0, 2:])
    nothing = read_worlds(
        [*table(whole)[:3], ",".join(["9", "1", "7"] + [""] * 45), ",".join(["9", "2", "7"] + [""] * 45)]
    )
    assert np.isnan(nothing.values[2:]).all() and not nothing.boxes()[2]
    assert (judge(nothing, ("three-brake", "four-brake")).words[2:] == CANNOT_TELL).all()


def test_the_table_is_enough_to_judge_and_to_write_the_report(small, whole):
    ranges = load_ranges(small)
    shares = ranges.drawn(2, 1)
    files, summary = report_files(table(whole), ranges, shares, 1)
    assert {path.name: path.read_bytes() for path in (whole / "report").iterdir()} == files
    page = files["report.md"].decode()
    assert page.startswith("# Worlds: small\n\n2 worlds of the ranges 'small', seed 1") and "$" not in page
    words = judge(read_worlds(table(whole)), ("three-brake", "four-brake")).words
    for statement in STATEMENTS:
        share = np.mean(words[:, statement.number - 1] == HOLDS)
        assert f"| {statement.number} | {statement.text} | **{100.0 * share:.1f} %** (" in page
    assert "all people of a world, all worlds" in page and "## What decides each" not in page
    nearest = Judgement(table(whole), ranges, shares).nearest
    assert f"World {nearest + 1}, seed {lines(whole)[2 * nearest]['seed']}." in page
    assert f"low gain (N s/m) | {float(lines(whole)[2 * nearest]['assumptions.low_gain'])}" in page
    assert tuple(lines(whole)[0]) == columns(ranges)
    assert files["overview.png"].startswith(b"\x89PNG") and "all_hold" in summary


def test_a_report_with_enough_worlds_says_what_decides_and_what_to_measure_first(small, monkeypatch):
    for name in ("DEALS", "DRAWS"):
        monkeypatch.setattr(f"experiments.worlds.indices.{name}", 50)
    ranges, made = load_ranges(small), made_table(1, 150)
    shares = ranges.drawn(150, 1)
    error = [place for place, cell in enumerate(made.cells) if cell[0] == "path_error_m" and cell[2] == 3]
    made.values[:, error] *= np.where(shares[:, 0] < 0.5, 0.5, 2.0)[:, np.newaxis, np.newaxis]  # by the rules
    body = [
        ",".join(["1", "1", "7", *["x"] * 5, *(" ".join(f"{x:.6g}" for x in cell) for cell in row)])
        for row in made.values
    ]
    files, summary = report_files([",".join(columns(ranges)), *body], ranges, shares, 1)
    page = files["report.md"].decode()
    assert (
        "| **rules " in page
        and not [line for line in page.splitlines() if "$" in line]
        and summary["measure_first"] == "rules"
    )
    assert "settled" in page.split("## What decides each")[1] and {"decided-by.png", "indices.csv"} <= files.keys()
    assert "| interplay and people |" in page and "whoever takes part" not in page


def test_studies_of_one_world_that_agree_count_once_and_those_that_do_not_one_by_one():
    generator = np.random.default_rng(1)
    agree = np.repeat(generator.random((500, 1, 1)) < 0.3, 10, axis=1)
    assert effective_counts(agree)[1] == pytest.approx(500, rel=0.01)
    assert effective_counts(generator.random((500, 10, 1)) < 0.3)[1] == pytest.approx(5000, rel=0.15)
    assert effective_counts(np.zeros((50, 10, 1)))[1] == 50


def test_the_interval_of_a_share_is_wilsons():
    low, high = wilson(5, 20)
    assert (float(low), float(high)) == pytest.approx((0.1119, 0.4687), abs=1e-3)
    assert tuple(map(float, wilson(0, 10))) == pytest.approx((0.0, 0.2775), abs=1e-3)


def test_a_share_lies_in_its_own_interval_also_where_none_or_all_hold():
    for n in range(1, 200):
        holding = np.arange(n + 1)
        low, high = wilson(holding, n)
        assert np.all(low <= holding / n) and np.all(holding / n <= high)
