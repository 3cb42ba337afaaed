"""What is written as a protocol reads back as the same protocol; what cannot be run is not written."""

import math
import shutil
import tomllib

import numpy as np
import pytest

from core.device import SHIPPED_FOLDER as DEVICES
from core.device_file import SHIPPED_FOLDER as BRAKES
from core.files import InputError, toml_text
from core.path import outline, path_from
from experiments.protocol import SHIPPED_FOLDER, load_protocol, read_protocol, shipped_protocols
from experiments.protocol_writer import path_through, points_of, protocol_text, save_protocol, whole_text


def shipped(name: str) -> dict:
    return tomllib.loads((SHIPPED_FOLDER / f"{name}.toml").read_text())


@pytest.mark.parametrize("name", shipped_protocols())
def test_a_shipped_protocol_reads_back_the_same(name: str) -> None:
    text = protocol_text(shipped(name))
    assert tomllib.loads(text) == shipped(name)
    again, before = read_protocol(text, SHIPPED_FOLDER, "it"), load_protocol(name)
    assert (again.paths, again.controllers, again.trial, again.mouse) == (
        before.paths, before.controllers, before.trial, before.mouse,
    )  # fmt: skip


def test_any_text_number_and_key_comes_back() -> None:
    content = {
        "name": 'a "b" \\ c\x7f\n\tü', "tiny": 1e-300, "large": 1e22, "whole": -3, "yes": True,
        "none": [], "left": None, "pairs": [[0.1, 0.2], [3, 4.0]],
        "form": {"a key": ["x", "y"], "deep": {"x": [{"y": 1}, {"y": {"z": 2}}]}},
    }  # fmt: skip
    back = tomllib.loads(protocol_text(content))
    assert back == {key: value for key, value in content.items() if value is not None}
    assert isinstance(back["whole"], int) and isinstance(back["large"], float)


def test_a_protocol_as_one_file_is_the_same_without_the_files_it_came_from(tmp_path) -> None:
    there = tmp_path / "there"
    there.mkdir()
    device = tomllib.loads((DEVICES / "four-brake.toml").read_text())
    device["brakes"] |= {"A": "weak.toml"}
    device["sensing"]["force"]["calibration"] = "gauges.csv"
    weak = tomllib.loads((BRAKES / "mrb-2107-3.toml").read_text())  # by the name of another
    (there / "weak.toml").write_text(toml_text(weak | {"k": [0.5 * k for k in weak["k"]]}))
    np.savetxt(there / "gauges.csv", np.eye(6), delimiter=",")
    (there / "mine.toml").write_text(toml_text(device))
    about = {"devices": ["three-brake", "mine.toml"], "instruction": [{"text": "Follow the line."}]}
    (there / "before.toml").write_text(toml_text(shipped("paper") | about | {"assumptions": {"gap_reading": "full"}}))
    before = load_protocol(there / "before.toml", rules="literal", low_gain=50.0, seed=7)
    file = tmp_path / "whole.toml"
    file.write_text(whole_text(before, "whole", "# About it.\n"))
    shutil.rmtree(there)
    again = load_protocol(file)
    assert (again.name, again.rules, again.seed, again.instruction) == ("whole", "literal", 7, ())
    assert file.read_text().startswith("# About it.\n")
    for key in ("paths", "controllers", "trial", "assumptions", "blocks"):
        assert getattr(again, key) == getattr(before, key)
    for one, other in zip(again.devices, before.devices, strict=True):
        about, was = tomllib.loads(one.text), tomllib.loads(other.text)
        assert [about[key] for key in ("name", "geometry", "mass", "limits")] == [
            was[key] for key in ("name", "geometry", "mass", "limits")
        ]
        for mine, its in zip(one.brakes, other.brakes, strict=True):
            assert np.array_equal(mine, its)
    assert again.devices[1].brakes.k[0, 0] == 0.5 * again.devices[1].brakes.k[1, 0]


def test_a_file_is_replaced_only_where_that_is_asked_for(tmp_path) -> None:
    file = tmp_path / "mine.toml"
    save_protocol(file, shipped("paper"))
    first = file.read_bytes()
    with pytest.raises(InputError, match=r"mine\.toml: exists already"):
        save_protocol(file, shipped("curves"))
    assert file.read_bytes() == first
    save_protocol(file, shipped("curves"), replacing=True)
    assert load_protocol(file).name == "curves" and [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


def test_what_cannot_be_run_or_written_leaves_nothing(tmp_path) -> None:
    with pytest.raises(InputError, match=r"mine\.toml: blocks must be at least 1, not 0"):
        save_protocol(tmp_path / "mine.toml", {**shipped("paper"), "blocks": 0})
    with pytest.raises(InputError, match="cannot be written"):
        save_protocol(tmp_path / "no" / "mine.toml", shipped("paper"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", shipped_protocols())
def test_a_path_is_drawn_again_from_its_points(name: str) -> None:
    for path in shipped(name)["path"]:
        again = path_through(path["kind"], points_of(path))
        before, after = (outline(path_from(one, "path"), 0.01) for one in (without_number(path), again))
        assert after == pytest.approx(before, abs=1e-5)


def without_number(path: dict) -> dict:
    return {key: value for key, value in path.items() if key != "number"}


@pytest.mark.parametrize("turn", [30.0, 170.0, 250.0, -30.0, -200.0])
@pytest.mark.parametrize("first", [-170.0, 0.0, 95.0])
def test_an_arc_runs_from_its_first_point_by_the_second_to_the_last(first: float, turn: float) -> None:
    arc = {"kind": "arc", "centre_m": [0.02, 0.3], "radius_m": 0.1, "from_deg": first, "to_deg": first + turn}
    again = path_through("arc", points_of(arc))
    assert again["to_deg"] - again["from_deg"] == pytest.approx(turn, abs=0.01)
    assert math.dist(points_of(again)[1], points_of(arc)[1]) < 1e-5


def test_points_without_a_path_are_refused() -> None:
    with pytest.raises(InputError, match="lie on a line"):
        path_through("arc", [(0.0, 0.3), (0.05, 0.3), (0.1, 0.3)])
    with pytest.raises(InputError, match="needs 2 points"):
        path_through("polyline", [(0.0, 0.3)])
