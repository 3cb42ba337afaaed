"""`phd doctor`: every line says what was found and, where something is wrong, what to do."""

import json
import os
from pathlib import Path

import pytest
from disks import flip_a_bit, full
from packaging.requirements import Requirement

from app import doctor
from app.cli import main
from app.ipc.messages import BAD, CAUTION, GOOD, Check
from app.ipc.scheduling import stolen_share
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


def test_where_pip_installed_the_program_the_libraries_asked_for_are_the_same(monkeypatch, tmp_path) -> None:
    beside_source = {need.name for need in doctor.wanted_libraries()}
    monkeypatch.setattr(doctor, "PYPROJECT", tmp_path / "none")
    assert {need.name for need in doctor.wanted_libraries()} == beside_source


@pytest.mark.parametrize(
    ("answer", "states"),
    [
        ([["A", 1920, 1080, 1.0, 60.0], ["B", 1920, 1080, 1.0, 60.0]], [GOOD, GOOD]),
        ([["A", 1920, 1080, 1.0, 60.0]], [GOOD, CAUTION]),
        ([["A", 1024, 600, 2.0, 60.0], ["B", 1920, 1080, 1.0, 60.0]], [CAUTION, GOOD]),
        ([["A", 1024, 600, 1.0, 60.0], ["B", 1920, 1080, 1.0, 60.0]], [CAUTION, GOOD]),
    ],
)
def test_screens_that_are_few_or_small_are_a_caution(monkeypatch, answer, states) -> None:
    tried = type("Tried", (), {"returncode": 0, "stdout": json.dumps(answer), "stderr": ""})
    monkeypatch.setattr(doctor.subprocess, "run", lambda *_, **__: tried)
    lines = doctor.screens()
    assert [line.state for line in lines] == states
    assert ("scale" in lines[0].advice) == (answer[0][1] < 1280 and answer[0][3] > 1.0)  # lowering 1 is no help


def test_without_a_screen_that_is_bad_and_says_what_still_works(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = type("Tried", (), {"returncode": -6, "stdout": "", "stderr": "aborted"})
    monkeypatch.setattr(doctor.subprocess, "run", lambda *_, **__: tried)
    (line,) = doctor.screens()
    assert line.state == BAD and "without" in line.advice


def test_kernels_are_compiled_once_those_of_a_trial_are_whatever_else_is(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, state in (("start", CAUTION), ("run_trial", GOOD)):
        monkeypatch.setattr(doctor, "is_compiled", lambda kernel, name=name: kernel == name)
        assert doctor.kernels().state == state


def test_kernels_of_other_versions_are_counted(tmp_path: Path) -> None:
    assert doctor.of_other_versions(tmp_path / "this") == ""
    (tmp_path / "older").mkdir()
    (tmp_path / "older" / "a.kernel").write_bytes(bytes(2_000_000))
    said = "; 1 of other versions there (2 MB), removed when unused for 60 days"
    assert doctor.of_other_versions(tmp_path / "this") == said


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


@pytest.mark.parametrize(
    ("states", "first"),
    [
        ({}, ""),
        ({"kernels": CAUTION, "screens": CAUTION}, ""),  # neither makes ticks late
        ({"load": CAUTION}, "load"),
        ({"load": CAUTION, "scheduling": CAUTION}, "scheduling"),
        ({"scheduling": CAUTION, "cores": CAUTION}, "cores"),
        ({"cores": CAUTION, "host": CAUTION, "scheduling": CAUTION}, "host"),
        ({"host": CAUTION, "libraries": BAD}, "libraries"),
    ],
)
def test_one_change_is_named_that_helps_most(states: dict[str, str], first: str) -> None:
    names = ("libraries", "screens", "scheduling", "cores", "host", "load", "kernels")
    checks = [Check(name, states.get(name, GOOD), "so", f"Mend {name}." if name in states else "") for name in names]
    most = doctor.first_change(checks)
    if first:
        assert (most.state, most.text, most.advice) == (CAUTION, f"what helps most: {first}", f"Mend {first}.")
    else:
        assert (most.state, most.advice) == (GOOD, "")


def test_the_report_ends_with_the_change_that_helps_most(quick, tmp_path: Path) -> None:
    quick.setattr(doctor, "stolen_share", lambda: 0.2)
    assert doctor.examine(tmp_path, doctor.look_around())[-1].text == "what helps most: host"


@pytest.mark.parametrize(
    ("stat", "text", "state"),
    [
        ("cpu  100 0 100 700 0 0 0 100 0 0\n", "10.0 %", CAUTION),
        ("cpu  100 0 100 795 0 0 0 5 0 0\n", "0.5 %", GOOD),
        ("cpu  100 0 100 800 0 0 0 0 0 0\n", "0.0 %", GOOD),
        ("intr 5\n", "not known", GOOD),
        (None, "not known", GOOD),
    ],
)
def test_what_the_host_keeps_is_told_or_not_known(stat: str | None, text: str, state: str) -> None:
    def read(path: str) -> str:
        if stat is None:
            raise FileNotFoundError(path)
        return stat

    line = doctor.host(stolen_share(read))
    assert text in line.text and line.state == state


def test_more_programs_than_cores_are_a_caution_and_a_system_that_does_not_count_says_so(monkeypatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    for running, state in ((4.0, GOOD), (4.5, CAUTION)):
        monkeypatch.setattr(os, "getloadavg", lambda running=running: (running, 0.0, 0.0), raising=False)
        assert doctor.load().state == state
    monkeypatch.delattr(os, "getloadavg")
    assert "not known" in doctor.load().text
