"""The serial port over USB (hardware/firmware/stm32f4/host_usb.c) against a model of the USB core and a host, on this
machine. The model is made from the reference manual: what the core itself does has not been seen.
"""

import ctypes
import struct
from collections import deque
from pathlib import Path

import pytest
from reference_board import SOURCES, compiled, needs_compiler

pytestmark = needs_compiler

GINTSTS, GRSTCTL, GRXSTSP, DCFG = 0x014, 0x010, 0x020, 0x800
RESET, ENUMERATED, RECEIVED, STALL, ENABLE = 1 << 12, 1 << 13, 1 << 4, 1 << 21, 1 << 31
STROBES = 1 << 26 | 1 << 27 | 1 << 28  # of an endpoint: done at once, and read as 0
IN, OUT, FREE, FIFO = 0x900, 0xB00, 0x918, 0x1000
GOT_DATA, OUT_DONE, SETUP_DONE, GOT_SETUP = 2, 3, 4, 6
STUB = """
#include "board.h"
uint32_t (*otg_get)(uint32_t at);
void (*otg_set)(uint32_t at, uint32_t value);
static const phd_capability made_of = {.serial = "0123456789ABCDEF"};
const phd_capability *capability(void) { return &made_of; }
"""


class Core:
    """The registers, and what a host does through them."""

    def __init__(self, port: ctypes.CDLL) -> None:
        self.port, self.registers = port, {}
        self.told: deque[tuple[int, bytes]] = deque()  # of the receive FIFO: status, then its bytes
        self.words: deque[int] = deque()  # of the packet that is being read
        self.written: dict[int, bytes] = {0: b"", 1: b"", 2: b""}  # to the FIFO of each endpoint
        self._functions = (
            ctypes.CFUNCTYPE(ctypes.c_uint32, ctypes.c_uint32)(self.get),
            ctypes.CFUNCTYPE(None, ctypes.c_uint32, ctypes.c_uint32)(self.set),
        )
        for name, function in zip(("otg_get", "otg_set"), self._functions, strict=True):
            ctypes.c_void_p.in_dll(port, name).value = ctypes.cast(function, ctypes.c_void_p).value
        port.host_begin()

    def get(self, at: int) -> int:
        if at == GRXSTSP:
            status, data = self.told.popleft()
            assert not self.words, "a packet was not read to its end"
            padded = data + bytes(-len(data) % 4)
            self.words.extend(struct.unpack(f"<{len(padded) // 4}I", padded))
            return status
        if at == FIFO:
            return self.words.popleft()
        if at == GRSTCTL:
            return 0
        if IN <= at < OUT and at % 0x20 == FREE % 0x20:
            return 128 - (len(self.written[(at - FREE) // 0x20]) + 3) // 4
        return self.registers.get(at, 0) | (RECEIVED if at == GINTSTS and self.told else 0)

    def set(self, at: int, value: int) -> None:
        if at == GINTSTS:
            self.registers[at] = self.registers.get(at, 0) & ~value
        elif at >= FIFO:
            self.written[(at - FIFO) // 0x1000] += value.to_bytes(4, "little")
        else:
            endpoint = IN <= at < 0xC00 and at % 0x20 == 0
            self.registers[at] = value & ~STROBES if endpoint else value

    def hears(self, *told: tuple[int, int, bytes]) -> None:
        """Kind, endpoint and bytes come into the receive FIFO."""
        self.told.extend((kind << 17 | len(data) << 4 | endpoint, data) for kind, endpoint, data in told)
        self.port.host_poll()
        assert not self.told

    def taken(self, endpoint: int) -> bytes:
        """What waits for the host, which takes it."""
        at = IN + 0x20 * endpoint
        assert self.registers[at] & ENABLE, "nothing is sent"
        size = self.registers[at + 0x10]
        packets, n = size >> 19 & 0x3FF, size & 0x7FFFF
        assert packets == max(1, -(-n // 64)) and n <= len(self.written[endpoint]) < n + 4
        self.registers[at] &= ~ENABLE
        data, self.written[endpoint] = self.written[endpoint][:n], b""
        return data

    def asks(self, kind: int, request: int, value: int = 0, length: int = 0, data: bytes = b"") -> bytes | None:
        """A control transfer: the answer, None where it is refused."""
        self.registers[IN] = self.registers.get(IN, 0) & ~STALL
        setup = struct.pack("<BBHHH", kind, request, value, 0, length)
        self.hears((GOT_SETUP, 0, setup), (SETUP_DONE, 0, b""))
        if self.registers[IN] & STALL:
            return None
        assert self.registers[OUT] & ENABLE, "it must hear what comes next"
        if data:
            self.hears((GOT_DATA, 0, data), (OUT_DONE, 0, b""))
        answer = self.taken(0)
        if kind & 0x80:  # the host says that it has the answer
            self.hears((GOT_DATA, 0, b""), (OUT_DONE, 0, b""))
        return answer

    def begins(self) -> None:
        """Plugged in."""
        for what in (RESET, ENUMERATED):
            self.registers[GINTSTS] = what
            self.port.host_poll()
            assert self.registers[GINTSTS] == 0

    def connects(self) -> None:
        """As far as a host goes until the port can be opened."""
        self.begins()
        assert self.asks(0, 5, 9) == b"" and self.registers[DCFG] >> 4 & 0x7F == 9
        assert self.asks(0, 9, 1) == b"" and self.asks(0x80, 8, length=1) == b"\1"

    def sends(self, data: bytes) -> None:
        """Data to the board, in packets."""
        for k in range(0, len(data), 64):
            assert self.registers[OUT + 0x20] & ENABLE, "it takes nothing"
            self.registers[OUT + 0x20] &= ~ENABLE
            self.hears((GOT_DATA, 1, data[k : k + 64]), (OUT_DONE, 1, b""))

    def read(self) -> bytes:
        """What the firmware has of it."""
        room = ctypes.create_string_buffer(2048)
        n = self.port.host_read(room, ctypes.c_size_t(2048))
        return room.raw[:n]

    def send(self, frame: bytes) -> None:
        """By the firmware."""
        self.port.phd_send(frame, ctypes.c_size_t(len(frame)))
        self.port.host_poll()


@pytest.fixture
def core(tmp_path: Path) -> Core:
    (tmp_path / "stub.c").write_text(STUB)
    (tmp_path / "host_usb.c").symlink_to(SOURCES / "stm32f4" / "host_usb.c")
    include = (f"-I{SOURCES}", f"-I{SOURCES / 'stm32f4'}", "-DOTG_MODEL", "-shared", "-fPIC")
    return Core(ctypes.CDLL(str(compiled(tmp_path, "usb.so", *include, sources="*.c", at=tmp_path))))


def test_it_says_that_it_is_a_serial_port(core: Core) -> None:
    core.begins()
    device = core.asks(0x80, 6, 0x100, 64)
    assert device is not None and len(device) == device[0] == 18 and device[4] == 2
    assert core.asks(0x80, 6, 0x100, 8) == device[:8]
    whole = core.asks(0x80, 6, 0x200, 255)
    assert whole is not None and len(whole) == struct.unpack("<H", whole[2:4])[0] == 67
    parts, at = [], 0
    while at < len(whole):
        parts.append(whole[at : at + whole[at]])
        at += whole[at]
    assert at == len(whole) and sum(part[1] == 4 for part in parts) == whole[4] == 2
    assert [(part[2], part[3]) for part in parts if part[1] == 5] == [(0x82, 3), (1, 2), (0x81, 2)]
    assert core.asks(0x80, 6, 0x300, 255) == bytes([4, 3, 9, 4])
    serial = core.asks(0x80, 6, 0x303, 255)
    assert serial is not None and serial[2:].decode("utf-16-le") == "0123456789ABCDEF"
    assert core.asks(0x80, 6, 0x600, 10) is None and core.asks(0x40, 1) is None


def test_bytes_go_both_ways_and_none_is_lost_or_waits(core: Core) -> None:
    core.send(b"nobody has opened it")
    core.connects()
    coding = struct.pack("<IBBB", 115_200, 0, 0, 8)
    assert core.asks(0x21, 0x20, length=7, data=coding) == b"" and core.asks(0xA1, 0x21, length=7) == coding
    assert core.asks(0x21, 0x22, 3) == b""
    for n in (1, 28, 63, 64, 65, 128, 200):
        sent = bytes(k % 251 for k in range(n))
        core.sends(sent)
        assert core.read() == sent
    for n in (1, 51, 69, 64, 128, 130):
        frame = bytes((7 * k) % 251 for k in range(n))
        core.send(frame)
        first = core.taken(1)
        assert len(first) % 64, "a full packet at the end would let the host wait for more"
        core.port.host_poll()
        assert first + (core.taken(1) if len(first) < n else b"") == frame
    for k in range(40):  # the host takes nothing for a while: whole frames are lost, and nobody waits
        core.send(bytes([k]) * 69)
    came = b""
    while core.registers[IN + 0x20] & ENABLE:
        came += core.taken(1)
        core.port.host_poll()
    assert came and all(came[k : k + 69] == bytes([came[k]]) * 69 for k in range(0, len(came), 69))


def test_it_takes_no_more_than_it_has_room_for_and_begins_anew_after_a_reset(core: Core) -> None:
    core.connects()
    taken = b""
    while core.registers[OUT + 0x20] & ENABLE:
        core.sends(bytes([len(taken) // 64]) * 64)
        taken += bytes([len(taken) // 64]) * 64
    assert 512 <= len(taken) < 1024 and core.read() == taken
    core.port.host_poll()
    assert core.registers[OUT + 0x20] & ENABLE
    core.send(b"old")
    core.connects()
    core.written[1] = b""  # the reset emptied it
    core.registers[IN + 0x20] &= ~ENABLE
    core.send(b"new")
    assert core.taken(1) == b"new"
