"""Which serial port is opened, and found again after the cable was out."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import serial
from simulated_bench import DEVICE, Bench, BenchWire

from core.device_interface import DeviceError
from core.files import InputError
from hardware.serial_device import SerialDevice
from hardware.serial_port import ST_LINK_BAUD, Port, find_port, link_of, usb_ports


def usb(
    name: str, serial: str | None = "B-7", location: str | None = None, product: int = 1, vendor: int = 0x1209
) -> SimpleNamespace:
    """A port as pyserial lists it."""
    return SimpleNamespace(device=name, vid=vendor, pid=product, serial_number=serial, location=location)


class Listed:
    """What the system lists now."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        patch.setattr("hardware.serial_port.list_ports.comports", lambda: self.ports)
        self.ports: list[SimpleNamespace] = []

    def __call__(self, *ports: SimpleNamespace) -> None:
        self.ports = list(ports)


@pytest.fixture
def listed(monkeypatch: pytest.MonkeyPatch) -> Listed:
    return Listed(monkeypatch)


@pytest.mark.parametrize("places", [(None, None), ("1-2:1.0", "1-2:1.2")])
def test_the_port_that_was_asked_for_is_opened_where_two_look_alike(listed: Listed, places: tuple) -> None:
    listed(usb("/dev/ttyACM0", location=places[0]), usb("/dev/ttyACM1", location=places[1]))
    bench, opened = Bench(), []
    for name in ("/dev/ttyACM1", "/dev/ttyACM0"):
        link = SerialDevice(DEVICE, name, open_port=lambda n: (opened.append(n), BenchWire(bench, n))[1])
        link.open()
        link.close()
    assert opened == ["/dev/ttyACM1", "/dev/ttyACM0"]


def test_a_board_that_is_back_under_another_name_is_found_by_its_serial_number_in_any_socket(listed: Listed) -> None:
    listed(usb("/dev/ttyACM0", "B-7", "1-2:1.0"), usb("/dev/ttyACM1", "B-8", "1-3:1.0"))
    board = usb_ports()["/dev/ttyACM0"]
    listed(usb("/dev/ttyACM1", "B-8", "1-3:1.0"), usb("/dev/ttyACM2", "B-7", "1-4.1:1.0"))
    assert find_port("/dev/ttyACM0", board) == "/dev/ttyACM2"


def test_of_a_device_with_two_ports_the_same_one_is_found_again_though_their_names_have_changed(listed: Listed) -> None:
    listed(usb("/dev/ttyACM0", location="1-2:1.0"), usb("/dev/ttyACM1", location="1-2:1.2"))
    second = usb_ports()["/dev/ttyACM1"]
    listed(usb("/dev/ttyACM1", location="1-2:1.0"), usb("/dev/ttyACM2", location="1-2:1.2"))
    assert find_port("/dev/ttyACM1", second) == "/dev/ttyACM2"


def test_two_ports_that_both_look_like_the_one_that_is_gone_are_refused(listed: Listed) -> None:
    listed(usb("/dev/ttyACM0"), usb("/dev/ttyACM1"))
    board = usb_ports()["/dev/ttyACM0"]
    listed(usb("/dev/ttyACM1"), usb("/dev/ttyACM2"))
    with pytest.raises(InputError, match="ttyACM0: it is gone, and /dev/ttyACM1 and /dev/ttyACM2 both look like it"):
        find_port("/dev/ttyACM0", board)


def test_an_adapter_without_number_is_never_taken_for_its_twin_in_another_socket(listed: Listed) -> None:
    listed(usb("/dev/ttyUSB0", None, "1-2"), usb("/dev/ttyUSB1", None, "1-3"))
    first = usb_ports()["/dev/ttyUSB0"]
    listed(usb("/dev/ttyUSB1", None, "1-3"))
    assert find_port("/dev/ttyUSB0", first) == "/dev/ttyUSB0", "it is away: opening it says so"
    listed(usb("/dev/ttyUSB1", None, "1-3"), usb("/dev/ttyUSB2", None, "1-2"))
    assert find_port("/dev/ttyUSB0", first) == "/dev/ttyUSB2"
    listed(usb("/dev/ttyUSB0", None, "1-4"), usb("/dev/ttyUSB1", None, "1-3"))
    assert find_port("/dev/ttyUSB0", first) == "/dev/ttyUSB0", "somebody has moved its plug"


def test_of_two_that_look_alike_the_other_is_not_opened_while_the_one_is_away(listed: Listed) -> None:
    listed(usb("/dev/ttyACM0"), usb("/dev/ttyACM1"))
    bench, opened = Bench(), []
    link = SerialDevice(DEVICE, "/dev/ttyACM0", open_port=lambda n: (opened.append(n), BenchWire(bench, n))[1])
    link.open()
    listed(usb("/dev/ttyACM1"))
    bench.plugged = False
    assert link.exchange((0.0,) * 4) is None and link.problem
    bench.plugged = True
    while link.problem:
        link.exchange((0.0,) * 4)
    link.close()
    assert set(opened) == {"/dev/ttyACM0"}


def test_another_device_that_has_got_the_name_is_not_opened_and_a_port_that_is_not_on_usb_is_its_name(listed) -> None:
    listed(usb("/dev/ttyACM0"))
    board = usb_ports()["/dev/ttyACM0"]
    listed(usb("/dev/ttyACM0", "M-1", product=2))
    with pytest.raises(InputError, match="ttyACM0: another device has this name now"):
        find_port("/dev/ttyACM0", board)
    assert find_port("/dev/ttyS0") == find_port("/dev/ttyS0", board._replace(serial="gone")) == "/dev/ttyS0"


@pytest.mark.parametrize(
    ("port", "vendor", "product", "words", "baud"),
    [
        ("/dev/ttyACM0", 0x1209, 0x0001, "USB", 921_600),
        ("/dev/ttyACM0", 0x0483, 0x5740, "USB", 921_600),  # a board's own port, of the same maker as the ST-LINK
        ("/dev/ttyACM0", 0x0483, 0x374B, "UART at 2000 kbaud, by an ST-LINK", 2_000_000),
        ("/dev/ttyUSB0", 0x0403, 0x6001, "UART at 921.6 kbaud, by an adapter (FTDI)", 921_600),
        ("/dev/ttyUSB1", 0x10C4, 0xEA60, "UART at 921.6 kbaud, by an adapter (CP210x)", 921_600),
        ("/dev/ttyS0", None, None, "UART at 921.6 kbaud", 921_600),
        ("/dev/pts/3", None, None, "pseudo-terminal", 921_600),
        ("socket://127.0.0.1:4000", None, None, "TCP", 921_600),
    ],
)
def test_the_port_says_what_carries_the_bytes_and_at_which_baud_rate_it_is_opened(
    port: str, vendor: int | None, product: int, words: str, baud: int, listed: Listed, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed(*([usb(port, vendor=vendor, product=product)] if vendor else []))
    opened = []

    def opens(name: str, rate: int, **how) -> None:
        opened.append((name, rate))
        raise serial.SerialException("not there")

    monkeypatch.setattr("hardware.serial_port.serial.serial_for_url", opens)
    with pytest.raises(DeviceError):
        Port(port)
    assert opened == [(port, baud)] and link_of(port).words == words


def test_the_firmware_s_uart_has_the_rate_of_the_port_that_it_is_wired_to() -> None:
    """Its clock of 42 MHz divides to it exactly, as the ST-LINK's of 36 MHz does."""
    uart = (Path(__file__).resolve().parents[2] / "hardware" / "firmware" / "stm32f4" / "host_uart.c").read_text()
    assert f"BAUD = {ST_LINK_BAUD} }}" in uart and 42_000_000 % ST_LINK_BAUD == 36_000_000 % ST_LINK_BAUD == 0
