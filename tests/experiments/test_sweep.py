"""Sweeps: one table, resumed after a kill, refused in one sentence; no worker outlives one."""

import itertools
import json
import multiprocessing
import signal
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from exports import rows as csv_rows
from msgspec import structs
from processes import children, gone
from refusals import refusal
from scipy.stats import rankdata
from waiting import wait_until

from app.cli import main
from core.simulator.simulated_device import SimulatedDevice
from experiments.analysis.metrics import BY_NAME
from experiments.assumptions import SENSINGS
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.study.sweep import load_sweep, run_sweep
from experiments.study.sweep_results import ranks, read_sweep
from experiments.study.unrecorded import person_of, run_measured, trial_of

SMALL = """
name = "small"
operators = 2
repetitions = 1
devices = ["three-brake"]
[[controller]]
kind = "none"
[[controller]]
kind = "sdof"
gap_m = [0.0, 0.005]
[[controller]]
kind = "proportional"
gain_N_s_m = [400.0]
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "sweep.toml"
    path.write_text(SMALL)
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> tuple[dict, Path]:
    """A whole sweep's summary and folder."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "sweep.toml").write_text(SMALL)
    return run_sweep(load_sweep(folder / "sweep.toml"), folder / "out"), folder / "out"


def test_every_cell_stands_in_the_table_once_and_no_brake_added_energy(whole):
    summary, out = whole
    rows = csv_rows(out / "sweep.csv")
    assert summary["trials"] == len(rows) == 4 * 2 * 2  # controllers, people, paths
    assert tuple(rows[0]) == load_sweep(out.parent / "sweep.toml").columns
    cells = [(r["kind"], r["gap_m"], r["gain_N_s_m"], r["participant"], r["path"]) for r in rows]
    assert len(set(cells)) == len(cells)
    assert {(r["kind"], float(r["gap_m"]), float(r["gain_N_s_m"])) for r in rows} == {
        ("none", 0.0, 0.0), ("sdof", 0.0, 0.0), ("sdof", 0.005, 0.0), ("proportional", 0.0, 400.0)
    }  # fmt: skip
    assert all(float(r["energy_added_max_J"]) == 0.0 and abs(float(r["energy_residual_J"])) < 1e-6 for r in rows)
    left = {path.name for path in out.iterdir()}
    assert left - {".lock"} == {"sweep.csv", "sweep.json", "figures"}  # Windows removes the lock's file with the lock


def test_a_resumed_sweep_gives_the_same_table_byte_for_byte_and_runs_only_what_is_missing(file, whole, tmp_path):
    sweep, out, cut = load_sweep(file), whole[1], tmp_path / "cut"
    (cut / "parts").mkdir(parents=True)
    (cut / "sweep.json").write_bytes((out / "sweep.json").read_bytes())
    for job in sweep.jobs[2:5]:
        (cut / "parts" / f"{job.number:06d}.csv").write_bytes(job.run().rows)
    summary = run_sweep(sweep, cut, resume=True)
    assert summary["already_done"] == 3
    assert (cut / "sweep.csv").read_bytes() == (out / "sweep.csv").read_bytes()
    assert run_sweep(sweep, cut, resume=True)["already_done"] == len(sweep.jobs)


def test_a_sweep_draws_each_key_against_each_measure_and_names_the_one_that_moves_it_most(whole):
    summary, out = whole
    assert (out / "figures/effects.png").read_bytes().startswith(b"\x89PNG")
    lines = csv_rows(out / "figures/effects.csv")
    assert {(line["key"], line["value"]) for line in lines} == {
        ("kind", "none"), ("kind", "sdof"), ("kind", "proportional"), ("gap_m of sdof", "0.0"),
        ("gap_m of sdof", "0.005"),
    }  # fmt: skip
    frame = pd.read_csv(out / "sweep.csv").query("status == 'done'")
    for line in lines:
        one = BY_NAME[line["measure"]]
        key, _, kind = line["key"].partition(" of ")
        here = frame[(frame["kind"] == (kind or line["value"])) & (frame[key].astype(str) == line["value"])]
        each = one.scale * here.groupby("participant")[one.name].mean()
        assert float(line["mean"]) == pytest.approx(each.mean())
        first = next(other for other in lines if (other["key"], other["measure"]) == (line["key"], line["measure"]))
        assert float(line["difference"]) == pytest.approx(float(line["mean"]) - float(first["mean"]))
    assert summary["moves_most"][0].startswith("path error: kind, from ")


def test_the_same_person_meets_every_controller_with_the_same_noise(file):
    """Without control nothing but the device acts: another rule set must not change a single digit."""
    jobs = [job for job in load_sweep(file).jobs if job.preset.name == "none"]
    one = jobs[0].run().rows
    literal = structs.replace(jobs[0].protocol, rules="literal")
    other = replace(jobs[0], protocol=literal).run().rows
    assert other.replace(b"literal", b"settled") == one
    assert jobs[1].run().rows != one


def test_the_first_trial_begins_where_the_last_path_ends_as_after_a_trial(file):
    """From where the handle comes to the start matters: from the middle of the path itself hardly anybody strays."""
    job = load_sweep(file).jobs[0]
    (measured, _) = job.run().rows.splitlines()
    person, planned = person_of(job.population, 1, job.operator), PlannedTrial(1, 1, "three-brake", 1, 1, 1)

    def error(*tip):
        device = SimulatedDevice(job.protocol.assumptions.applied_to(job.device), tip)
        trial = trial_of(job.protocol, person, job.operator, planned, device, job.preset)
        return str(run_measured(trial, "01")[0].value("path_error_m"))

    at_the_end, in_the_middle = (error(*tip).encode() for tip in ((0.08, 0.42), (0.0, 0.40)))
    assert at_the_end in measured.split(b",") and in_the_middle not in measured.split(b",")


WRONG = {
    "the same seed twice": ("seed = [1, 1]\n" + SMALL, "seed: the same value is given twice"),
    "gap without control": (SMALL.replace('kind = "none"', 'kind = "none"\ngap_m = [0.1]'), "gap_m is not for 'none'"),
    "gain missing": (SMALL.replace("gain_N_s_m = [400.0]", ""), "gain_N_s_m is required"),
    "twice the same": (SMALL.replace("[0.0, 0.005]", "[0.005, 0.005]"), "same controller is given twice"),
    "more combinations than fit": (
        SMALL.replace("[0.0, 0.005]", str([0.001 + 1e-6 * n for n in range(1001)])).replace(
            'kind = "sdof"', 'kind = "proportional"\ngain_N_s_m = ' + str([1.0 + n for n in range(1001)])
        ),
        "more than the 1000000 combinations",
    ),
}


@pytest.mark.parametrize("text, says", WRONG.values(), ids=WRONG)
def test_a_wrong_sweep_file_is_one_sentence_and_nothing_written(file, tmp_path, capsys, text, says):
    file.write_text(text)
    assert says in refusal(capsys, "study", "--sweep", file, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def swept(arguments: list[str], said: Path) -> None:
    """`phd ARGUMENTS` in a process of its own, which is to be killed; what it says goes into a file."""
    with said.open("w") as sys.stderr:
        sys.exit(main(arguments))


def test_a_killed_sweep_leaves_no_worker_and_keeps_what_was_done(file, tmp_path):
    file.write_text(SMALL.replace("operators = 2", "operators = 400"))
    out, said = tmp_path / "out", tmp_path / "said"
    arguments = ["study", "--sweep", str(file), "--out", str(out)]
    context = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")
    process = context.Process(target=swept, args=(arguments, said))
    process.start()
    wait_until(lambda: len(list(out.glob("parts/0*.csv"))) >= 3)
    workers = children(process.pid)
    process.terminate()
    process.join()
    assert abs(process.exitcode) == signal.SIGTERM and workers  # Windows has no sign before it
    wait_until(lambda: all(map(gone, workers)))
    lines = said.read_text().replace("\r", "\n").splitlines()
    assert f"phd: {out}: interrupted; continue with the same command and --resume" in lines
    assert not [line for line in lines if "arning" in line or "Traceback" in line]
    assert not (out / "sweep.csv").exists() and json.loads((out / "sweep.json").read_text())["name"] == "small"
    first = load_sweep(file).jobs[0]
    assert (out / "parts" / f"{first.number:06d}.csv").read_bytes() == first.run().rows


def test_a_sweep_without_controllers_takes_those_of_its_protocol_under_each_seed():
    arena = load_sweep("arena")
    names = {preset.name for preset in load_protocol("arena").controllers.values()}
    assert {job.controller_name for job in arena.jobs} == names
    assert {(job.protocol.seed, job.population.name, job.protocol.assumptions.sensing) for job in arena.jobs} == set(
        itertools.product((1, 2, 3), ("average", "tremulous"), SENSINGS)
    )
    assert len(arena.jobs) == len(names) * 4 * 12 * 3 * 2  # displays, people, seeds, sensings
    assert arena.columns[arena.columns.index("rules") + 1 :][:2] == ("seed", "sensing")


def test_the_medians_of_a_sweep_stand_by_device_path_and_controller(whole):
    rows, found = csv_rows(whole[1] / "sweep.csv"), csv_rows(whole[1] / "figures/medians.csv")
    place = ("configuration", "path", "controller_name")
    done = [row for row in rows if row["status"] == "done"]
    assert sum(int(line["trials"]) for line in found) == len(done)
    for line in found:
        errors = [float(row["path_error_m"]) for row in done if all(row[key] == line[key] for key in place)]
        assert float(line["path_error_m"]) == pytest.approx(np.median(errors)) and int(line["trials"]) == len(errors)


def test_controllers_rank_by_the_median_of_people_and_half_of_the_people_rank_them_between_the_ends(whole):
    out = whole[1]
    rows = csv_rows(out / "sweep.csv")
    lines = [line for line in csv_rows(out / "figures/ranks.csv") if line["where"] == "all"]
    names = list(dict.fromkeys(row["controller_name"] for row in rows))
    assert {line["measure"] for line in lines} >= {"path_error_m", "steerable_share"}
    for measure in dict.fromkeys(line["measure"] for line in lines):
        here = {line["controller"]: line for line in lines if line["measure"] == measure}
        cells = {(name, person): [float(row[measure]) for row in rows
                                  if (row["controller_name"], row["participant"]) == (name, person) and row[measure]]
                 for name in here for person in ("01", "02")}  # fmt: skip
        scores = np.array([[np.mean(cells[name, person]) for name in here] for person in ("01", "02")])
        scores *= BY_NAME[measure].scale
        sign = -1.0 if BY_NAME[measure].better == "higher" else 1.0
        assert [float(line["value"]) for line in here.values()] == pytest.approx(np.median(scores, axis=0))
        assert [float(line["rank"]) for line in here.values()] == list(rankdata(sign * np.median(scores, axis=0)))
        of_each = [rankdata(sign * person) for person in scores]
        ends = (np.quantile(of_each, 0.25, axis=0, method="lower"), np.quantile(of_each, 0.75, axis=0, method="higher"))
        for end, wanted in zip(("rank_low", "rank_high"), ends, strict=True):
            assert [float(line[end]) for line in here.values()] == pytest.approx(wanted)
    assert {line["controller"] for line in lines} == set(names)
    assert whole[0]["ranks"][0].startswith("path error: 1 ")


def test_of_people_of_several_seeds_each_is_one_and_a_controller_that_nobody_finished_with_has_no_rank(whole):
    frame = read_sweep(whole[1] / "sweep.csv", list(BY_NAME))
    frame.loc[frame["controller_name"] == "SDOF", "status"] = "timeout"
    twice = pd.concat([frame.assign(seed="1"), frame.assign(seed="2")], ignore_index=True)
    found = ranks(twice, ("seed",)).query("measure == 'path_error_m'")
    assert set(found["where"]) == {"all"} and set(found["people"]) == {4}
    assert sorted(found["rank"]) == [1.0, 2.0, 3.0] and "SDOF" not in set(found["controller"])
