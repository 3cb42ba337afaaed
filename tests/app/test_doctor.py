"""`phd doctor`: every line says what was found and, where something is wrong, what to do; what is attached."""

import json
import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from disks import flip_a_bit
from emulated import Emulated
from packaging.requirements import Requirement

from app import doctor
from app.cli import main
from app.doctor import UDEV_RULE, Around, hand_checks, port_checks
from app.ipc.messages import BAD, CAUTION, GOOD, Check
from core.files import InputError
from core.kernels.cache import Place, write_file
from hardware import discovery
from hardware.emulated_board.plug import LOOPBACK

NAVIGATOR = {"path": b"/dev/hidraw77", "vendor_id": 0x046D, "product_id": 0xC626, "usage_page": 1, "usage": 8,
             "product_string": "SpaceNavigator"}  # fmt: skip
TEENSY = SimpleNamespace(device="/dev/ttyACM9", vid=0x16C0, pid=0x0483, serial_number="123", product="USB Serial",
                         description="USB Serial")  # fmt: skip


@pytest.fixture
def nothing(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [])
    monkeypatch.setattr(discovery, "list_hid", lambda: [])
    for slow in ("screens", "scheduling", "libraries", "kernels"):
        well = Check(slow, GOOD, "well")
        monkeypatch.setattr(doctor, slow, lambda well=well: [well] if well.name == "screens" else well)
    return monkeypatch


@pytest.fixture
def dead_port() -> Iterator[str]:
    """A port at which nobody is: a pseudo-terminal, or where there is none a TCP port."""
    if not hasattr(os, "openpty"):
        with socket.create_server((LOOPBACK, 0)) as silent:
            yield f"socket://{LOOPBACK}:{silent.getsockname()[1]}"
        return
    import tty

    ours, theirs = os.openpty()
    tty.setraw(theirs)
    yield os.ttyname(theirs)
    os.close(ours)
    os.close(theirs)


def said(capsys: pytest.CaptureFixture, *arguments: str) -> tuple[int, list[str]]:
    """The exit code, and the lines on what is attached with their advice."""
    code = main(["doctor", "--data-dir", str(Path(os.environ["TMPDIR"], "none")), *arguments])
    lines = capsys.readouterr().out.splitlines()
    begins, ends = (
        next(n for n, line in enumerate(lines) if line[4:].startswith(name)) for name in ("serial", "first")
    )
    return code, lines[begins:ends]


def listed(capsys: pytest.CaptureFixture, *arguments: str) -> tuple[int, dict]:
    """The exit code, and what --json prints."""
    code = main(["doctor", "--data-dir", str(Path(os.environ["TMPDIR"], "none")), "--json", *arguments])
    return code, json.loads(capsys.readouterr().out)


def test_nothing_attached_is_said_plainly_and_no_failure(nothing, capsys: pytest.CaptureFixture) -> None:
    code, (port, hand) = said(capsys)
    assert code == 0 and "nothing attached" in port and "no six-axis device attached" in hand
    code, found = listed(capsys)
    assert code == 0 and {**found, "checks": []} == {"checks": [], "ports": [], "boards": [], "hands": []}
    assert [line.state for line in (*port_checks([]), *hand_checks(Around([], [], [])))] == [GOOD, GOOD]


def test_what_is_attached_has_a_line_each_with_its_identity(nothing, capsys: pytest.CaptureFixture) -> None:
    nothing.setattr("serial.tools.list_ports.comports", lambda: [TEENSY])
    nothing.setattr(discovery, "list_hid", lambda: [NAVIGATOR])
    code, lines = said(capsys)
    port, hand = lines[0], lines[-1]
    assert code == 0 and "/dev/ttyACM9: 16c0:0483 123 USB Serial" in port
    assert (port[:2] == "--") == (os.name == "posix")  # Windows' ports are open to all
    assert "/dev/hidraw77: 046d:c626 SpaceNavigator" in hand
    code, found = listed(capsys)
    assert found["ports"] == [{"port": "/dev/ttyACM9", "usb": "16c0:0483", "serial": "123", "name": "USB Serial",
                               "allowed": os.name != "posix"}]  # fmt: skip
    assert found["hands"][0]["ids"] == "046d:c626"


def test_rights_that_are_missing_come_with_what_to_type(nothing, tmp_path: Path) -> None:
    (line,) = port_checks([discovery.SerialPort("/dev/ttyACM9", "16c0:0483", "123", "USB Serial", False)])
    assert line.state == CAUTION and (sys.platform != "linux" or "usermod -aG dialout" in line.advice)
    hand = discovery.HidDevice("/dev/hidraw7", "046d:c626", "S", False)
    (line,) = hand_checks(Around([], [], [hand]))
    assert line.state == CAUTION and UDEV_RULE in line.advice

    def broken():
        raise InputError("six-axis devices cannot be read: no library")

    nothing.setattr("app.doctor.hid_devices", broken)
    (line,) = hand_checks(doctor.look_around())
    assert line.state == CAUTION and "no library" in line.text


def test_a_dead_port_says_that_no_board_answers_and_what_to_do_about_it(nothing, dead_port, capsys) -> None:
    nothing.setattr("hardware.serial_device.HELLO_S", 0.3)
    code, (_, board, advice, _) = said(capsys, "--port", dead_port)
    assert code == 1 and board.startswith("NO  board ") and board.endswith(f"{dead_port}: no board answers there")
    assert "that the board has power" in advice


def test_the_emulated_board_says_who_it_is_and_one_in_use_is_left_alone(nothing, tmp_path, capsys, monkeypatch) -> None:
    emulated = Emulated(tmp_path, "--device", "three-brake", "--seed", "9")
    port = emulated.port
    monkeypatch.setattr("hardware.serial_device.HELLO_S", 60.0)
    code, found = listed(capsys, "--port", port)
    (board,) = found["boards"]
    assert code == 0 and board["problem"] == "" and board["device"] == "three-brake"
    assert board["board"] == "EMULATED-9" and board["encoders"] == {"A": 96000, "B": 96000}
    assert set(board["brakes"]) == {"A", "E", "B"} and board["force_channels"] == 6 and board["state"] == "Idle"
    wire = discovery.Port(port)
    code, lines = said(capsys, "--port", port)
    wire.close()
    assert code == 1 and f"{port}: another program is using it" in lines[1]
    code, lines = said(capsys, "--port", port)
    assert code == 0 and lines[1].startswith("ok  board") and "EMULATED-9, wired to three-brake" in lines[1]
    assert emulated.end() == 0


def test_a_machine_that_is_fit_gives_0_and_one_that_is_not_1(nothing, tmp_path: Path, capsys) -> None:
    assert main(["doctor", "--data-dir", str(tmp_path), "--json"]) == 0
    lines = json.loads(capsys.readouterr().out)["checks"]
    assert {line["name"] for line in lines} >= {"libraries", "screens", "scheduling", "cores", "Disk", "kernels"}
    nothing.setattr(doctor, "scheduling", lambda: Check("scheduling", BAD, "could not be tried", "Reinstall."))
    assert main(["doctor", "--data-dir", str(tmp_path)]) == 1
    out = capsys.readouterr().out
    assert "NO  scheduling" in out and "Reinstall." in out
    assert list(tmp_path.iterdir()) == [], "it changes nothing"


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
