"""What `phd bench` measures with: its scenes, its independent reference, its order. Times are in no test."""

import json
from dataclasses import replace

import numpy as np
import pytest
from devices import BENCH

from app.cli import main
from experiments.benchmark.bench import PEERS, BenchRun, Peer, Row, creep, simulated, with_order
from experiments.benchmark.bench_tables import table, work_precision
from experiments.benchmark.reference import reference_tips
from experiments.benchmark.scenes import COMPARE_S, START, STEPS_S, bench_devices, bench_scenes

BRIEF_S = 0.4


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


@pytest.mark.parametrize("device, bar", list(zip(bench_devices(), BENCH, strict=True)), ids=lambda d: d.name)
def test_bench_devices_are_those_of_the_design(device, bar):
    for ours, theirs in zip(device.mechanism, bar.device.mechanism, strict=True):
        assert np.asarray(ours) == pytest.approx(np.asarray(theirs), rel=1e-15)


def test_scenes_are_those_of_the_design():
    s1, s2, s3, s4 = bench_scenes(bench_devices()[1])
    t = 0.123
    assert s1.force(t) == pytest.approx([6 * np.sin(4 * np.pi * t), -6 * np.cos(2.8 * np.pi * t)])
    assert s4.force(t) == pytest.approx([15 * np.sin(2 * np.pi * t), 10 * np.cos(1.4 * np.pi * t)])
    assert s3.force(t).tolist() == [10.0, 0.0]
    assert s2.torques.tolist() == [[5.6, 0.3, 0.3, 0.3]]
    assert np.argmax(s4.torques[:5], axis=1).tolist() == [0, 2, 1, 3, 0]  # A, B, E, C
    assert all((COMPARE_S / step) == pytest.approx(round(COMPARE_S / step)) for step in STEPS_S)


@pytest.mark.parametrize("scene", SCENES, ids=_name)
def test_event_motion_equals_dop853_on_the_ten_coordinate_form(scene):
    """Two routes with nothing in common but the device file: equations, stick-slip solver, integrator, events."""
    apart = np.linalg.norm(simulated(BenchRun(scene, "event", "ideal", 1e-4))[1] - reference(scene), axis=1)
    assert apart.max() < 2e-12


@pytest.mark.parametrize("scene", SCENES, ids=_name)
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


def test_order_is_the_slope_of_the_errors_above_rounding():
    def rows(errors):
        blank = Row("event", "ideal", "d", "S1", 0.0, 0.0, 0.0, 0.0, 0.0)
        return [replace(blank, step_s=h, rms_error_m=e) for h, e in zip(STEPS_S, errors, strict=True)]

    fourth = with_order(rows([h**4 for h in STEPS_S]))
    assert fourth[0].order == pytest.approx(4.0) and len({row.order for row in fourth}) == 1
    assert with_order(rows([1e-3, 1e-13, 1e-13, 1e-13, 1.0]))[0].order is None  # one point above rounding
    assert with_order(rows([1e-6, 4e-7, 1e-13, 1e-13, 1.0]))[0].order == pytest.approx(1.0, abs=1e-3)


def test_creep_is_the_largest_displacement_over_elapsed_time():
    s3 = bench_scenes(bench_devices()[0])[2]
    tips = np.array([START] * (s3.comparisons + 1))
    assert creep(s3, tips) == 0.0
    tips[50:] += (1e-3, 0.0)
    assert creep(s3, tips) == pytest.approx(1e-3 / (50 * COMPARE_S))
    assert creep(SCENES[0], tips) is None


def test_bench_writes_what_it_prints(tmp_path, capsys, monkeypatch):
    """Also without a peer, which is then said not to be there."""
    monkeypatch.setitem(PEERS, "mujoco", Peer("MuJoCo", lambda: None, PEERS["mujoco"].run))
    monkeypatch.setattr("experiments.benchmark.bench.reference_tips", reference)
    monkeypatch.setattr("experiments.benchmark.bench.bench_scenes", brief_scenes)
    assert main(["bench", "--quick", "--json", "--out", str(tmp_path / "b")]) == 0
    result = json.loads(capsys.readouterr().out)
    assert json.loads((tmp_path / "b" / "bench.json").read_text()) == result
    assert set(result["rows"][0]) == {
        "integrator", "fidelity", "device", "scene", "step_s", "us_per_step", "four_accelerations_us",
        "wall_s_per_sim_s", "rms_error_m", "max_error_m", "creep_m_s", "energy_residual_J", "events", "fallbacks",
        "order",
    }  # fmt: skip
    for row in result["rows"]:
        if (row["integrator"], row["fidelity"]) == ("event", "ideal"):
            assert row["rms_error_m"] <= 1e-8 and row["fallbacks"] == 0
            if row["scene"] == "S3":
                assert row["creep_m_s"] == 0.0
    for check in result["reference"]["checks"]:
        assert check["max_difference_m"] < (1e-12 if check["fidelity"] == "ideal" else 1e-7), check
    assert [set(cost) for cost in result["python"]] == [{"device", "event"}] and result["python"][0]["event"] > 0.0
    assert "event" in table(result) and "MuJoCo is not installed (pip" in table(result)
    assert result["machine"]["mujoco"] is None and not any(row["integrator"] == "mujoco" for row in result["rows"])
    assert work_precision(result)["pdf"].startswith(b"%PDF")
    assert (tmp_path / "b" / "work-precision.png").stat().st_size > 1000


def test_bench_refuses_a_folder_that_exists_before_it_measures(tmp_path, capsys):
    assert main(["bench", "--out", str(tmp_path)]) == 2
    assert main(["bench", "--out", str(tmp_path / "no" / "b")]) == 2
    assert "never overwritten" in capsys.readouterr().err
