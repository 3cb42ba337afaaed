"""A serial port that is the address of a TCP port, and the emulated board's plug at its other end."""

import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from waiting import wait_until

from core.device_interface import DeviceError
from core.files import InputError
from hardware.emulated_board import plug
from hardware.emulated_board.plug import CONTROL, LOOPBACK, PORT, TcpPort, emulated_ports
from hardware.serial_port import Port, is_address, is_missing

FRAME = bytes(range(1, 67)) + b"\0"
PATIENT_S = 30.0


@pytest.fixture
def board(tmp_path: Path) -> Iterator[TcpPort]:
    board = TcpPort(tmp_path)
    yield board
    board.close()


def joined(board: TcpPort) -> Port:
    """A host that the board has heard."""
    host = Port(board.address)
    host.write(b"hello")
    assert wait_until(board.read) == b"hello"
    return host


def test_bytes_go_both_ways_as_they_were_sent(board: TcpPort) -> None:
    host = joined(board)
    for _ in range(3):
        board.write(FRAME)
    assert wait_until(host.read) == 3 * FRAME
    began = time.monotonic()
    assert host.read() == b"" and time.monotonic() - began < PATIENT_S, "a read does not wait for what does not come"
    host.close()


def test_a_second_host_is_sent_away_and_the_first_is_not_disturbed(board: TcpPort) -> None:
    first, second = joined(board), Port(board.address)
    assert board.read() == b""
    with pytest.raises(DeviceError, match="another program is using it"):
        wait_until(second.read)
    board.write(FRAME)
    assert wait_until(first.read) == FRAME
    first.close()
    joined(board).close()
    second.close()


def test_an_unplugged_board_is_known_as_such_and_comes_back_at_its_address(board: TcpPort, tmp_path: Path) -> None:
    host, address, number = joined(board), board.address, board.number
    board.write(FRAME)
    assert wait_until(host.read) == FRAME
    board.close()
    with pytest.raises(DeviceError, match="the board was unplugged"):
        wait_until(host.read)
    host.close()
    with pytest.raises(DeviceError, match=f"serial port {address}: nothing listens there"):
        Port(address)
    again = TcpPort(tmp_path, number)
    assert again.address == address
    joined(again).close()
    again.close()


def test_a_host_that_does_not_read_never_holds_the_board_up_and_what_it_reads_later_is_whole(board: TcpPort) -> None:
    host, sent = joined(board), 20_000
    for _ in range(sent):
        board.write(FRAME)
    came = b""
    while data := host.read():
        came += data
    assert 0 < len(came) < sent * len(FRAME) and came.startswith(FRAME)
    host.close()


def test_a_board_that_does_not_read_never_holds_the_host_up(board: TcpPort) -> None:
    host = joined(board)
    began = time.monotonic()
    while not host.not_taken:
        host.write(FRAME)
        assert time.monotonic() - began < PATIENT_S
    host.close()


ADDRESSES = [
    ("socket://127.0.0.1:5000", True), ("socket://bench:65535", True), ("socket://127.0.0.1", False),
    ("socket://127.0.0.1:0", False), ("socket://127.0.0.1:65536", False), ("socket://a:1?logging=debug", False),
    ("loop://", False), ("/dev/ttyACM0", False), ("COM3", False),
]  # fmt: skip


@pytest.mark.parametrize(("name", "is_one"), ADDRESSES)
def test_what_an_address_is(name: str, is_one: bool) -> None:
    assert is_address(name) == is_one
    assert not (is_one and is_missing(name))
    if "://" in name and not is_one:
        with pytest.raises(DeviceError, match="an address must be socket://HOST:NUMBER"):
            Port(name)


def test_a_number_that_another_program_has_is_refused(board: TcpPort, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"TCP port {board.number} of this computer: "):
        TcpPort(tmp_path, board.number)


def test_a_board_that_was_killed_is_not_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plug.tempfile, "tempdir", str(tmp_path))
    folder = tmp_path / f"{plug.FOLDER}x"
    folder.mkdir()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as orders:
        orders.bind((LOOPBACK, 0))
        number = orders.getsockname()[1]
        (folder / CONTROL).write_text(str(number))
        (folder / PORT).write_text("socket://127.0.0.1:5000")
        assert emulated_ports() == {"socket://127.0.0.1:5000": number}
    assert emulated_ports() == {}
