"""`phd simulate`: the rows of a file are the simulator's; a run that fails leaves none; leaving is warned of."""

import io
import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.cli import main
from core.device import load_device
from core.simulator.simulation import ROW_WIDTH, STUCK
from core.workspace import free_tips
from experiments.simulate import simulate as simulate_module
from experiments.simulate.leaving import Leaving
from experiments.simulate.scene import Scene, read_scene
from experiments.simulate.simulate import TORQUE, column_names, simulate, write_rows


@pytest.fixture
def scene(tmp_path: Path):
    """A function that writes and reads a scene of three-brake, with a brake schedule if given."""

    def read(more: str = "", duration_s: float = 0.02, brakes: str = "") -> Scene:
        plain = f'device = "three-brake"\nduration_s = {duration_s}\nstep_s = 1e-3\ninitial_tip_m = [0.05, 0.40]\n'
        (tmp_path / "scene.toml").write_text(plain + more)
        (tmp_path / "brakes.csv").write_text(brakes)
        return read_scene(tmp_path / "scene.toml")

    return read


class Ramp:
    """A row source that counts: row k of the scene holds k + column / 100."""

    def __init__(self, scene, fails_after: int | None = None, error: BaseException | None = None) -> None:
        self.scene, self.done, self.fails_after, self.error = scene, 0, fails_after, error
        self.leaving = SimpleNamespace(warning="")

    def ledger(self) -> SimpleNamespace:
        return SimpleNamespace(events=3, fallbacks=1, warnings=tuple)

    def run_chunk(self, rows: int) -> np.ndarray:
        if self.error and self.fails_after is not None and self.done >= self.fails_after:
            raise self.error
        k = np.arange(self.done, self.done + rows, dtype=float)
        self.done += rows
        chunk = k[:, None] + np.arange(ROW_WIDTH) / 100
        chunk[:, STUCK] = k % 16
        return chunk


@pytest.fixture
def ramp(monkeypatch) -> pytest.MonkeyPatch:
    monkeypatch.setattr(simulate_module, "SceneRun", Ramp)
    return monkeypatch


#: A scene with brakes at A and E alone, as its columns need it.
OF_TWO: Any = SimpleNamespace(device=SimpleNamespace(braked="AE"), fidelity="ideal")


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=7, max_size=7), st.integers(0, 15))
def test_every_double_reads_back_as_itself(values, bits):
    chunk = np.zeros((1, ROW_WIDTH))
    chunk[0, 1:5] = values[:4]
    chunk[0, TORQUE : TORQUE + 2] = values[4:6]
    chunk[0, STUCK] = bits
    file = io.BytesIO()
    write_rows(file, np.array(values[6:]), chunk, OF_TWO, {})
    line = file.getvalue().decode()
    *numbers, stuck = line.split(",")[:8]
    assert [float(number) for number in numbers] == [values[6], *values[:6]]
    assert stuck == "".join(joint for i, joint in enumerate("AEBC") if bits >> i & 1)


def test_the_file_holds_every_row_whatever_the_chunks(scene, tmp_path: Path, ramp):
    s = scene("output_interval_s = 2e-3\n")
    written = []
    for chunk_rows, chunk_steps in ((1000, 1000), (3, 1000), (1000, 7), (1, 1)):
        ramp.setattr(simulate_module, "CHUNK_ROWS", chunk_rows)
        ramp.setattr(simulate_module, "CHUNK_STEPS", chunk_steps)
        path = tmp_path / f"{chunk_rows}-{chunk_steps}.csv"
        summary = simulate(s, path)
        assert [summary[name] for name in ("rows", "steps", "events", "fallbacks")] == [11, 20, 3, 1]
        written.append(path.read_bytes())
    assert len(set(written)) == 1
    lines = written[0].decode().split("\n")
    assert lines[0].split(",") == column_names(s) and "torque_C_N_m" not in lines[0]
    rows = [dict(zip(column_names(s), line.split(","), strict=True)) for line in lines[1:3]]
    assert [row["stuck"] for row in rows] == ["", "A"] and [row["t_s"] for row in rows] == ["0", "0.002"]
    assert list(rows[1].values())[1:8] == ["1.01", "1.02", "1.03", "1.04", "1.05", "1.06", "1.07"]
    assert len(lines) == 11 + 2 and lines[-1] == "" and b"\r" not in written[0]


def test_motion_that_is_not_finite_is_never_written(scene, tmp_path: Path, monkeypatch):
    class Diverging(Ramp):
        def run_chunk(self, rows):
            chunk = super().run_chunk(rows)
            chunk[5, 2] = np.nan
            return chunk

    monkeypatch.setattr(simulate_module, "SceneRun", Diverging)
    with pytest.raises(FloatingPointError, match=r"no longer finite at t = 0\.005 s"):
        simulate(scene(), tmp_path / "out.csv")
    assert not (tmp_path / "out.csv").exists()


def test_a_row_shows_the_state_after_what_happens_at_its_time(scene, tmp_path: Path):
    more = '[brakes]\nschedule = "brakes.csv"\n[force]\nconstant_N = [3, 2]\n'
    s = scene(more, brakes="t_s,A,E,B\n0,5,5,5\n0.005,0,0,0\n0.0125,5,5,5\n")
    simulate(s, tmp_path / "out.csv")
    rows = [line.split(",") for line in (tmp_path / "out.csv").read_text().split("\n")[1:-1]]
    assert len(rows) == 21
    tips = np.array([[float(cell) for cell in row[1:5]] for row in rows])
    assert all(row[8] == "AEB" for row in rows[:5]) and np.all(tips[:6] == tips[0])
    assert all(row[8] == "" and set(row[5:8]) == {"0"} for row in rows[5:13])
    assert np.all(np.diff(np.hypot(tips[5:13, 2], tips[5:13, 3])) > 0)
    assert all(set(row[5:8]) != {"0"} for row in rows[13:])


def test_a_result_that_half_the_step_contradicts_carries_a_warning(scene, tmp_path: Path, capsys):
    """First order at 20 ms is off by millimetres and says so, in the summary, on stderr and in --json."""
    s = scene("integrator = 'stepping'\n[force]\nconstant_N = [20.0, 5.0]\n", 0.4)
    coarse = replace(s, step_s=0.02, steps=20, output_every=1, output_interval_s=0.02)
    found = simulate(coarse, tmp_path / "coarse.csv")
    assert found["half_step_differs_m"] > 1e-3
    assert any("half the step" in sentence for sentence in found["warnings"])
    fine = simulate(replace(s, integrator="event"), tmp_path / "fine.csv")
    assert fine["half_step_differs_m"] < 1e-8 and fine["warnings"] == []
    path = tmp_path / "scene.toml"
    path.write_text(path.read_text().replace("step_s = 1e-3", "step_s = 0.02"))
    assert main(["simulate", str(path), "--out", str(tmp_path / "verb.csv"), "--json"]) == 0
    said = capsys.readouterr()
    assert said.err.startswith("warning: ")
    assert len(json.loads(said.out)["warnings"]) >= 1


SCENE = """device = "four-brake"
duration_s = {}
step_s = 1e-3
initial_tip_m = [0.2, 0.36]
output_interval_s = {}
[force]
constant_N = {}
"""
AT_T = re.compile(r"the tip leaves the workspace at t = (\S+) s: it passes behind the bases, at \((\S+), (\S+)\) m")


def warnings_of(tmp_path, duration, interval, force):
    (tmp_path / "scene.toml").write_text(SCENE.format(duration, interval, force))
    return simulate(read_scene(tmp_path / "scene.toml"), tmp_path / f"{duration}-{interval}.csv")["warnings"]


@pytest.mark.parametrize("interval", [0.5, 0.001])
def test_a_tip_that_passes_behind_its_bases_is_warned_of_once_however_far_apart_the_rows(tmp_path, interval):
    (warning,) = warnings_of(tmp_path, 2.0, interval, [4.0, -6.0])
    found = AT_T.fullmatch(warning)
    assert found and float(found[1]) == pytest.approx(0.59, abs=0.006) and -0.01 < float(found[3]) <= 0.0


def test_a_tip_that_is_pushed_against_a_hard_stop_has_not_left(tmp_path):
    assert warnings_of(tmp_path, 0.5, 0.01, [20.0, 60.0]) == []


def test_whatever_is_beyond_a_stop_or_out_of_reach_has_left_and_what_is_free_has_not():
    mechanism = load_device("four-brake").mechanism
    tips = free_tips(mechanism)
    leaving = Leaving(mechanism)
    leaving.look(np.arange(len(tips)) * 1e-3, *tips.T)
    assert leaving.warning == ""
    leaving.look(np.array([7.0, 8.0]), np.array([0.0, 0.0]), np.array([0.4, 5.0]))
    assert leaving.warning.startswith(
        "the tip leaves the workspace at t = 8 s: it is beyond a hard stop, at (0.000, 5.0"
    )
