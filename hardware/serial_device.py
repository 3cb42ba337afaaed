"""The real device at the other end of a serial port (`core.device_interface.RealDevice`).

`exchange` sends currents and takes in samples; a port that dies or falls silent is noticed there, and a thread of its
own brings it back. Nothing waits longer than a few ms while the loop runs.

The force channels may be those of an ATI Net F/T on the network, in place of the board's. Mounting and mass beyond the
sensor are the device file's, its calibration is the sensor's own, and its zero is taken with the board's. A sensor that
falls silent is a device that is lost: brakes off, and no samples until it is back.
"""

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from core.device import Device
from core.device_interface import DeviceError, DeviceSample, RealDevice, ZeroRecord
from core.faults import after, cause, cause_of
from core.files import InputError
from core.mechanism import JOINTS
from hardware.connection import Connection, FreshnessWatch, Wire
from hardware.sensing.encoders import load_kernels
from hardware.sensing.force_sensor import ZERO_SAMPLES, zero_of
from hardware.sensing.net_ft import CHANNELS, COUNT_UN, NET_FT, NetFT
from hardware.sensing.samples import BoardSensing, fault_words
from hardware.serial_port import Identity, Port, find_port, identity_of
from hardware.wire.frames import FrameCounts
from hardware.wire.messages import (
    TYPES,
    Bye,
    Command,
    FaultReport,
    Flag,
    Heartbeat,
    HeartbeatReply,
    Hello,
    Home,
    Homed,
    Limits,
    Refusal,
    Refused,
    ResetFault,
    Sample,
    State,
    Stop,
    joints_of,
)

SILENCE_S = 0.2  # without a sample: the link is lost
SAMPLE_S = 0.004  # longest wait of `exchange` for a sample
AGAIN_S = 0.1  # between attempts to reach the board again
HEARTBEAT_S = 0.5
MOST_KEPT = 2000  # samples that wait for whoever asks for all of them
WRAP = 1 << 32
NOT_CONNECTED = Refused(TYPES[Command], Refusal.WRONG_STATE)
NO_CURRENT = (0.0, 0.0, 0.0, 0.0)

Reached = tuple[Connection, BoardSensing, Limits]


@dataclass
class Health:
    """Counted since the device was opened, for the device page and for each recording."""

    samples: int = 0
    lost: int = 0  # samples that never came
    repeated: int = 0  # .. that came again, or after a newer one
    late_commands: int = 0  # samples that say that the board did not obey a command that waited
    refused: int = 0
    clamped: int = 0  # exchanges whose currents had to be put right: beyond a limit, below zero, not finite
    not_closed: int = 0  # samples whose encoders are of no pose
    lost_links: int = 0
    begun_anew: int = 0  # of these: connections given up because the board took, or would take, all commands for late
    round_trip_s: float = math.inf  # the least, of heartbeats
    frames: FrameCounts = field(default_factory=FrameCounts)  # of the present connection

    def report(self, sensing: BoardSensing | None, connection: Connection | None) -> dict:
        """All of it, with the clock model and what the board says of itself, as JSON holds it."""
        about = {name: value for name, value in vars(self).items() if name not in ("frames", "round_trip_s")}
        about["round_trip_s"] = self.round_trip_s if math.isfinite(self.round_trip_s) else None
        about["frames"] = {**vars(self.frames), "bad": self.frames.bad}
        if connection is not None:
            about["not_understood"], about["not_taken"] = connection.not_understood, connection.wire.not_taken
        if sensing is not None:
            about["zero"] = sensing.zero._asdict() if sensing.zero.samples else None
            about["clock"] = sensing.clock.fit._asdict()
            about["board_time_back"] = sensing.clock.went_back  # since the board's last start
            hello = sensing.hello
            about["board"] = hello.serial.decode(errors="replace")
            about["firmware"] = ".".join(map(str, hello.firmware))
            about["protocol"] = hello.version
            about["starts"] = hello.starts
            about["state"] = State(sensing.state).name if sensing.state in set(State) else f"state {sensing.state}"
            about["counts_per_rev"] = [hello.counts_per_rev[i] for i in joints_of(hello.encoders)]
        return about


class SerialDevice:
    """One board. Its methods belong to one thread, the control loop's."""

    def __init__(
        self, device: Device, port: str, net_force: str = "", clock: Callable[[], float] = time.monotonic,
        open_port: Callable[[str], Wire] = Port, sleep: Callable[[float], None] = time.sleep,
    ) -> None:  # fmt: skip
        """port: its name, or "auto": the only serial port on USB. net_force: a Net F/T, as `NetFT` takes it; "": none.

        clock, sleep, open_port: of the machine, but for tests.
        """
        self.device, self.port = device, port
        self._problem, self._trouble = "not opened yet", ""  # of the board, of the force sensor
        self._net_force, self._force_sensor = net_force, None  # opened with the device
        self.health = Health()
        self.encoders, self.force_channels = "", 0
        self.sensing: BoardSensing | None = None  # of the present connection, or of the last one
        self.clock, self._sleep, self._open_port = clock, sleep, open_port
        self._connection: Connection | None = None
        self._back: Reached | None = None  # made by the thread that brings it back
        self._bringing: threading.Thread | None = None
        self._closing = threading.Event()
        self._sequence = self._token = 0
        self._beat: tuple[int, float] | None = None  # token and time of the heartbeat that is out
        self._beat_at = self._heard = self._asked = -math.inf
        self._last: int | None = None  # sequence of the last sample
        self._watch = FreshnessWatch()  # of the present connection
        self._taken: deque[DeviceSample] = deque(maxlen=MOST_KEPT)  # since `samples` was called
        self._limits = Limits((0, 0, 0, 0), (0, 0, 0, 0))
        self._identity: Identity | None = None

    @property
    def problem(self) -> str:
        """Why there are no samples; "" while they come."""
        return self._problem or self._trouble

    def open(self) -> None:
        """Reach the force sensor, then the board, which does not wait. InputError: not there, or another board."""
        if self._net_force:
            self._force_sensor = NetFT(self._net_force)
        try:
            self._open()
        except InputError:
            if self._force_sensor:
                self._force_sensor.close()
            raise

    def _open(self) -> None:
        load_kernels(self.device)
        self.port = find_port(self.port)
        self._identity = identity_of(self.port)
        try:
            self._begin(*self._reach())
        except DeviceError as error:
            raise InputError(cause_of(error)) from None

    def exchange(self, currents: Sequence[float]) -> DeviceSample | None:
        """Currents (4,), A, to the brakes; the newest sample, or None: nothing came, see `problem`."""
        self._trouble = self._force_sensor.trouble() if self._force_sensor else ""
        sample = self._exchange(NO_CURRENT if self._trouble else currents)
        return None if self._trouble else sample

    def _exchange(self, currents: Sequence[float]) -> DeviceSample | None:
        now = self.clock()
        if now - self._asked > SILENCE_S / 2:
            self._heard = max(self._heard, now)  # nobody listened for a while: that is no silence
        self._asked = now
        if self._back is not None:
            self._begin(*self._back)
        connection, sensing = self._connection, self.sensing
        if connection is None or sensing is None:
            self._sleep(SAMPLE_S)
            return None
        try:
            milliamperes = self._clamped(currents)
            self._sequence = self._sequence % (WRAP - 1) + 1
            connection.send(Command(self._sequence, round(1e6 * now), int(any(milliamperes)), milliamperes))
            if now >= self._beat_at:
                self._send_heartbeat(connection, now)
            return self._listen(connection, sensing, now + SAMPLE_S)
        except DeviceError as error:
            self._lose(cause_of(error))
            return None

    def samples(self) -> list[DeviceSample]:
        """Every sample since the last call, oldest first (the newest two seconds of them)."""
        taken = list(self._taken)
        self._taken.clear()
        return taken

    def begin(self) -> None:
        """A trial begins: samples from before are not its own."""
        self._taken.clear()

    def end_record(self) -> dict[str, Any]:
        """Health and clock of the connection, for the end of a trial's recording."""
        return {"link": self.report()}

    def report(self) -> dict:
        """Counters since `open`, clock model (offset, drift, residual of host time over board time), and the zero."""
        report = self.health.report(self.sensing, self._connection)
        return report | ({"force_sensor": self._force_sensor.report()} if self._force_sensor else {})

    @property
    def zeroed(self) -> bool:
        """Whether the zero of this board, since its last start, is known; a board without force sensor needs none."""
        return self.sensing is not None and (self.sensing.zero.samples > 0 or self.force_channels == 0)

    def home(self, tip: tuple[float, float]) -> None:
        """The handle is held at `tip` (m) now: set the encoders. DeviceError if the board did not."""
        self.exchange(NO_CURRENT)
        connection, sensing = self._there()
        connection.ask(Home(sensing.hello.encoders, sensing.pose.counts_at(tip)), Homed)
        sensing.moved()
        self._last = None

    def zero(self) -> ZeroRecord:
        """Nobody touches the handle: what sensor and amplifiers read is zero.

        DeviceError, and the zero before holds: the handle moved, samples are missing, the board was away meanwhile.
        """
        sensing = self._there()[1]
        taken: list[DeviceSample] = []
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
        """Brakes off, latched on the board; where it cannot be reached, its watchdog does it."""
        if self._connection is not None:
            try:
                self._connection.send(Stop())
            except DeviceError as error:
                self._lose(cause_of(error))

    def reset(self) -> None:
        """Forget the board's faults. DeviceError: a condition still stands, or the board is not there."""
        connection = self._there()[0]
        report = connection.ask(ResetFault(), FaultReport)
        if report.faults:
            raise DeviceError(after("the board keeps its fault: ", fault_words(report.cause)))
        self._begin(*self._shake_hands(connection))

    def close(self) -> None:
        """Zero currents and leave; within a second, whatever hangs."""
        self._closing.set()
        if self._bringing is not None:
            self._bringing.join(2.0)
        for connection in (self._connection, self._back[0] if self._back else None):
            if connection is not None:
                try:
                    self._sequence = self._sequence % (WRAP - 1) + 1
                    connection.send(Command(self._sequence, round(1e6 * self.clock()), 0, (0, 0, 0, 0)))
                    connection.send(Bye())
                except DeviceError:
                    pass  # gone already: its watchdog has made the currents zero
                connection.wire.close()
        self._connection = self._back = None
        self._problem = "closed"
        if self._force_sensor:
            self._force_sensor.close()

    def _clamped(self, currents: Sequence[float]) -> tuple[int, int, int, int]:
        """mA, each within 0 and the limit of its brake: the last line before the wire. What is not finite is 0."""
        asked = [round(1000.0 * min(current, 1e3)) if 0.0 < current < math.inf else 0 for current in currents]
        a, e, b, c = (min(most, now) for most, now in zip(self._limits.current_mA, asked, strict=True))
        wrong = asked != [a, e, b, c] or not all(0.0 <= current < math.inf for current in currents)
        self.health.clamped += wrong
        return a, e, b, c

    def _there(self) -> tuple[Connection, BoardSensing]:
        if self._connection is None or self.sensing is None:
            raise DeviceError(after("the board cannot be reached: ", self.problem))
        return self._connection, self.sensing

    def _shake_hands(self, connection: Connection) -> Reached:
        hello = connection.hello(self.device)
        return connection, self._sensing(hello), connection.set_limits(hello, self.device)

    def _sensing(self, hello: Hello) -> BoardSensing:
        if not self._net_force:
            return BoardSensing(self.device, hello, self.sensing)
        hello = hello._replace(force_channels=CHANNELS, force_unit=COUNT_UN)
        return BoardSensing(replace(self.device, calibration=None), hello, self.sensing)

    def _reach(self) -> Reached:
        """Open the port and shake hands."""
        connection = Connection(self._open_port(find_port(self.port, self._identity)))
        try:
            return self._shake_hands(connection)
        except BaseException:
            connection.wire.close()
            raise

    def _begin(self, connection: Connection, sensing: BoardSensing, limits: Limits) -> None:
        """A connection begins: everything that does not outlive one is new."""
        self.sensing, self._limits = sensing, limits
        self.encoders = "".join(JOINTS[i] for i in joints_of(sensing.hello.encoders))
        self.force_channels = sensing.hello.force_channels
        self._connection, self._back, self._bringing = connection, None, None
        self._last, self._watch = None, FreshnessWatch()
        self._sequence, self._beat = 0, None
        self._heard = self.clock()
        self.health.frames = connection.frames
        self._problem = ""

    def _lose(self, reason: str) -> None:
        """The link is lost: a thread brings it back."""
        self._problem = reason
        self.health.lost_links += 1
        lost, self._connection = self._connection, None
        self._bringing = threading.Thread(
            target=self._bring_back, args=(lost,), name="bring the board back", daemon=True
        )
        self._bringing.start()

    def _bring_back(self, lost: Connection | None) -> None:
        if lost is not None:
            lost.wire.close()
        while not self._closing.is_set():
            try:
                self._back = self._reach()
                return
            except (DeviceError, InputError) as error:
                self._problem = cause_of(error)
            self._closing.wait(AGAIN_S)

    def _send_heartbeat(self, connection: Connection, now: float) -> None:
        self._token = (self._token + 1) % WRAP
        self._beat, self._beat_at = (self._token, now), now + HEARTBEAT_S
        connection.send(Heartbeat(self._token))

    def _listen(self, connection: Connection, sensing: BoardSensing, until: float) -> DeviceSample | None:
        """Take in what comes until there is a sample, or the time is over."""
        newest = None
        while newest is None:
            messages = connection.read()
            now = self.clock()
            for message in messages:
                if isinstance(message, Sample):
                    newest = self._sample(sensing, message, now) or newest
                elif isinstance(message, HeartbeatReply):
                    if self._beat is not None and self._beat[0] == message.token:
                        self.health.round_trip_s = min(self.health.round_trip_s, now - self._beat[1])
                elif isinstance(message, Refused):
                    self.health.refused += 1
                    if message == NOT_CONNECTED:
                        raise DeviceError(cause("board-left"))
            if now - self._heard > SILENCE_S:
                raise DeviceError(cause("no-sample", ms=1e3 * SILENCE_S))
            if now >= until:
                break
        return newest

    def _sample(self, sensing: BoardSensing, sample: Sample, now: float) -> DeviceSample | None:
        """A sample in SI units; None for one that came before. DeviceError: the connection must begin anew."""
        if self._last is not None:
            ahead = (sample.sequence - self._last) % WRAP
            if not 0 < ahead < WRAP // 2:
                self.health.repeated += 1
                return None
            self.health.lost += ahead - 1
        self._last, self._heard = sample.sequence, now
        self.health.samples += 1
        self.health.late_commands += bool(sample.flags & Flag.LATE)
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


def device_at(device: Device, where: str) -> RealDevice:
    """The real device that a text asks for: a port, or "PORT netft:HOST". It is not opened yet."""
    port, _, host = where.partition(f" {NET_FT}")
    return SerialDevice(device, port, host)
