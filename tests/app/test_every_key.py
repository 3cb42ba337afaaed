"""Each key of each kind of file, spoilt: misspelt, of a wrong type, not finite, far too small or large. A sentence
that names it refuses it.

What else a value cannot be (a bound, two values that contradict each other) is in the tests of its kind.
"""

import copy
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from core.device import SHIPPED_FOLDER, build_device
from core.device_file import parse_brake
from core.files import InputError, toml_text
from experiments.protocol import read_protocol
from experiments.sensitivity.ranges import load_ranges
from experiments.simulate.cobot_scene import read_cobot_scene
from experiments.simulate.scene import read_scene
from experiments.study.sweep import load_sweep
from experiments.trial.population import load_population

ROOT = Path(__file__).parents[2]
EXAMPLES, EXPERIMENTS = ROOT / "docs/examples", ROOT / "experiments"
BRAKE = (SHIPPED_FOLDER.parent / "brake_files/mrb-2107-3.toml").read_text()
SCENE = """device = "four-brake"
fidelity = "ideal"
integrator = "event"
duration_s = 0.02
step_s = 1e-3
output_interval_s = 1e-3
initial_tip_m = [0.05, 0.40]
initial_tip_velocity_m_s = [0.0, 0.0]
brakes.torque_N_m = {A = 5.6, E = 0.3}
force.constant_N = [1.0, 2.0]
"""
Load = Callable[[str], Any]


def from_file(load: Callable[[Path], Any]) -> Load:
    def written(text: str) -> Any:
        Path("it.toml").write_text(text, encoding="utf-8")
        return load(Path("it.toml"))

    return written


def device(text: str) -> Any:
    return build_device(text, {"mrb-2107-3": BRAKE}, "it.toml")


def protocol(text: str) -> Any:
    return read_protocol(text, EXAMPLES / "protocols", "it.toml")


#: Kind of file -> a good one, how it is read, and of how many spoilt ones one is tried.
KINDS: dict[str, tuple[str | Path, Load, int]] = {
    "device": (SHIPPED_FOLDER / "four-brake.toml", device, 1),
    "couplings": (SHIPPED_FOLDER / "pter.toml", device, 1),
    "brake": (BRAKE, lambda text: parse_brake(text, "it.toml"), 1),
    "protocol": (EXAMPLES / "protocols/every-key.toml", protocol, 3),
    "scene": (SCENE, from_file(read_scene), 1),
    "cobot scene": (EXPERIMENTS / "scenes/scooter.toml", from_file(read_cobot_scene), 1),
    "ranges": (EXAMPLES / "ranges/slow-brakes.toml", from_file(load_ranges), 1),
    "sweep": (EXAMPLES / "sweeps/assumptions.toml", from_file(load_sweep), 1),
    "population": (EXPERIMENTS / "trial/populations/average.toml", from_file(load_population), 1),
}


def ways(at: Any, way: tuple = ()) -> Iterator[tuple]:
    """To each key of tables in tables and lists."""
    for key, value in at.items() if isinstance(at, dict) else enumerate(at) if isinstance(at, list) else ():
        if isinstance(at, dict):
            yield (*way, key)
        yield from ways(value, (*way, key))


def spoilt(content: dict, way: tuple) -> Iterator[dict]:
    """The content with the value at the end of the way spoilt, in each manner; no number is without its bounds."""

    def copied(value: Any, name: str = "") -> dict:
        whole = table = copy.deepcopy(content)
        for key in way[:-1]:
            table = table[key]
        del table[way[-1]]
        table[name or way[-1]] = value
        return whole

    value = content
    for key in way:
        value = value[key]
    if way[0] != "form":  # whose names are anybody's
        yield copied(value, f"{way[-1]}x")
    yield copied(7 if isinstance(value, dict) else {"x": 1})
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield copied(float("nan"))
        for huge in (-1e12, 1e12) if way[-1] not in ("seed", "heading_rad", "radius_m") else ():
            yield copied(type(value)(huge))
    if isinstance(value, list) and value and isinstance(value[0], int | float):
        yield copied([*value[:-1], float("inf")])


@pytest.mark.parametrize("kind", KINDS)
def test_a_spoilt_key_is_refused_by_its_name(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    good, load, of = KINDS[kind]
    content = tomllib.loads(good.read_text(encoding="utf-8") if isinstance(good, Path) else good)
    load(toml_text(content))
    tried = [(way, one) for way in ways(content) for one in spoilt(content, way)][::of]
    assert len(tried) > 10
    for way, one in tried:
        with pytest.raises(InputError) as refused:
            load(toml_text(one))
        said = str(refused.value)
        names = [name for name in way[-3:] if name not in ("low", "high", "value") and isinstance(name, str)]
        assert said.startswith("it.toml: ") and "\n" not in said and names[-1] in said, (way, said)
