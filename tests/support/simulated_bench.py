"""A board in simulated time with the simulated device behind it, and wires that a link can be plugged into."""

import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from core.device import Device, load_device
from core.device_interface import DeviceError
from core.faults import cause
from hardware.emulated_board.board import Board
from hardware.emulated_board.device import EmulatedDevice, EmulatedHand, HeldHand, hello_of
from hardware.emulated_board.line_faults import POWER, Line, LineFault, read_fault
from hardware.emulated_board.plug import TcpPort
from hardware.serial_device import SerialDevice
from hardware.serial_port import Port

DEVICE = load_device("four-brake")
TIP = (0.02, 0.40)
NO = (0.0,) * 4  # currents
WRAP_US = 1 << 32


class Bench:
    """A board with a simulated device, and the wires that are plugged into it; each read of a wire takes a tick."""

    def __init__(
        self, behind: Device = DEVICE, hand: EmulatedHand | None = None, board_began_us: int = 0,
        kind: type[Board] = Board, **hello,
    ) -> None:  # fmt: skip
        self.board = kind(hello_of(behind, "TEST")._replace(**hello))
        self.hand = hand or HeldHand(TIP)
        self.device = EmulatedDevice(behind, self.board.hello, self.hand, TIP, seed=1)
        self.faults: list[LineFault] = []
        self.to_host, self.to_board = Line(self.faults, 1, 0), Line(self.faults, 1, 1)
        self.ticks = self.last_current = 0
        self.board_began_us = board_began_us  # by its own clock
        self.heard: list[bytes] = []  # all that the host sent
        self.plugged = self.powered = True
        self.backlog = b""  # what waits for a host that was late
        self._acting: set[str] = set()  # kinds of faults
        self.tick()  # kernels are compiled, or loaded, before a host waits for an answer
        self.lock = threading.Lock()  # the link's thread that brings the board back reads as well

    @property
    def now_s(self) -> float:
        return 100.0 + 1e-3 * self.ticks

    def tick(self) -> bytes:
        """A millisecond; what arrives at the host's end."""
        self.ticks += 1
        acting = [fault for fault in self.faults if fault.acts(self.now_s)]
        self._plug_and_power({fault.kind for fault in acting})
        now_us = (self.board_began_us + 1000 * self.ticks) % WRAP_US
        if (data := self.to_board.take(self.now_s)) and self.powered:
            self.send(self.board.receive(data, now_us))
        readings = self.device.sense(self.board.currents, acting)
        force = readings.force[: self.board.hello.force_channels]
        if self.powered:
            self.send(self.board.tick(readings._replace(force=force), now_us))
        self.device.advance(self.board.currents)
        if any(self.board.currents):
            self.last_current = self.ticks
        return self.to_host.take(self.now_s)

    def _plug_and_power(self, kinds: set[str]) -> None:
        began, ended = kinds - self._acting, self._acting - kinds
        self._acting = kinds
        if "unplug" in began:
            self.plugged = False
            self.to_host.clear()
            self.to_board.clear()
        if off := began.intersection(POWER):
            self.powered = False
            self.board.lose_power(0, noticed="brown-out" in off)
            self.device.sensors.power_up()
        self.plugged |= "unplug" in ended
        if ended.intersection(POWER):
            self.powered = True
            self.board_began_us = -1000 * self.ticks

    def send(self, data: bytes) -> None:
        for frame in data.split(b"\0")[:-1]:
            self.to_host.put(frame + b"\0", self.now_s)

    def fault(self, text: str) -> None:
        self.faults.append(read_fault(text, self.now_s))


class BenchWire:
    """A wire to the bench."""

    def __init__(self, bench: Bench, name: str) -> None:
        self.bench, self.name, self.closed, self.not_taken = bench, name, False, 0
        self.check()
        bench.backlog = b""

    def check(self) -> None:
        if not self.bench.plugged or self.closed:
            raise DeviceError(cause("port", name=self.name, what="it is gone"))

    def read(self) -> bytes:
        self.check()
        with self.bench.lock:
            backlog, self.bench.backlog = self.bench.backlog, b""
            return backlog + self.bench.tick()

    def write(self, data: bytes) -> None:
        self.check()
        with self.bench.lock:
            self.bench.to_board.put(data, self.bench.now_s)
            self.bench.heard.append(data)

    def close(self) -> None:
        self.closed = True


class TcpWire:
    """The same by way of a TCP connection: between the emulated board's plug and the port that the app opens."""

    def __init__(self, bench: Bench, name: str) -> None:
        self.bench, self._folder = bench, tempfile.TemporaryDirectory()
        self._plug = TcpPort(Path(self._folder.name))
        if not bench.plugged:
            self._plug.close()
        self._port = Port(self._plug.address)
        self.name = self._port.name
        self._plug.read()  # it takes the host in
        bench.backlog = b""

    @property
    def not_taken(self) -> int:
        return self._port.not_taken

    def read(self) -> bytes:
        with self.bench.lock:
            data, self.bench.backlog = self.bench.backlog + self.bench.tick(), b""
        if self.bench.plugged:
            self._plug.write(data)
        else:
            self._plug.close()
        return self._port.read() if data or not self.bench.plugged else b""

    def write(self, data: bytes) -> None:
        self._port.write(data)
        if data := self._plug.read():
            with self.bench.lock:
                self.bench.to_board.put(data, self.bench.now_s)
                self.bench.heard.append(data)

    def close(self) -> None:
        self._plug.close()
        threading.Thread(target=self._port.close).start()  # pyserial waits for 0.3 s
        self._folder.cleanup()


def reached(bench: Bench, device: Device = DEVICE) -> SerialDevice:
    """The link of a bench, reached."""
    link = SerialDevice(
        device, "bench", clock=lambda: bench.now_s, open_port=lambda name: BenchWire(bench, name),
        sleep=lambda seconds: time.sleep(0.1 * seconds),
    )  # fmt: skip
    link.open()
    return link


def homed_link(bench: Bench) -> Iterator[SerialDevice]:
    """A link whose handle is homed, closed at the end, with nothing left that looks for the board."""
    link = reached(bench)
    link.home(TIP)
    yield link
    link.close()
    nothing_looks_for_the_board()


def nothing_looks_for_the_board() -> None:
    """An attempt to bring a board back that had begun when its link was closed is the last one."""
    for thread in threading.enumerate():
        if thread.name == "reconnect the board":
            thread.join(60.0)
            assert not thread.is_alive()


def run(link: SerialDevice, n: int, currents=NO) -> list:
    """The samples of n exchanges."""
    return [sample for _ in range(n) if (sample := link.exchange(currents)) is not None]
