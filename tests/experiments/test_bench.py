"""What `phd bench` measures with: its scenes, its independent reference, its order. Times are in no test."""

import json

import numpy as np
import pytest

from experiments.benchmark.bench import BenchRun, run_bench, simulated
from experiments.benchmark.bench_tables import table, work_precision
from experiments.benchmark.reference import reference_tips
from experiments.benchmark.scenes import bench_devices, bench_scenes

BRIEF_S = 0.3
SCENES = [scene.until(BRIEF_S) for scene in bench_scenes(bench_devices()[0])]


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_event_motion_equals_dop853_on_the_ten_coordinate_form(scene):
    """Two routes with nothing in common but the device file: equations, stick-slip solver, integrator, events."""
    apart = np.linalg.norm(simulated(BenchRun(scene, "event", "ideal", 1e-4))[1] - reference_tips(scene), axis=1)
    assert apart.max() < 2e-12


def test_on_the_other_device_motion_nears_the_reference_with_its_order_and_lagging_brakes_with_second_order():
    """Against DOP853 on the ten-coordinate form, with lagging brakes on Eq. (1) and Eq. (5)."""
    result = run_bench(quick=True, longest_s=0.2)
    for row in result["rows"]:
        if (row["integrator"], row["fidelity"]) == ("event", "ideal"):
            assert row["rms_error_m"] <= 1e-8 and row["fallbacks"] == 0
            assert row["scene"] != "S3" or row["creep_m_s"] == 0.0
        if (row["integrator"], row["fidelity"]) == ("event", "mr"):
            assert row["max_error_m"] < 1e-4 and (row["max_error_m"] < 1e-8 or row["order"] > 1.5)
    checks = result["reference"]["checks"]
    assert {(check["scene"], check["fidelity"]) for check in checks} == {
        (scene.name, fidelity) for scene in SCENES for fidelity in ("ideal", "mr")
    }
    for check in checks:
        assert check["max_difference_m"] < (1e-12 if check["fidelity"] == "ideal" else 1e-7), check
        assert check["compared_s"] > 0.15 or check["scene"] == "S4", "there the hand throws it against a hard stop"
    assert json.loads(json.dumps(result)) == result and "S4" in table(result)
    assert work_precision(result)["pdf"].startswith(b"%PDF")
