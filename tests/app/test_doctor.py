"""`phd doctor`: every line says what was found and, where something is wrong, what to do."""

import json
from pathlib import Path

import pytest
from disks import flip_a_bit, full
from packaging.requirements import Requirement

from app import doctor
from app.cli import main
from app.ipc.messages import BAD, CAUTION, GOOD, Check
from app.session_server import preflight
from core.kernels.cache import Place, write_file


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Without the looks that take a process of their own."""
    monkeypatch.setattr(doctor, "screens", lambda: [Check("screen", GOOD, "one")])
    monkeypatch.setattr(doctor, "scheduling", lambda: Check("scheduling", GOOD, "real-time"))
    monkeypatch.setattr(doctor, "serial_ports", list)
    monkeypatch.setattr(doctor, "hid_devices", list)
    monkeypatch.setattr(doctor, "libraries", lambda: Check("libraries", GOOD, "all there"))
    monkeypatch.setattr(doctor, "kernels", lambda: Check("kernels", GOOD, "compiled"))
    return monkeypatch


def test_a_machine_that_is_fit_gives_0_and_one_that_is_not_1(quick, tmp_path: Path, capsys) -> None:
    assert main(["doctor", "--data-dir", str(tmp_path), "--json"]) == 0
    lines = json.loads(capsys.readouterr().out)["checks"]
    assert {line["name"] for line in lines} >= {"libraries", "screen", "scheduling", "cores", "Disk", "kernels"}
    quick.setattr(doctor, "scheduling", lambda: Check("scheduling", BAD, "could not be tried", "Reinstall."))
    assert main(["doctor", "--data-dir", str(tmp_path)]) == 1
    out = capsys.readouterr().out
    assert "NO  scheduling" in out and "Reinstall." in out
    assert list(tmp_path.iterdir()) == [], "it changes nothing"


def test_a_folder_that_does_not_exist_is_judged_by_where_it_would_be_and_not_made(tmp_path: Path) -> None:
    line = doctor.check_disk(tmp_path / "not" / "yet")
    assert line.state in (GOOD, CAUTION, BAD) and "GB free" in line.text
    assert not (tmp_path / "not").exists()


def test_a_folder_that_cannot_be_written_to_is_bad(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert doctor.check_disk(tmp_path / "file").state == BAD


def test_a_full_disk_is_told_with_what_to_do(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(preflight, "TOO_LOW", 10**18)
    full = doctor.check_disk(tmp_path)
    assert full.state == BAD and "Make room" in full.advice


@pytest.mark.parametrize(
    ("needs", "state", "says"),
    [
        (["numpy"], GOOD, "all there"),
        (["numpy>=999"], BAD, "not >=999"),
        (["no-such-library"], BAD, "no-such-library is missing"),
    ],
)
def test_a_library_that_is_missing_or_another_than_asked_for_is_named(monkeypatch, needs, state, says) -> None:
    monkeypatch.setattr(doctor, "wanted_libraries", lambda: [Requirement(need) for need in needs])
    line = doctor.libraries()
    assert line.state == state and says in line.text and bool(line.advice) == (state == BAD)


def test_damaged_kernels_are_named_and_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "cache_place", lambda: Place(tmp_path))
    monkeypatch.setattr(doctor, "is_compiled", lambda kernel: True)
    for name in "ab":
        write_file(tmp_path / "core" / f"{name}.kernel", b"code")
    assert doctor.kernels().state == GOOD
    flip_a_bit(tmp_path / "core" / "a.kernel")
    line = doctor.kernels()
    assert line.state == CAUTION and line.text.startswith("1 of the files") and "a.kernel: it is damaged" in line.text
    assert [file.name for file in tmp_path.rglob("*.kernel")] == ["b.kernel"] and doctor.kernels().state == GOOD


def test_kernels_that_cannot_be_kept_are_a_caution_that_says_why(tmp_path, monkeypatch) -> None:
    for place in (Place(tmp_path, "it belongs to another user"), Place(None, "it belongs to another user")):
        monkeypatch.setattr(doctor, "cache_place", lambda place=place: place)
        line = doctor.kernels()
        assert line.state == CAUTION and "it belongs to another user" in line.text
    monkeypatch.setattr(doctor, "cache_place", lambda: Place(tmp_path))
    monkeypatch.setattr("core.kernels.cache.tempfile.TemporaryFile", full)
    line = doctor.kernels()
    assert line.state == CAUTION and "No space left on device" in line.text and "Make room" in line.advice
