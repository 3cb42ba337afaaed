"""`import phd`: the numbers of the verbs as pandas frames, in a process that stays the caller's."""

import json
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
import tomllib
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from protocols import short

import phd
from experiments.analysis.statistics import statistics
from experiments.analysis.trials_table import read_table
from experiments.protocol import load_protocol, protocol_to_json
from experiments.simulate.scene import read_scene
from experiments.simulate.simulate import simulate

ROOT = Path(__file__).resolve().parents[2]
LOCKED = ROOT / "experiments/scenes/locked-brake.toml"


def test_a_study_has_the_numbers_of_its_table_and_participants_as_text(whole_study: Path, tmp_path: Path):
    (protocol := tmp_path / "short.toml").write_text(short().text)
    there = phd.load_trials(whole_study)
    assert list(there["participant"].unique()) == ["01"] and there.attrs["units"]["path_error_m"] == "m"
    simulated = phd.run_study(protocol, operators=1, seed=4)
    same = [name for name in there if name != "recording"]
    pd.testing.assert_frame_equal(simulated[same], there[same])
    found = phd.statistics(there)
    assert len(found) == len(statistics(read_table(whole_study / "trials.csv")))
    assert set(found.query("test == 'mean' and first == '1'")["first_name"]) == {"No control"}
    assert set(found.query("test == 'difference' and second == '2'")["second_name"]) == {"SDOF"}
    boxes = phd.boxes(pd.concat([there] * 5, ignore_index=True), "path_error_m")
    first = there[(there.controller == 1) & (there.configuration == "four-brake")]
    assert boxes.loc[(1, "four-brake"), "controller_name"] == first["controller_name"].iloc[0] == "No control"
    assert boxes.loc[(1, "four-brake"), "median"] == pytest.approx(first["path_error_m"].median())
    with pytest.raises(phd.InputError, match="there is no measure 'speed'"):
        phd.boxes(there, "speed")


def test_a_recording_and_its_replay_are_frames(whole_study: Path, tmp_path: Path):
    session = shutil.copytree(whole_study / "sub-01/ses-01", tmp_path / "sub-01/ses-01")
    file = next(session.glob("trials/run-*.parquet"))
    ticks = phd.load_recording(file)
    assert ticks["t_s"].diff()[1:].to_numpy() == pytest.approx(1e-3) and set(ticks["phase"]) >= {"move"}
    assert ticks.attrs["units"]["hand_fx_N"] == "N" and ticks.attrs["outcome"]["status"] == "done"
    again = phd.replay(file)
    assert (again["before"].dropna() == again["after"].dropna()).all() and again.attrs["summary"]["equal"]
    file.write_bytes(file.read_bytes()[:-2000])
    with pytest.raises(phd.InputError, match="changed or cut"):
        phd.load_recording(file)


def test_a_scene_has_the_rows_of_its_file_from_a_path_or_from_text(tmp_path: Path):
    simulate(read_scene(LOCKED), tmp_path / "motion.csv")
    there = pd.read_csv(tmp_path / "motion.csv", keep_default_na=False)
    motion = phd.run_scene(LOCKED)
    pd.testing.assert_frame_equal(motion, there, check_exact=True)
    without = [name for name, unit in motion.attrs["units"].items() if not unit]
    assert without == ["stuck"] and motion.attrs["units"]["kinetic_J"] == "J"
    pd.testing.assert_frame_equal(phd.run_scene(LOCKED.read_text(), LOCKED.parent), there)
    with pytest.raises(phd.InputError, match="device"):
        phd.run_scene(LOCKED.read_text().replace("three-brake", "no-such"))


def test_importing_changes_nothing_in_the_callers_process_and_a_bar_shows_what_is_compiled_later():
    code = """
import os, signal, sys, warnings
import numpy, pandas, pyarrow, scipy
state = lambda: (dict(os.environ), sys.path[:], numpy.geterr(), [signal.getsignal(n) for n in signal.valid_signals()],
                 [one for one in warnings.filters if not one[2].__module__.startswith("core")], sys.excepthook)
before = state()
import phd
assert state() == before, "something changed"
assert not {"matplotlib", "PySide6"} & set(sys.modules), "slow to import"
from core.kernels.cache import watchers
assert [type(one).__name__ for one in watchers] == ["CompileProgress"]
"""
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_the_snippets_of_the_pages_and_the_notebook_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """With one operator in place of six, and a session of few trials."""
    texts = "".join((ROOT / name).read_text("utf-8") for name in ("README.md", "docs/python.md"))
    snippets = re.findall(r"```python\n(.*?)```", texts, re.DOTALL)
    declared = texts.partition("<!-- python -->")[2]
    snippets += ["import phd\n" + textwrap.dedent(code) for code in re.findall(r"(?:^    .*\n)+", declared, re.M)]
    assert len(snippets) == 3 and all(len(snippet.splitlines()) <= 16 for snippet in snippets)
    (tmp_path / "short.toml").write_text(short(paths=1).text)
    notebook = json.loads((ROOT / "docs/from-python.ipynb").read_text())
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] for cell in notebook["cells"] if cell["cell_type"] == "code"), "it is shown executed"
    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    for code in (*snippets, "\n".join(cells)):
        exec(code.replace("operators=6", "operators=1").replace('Session("paper"', 'Session("short.toml"'), {})


@settings(max_examples=8)
@given(
    links=st.tuples(*[st.floats(0.2, 0.4)] * 4),
    apart=st.floats(0.0, 0.1),
    braked=st.sets(st.sampled_from("AEBC"), min_size=1),
    tip_kg=st.floats(0.1, 2.0),
)
def test_a_device_from_values_is_the_one_of_its_toml(links, apart, braked, tip_kg):
    content = tomllib.loads((ROOT / "core/brake_files/mrb-2107-3.toml").read_text()) | {"name": "mine"}
    brakes = {joint: content if joint in "AB" else "mrb-2107-3" for joint in sorted(braked)}
    made = phd.device(links, ((0.0, 0.0), (apart, 0.0)), brakes, tip_kg=tip_kg, name="mine", limits={"margin": 0.2})
    with tempfile.TemporaryDirectory() as folder:
        for name, text in made.brake_texts.items():
            (Path(folder) / name).write_text(text)
        (file := Path(folder) / "mine.toml").write_text(made.text)
        read = phd.load_device(file)
    for ours, theirs in zip((*made.mechanism, *made.brakes), (*read.mechanism, *read.brakes), strict=True):
        assert np.array_equal(ours, theirs)
    assert made.mechanism.arm_1.length_1 == links[0] and made.braked == "".join(j for j in "AEBC" if j in braked)
    phd.Simulation(made, "ideal").step([0.1] * len(braked))


@pytest.mark.filterwarnings("ignore")
def test_a_device_that_cannot_be_is_refused():
    brakes = {"A": "mrb-2107-3"}
    for values, why in [
        (((0.3, 0.3, 0.3), ((0, 0), (0, 0)), brakes), "four numbers"),
        (((0.3,) * 4, ((0, 0), (9, 0)), brakes), "more than the arms reach"),
        (((0.3,) * 4, ((0, 0), (0, 0)), {"F": "mrb-2107-3"}), "no joint 'F'"),
        (((0.3,) * 4, ((0, 0), (0, 0)), {"A": "none"}), "unknown brake"),
    ]:
        with pytest.raises(phd.InputError, match=why):
            phd.device(*values)


def test_a_protocol_from_values_is_the_one_of_its_toml_and_runs(tmp_path: Path):
    brakes = tomllib.loads((ROOT / "core/brake_files/mrb-2107-3.toml").read_text()) | {"name": "mine"}
    device = phd.device((0.3,) * 4, ((-0.05, 0.0), (0.05, 0.0)), {"A": brakes, "B": "mrb-2107-3"}, name="small")
    line = {"kind": "segment", "start_m": np.array([-0.1, 0.4]), "end_m": (0.1, 0.4), "number": 3}
    bow = np.column_stack([np.linspace(-0.1, 0.1, 9), 0.4 + 0.02 * np.cos(np.linspace(-1.5, 1.5, 9))])
    guides = [
        {"name": "No control", "kind": "none"},
        {"name": "Soft", "kind": "proportional", "gain_N_s_m": np.float64(300)},
    ]
    made = phd.protocol("mine", [device, "four-brake"], [line, bow], guides, seed=5, trial={"hold_s": 0.2})
    (file := tmp_path / "mine.toml").write_text(made.text)
    read = load_protocol(file)
    assert protocol_to_json(read) == protocol_to_json(made) and (read.paths, read.trial) == (made.paths, made.trial)
    assert made.paths[3].start_m == (-0.1, 0.4) and made.trial.hold_s == 0.2
    assert [one.braked for one in made.devices] == ["AB", "AEBC"] and made.controllers[2].value("gain_N_s_m") == 300.0
    pd.testing.assert_frame_equal(phd.run_study(made, 1, seed=2), phd.run_study(file, 1, seed=2))
    with pytest.raises(phd.InputError, match="protocol mine: path 1"):
        phd.protocol("mine", ["three-brake"], [[(0.0, 0.4)]], guides)
