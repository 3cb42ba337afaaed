"""What `phd bench` measures with: its scenes, its independent reference, its order. Times are in no test."""

import json
from dataclasses import replace

import numpy as np
import pytest

from app.cli import main
from experiments.benchmark.bench import PEERS, BenchRun, Peer, simulated
from experiments.benchmark.bench_tables import table, work_precision
from experiments.benchmark.reference import reference_tips
from experiments.benchmark.scenes import bench_devices, bench_scenes

BRIEF_S = 0.3


def brief_scenes(device):
    """The beginning of each scene."""
    for scene in bench_scenes(device):
        begun = scene.times < BRIEF_S
        yield replace(scene, duration_s=BRIEF_S, times=scene.times[begun], torques=scene.torques[begun])


SCENES = [scene for device in bench_devices() for scene in brief_scenes(device)]


_REFERENCES: dict[tuple[str, str, str], np.ndarray] = {}


def reference(scene, fidelity="ideal"):
    """The reference's tips, computed once for each scene and fidelity."""
    key = scene.name, scene.device.name, fidelity
    if key not in _REFERENCES:
        _REFERENCES[key] = reference_tips(scene, fidelity)
    return _REFERENCES[key]


def _name(scene):
    return f"{scene.name}-{scene.device.name}"


@pytest.mark.parametrize("scene", SCENES, ids=_name)
def test_event_motion_equals_dop853_on_the_ten_coordinate_form(scene):
    """Two routes with nothing in common but the device file: equations, stick-slip solver, integrator, events."""
    apart = np.linalg.norm(simulated(BenchRun(scene, "event", "ideal", 1e-4))[1] - reference(scene), axis=1)
    assert apart.max() < 2e-12


@pytest.mark.parametrize("scene", SCENES[4:], ids=_name)
def test_event_motion_with_lagging_brakes_nears_dop853_on_eq_1_and_eq_5_with_second_order(scene):
    tips = reference(scene, "mr")
    compared = np.isfinite(tips[:, 0])
    assert compared.all() or scene.name == "S4"  # there the hand throws the device against a hard stop
    assert np.count_nonzero(compared) > 25
    coarse, fine = (
        np.linalg.norm(simulated(BenchRun(scene, "event", "mr", step))[1] - tips, axis=1)[compared].max()
        for step in (1e-3, 1e-4)
    )
    assert fine < 3e-6
    assert fine < 1e-12 or fine < 0.02 * coarse


def test_bench_writes_what_it_prints(tmp_path, capsys, monkeypatch):
    """Also without a peer, which is then said not to be there."""
    monkeypatch.setitem(PEERS, "mujoco", Peer("MuJoCo", lambda: None, PEERS["mujoco"].run))
    monkeypatch.setattr("experiments.benchmark.bench.reference_tips", reference)
    monkeypatch.setattr("experiments.benchmark.bench.bench_scenes", brief_scenes)
    assert main(["bench", "--quick", "--json", "--out", str(tmp_path / "b")]) == 0
    result = json.loads(capsys.readouterr().out)
    assert json.loads((tmp_path / "b" / "bench.json").read_text()) == result
    for row in result["rows"]:
        if (row["integrator"], row["fidelity"]) == ("event", "ideal"):
            assert row["rms_error_m"] <= 1e-8 and row["fallbacks"] == 0
            if row["scene"] == "S3":
                assert row["creep_m_s"] == 0.0
    for check in result["reference"]["checks"]:
        assert check["max_difference_m"] < (1e-12 if check["fidelity"] == "ideal" else 1e-7), check
    assert "MuJoCo is not installed (pip" in table(result) and result["machine"]["mujoco"] is None
    assert work_precision(result)["pdf"].startswith(b"%PDF")
