"""The examples in docs run as they stand, and show what their first line says."""

import runpy
import tomllib
from pathlib import Path

import msgspec
import numpy as np
import pytest
from exports import rows
from gymnasium.utils.env_checker import check_env

from app.cli import main
from core.device import load_device
from core.files import table_in
from core.linkage import joint_angles
from core.simulator.state import pack_mechanism
from experiments.protocol import load_protocol
from experiments.protocol_file import ProtocolFile
from experiments.sensitivity.ranges import load_ranges
from experiments.sensitivity.run import SensitivityRun
from experiments.study.sweep import load_sweep

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
SCENES = EXAMPLES.parents[1] / "experiments" / "scenes"


def rows_of(scene: str, folder: Path) -> dict[str, list[str]]:
    out = folder / "motion.csv"
    assert main(["simulate", scene, "--out", str(out)]) == 0
    found = rows(out)
    columns = {name: [row[name] for row in found] for name in found[0]}
    times = np.array(columns["t_s"], dtype=float)
    assert times[0] == 0.0 and np.all(np.diff(times) > 0.0)
    x = columns["x_m" if scene.startswith("scooter") else "tip_x_m"]
    assert np.isfinite(np.array(x, dtype=float)).all()
    return columns


#: Tests below run the others.
@pytest.mark.parametrize("scene", sorted({path.stem for path in SCENES.glob("*.toml")} - {"locked-brake", "guarded"}))
def test_every_example_runs_to_its_end(scene, tmp_path):
    rows_of(scene, tmp_path)


def test_a_locked_brake_keeps_its_joint_angle_while_the_tip_moves(tmp_path):
    columns = rows_of("locked-brake", tmp_path)
    x, y = (np.array(columns[name], dtype=float) for name in ("tip_x_m", "tip_y_m"))
    mechanism = pack_mechanism(load_device("three-brake").mechanism)[0]
    angles = np.zeros((len(x), 4))
    for k in range(len(x)):
        joint_angles(mechanism, x[k], y[k], angles[k])
    assert np.hypot(x[-1] - x[0], y[-1] - y[0]) > 0.05
    assert np.ptp(angles[:, 0]) < 1e-12 and np.ptp(angles[:, 1]) > 0.1
    assert all("A" in stuck for stuck in columns["stuck"])


def test_the_guard_keeps_the_tip_from_a_wall_that_it_is_through_without(tmp_path):
    columns = rows_of("guarded", tmp_path)
    assert min(map(float, columns["obstacle_m"])) > 0.0 and set(columns["guard"]) == {"", "lock"}
    text = (SCENES / "guarded.toml").read_text(encoding="utf-8")
    (tmp_path / "free.toml").write_text(text[: text.index("\n[guard]\n") + 1], encoding="utf-8")
    (tmp_path / "guarded-force.csv").write_bytes((SCENES / "guarded-force.csv").read_bytes())
    assert main(["simulate", str(tmp_path / "free.toml"), "--out", str(tmp_path / "free.csv")]) == 0
    inside = [float(row["t_s"]) for row in rows(tmp_path / "free.csv") if float(row["obstacle_m"]) < 0.0]
    assert inside[0] == pytest.approx(0.15, abs=0.01)


@pytest.mark.parametrize("file", sorted((EXAMPLES / "protocols").glob("*.toml")), ids=lambda file: file.stem)
def test_every_protocol_can_be_run(file):
    assert main(["run", str(file), "--print-plan"]) == 0


@pytest.mark.parametrize("file", sorted((EXAMPLES / "sweeps").glob("*.toml")), ids=lambda file: file.stem)
def test_every_sweep_can_be_run(file):
    sweep = load_sweep(file)
    assert sweep.jobs[0].run().ticks > 0


@pytest.mark.parametrize("file", sorted((EXAMPLES / "ranges").glob("*.toml")), ids=lambda file: file.stem)
def test_every_ranges_file_gives_samples_of_three_people(file):
    ranges = load_ranges(file)
    sample = SensitivityRun(ranges, 2).samples()[0]
    protocol, _ = ranges.study(sample.values, sample.seed)
    fixed = {name.partition(".")[2]: one.value for name, one in ranges.fixed.items() if name.startswith("assumptions.")}
    assert ranges.operators == 3
    assert {name: getattr(protocol.assumptions, name) for name in fixed} == fixed


@pytest.mark.filterwarnings("error")
def test_the_gymnasium_environment_passes_gymnasiums_own_check_and_brakes_hold_the_hand():
    module = runpy.run_path(str(EXAMPLES / "gymnasium_env.py"))
    environment = module["GuideAlongLine"]()
    check_env(environment, skip_render_check=True)
    ways = []
    for share in (0.0, 1.0):
        environment.reset(seed=1)
        for _ in range(50):
            seen, *_ = environment.step(np.full(3, share, np.float32))
        ways.append(np.linalg.norm(seen[:2] - module["START"]))
    assert 10.0 * ways[1] < ways[0]  # the brakes lag, and have play


def keys_of(kind) -> dict[str, object]:
    """Every key of a file of this kind with its declaration, by its full name."""
    found = {}
    for one in msgspec.structs.fields(kind):
        found[one.name] = one
        if (table := table_in(one.type)) is not None:
            found |= {f"{one.name}.{name}": inner for name, inner in keys_of(table).items()}
    return found


def test_the_example_with_every_key_of_a_protocol_has_them_all():
    text = (EXAMPLES / "protocols/every-key.toml").read_text()
    load_protocol(EXAMPLES / "protocols/every-key.toml")
    content, declared = tomllib.loads(text), keys_of(ProtocolFile)
    for name in declared.keys() - {"device", "brake"}:  # files of their own
        top, _, key = name.partition(".")
        tables = content[top] if isinstance(content[top], list) else [content[top]]
        assert not key or any(key in table for table in tables), name
