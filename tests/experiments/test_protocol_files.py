"""What a protocol file may hold besides its plan: devices, brakes, languages, pictures; what is saved; the wedge."""

import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from exports import rows as csv_rows
from refusals import refusal

from core.control.controllers import PARAMETERS
from core.device import SHIPPED_FOLDER as DEVICES
from core.device import load_device
from core.device_file import SHIPPED_FOLDER as BRAKES
from core.files import InputError, toml_text
from experiments.language import FOLDER, read_language
from experiments.protocol import (
    SHIPPED_FOLDER,
    load_protocol,
    protocol_from_json,
    protocol_to_json,
    read_protocol,
    shipped_protocols,
)
from experiments.protocol_writer import (
    protocol_text,
    save_protocol,
    whole_text,
)
from experiments.study.sweep import FACTORS, MEASURED, load_sweep, run_sweep

DEVICE = tomllib.loads((DEVICES / "four-brake.toml").read_text())
BRAKE = tomllib.loads((BRAKES / "mrb-2107-3.toml").read_text())
MINE = {
    "device": [DEVICE | {"name": "mine", "brakes": DEVICE["brakes"] | {"A": "weak"}}, DEVICE | {"name": "other"}],
    "brake": [BRAKE | {"name": "weak", "k": [0.5 * k for k in BRAKE["k"]]}],
}


def protocol_file(folder: Path, **changes) -> Path:
    """The paper's protocol with devices of its own."""
    content = tomllib.loads((SHIPPED_FOLDER / "paper.toml").read_text())
    path = folder / "mine.toml"
    path.write_text(toml_text(content | {"devices": ["mine", "three-brake", "other"]} | MINE | changes))
    return path


def test_they_are_stored_in_full_and_come_back_without_the_file(tmp_path):
    path = protocol_file(tmp_path)
    stored = protocol_to_json(load_protocol(path))
    path.unlink()
    mine, before = protocol_from_json(stored, "stored").device("mine"), load_device("four-brake")
    assert mine.brakes.k[0].tolist() == (0.5 * before.brakes.k[0]).tolist()
    assert protocol_to_json(protocol_from_json(stored, "stored")) == stored


WRONG = {
    "brake missing": ({"brake": []}, "device 1: brakes: unknown brake 'weak'"),
    "two of one name": ({"device": MINE["device"] * 2}, "device: two have the same name (mine)"),
    "second of a list": (
        {"controller": [{"name": "a", "kind": "none"}, {"name": "b", "kind": "sdof", "gap_m": -1.0}]},
        "mine.toml: controller 2: gap_m must be at least 0, not -1.0",
    ),
    "no encoders": (
        {"device": [{k: v for k, v in one.items() if k != "sensing"} for one in MINE["device"]],
         "assumptions": {"sensing": "encoders"}},
        "device mine: has no encoders that give its tip",
    ),
}  # fmt: skip


@pytest.mark.parametrize("changes, says", WRONG.values(), ids=WRONG)
def test_a_wrong_one_is_refused_in_one_sentence(tmp_path, capsys, changes, says):
    path = protocol_file(tmp_path, **changes)
    assert says in refusal(capsys, "study", path, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


SWEEP = {
    "name": "combinations",
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
    rows = csv_rows(tmp_path / "out" / "sweep.csv")
    names = list(rows[0])
    known = {*FACTORS, "kind", *PARAMETERS, *MEASURED, "controller_name"}
    assert [name for name in names if name not in known] == ["lag_factor", "gap_reading"]
    assert names.index("lag_factor") == names.index("rules") + 1
    assert {(row["lag_factor"], row["gap_reading"], row["gap_m"]) for row in rows if row["kind"] == "sdof"} == {
        ("0.5", "half", "0.004"), ("0.5", "full", "0.002"), ("1.0", "half", "0.004"), ("1.0", "full", "0.002")
    }  # fmt: skip
    error = {(row["kind"], row["lag_factor"], row["gap_reading"], row["path"]): row["path_error_m"] for row in rows}
    assert error["sdof", "1.0", "half", "1"] != error["sdof", "1.0", "full", "1"]
    assert error["none", "1.0", "half", "1"] == error["none", "1.0", "full", "1"] == error["none", "0.5", "half", "1"]
    stored = load_sweep(sweep_file(tmp_path)).texts
    assert "device mine" in stored and "brake weak of mine" in stored


GERMAN = (FOLDER / "de.toml").read_text(encoding="utf-8")
PAPER = (SHIPPED_FOLDER / "paper.toml").read_text(encoding="utf-8")


def with_lines(folder: Path, *lines: str, text: str = PAPER) -> Path:
    """A protocol file that begins with these lines."""
    path = folder / "mine.toml"
    path.write_text("\n".join(lines) + "\n" + text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (GERMAN.replace("hold = ", "hald = "), "hold is missing"),
        (GERMAN.replace("{seconds} Sekunden", "Sekunden"), "time must be a text"),
        ("hold = " + "[" * 3000, "mine.toml: is not valid TOML"),
    ],
)
def test_a_translation_that_lacks_a_sentence_or_a_placeholder_is_refused(text: str, what: str) -> None:
    with pytest.raises(InputError, match=what):
        read_language(text, "mine.toml")


def test_a_protocol_takes_a_shipped_language_or_a_file_and_keeps_it_when_the_file_is_gone(tmp_path: Path) -> None:
    assert load_protocol().sentences["go"] == "Go"
    assert load_protocol(with_lines(tmp_path, 'language = "de"')).sentences["go"] == "Los"
    own = tmp_path / "nl.toml"
    own.write_text(GERMAN.replace('go = "Los"', 'go = "Start"'), encoding="utf-8")
    stored = protocol_to_json(load_protocol(with_lines(tmp_path, 'language = "nl.toml"')))
    own.unlink()
    assert protocol_from_json(stored, "session.db").sentences["go"] == "Start"
    with pytest.raises(InputError, match="mine.toml: language: unknown language 'nl.toml'"):
        load_protocol(tmp_path / "mine.toml")


def test_instructions_keep_their_pictures_and_a_file_that_is_not_there_is_named_with_its_place(
    tmp_path: Path,
) -> None:
    picture = b"\x89PNG\r\n\x1a\n and so on"
    (tmp_path / "grip.png").write_bytes(picture)
    pages = '\n[[instruction]]\ntext = "Hold the handle."\npicture = "grip.png"\n[[instruction]]\ntext = "Go on."\n'
    path = with_lines(tmp_path, text=PAPER + pages)
    stored = protocol_to_json(load_protocol(path))
    (tmp_path / "grip.png").unlink()
    assert protocol_from_json(stored, "session.db").pages == (("Hold the handle.", picture), ("Go on.", b""))
    with pytest.raises(InputError, match="instruction: .*grip.png: no such file"):
        load_protocol(path)
    with pytest.raises(InputError, match="instruction: picture: the path is not valid"):
        load_protocol(with_lines(tmp_path, text=PAPER + pages.replace("grip", "\\u0000")))
    drawn = '\n[[path]]\nkind = "drawing"\nfile = "sprial.svg"\nwidth_m = 0.1\ncentre_m = [0.0, 0.4]\n'
    with pytest.raises(InputError, match=r"\.toml: path 3: .*sprial\.svg: cannot be read \(no such file"):
        load_protocol(with_lines(tmp_path, text=PAPER + drawn))


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
    save_protocol(file, protocol_text(shipped("paper")))
    first = file.read_bytes()
    with pytest.raises(InputError, match=r"mine\.toml: exists already"):
        save_protocol(file, protocol_text(shipped("displays")))
    assert file.read_bytes() == first
    save_protocol(file, protocol_text(shipped("displays")), replacing=True)
    assert load_protocol(file).name == "displays" and [path.name for path in tmp_path.iterdir()] == ["mine.toml"]
