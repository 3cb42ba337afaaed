"""`import phd`: the numbers of the verbs as pandas frames, in a process that stays the caller's."""

import json
import re
import subprocess
import sys
from pathlib import Path

import matplotlib
import pandas as pd
import pytest
from protocols import short

import phd
from app.progress import CompileProgress
from core.kernels.cache import watchers
from experiments.analysis.statistics import statistics
from experiments.analysis.trials_table import read_table
from experiments.simulate.scene import read_scene
from experiments.simulate.simulate import simulate
from experiments.study.study import run_study
from experiments.trial.population import load_population

ROOT = Path(__file__).resolve().parents[2]
LOCKED = ROOT / "docs/examples/locked-brake.toml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("study") / "study"
    run_study(out, 1, short(paths=1), load_population())
    return out


def test_a_study_has_the_numbers_of_its_table_and_participants_as_text(folder: Path, tmp_path: Path):
    (protocol := tmp_path / "short.toml").write_text(short(paths=1).text)
    there = phd.load_trials(folder)
    assert list(there["participant"].unique()) == ["01"] and there.attrs["units"]["path_error_m"] == "m"
    simulated = phd.run_study(protocol, operators=1)
    same = [name for name in there if name != "recording"]
    pd.testing.assert_frame_equal(simulated[same], there[same])
    assert len(phd.statistics(there)) == len(statistics(read_table(folder / "trials.csv")))
    boxes = phd.boxes(pd.concat([there] * 5, ignore_index=True), "path_error_m")
    first = there[(there.controller == 1) & (there.configuration == "four-brake")]
    assert boxes.loc[(1, "four-brake"), "median"] == pytest.approx(first["path_error_m"].median())
    with pytest.raises(phd.InputError, match="there is no measure 'speed'"):
        phd.boxes(there, "speed")


def test_a_recording_and_its_replay_are_frames(folder: Path):
    file = next(folder.glob("sub-01/ses-01/trials/run-*.parquet"))
    ticks = phd.load_recording(file)
    assert ticks["t_s"].diff()[1:].to_numpy() == pytest.approx(1e-3) and set(ticks["phase"]) >= {"move"}
    assert ticks.attrs["units"]["hand_fx_N"] == "N" and ticks.attrs["outcome"]["status"] == "done"
    again = phd.replay(file)
    assert (again["before"].dropna() == again["after"].dropna()).all() and again.attrs["summary"]["equal"]
    content = file.read_bytes()
    file.write_bytes(content[:-2000])
    with pytest.raises(phd.InputError, match="changed or cut"):
        phd.load_recording(file)
    file.write_bytes(content)


def test_a_scene_has_the_rows_of_its_file_from_a_path_or_from_text(tmp_path: Path):
    simulate(read_scene(LOCKED), tmp_path / "motion.csv")
    there = pd.read_csv(tmp_path / "motion.csv", keep_default_na=False)
    pd.testing.assert_frame_equal(phd.run_scene(LOCKED), there)
    pd.testing.assert_frame_equal(phd.run_scene(LOCKED.read_text(), LOCKED.parent), there)
    with pytest.raises(phd.InputError, match="device"):
        phd.run_scene(LOCKED.read_text().replace("three-brake", "no-such"))


def test_importing_changes_nothing_in_the_callers_process():
    code = """
import os, signal, sys, warnings
import numpy, pandas, pyarrow, scipy
state = lambda: (dict(os.environ), sys.path[:], numpy.geterr(), [signal.getsignal(n) for n in signal.valid_signals()],
                 [one for one in warnings.filters if not one[2].__module__.startswith("core")], sys.excepthook)
before = state()
import phd
assert state() == before, "something changed"
assert not {"matplotlib", "PySide6"} & set(sys.modules), "slow to import"
"""
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_on_first_use_stderr_says_which_kernel_of_how_many_is_compiled(monkeypatch: pytest.MonkeyPatch):
    class Seen(Exception):
        pass

    def compiles():
        assert [type(watcher) for watcher in watchers] == [CompileProgress]
        raise Seen

    monkeypatch.setattr("phd.load_kernels", compiles)
    try:
        for call in (lambda: phd.run_study("paper", operators=1), lambda: phd.replay("none")):
            watchers.clear()
            with pytest.raises(Seen):
                call()
    finally:
        watchers.clear()


def test_the_door_has_few_names_and_each_is_explained():
    assert len(phd.__all__) <= 18
    assert all(getattr(phd, name).__doc__ for name in phd.__all__)


def test_the_snippet_of_the_readme_and_the_notebook_run(monkeypatch: pytest.MonkeyPatch):
    """With one operator in place of six."""
    (snippet,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert len(snippet.splitlines()) <= 10
    notebook = json.loads((ROOT / "docs/from-python.ipynb").read_text())
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] for cell in notebook["cells"] if cell["cell_type"] == "code"), "it is shown executed"
    matplotlib.use("Agg")
    monkeypatch.chdir(ROOT)
    for code in (snippet, "\n".join(cells)):
        exec(code.replace("operators=6", "operators=1"), {})
