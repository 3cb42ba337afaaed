"""The real device at the other end of a serial port (`core.device_interface.RealDevice`).

`exchange` sends currents and reads samples. If it finds that the port has died or is silent, a thread reconnects. No
call waits longer than a few ms while the loop runs.

The force channels may be those of an ATI Net F/T on the network, in place of the board's. Mounting and mass beyond the
sensor are the device file's, its calibration is the sensor's own, and its zero is taken with the board's. A sensor that
falls silent is a device that is lost: brakes off, and no samples until it is back.
"""

import contextlib
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeVar

from core.device import Device
from core.device_interface import DeviceError, DeviceSample, RealDevice, ZeroRecord
from core.faults import after, cause, cause_of
from core.files import InputError
from core.mechanism import JOINTS
from hardware.handshake import check_hello, limits_of, rewire_emulated, shortened, wired_to
from hardware.own_driver import DRIVER, own_device
from hardware.sensing.board_clock import FreshnessWatch
from hardware.sensing.encoders import load_kernels
from hardware.sensing.net_ft import CHANNELS, COUNT_UN, NET_FT, NetFT
from hardware.sensing.samples import ZERO_SAMPLES, BoardSensing, fault_words, zero_of
from hardware.serial_port import Identity, Port, find_port, identity_of, link_of
from hardware.wire import messages as m
from hardware.wire.frames import FrameCounts, FrameDecoder, encode_frame
from hardware.wire.messages import Four, Hello, Refusal, joints_of

ANSWER_S = 0.5  # longest wait for an answer
HELLO_S = 1.5  # .. for a board that may just be starting
SILENCE_S = 0.2  # without a sample: the link is lost
SAMPLE_S = 0.004  # longest wait of `exchange` for a sample
AGAIN_S = 0.1  # between questions that were not answered, and between attempts to reach the board again
HEARTBEAT_S = 0.5
MOST_KEPT = 2000  # samples that wait for `samples`
WRAP = 1 << 32
NOT_CONNECTED = m.Refused(m.TYPES[m.Command], Refusal.WRONG_STATE)
NO_CURRENT = (0.0, 0.0, 0.0, 0.0)

REFUSAL_WORDS: dict[int, str] = {
    Refusal.WRONG_STATE: "it does not do that in the state it is in",
    Refusal.BAD_VALUE: "it cannot take the value that it was sent",
    Refusal.FAULT_STANDS: "what caused its fault is still there",
    Refusal.VERSION: "it speaks another version of the protocol",
}
#: what a board can refuse to do
ASKED_WORDS = {
    m.SetLimits: "take the limits of the brakes",
    m.Home: "take the homing",
    m.ResetFault: "forget its fault",
    m.AskHello: "connect",
}

Answer = TypeVar("Answer")


class Connection:
    """Messages to and from one board, from Hello to Bye."""

    def __init__(self, wire: Port, clock: Callable[[], float] = time.perf_counter) -> None:
        self.wire, self._clock = wire, clock
        self._decoder = FrameDecoder()
        self._layout: m.Layout | None = None
        self.not_understood = 0  # whole frames that hold no message of this protocol

    @property
    def frames(self) -> FrameCounts:
        return self._decoder.counts

    def send(self, message: tuple) -> None:
        self.wire.write(encode_frame(m.pack(message)))

    def read(self) -> list[tuple]:
        """The messages that have arrived (samples once limits were set); waits some ms for the first byte."""
        messages = []
        for payload in self._decoder.feed(self.wire.read()):
            message = (self._layout.unpack(payload) if self._layout else None) or m.unpack(payload)
            if message is not None:
                messages.append(message)
            elif self._layout:  # before, a sample's layout is not known
                self.not_understood += 1
        return messages

    def ask(self, question: tuple, kind: type[Answer], patience_s: float = ANSWER_S) -> Answer:
        """The board's answer of this kind; other messages are dropped. DeviceError: refused, or no answer."""
        end = self._clock() + patience_s
        again, late = -math.inf, False
        while not late:
            now = self._clock()
            late = now >= end  # a delayed host still reads what has arrived
            if now >= again:
                self.send(question)
                again = now + AGAIN_S
            for message in self.read():
                if isinstance(message, kind):
                    return message
                if isinstance(message, m.Refused) and message.message == m.pack(question)[0]:
                    raise DeviceError(refusal(question, message.reason))
        raise DeviceError(cause("no-board", name=self.wire.name))

    def hello(self) -> Hello:
        """Ask who is there; ends an existing connection."""
        self._layout = None
        self.wire.write(b"\0")
        return self.ask(m.AskHello(m.VERSION), Hello, HELLO_S)

    def set_limits(self, hello: Hello, device: Device) -> Four:
        """Start the samples; the current limits in force, mA."""
        asked = limits_of(hello, device)
        limits = self.ask(asked, m.Limits)
        if limits.current_mA != asked.current_mA:
            raise DeviceError(
                f"the board has set other current limits, {limits.current_mA} mA, than {asked.current_mA}"
            )
        self._layout = m.layout_of(hello)
        return limits.current_mA


def refusal(question: tuple, reason: int) -> str:
    """The refusal of a question in words."""
    action = ASKED_WORDS.get(type(question), f"answer {type(question).__name__}")
    return f"the board would not {action}: {REFUSAL_WORDS.get(reason, f'its reason, {reason}, is not known here')}"


def clamped(currents: Sequence[float], most_mA: Four) -> tuple[Four, bool]:
    """Currents (4,), A, as mA between 0 and their limits, 0 if not finite; and whether one had to be changed.

    The last line before the wire.
    """
    commanded = tuple(round(1000.0 * min(current, 1e3)) if 0.0 < current < math.inf else 0 for current in currents)
    within = tuple(map(min, most_mA, commanded))
    return within, within != commanded or not all(0.0 <= current < math.inf for current in currents)


@dataclass
class Health:
    """Counters since the device was opened, for the device page and each recording."""

    samples: int = 0
    lost: int = 0  # samples that never came
    repeated: int = 0  # .. that came again, or after a newer one
    late_commands: int = 0  # samples that say that the board did not obey a command that waited
    refused: int = 0
    clamped: int = 0  # exchanges whose currents had to be put right: beyond a limit, below zero, not finite
    not_closed: int = 0  # samples whose encoder counts match no position
    lost_links: int = 0
    begun_anew: int = 0  # of these: because the board took, or would take, all commands for late
    round_trip_s: float = math.inf  # the least, of heartbeats
    delay_ticks: int | None = None  # from a sample to the first that has taken in the command that answers it, newest
    frames: FrameCounts = field(default_factory=FrameCounts)  # of the present connection

    def report(self, sensing: BoardSensing | None, connection: Connection | None) -> dict:
        """All counters, the clock model and the board's identity, as JSON holds them."""
        about = vars(self) | {
            "round_trip_s": self.round_trip_s if math.isfinite(self.round_trip_s) else None,
            "frames": {**vars(self.frames), "bad": self.frames.bad},
        }
        if connection is not None:
            about |= {"not_understood": connection.not_understood, "not_taken": connection.wire.not_taken}
        if sensing is not None:
            hello = sensing.hello
            about |= {
                "zero": sensing.zero._asdict() if sensing.zero.samples else None,
                "clock": sensing.clock.fit._asdict(),
                "board_time_back": sensing.clock.went_back,  # since the board's last start
                "board": hello.serial.decode(errors="replace"),
                "firmware": ".".join(map(str, hello.firmware)),
                "protocol": hello.version,
                "starts": hello.starts,
                "state": m.State(sensing.state).name if sensing.state in set(m.State) else f"state {sensing.state}",
                "counts_per_rev": [hello.counts_per_rev[i] for i in joints_of(hello.encoders)],
            }
        return about


class Reached(NamedTuple):
    """A connected board."""

    connection: Connection
    sensing: BoardSensing
    limits_mA: Four


class SerialDevice:
    """One board, with the methods of `RealDevice`. They belong to one thread, the control loop's."""

    def __init__(
        self, device: Device, port: str, net_force: str = "", clock: Callable[[], float] = time.perf_counter,
        open_port: Callable[[str], Port] = Port, sleep: Callable[[float], None] = time.sleep,
    ) -> None:  # fmt: skip
        """port: its name, or "auto": the only serial port on USB. net_force: a Net F/T, as `NetFT` takes it; "": none.

        clock, sleep, open_port: of the machine, but for tests.
        """
        self.device, self.port = device, port
        self._problem, self._trouble = "not opened yet", ""  # of the board, of the force sensor
        self._net_force = net_force
        self._force_sensor: NetFT | None = None  # opened with the device
        self.health = Health()
        self.encoders, self.force_channels = "", 0
        self.sensing: BoardSensing | None = None  # of the present connection, or of the last one
        self.clock, self._sleep, self._open_port = clock, sleep, open_port
        self._board: Reached | None = None  # None: the link is lost
        self._reconnected: Reached | None = None  # found by the thread below, for `exchange` to take up
        self._reconnecting: threading.Thread | None = None
        self._closing = threading.Event()
        self._sequence = self._token = 0
        self._beat: tuple[int, float] | None = None  # token and time of the heartbeat that is out
        self._beat_at = self._heard = self._asked = -math.inf
        self._last: int | None = None  # sequence of the last sample
        self._timed: tuple[int, int] | None = None  # a command on its way, and the sample that it answers
        self._watch = FreshnessWatch()  # of the present connection
        self._taken: deque[DeviceSample] = deque(maxlen=MOST_KEPT)  # since `samples` was called
        self._identity: Identity | None = None
        self._link = ""  # what carries the bytes, in words

    @property
    def problem(self) -> str:
        return self._problem or self._trouble

    @property
    def zeroed(self) -> bool:
        """Whether the zero of this board is known since its last start; none is needed without a force sensor."""
        return self.sensing is not None and (self.sensing.zero.samples > 0 or self.force_channels == 0)

    # ----------------------------------------------------------------------------------------- from first to last

    def open(self) -> None:
        """Connect the force sensor, then the board, which does not wait. InputError: not there, or another board."""
        if self._net_force:
            self._force_sensor = NetFT(self._net_force)
        try:
            load_kernels(self.device)
            self.port = find_port(self.port)
            self._identity, self._link = identity_of(self.port), link_of(self.port).words
            self._begin(self._reach())
        except (DeviceError, InputError) as error:
            if self._force_sensor:
                self._force_sensor.close()
            raise InputError(cause_of(error)) from None

    def _reach(self) -> Reached:
        """Open the port and shake hands."""
        connection = Connection(self._open_port(find_port(self.port, self._identity)), self.clock)
        try:
            return self._shake_hands(connection)
        except BaseException:
            connection.wire.close()
            raise

    def _shake_hands(self, connection: Connection) -> Reached:
        """DeviceError: no answer, or refused. InputError: the board does not match the device file."""
        device, hello = self.device, connection.hello()
        if wired_to(hello) != shortened(device) and rewire_emulated(hello, connection.wire.name, device):
            hello = connection.hello()
        check_hello(hello, device)
        before, fault = self._known(connection, hello)
        limits_mA = connection.set_limits(hello, device)
        if self._net_force:
            hello = hello._replace(force_channels=CHANNELS, force_unit=COUNT_UN)
            device = replace(device, calibration=None)
        return Reached(connection, BoardSensing(device, hello, before, fault), limits_mA)

    def _known(self, connection: Connection, hello: Hello) -> tuple[BoardSensing | None, str]:
        """The earlier sensing of this board if it has had power since (else None), and the fault of one that has not.

        A board that gives the same number of starts after a power-up has a fault: its clock shows that it lost power.
        """
        before = self.sensing
        if before is None or (before.hello.serial, before.hello.starts) != (hello.serial, hello.starts):
            return None, ""
        asked_s = self.clock()
        if before.clock.went_on(connection.ask(m.Heartbeat(0), m.HeartbeatReply).board_us, asked_s):
            return before, before.fault
        return None, cause("started-again", starts=hello.starts)

    def _begin(self, reached: Reached) -> None:
        """Reset everything that does not outlive a connection."""
        self._board, self.sensing, hello = reached, reached.sensing, reached.sensing.hello
        self.encoders = "".join(JOINTS[i] for i in joints_of(hello.encoders))
        self.force_channels = hello.force_channels
        self._reconnected = self._reconnecting = self._last = self._beat = self._timed = None
        self._watch, self._sequence = FreshnessWatch(), 0
        self._heard = self.clock()
        self.health.frames = reached.connection.frames
        self._problem = ""

    def _lose(self, reason: str) -> None:
        """Let a thread reconnect: the link is lost."""
        self._problem = reason
        self.health.lost_links += 1
        lost, self._board = self._board, None
        self._reconnecting = threading.Thread(
            target=self._reconnect, args=(lost,), name="reconnect the board", daemon=True
        )
        self._reconnecting.start()

    def _reconnect(self, lost: Reached) -> None:
        lost.connection.wire.close()
        while not self._closing.is_set():
            try:
                self._reconnected = self._reach()
                return
            except (DeviceError, InputError) as error:
                self._problem = cause_of(error)
            self._closing.wait(AGAIN_S)

    def close(self) -> None:
        """Set the currents to zero and disconnect, within a second in any case."""
        self._closing.set()
        if self._reconnecting is not None:
            self._reconnecting.join(2.0)
        for reached in (self._board, self._reconnected):
            if reached is not None:
                connection = reached.connection
                with contextlib.suppress(DeviceError):  # gone already: its watchdog has made the currents zero
                    self._command(connection, (0, 0, 0, 0))
                    connection.send(m.Bye())
                connection.wire.close()
        self._board = self._reconnected = None
        self._problem = "closed"
        if self._force_sensor:
            self._force_sensor.close()

    # ------------------------------------------------------------------------------------------------- every tick

    def exchange(self, currents: Sequence[float]) -> DeviceSample | None:
        """Currents (4,), A, to the brakes; the newest sample, or None: nothing came, see `problem`."""
        self._trouble = self._force_sensor.trouble() if self._force_sensor else ""
        sample = self._exchange(NO_CURRENT if self._trouble else currents)
        return None if self._trouble else sample

    def _exchange(self, currents: Sequence[float]) -> DeviceSample | None:
        now = self.clock()
        if now - self._asked > SILENCE_S / 2:
            self._heard = max(self._heard, now)  # this host did not listen for a while: that is no silence
        self._asked = now
        if self._reconnected is not None:
            self._begin(self._reconnected)
        reached = self._board
        if reached is None:
            self._sleep(SAMPLE_S)
            return None
        try:
            milliamperes, put_right = clamped(currents, reached.limits_mA)
            self.health.clamped += put_right
            self._command(reached.connection, milliamperes)
            if now >= self._beat_at:
                self._token = (self._token + 1) % WRAP
                self._beat, self._beat_at = (self._token, now), now + HEARTBEAT_S
                reached.connection.send(m.Heartbeat(self._token))
            return self._listen(reached, now + SAMPLE_S)
        except DeviceError as error:
            self._lose(cause_of(error))
            return None

    def _command(self, connection: Connection, milliamperes: Four) -> None:
        self._sequence = self._sequence % (WRAP - 1) + 1
        if self._timed is None and self._last is not None:
            self._timed = self._sequence, self._last
        now_us = round(1e6 * self.clock())
        connection.send(m.Command(self._sequence, now_us, int(any(milliamperes)), milliamperes))

    def _listen(self, reached: Reached, until: float) -> DeviceSample | None:
        """Read messages until a sample arrives or the time is over."""
        newest = None
        while newest is None:
            messages = reached.connection.read()
            now = self.clock()
            for message in messages:
                if isinstance(message, m.Sample):
                    newest = self._sample(reached.sensing, message, now) or newest
                elif isinstance(message, m.HeartbeatReply):
                    if self._beat is not None and self._beat[0] == message.token:
                        self.health.round_trip_s = min(self.health.round_trip_s, now - self._beat[1])
                elif isinstance(message, m.Refused):
                    self.health.refused += 1
                    if message == NOT_CONNECTED:
                        raise DeviceError(cause("board-left"))
            if now - self._heard > SILENCE_S:
                raise DeviceError(cause("no-sample", ms=1e3 * SILENCE_S))
            if now >= until:
                break
        return newest

    def _sample(self, sensing: BoardSensing, sample: m.Sample, now: float) -> DeviceSample | None:
        """A sample in SI units; None for one that came before. DeviceError: the board must be reconnected."""
        if self._last is not None:
            ahead = (sample.sequence - self._last) % WRAP
            if not 0 < ahead < WRAP // 2:
                self.health.repeated += 1
                return None
            self.health.lost += ahead - 1
        self._last, self._heard = sample.sequence, now
        if self._timed is not None and (sample.echo - self._timed[0]) % WRAP < WRAP // 2:
            self.health.delay_ticks = (sample.sequence - self._timed[1]) % WRAP
            self._timed = None
        self.health.samples += 1
        self.health.late_commands += bool(sample.flags & m.Flag.LATE)
        if self._force_sensor:
            sample = sample._replace(force=self._force_sensor.read())
        taken = sensing.take(sample, now)
        self.health.not_closed += not taken.closed
        self._taken.append(taken)
        if doubt := self._watch.doubt(sample, now):
            self.health.begun_anew += 1
            sensing.clock.begin()
            raise DeviceError(doubt)
        return taken

    def samples(self) -> list[DeviceSample]:
        taken = list(self._taken)
        self._taken.clear()
        return taken

    # ------------------------------------------------------------------------------------- trials, and between them

    def begin(self) -> None:
        self._taken.clear()

    def end_record(self) -> dict[str, Any]:
        return {"link": self.report()}

    def report(self) -> dict:
        """Counters since `open`, clock model (offset, drift, residual of host time over board time), and the zero."""
        report = self.health.report(self.sensing, self._board and self._board.connection) | {"link": self._link}
        return report | ({"force_sensor": self._force_sensor.report()} if self._force_sensor else {})

    def home(self, tip: tuple[float, float]) -> None:
        self.exchange(NO_CURRENT)
        connection, sensing, _ = self._connected()
        connection.ask(m.Home(sensing.hello.encoders, sensing.pose.counts_at(tip)), m.Homed)
        sensing.moved()
        self._last = None

    def zero(self) -> ZeroRecord:
        """DeviceError, and the zero before holds: the handle moved, samples are missing, the board was away."""
        sensing, taken = self._connected().sensing, []
        for _ in range(2 * ZERO_SAMPLES):
            if (sample := self.exchange(NO_CURRENT)) is not None:
                taken.append(sample)
            if len(taken) == ZERO_SAMPLES:
                break
        else:
            raise DeviceError(
                f"zero: only {len(taken)} of {ZERO_SAMPLES} samples came; {self.problem or 'many are lost'}"
            )
        if self.sensing is not sensing:
            raise DeviceError("zero: the board was away meanwhile")
        sensing.set_zero(zero_of(taken, sensing.zero))
        return sensing.zero

    def stop(self) -> None:
        """Where the board cannot be reached, its watchdog does it."""
        if self._board is not None:
            try:
                self._board.connection.send(m.Stop())
            except DeviceError as error:
                self._lose(cause_of(error))

    def reset(self) -> None:
        connection, sensing, _ = self._connected()
        report = connection.ask(m.ResetFault(), m.FaultReport)
        if report.faults:
            raise DeviceError(after("the board keeps its fault: ", fault_words(report.cause)))
        sensing.fault = ""
        self._begin(self._shake_hands(connection))

    def _connected(self) -> Reached:
        if self._board is None:
            raise DeviceError(after("the board cannot be reached: ", self.problem))
        return self._board


def device_at(device: Device, where: str) -> RealDevice:
    """The real device that a text asks for: a port, "PORT netft:HOST", or a driver's file.

    It is not opened yet.
    """
    if where.startswith(DRIVER):
        return own_device(device, where)
    port, _, host = where.partition(f" {NET_FT}")
    return SerialDevice(device, port, host)
