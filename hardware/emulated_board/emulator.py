"""The emulated board: the board's state machine with the simulated device behind it, plugged in at 1 kHz.

For a host it differs from a board on the bench by its serial number alone. It keeps its own time: if the machine delays
it for long, its time stands still meanwhile (a real board is not delayed), and the log says so.
"""

import json
import math
import select
import socket
import tempfile
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from core.device import Device
from core.files import InputError
from core.tick_log import TICK_S
from hardware.emulated_board.board import ZERO, Board
from hardware.emulated_board.device import EmulatedDevice, EmulatedHand, hello_of
from hardware.emulated_board.line_faults import POWER, Line, LineFault, read_fault
from hardware.emulated_board.plug import CONTROL, EMULATED, FOLDER, LOOPBACK, TcpPort, Terminal
from hardware.wire import messages as m
from hardware.wire.frames import encode_frame

MOST_AT_ONCE = 20  # ticks that are caught up after a delay by this machine; after a longer one the board's time waits
ORDER_BYTES = 4096


class EmulatorSettings(NamedTuple):
    """How the board is started."""

    seed: int = 1  # of noise and faults
    homed: bool = True  # as if its encoders had been homed since power-up
    tcp: int | None = None  # number of the TCP port that a host opens (0: a free one); None: a pseudo-terminal


class Emulator:
    """One emulated board. Times in s of its own clock, from its start."""

    def __init__(
        self, devices: Sequence[Device], hand: EmulatedHand, tip: tuple[float, float], faults: list[LineFault],
        settings: EmulatorSettings, log: Callable[[str], None] = lambda line: None,
    ) -> None:  # fmt: skip
        """devices: the first one is wired to the board, the others can be by an order. tip: of the handle, m.

        InputError: the handle cannot be at `tip`; another program has the TCP port.
        """
        self._devices = {device.name: device for device in devices}
        self._seed, self._homed, self._tcp = settings
        self._wire(devices[0], hand, tip)
        self.faults = [fault for fault in faults if fault.start_s == 0.0]
        self._later = [fault for fault in faults if fault.start_s > 0.0]  # until a host asks for samples
        self.to_host, self.to_board = Line(self.faults, self._seed, 0), Line(self.faults, self._seed, 1)
        self.events: deque[tuple[float, str]] = deque(maxlen=200)  # s, what happened
        self.ticks = 0
        self._log = log
        self._shown: tuple = (m.State.BOOT, 0, False)  # state, faults, whether currents flow
        self._acting: set[LineFault] = set()
        self._powered_s = 0.0  # when the board's clock began; infinite: it has no power
        self._stopping = False
        self._orders = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._orders.bind((LOOPBACK, 0))
        self._orders.setblocking(False)
        self.control = self._orders.getsockname()[1]  # number of the UDP port that takes orders
        self._folder = tempfile.TemporaryDirectory(prefix=FOLDER)
        (Path(self._folder.name) / CONTROL).write_text(str(self.control))
        self._plug: Terminal | TcpPort | None = None
        try:
            self._plug = self._plug_in()
        except InputError:
            self.close()
            raise
        self.port = self._plug.address
        self._tick()  # kernels are compiled, or loaded, before time runs
        self._zero = time.perf_counter() - self.ticks * TICK_S

    def _plug_in(self) -> Terminal | TcpPort:
        if self._tcp is None:
            return Terminal(Path(self._folder.name))
        plug = TcpPort(Path(self._folder.name), self._tcp)
        self._tcp = plug.number  # the same one when it is plugged in again
        return plug

    def _wire(self, device: Device, hand: EmulatedHand, tip: tuple[float, float]) -> None:
        """Wire a device to a board that was just powered up; tip: of the handle, m."""
        hello = hello_of(device, f"{EMULATED}{self._seed}")
        self.board, self._home = Board(hello), self._homed
        self.device = EmulatedDevice(device, hello, hand, tip, self._seed)

    def rewire(self, name: str) -> None:
        """Emulate a re-rig to another device, with the handle where it was. InputError: it cannot be emulated here."""
        if name not in self._devices:
            raise InputError(f"only {', '.join(self._devices)} can be emulated here, not {name!r}")
        if name.encode()[:24] != self.board.hello.device:
            self._wire(self._devices[name], self.device.hand, self.device.tip)
            self._powered_s = self.ticks * TICK_S
            self.log_event(f"wired to {name}")

    def run(self) -> None:
        """Run until `stop`."""
        self._zero = time.perf_counter() - self.ticks * TICK_S
        while not self._stopping:
            now, due = self.now(), self.ticks * TICK_S
            if now >= due + MOST_AT_ONCE * TICK_S:
                self._zero += now - due
                self.log_event(f"delayed by this machine: the board's time stood still for {1e3 * (now - due):.0f} ms")
                continue
            if now < due:
                self._wait(min(due, self.to_host.next_s(), self.to_board.next_s()) - now)
            self._receive(self.now())
            if self.now() >= due:
                self._tick()
            self._transmit(self.now())

    def stop(self) -> None:
        """End `run`: from a signal handler or another thread."""
        self._stopping = True

    def close(self) -> None:
        """Close the port and remove the folder."""
        if self._plug:
            self._plug.close()
        self._orders.close()
        self._folder.cleanup()

    def now(self) -> float:
        return time.perf_counter() - self._zero

    def log_event(self, text: str) -> None:
        self.events.append((self.ticks * TICK_S, text))
        self._log(f"{self.ticks * TICK_S:9.3f} s  {text}")

    def _wait(self, seconds: float) -> None:
        """Wait until something arrives, at most this long."""
        ends = [self._orders, *(self._plug.descriptors() if self._plug else ())]
        if self._orders in select.select(ends, [], [], max(0.0, seconds))[0]:
            self._take_order()

    def _tick(self) -> None:
        """Make one tick: begin and end faults, read the sensors, tick the board, move the device."""
        now = self.ticks * TICK_S
        if self._later and self.board.streaming:
            self.faults += [fault.after(now) for fault in self._later]
            self._later.clear()
        self._begin_and_end_faults(now)
        readings = self.device.sense(self.board.currents, self._acting)
        if now >= self._powered_s:
            self._send(self.board.tick(readings, self._board_us(now)), now)
            if self._home and self.board.state != m.State.BOOT:
                self._home = False
                home = m.Home(self.board.hello.encoders, self.device.sensors.home_counts())
                self.board.receive(encode_frame(m.pack(home)), self._board_us(now))
        self.device.advance(self.board.currents)
        self._tell_changes()
        self.ticks += 1

    def _board_us(self, now: float) -> int:
        return round((now - self._powered_s) * 1e6)

    def _receive(self, now: float) -> None:
        """Give the board what the host sent, by way of the wire and its faults."""
        if self._plug and (data := self._plug.read()):
            self.to_board.put(data, now)
        data = self.to_board.take(now)
        if data and now >= self._powered_s:
            self._send(self.board.receive(data, self._board_us(now)), now)

    def _send(self, frames: bytes, now: float) -> None:
        """Put the board's frames onto the wire."""
        for frame in frames.split(b"\0")[:-1]:
            self.to_host.put(frame + b"\0", now)

    def _transmit(self, now: float) -> None:
        """Give the host what has come to its end of the wire."""
        data = self.to_host.take(now)
        if data and self._plug:
            self._plug.write(data)

    def _begin_and_end_faults(self, now: float) -> None:
        if not self.faults and not self._acting:
            return
        acting = {fault for fault in self.faults if fault.acts(now)}
        for fault in self._acting - acting:
            self.log_event(f"{fault.kind} is over")
        for fault in acting - self._acting:
            self.log_event(f"{fault.kind} begins")
        self._acting, kinds = acting, {fault.kind for fault in acting}
        if self._plug and "unplug" in kinds:
            self._plug.close()
            self._plug = None
            self.to_host.clear()
            self.to_board.clear()
        elif self._plug is None and "unplug" not in kinds:
            self._plug = self._plug_in()
        without = kinds.intersection(POWER)
        if without and now >= self._powered_s:
            self.board.lose_power(0, noticed="brown-out" in without)
            self.device.sensors.power_up()
            self.to_board.clear()
            self._powered_s = math.inf
        elif math.isinf(self._powered_s) and not without:
            self._powered_s = now

    def _tell_changes(self) -> None:
        board = self.board
        state, faults, flows = shown = (board.state, board.faults, board.currents != ZERO)
        if flows != self._shown[2]:
            self.log_event("currents flow" if flows else "currents zero")
        if (state, faults) != self._shown[:2]:
            cause = f", cause {board.cause.name}" if faults else ""
            self.log_event(f"state {state.name}{cause}")
        self._shown = shown

    def _take_order(self) -> None:
        """An order, a JSON object; the answer is the true state."""
        try:
            data, sender = self._orders.recvfrom(ORDER_BYTES)
        except (BlockingIOError, ConnectionResetError):  # Windows' reset: the sender of the last order has gone
            return
        try:
            answer = self._obey(json.loads(data))
        except (ValueError, RecursionError, InputError) as error:  # brackets in brackets, too many for JSON
            answer = {"error": str(error)}
            self.log_event(f"order refused: {error}")
        try:
            self._orders.sendto(json.dumps(answer).encode(), sender)
        except OSError as error:
            self.log_event(f"the order could not be answered: {error}")

    def _obey(self, order: object) -> dict:
        """{"fault": KIND..} from now on; {"clear": true} ends all faults; {"device": NAME}: it is wired to that one.

        {}: nothing; the rest is for the hand.
        """
        if not isinstance(order, dict):
            raise InputError("an order must be a JSON object")
        orders = dict(order)
        if "fault" in orders:
            self.faults.append(read_fault(str(orders.pop("fault")), self.now()))
        if orders.pop("clear", False):
            self.faults.clear()
            self._later.clear()
        if "device" in orders:
            self.rewire(str(orders.pop("device")))
        if orders:
            self.device.hand.obey(orders)
        return self.truth()

    def truth(self) -> dict:
        """The true state, which a host cannot see: SI units, times in s."""
        device, board = self.device, self.board
        return {
            "t_s": self.now(),
            "tip_m": list(device.tip),
            "velocity_m_s": [float(v) for v in device.motion[2:]],
            "hand_force_N": [float(f) for f in device.hand_force],
            "currents_mA": list(board.currents),
            "state": board.state.name,
            "faults": int(board.faults),
            "cause": int(board.cause),
            "events": list(self.events),
            "frames": vars(board.decoder.counts),
            "commands": vars(board.counts),
        }
