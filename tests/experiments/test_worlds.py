"""Worlds: each is the study that `phd study` runs; one table whatever ran where; the report names what decides."""

import math
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import joblib
import killed_work
import numpy as np
import pytest
from exports import rows
from refusals import refusal

from app.cli import main
from core.files import InputError
from experiments.analysis.findings import HOLDS, IN_BOXES, STATEMENTS, box_findings_of, pooled_boxes
from experiments.protocol import load_protocol
from experiments.session.files import write_pooled_table
from experiments.study.study import run_study
from experiments.trial.population import load_population
from experiments.worlds.ranges import Range, load_ranges
from experiments.worlds.report import (
    Indices,
    Worlds,
    indices,
    judged_again,
    nearest_world,
    read_worlds,
    report_files,
    settled,
    where_it_holds,
    wilson,
)
from experiments.worlds.worlds import columns, run_worlds, worlds_of

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
    """Four worlds, run in one go."""
    out = tmp_path_factory.mktemp("worlds") / "out"
    run_worlds(load_ranges(small), out, 4)
    return out


def lines(out: Path) -> list[dict[str, str]]:
    return rows(out / "worlds.csv")


def is_judged_as(line: dict[str, str], study: Path) -> None:
    """A study has the boxes, verdicts and margins of a world's row, digit by digit."""
    rows = write_pooled_table(study)
    boxes = pooled_boxes(rows)
    assert len(boxes) == 2 * 5 * len(IN_BOXES)
    for (measure, device, controller), box in boxes.items():
        for name, value in box._asdict().items():
            assert line[f"{measure}:{device}:{controller}:{name}"] == repr(value)
    for found in box_findings_of(rows):
        number = found.statement.number
        assert line[f"statement_{number}"] == found.verdict
        assert line[f"margin_{number}"] == ("" if math.isnan(found.margin) else repr(found.margin))


def test_a_world_is_the_study_of_the_same_assumptions_and_seed(small, whole, tmp_path):
    ranges = load_ranges(small)
    for world, line in list(zip(worlds_of(ranges, 4, 1), lines(whole), strict=True))[:2]:
        protocol, population = ranges.study(world.values, world.seed)
        assert protocol.low_gain == world.values["assumptions.low_gain"] and protocol.seed == int(line["seed"])
        assert protocol.rules == line["rules"]
        run_study(tmp_path / f"{world.number}", 1, protocol, population)
        is_judged_as(line, tmp_path / f"{world.number}")


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
    summary = run_worlds(ranges, tmp_path / "out", 2)
    rows = lines(tmp_path / "out")
    assert list(rows[0])[:3] == ["world", "seed", "share_done"] and rows[0]["seed"] != rows[1]["seed"]
    report = tmp_path / "out" / "report"
    page = (report / "report.md").read_text()
    assert "The same in all: population steady, lag 3.0, skill 0.5." in page and "## What decides each" not in page
    assert summary["measure_first"].startswith("no assumption") and (report / "overview.png").exists()
    assert not (report / "indices.csv").exists()


def test_the_nearest_world_is_left_as_files_that_a_study_runs_to_the_same_verdicts(small, whole, monkeypatch):
    report, nearest = whole / "report", nearest_world(read_worlds(whole / "worlds.csv"))
    line = lines(whole)[nearest]
    command = next(one for one in (report / "nearest.toml").read_text().splitlines() if "phd study" in one)
    assert command.removeprefix("#   ") in (report / "report.md").read_text()
    monkeypatch.chdir(report)
    assert main(command.split()[2:]) == 0
    is_judged_as(line, report / "nearest")
    shutil.rmtree(report / "nearest")


@pytest.mark.skipif(sys.platform == "win32", reason="a process group is killed")
def test_a_killed_run_goes_on_from_the_command_line_to_the_same_table(small, whole, tmp_path):
    cut = tmp_path / "cut"
    arguments = ["worlds", str(small), "--n", "4", "--out", str(cut)]
    command = [sys.executable, killed_work.__file__, str(int(signal.SIGKILL)), "group", *arguments]
    assert subprocess.run(command, stdout=subprocess.DEVNULL, start_new_session=True).returncode == -signal.SIGKILL
    assert len(list(cut.glob("parts/0*.csv"))) == killed_work.DONE and not (cut / "worlds.csv").exists()
    assert main([*arguments, "--resume"]) == 0
    assert (cut / "worlds.csv").read_bytes() == (whole / "worlds.csv").read_bytes()
    assert (cut / "report" / "report.md").read_bytes() == (whole / "report" / "report.md").read_bytes()


def test_without_a_cluster_to_run_on_nothing_is_written(small, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "dask.distributed", None)
    assert main(["worlds", str(small), "--n", "2", "--cluster", "tcp://x:1", "--out", str(tmp_path / "out")]) == 2
    assert "--cluster: needs dask.distributed" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_a_resumed_run_gives_the_same_table_byte_for_byte_and_runs_only_what_is_missing(small, whole, tmp_path):
    ranges = load_ranges(small)
    cut = tmp_path / "cut"
    (cut / "parts").mkdir(parents=True)
    (cut / "worlds.json").write_bytes((whole / "worlds.json").read_bytes())
    for world in worlds_of(ranges, 4, 1)[1:3]:
        (cut / "parts" / f"{world.number:06d}.csv").write_bytes(world.run().rows)
    assert run_worlds(ranges, cut, 4, resume=True)["already_done"] == 2
    assert (cut / "worlds.csv").read_bytes() == (whole / "worlds.csv").read_bytes()
    for name in ("report.md", "indices.csv", "overview.png"):
        assert (cut / "report" / name).read_bytes() == (whole / "report" / name).read_bytes()
    with pytest.raises(InputError, match="worlds was begun with another n"):
        run_worlds(ranges, cut, 5, resume=True)


def test_neither_the_number_of_cores_nor_the_order_changes_a_digit(small, whole, tmp_path, monkeypatch):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 1)
    ranges = load_ranges(small)
    backwards = [world.run().rows for world in reversed(worlds_of(ranges, 4, 1))]
    assert (whole / "worlds.csv").read_bytes().split(b"\n", 1)[1] == b"".join(reversed(backwards))
    run_worlds(ranges, tmp_path / "other", 2, seed=2)
    assert [line["seed"] for line in lines(tmp_path / "other")] != [line["seed"] for line in lines(whole)][:2]


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


def made_worlds(n: int = 1000) -> tuple[dict[str, Range], np.ndarray, np.ndarray]:
    """Statement 1 is decided by the second assumption, 2 by the first and third together, the others always hold."""
    ranges = {name: Range(source="made", low=0.0, high=1.0) for name in "abcd"}
    shares = np.random.default_rng(1).random((n, 4))
    holds = np.ones((n, len(STATEMENTS)), dtype=bool)
    holds[:, 0] = shares[:, 1] > 0.7
    holds[:, 1] = (shares[:, 0] > 0.5) & (shares[:, 2] > 0.5)
    return ranges, shares, holds


def test_indices_find_what_decides_and_what_would_settle_most():
    ranges, shares, holds = made_worlds()
    found = indices(ranges, shares, holds)
    assert found.first[0, 1] == pytest.approx(1.0, abs=0.1) and found.first[0, [0, 2, 3]].max() < 0.05
    for j in (0, 2):  # Var(E[y | a]) / Var(y) = (1/4)^2 / (1/4 * 3/4)
        assert abs(found.first[1, j] - 1.0 / 3.0) < 1.5 * found.half_width[1, j] < 0.2
    assert np.isnan(found.first[2:]).all()  # all worlds agree
    doubt = settled(found, holds)
    assert np.argmax(doubt) == 1 and doubt.sum() <= 1.1 and doubt[3] < 0.05
    rare = np.arange(1000) < 29
    assert np.isnan(indices(ranges, shares, np.column_stack([rare, ~rare])).first).all()
    assert found.clear[0].tolist() == [False, True, False, False] and found.clear[1, [0, 2]].all()
    assert not settled(Indices(found.first * np.nan, found.half_width), np.ones_like(holds)).any()


def test_the_report_says_with_which_choice_and_in_which_half_of_a_range_a_statement_holds():
    shares = np.linspace(0.0, 0.999, 1000)
    gain = Range(source="made", low=1.0, high=100.0, log=True)
    assert where_it_holds(gain, shares, shares > 0.75) == "up to 10 0.0 %, above 50 %"
    rules = Range(source="made", choices=("settled", "literal", "both"))
    assert where_it_holds(rules, shares, shares < 1.1 / 3.0) == "settled 100 %, literal 10 %, both 0.0 %"


def test_the_nearest_world_holds_most_statements_and_misses_the_others_by_least():
    margins = np.full((4, len(STATEMENTS)), 0.1)
    margins[0, :2] = -0.1
    margins[1, 0] = -0.5
    margins[2, 5] = -0.2
    margins[3, 3] = math.nan  # one cannot tell
    worlds = Worlds(np.arange(4), np.ones(4), margins, [], np.empty((4, 0, 3)))
    assert nearest_world(worlds) == 2
    assert worlds.holds.sum(axis=1).tolist() == [9, 10, 10, 10]


def test_the_table_is_enough_to_judge_again_and_to_write_the_report(small, whole):
    ranges, worlds = load_ranges(small), read_worlds(whole / "worlds.csv")
    assert np.array_equal(judged_again(worlds, ranges, 1.0), worlds.holds)
    verdicts = [[line[f"statement_{k}"] == HOLDS for k in range(1, 12)] for line in lines(whole)]
    assert np.array_equal(worlds.holds, verdicts)
    files, summary = report_files(whole / "worlds.csv", ranges, 1)
    assert {path.name: path.read_bytes() for path in (whole / "report").iterdir()} == files
    page = files["report.md"].decode()
    assert page.startswith("# Worlds: small\n\n4 worlds of the ranges 'small', seed 1")
    often = [str(k) for k in range(1, 12) if worlds.holds[:, k - 1].mean() > 0.5]
    assert f"**In short.** Statements that hold in more than half of the worlds: {', '.join(often) or 'none'};" in page
    assert f"at most {worlds.holds.sum(axis=1).max()} do, in world {nearest_world(worlds) + 1}." in page
    assert "No assumption alone stands out from chance" in page and "| SDOF with gap |" in page
    nearest = nearest_world(worlds)
    assert f"World {nearest + 1}, seed {lines(whole)[nearest]['seed']}:" in page
    assert f"low gain (N s/m) | {float(lines(whole)[nearest]['assumptions.low_gain'])}" in page
    for statement in STATEMENTS:
        share = np.mean([of_world[statement.number - 1] for of_world in verdicts])
        assert f"| {statement.number} | {statement.text} | **{share:.1%}** (" in page
    assert tuple(lines(whole)[0]) == columns(ranges)
    assert files["overview.png"].startswith(b"\x89PNG") and "all_hold" in summary


def test_the_interval_of_a_share_is_wilsons():
    low, high = wilson(5, 20)
    assert (float(low), float(high)) == pytest.approx((0.1119, 0.4687), abs=1e-3)
    assert tuple(map(float, wilson(0, 10))) == pytest.approx((0.0, 0.2775), abs=1e-3)


def test_a_share_lies_in_its_own_interval_also_where_none_or_all_hold():
    for n in range(1, 200):
        holding = np.arange(n + 1)
        low, high = wilson(holding, n)
        assert np.all(low <= holding / n) and np.all(holding / n <= high)
