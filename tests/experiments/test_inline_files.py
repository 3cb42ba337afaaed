"""Device and brake files that stand in a protocol or sweep file, and sweeps of assumptions."""

import csv
import tomllib
from pathlib import Path

import msgspec
import pytest

from app.cli import main
from core.device import SHIPPED_FOLDER, load_device
from core.device_file import SHIPPED_FOLDER as BRAKES
from core.files import InputError, toml_text
from experiments.assumptions import DEFAULTS
from experiments.protocol import SHIPPED_FOLDER as PROTOCOLS
from experiments.protocol import load_protocol, protocol_from_json, protocol_to_json
from experiments.protocol_writer import save_variant
from experiments.study.sweep import COLUMNS, load_sweep, run_sweep

DEVICE = tomllib.loads((SHIPPED_FOLDER / "four-brake.toml").read_text())
BRAKE = tomllib.loads((BRAKES / "mrb-2107-3.toml").read_text())
MINE = {
    "device": [DEVICE | {"name": "mine", "brakes": DEVICE["brakes"] | {"A": "weak"}}, DEVICE | {"name": "other"}],
    "brake": [BRAKE | {"name": "weak", "k": [0.5 * k for k in BRAKE["k"]]}],
}


def protocol_file(folder: Path, **changes) -> Path:
    """The paper's protocol with devices of its own."""
    content = tomllib.loads((PROTOCOLS / "paper.toml").read_text())
    path = folder / "mine.toml"
    path.write_text(toml_text(content | {"devices": ["mine", "three-brake", "other"]} | MINE | changes))
    return path


def test_devices_and_brakes_may_stand_in_the_protocol_file(tmp_path):
    protocol = load_protocol(protocol_file(tmp_path))
    mine, three, other = protocol.devices
    four = load_device("four-brake")
    assert (mine.name, three.name, other.name) == ("mine", "three-brake", "other")
    assert mine.brakes.k[0].tolist() == (0.5 * four.brakes.k[0]).tolist()
    assert mine.brakes.k[1:].tolist() == other.brakes.k[1:].tolist() == four.brakes.k[1:].tolist()
    assert other.mechanism.arm_1 == four.mechanism.arm_1


def test_they_are_stored_in_full_and_come_back_without_the_file(tmp_path):
    path = protocol_file(tmp_path)
    stored = protocol_to_json(load_protocol(path))
    path.unlink()
    mine, before = protocol_from_json(stored, "stored").device("mine"), load_device("four-brake")
    assert mine.brakes.k[0].tolist() == (0.5 * before.brakes.k[0]).tolist()
    assert protocol_to_json(protocol_from_json(stored, "stored")) == stored


def test_the_command_line_may_choose_among_them(tmp_path, capsys):
    path = protocol_file(tmp_path)
    assert [one.name for one in load_protocol(path, devices=["other"]).devices] == ["other"]
    assert main(["run", str(path), "--device", "mine", "--print-plan"]) == 0
    assert "mine" in capsys.readouterr().out


def test_a_variant_of_the_protocol_keeps_its_assumptions_and_applies_none_twice(tmp_path):
    path = protocol_file(tmp_path, assumptions={"gap_reading": "full", "low_gain": 300.0, "lag_factor": 2.0})
    protocol = load_protocol(path)
    assert protocol.controllers[3].value("gap_m") == 0.0025
    saved = tmp_path / "variant.toml"
    save_variant(saved, protocol, protocol.devices[0], 1, protocol.controllers, "settled", protocol.mouse)
    again = load_protocol(saved)
    assert again.controllers == protocol.controllers
    assert again.assumptions == msgspec.structs.replace(DEFAULTS, lag_factor=2.0)


WRONG = {
    "unknown key": ({"device": [DEVICE | {"name": "mine", "colour": "red"}]}, "device 1: unknown key colour"),
    "no geometry": ({"device": [{"name": "mine"}]}, "device 1: the required key geometry is missing"),
    "brake without name": ({"brake": [{"k": 1.0}]}, "brake 1: "),
    "brake that cannot be": ({"brake": [BRAKE | {"name": "weak", "knee_A": -1.0}]}, "brake 1: knee_A must be"),
    "brake missing": ({"brake": []}, "device 1: brakes: unknown brake 'weak'"),
    "two of one name": ({"device": MINE["device"] * 2}, "device: two have the same name (mine)"),
    "device missing": ({"devices": ["yours"]}, "unknown device 'yours'"),
    "no encoders": (
        {"device": [{k: v for k, v in one.items() if k != "sensing"} for one in MINE["device"]],
         "assumptions": {"sensing": "encoders"}},
        "device mine: has no encoders that give its tip",
    ),
}  # fmt: skip


@pytest.mark.parametrize("changes, says", WRONG.values(), ids=WRONG)
def test_a_wrong_one_is_refused_in_one_sentence(tmp_path, capsys, changes, says):
    path = protocol_file(tmp_path, **changes)
    assert main(["study", str(path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert says in said.err and said.err.count("\n") == 1 and said.out == ""
    assert not (tmp_path / "out").exists()


SWEEP = {
    "name": "worlds",
    "operators": 1,
    "repetitions": 1,
    "devices": ["mine"],
    "assumptions": {"lag_factor": [0.5, 1.0], "gap_reading": ["half", "full"], "sensing": ["encoders"]},
    "controller": [{"kind": "none"}, {"kind": "sdof", "gap_m": [0.004]}],
}


def sweep_file(folder: Path, **changes) -> Path:
    path = folder / "sweep.toml"
    path.write_text(toml_text(SWEEP | MINE | changes))
    return path


def test_a_sweep_varies_assumptions_in_columns_of_their_own(tmp_path):
    run_sweep(load_sweep(sweep_file(tmp_path)), tmp_path / "out")
    with (tmp_path / "out" / "sweep.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    names = list(rows[0])
    assert [name for name in names if name not in COLUMNS] == ["lag_factor", "gap_reading"]
    assert names.index("lag_factor") == names.index("rules") + 1
    assert {(row["lag_factor"], row["gap_reading"], row["gap_m"]) for row in rows if row["kind"] == "sdof"} == {
        ("0.5", "half", "0.004"), ("0.5", "full", "0.002"), ("1.0", "half", "0.004"), ("1.0", "full", "0.002")
    }  # fmt: skip
    error = {(row["kind"], row["lag_factor"], row["gap_reading"], row["segment"]): row["path_error_m"] for row in rows}
    assert error["sdof", "1.0", "half", "1"] != error["sdof", "1.0", "full", "1"]
    assert error["none", "1.0", "half", "1"] == error["none", "1.0", "full", "1"] == error["none", "0.5", "half", "1"]
    stored = load_sweep(sweep_file(tmp_path)).texts
    assert "device mine" in stored and "brake weak of mine" in stored


WRONG_SWEEPS = {
    "no value": ({"lag_factor": []}, "assumptions.lag_factor"),
    "no list": ({"lag_factor": 2.0}, "assumptions.lag_factor must be a list, not a number"),
    "a wrong value": ({"fidelity": ["mr", "best"]}, "assumptions.fidelity[1] must be one of ideal, static, mr"),
    "twice the same": ({"backlash_deg": [1.0, 1.0]}, "assumptions.backlash_deg: the same one stands there twice"),
    "a gain": ({"low_gain": [5.0]}, "unknown key assumptions.low_gain"),
}


@pytest.mark.parametrize("assumptions, says", WRONG_SWEEPS.values(), ids=WRONG_SWEEPS)
def test_a_sweep_of_wrong_assumptions_is_refused(tmp_path, assumptions, says):
    with pytest.raises(InputError) as refusal:
        load_sweep(sweep_file(tmp_path, assumptions=assumptions))
    assert says in str(refusal.value) and "\n" not in str(refusal.value)
