"""The board's state machine as a pure object: bytes in, bytes out, and the time is an argument.

It has no port and no clock, so every state, limit and fault can be tested in simulated time. The emulated board puts a
simulated device behind it. docs/protocol.md describes it for authors of firmware.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from hardware.wire import messages as m
from hardware.wire.frames import FrameDecoder, encode_frame
from hardware.wire.messages import Fault, Flag, Four, Refusal, State, joints_of

OVER_CURRENT_mA = 100  # a brake may draw this and a tenth of its limit more than its limit
OVER_CURRENT_TICKS = 10
SATURATED_TICKS = 5
SPEED_TICKS = 10  # a joint's speed is taken over this many ticks
ZERO: Four = (0, 0, 0, 0)


class Readings(NamedTuple):
    """The inputs of the board at a tick, for each joint in the order A, E, B, C; 0: no such input."""

    counts: Four = ZERO
    force: tuple[int, ...] = ()  # counts, one a channel
    current_mA: Four = ZERO  # measured
    encoder_good: tuple[bool, ...] = (True, True, True, True)
    supply_cut: bool = False  # an emergency stop beside the board has cut the amplifiers' supply


#: The Hello of a board with two encoders, four brakes and a force sensor, at its start.
FULL_BOARD = m.Hello(
    version=m.VERSION, state=State.BOOT, faults=Fault.NONE, cause=Fault.NONE, firmware=(1, 0, 0), encoders=0b0101,
    brakes=0b1111, force_channels=6, sample_hz=m.SAMPLE_HZ, watchdog_ms=m.WATCHDOG_US // 1000,
    counts_per_rev=(96000, 0, 96000, 0), current_max_mA=(1000, 1000, 1000, 1000), force_unit=1000,
    force_full_scale=66_700, starts=1, device=b"", serial=b"",
)  # fmt: skip


class Watch:
    """Checks the readings of every tick, and counts how long something has been wrong."""

    def __init__(self, hello: m.Hello) -> None:
        self._encoders = joints_of(hello.encoders)
        self._brakes = joints_of(hello.brakes)
        self._full_scale = hello.force_full_scale
        self._past: deque[Four] = deque(maxlen=SPEED_TICKS + 1)  # counts as read
        self._over_current = [0, 0, 0, 0]  # ticks on end
        self._saturated = 0  # ticks on end

    def conditions(self, readings: Readings, limits: m.Limits) -> Iterator[tuple[Fault, int]]:
        """(fault, index of joint or channel) of every condition at this tick."""
        self._past.append(readings.counts)
        for i in self._brakes:
            most = limits.current_mA[i] + limits.current_mA[i] // 10 + OVER_CURRENT_mA
            self._over_current[i] = self._over_current[i] + 1 if abs(readings.current_mA[i]) > most else 0
            if self._over_current[i] >= OVER_CURRENT_TICKS:
                yield Fault.OVER_CURRENT, i
        for i in self._encoders:
            if self._too_fast(i, limits.speed_counts_s[i]):
                yield Fault.OVER_SPEED, i
            if not readings.encoder_good[i]:
                yield Fault.BAD_ENCODER, i
        at_end = [k for k, f in enumerate(readings.force) if abs(f) >= self._full_scale]
        self._saturated = self._saturated + 1 if at_end else 0
        if self._saturated >= SATURATED_TICKS:
            yield Fault.FORCE_SATURATED, at_end[0]

    def _too_fast(self, i: int, most: int) -> bool:
        if most == 0 or len(self._past) <= SPEED_TICKS:
            return False
        return abs(_int32(self._past[-1][i] - self._past[0][i])) * m.SAMPLE_HZ > most * SPEED_TICKS


LATE_US = 50_000  # us; a command that took so much longer than the quickest one lately is not obeyed
LATE_FORGET = 1000  # us a second, by which the time of the quickest one grows: more than two clocks drift apart
WRAP = 1 << 32


class Age(Enum):
    """Whether a command is fresh, by sequence number and host time."""

    FRESH = 0
    OLD = 1  # it came before, or after a newer one
    LATE = 2


class Freshness:
    """Judges the commands of one connection, by differences of the two clocks alone."""

    def __init__(self) -> None:
        self.last = 0  # sequence number of the last command that was taken in
        self._any = False
        self._quickest: tuple[int, int] | None = None  # us: when it came, and board time less host time then

    def judge(self, sequence: int, host_us: int, now_us: int) -> Age:
        """The age of a command. It remembers the travel time, but not yet the command."""
        if self._any and not 0 < (sequence - self.last) % WRAP < WRAP // 2:
            return Age.OLD
        took = now_us - host_us
        quickest = took
        if self._quickest is not None:
            then, least = self._quickest
            quickest = least + (now_us - then) * LATE_FORGET // 1_000_000
        if took <= quickest:
            self._quickest = now_us, took
        return Age.LATE if took - quickest > LATE_US else Age.FRESH

    def take(self, sequence: int) -> None:
        """Remember a command that is obeyed."""
        self.last, self._any = sequence, True


class BoardEvent(Enum):
    """What can happen to a board: a message of the host, or an event of its own."""

    HELLO = "AskHello"
    LIMITS = "SetLimits"
    ON = "Command on"
    OFF = "Command off"
    HOME = "Home"
    RESET = "ResetFault"
    HEARTBEAT = "Heartbeat"
    STOP = "Stop"
    BYE = "Bye"
    STARTED = "started"  # the self-test is over
    STARTED_LOW = "started after brown-out"
    SILENCE = "silence"  # no good frame for SILENCE_US
    WATCHDOG = "watchdog"  # no fresh command for WATCHDOG_US
    BAD = "condition"  # over-current, over-speed, encoder, force saturated
    BROWN_OUT = "brown-out"  # the supply falls: the board restarts


BOOT, IDLE, READY, ACTIVE, FAULT = State

#: (state, event) -> the state after it; a pair that is not here changes nothing
NEXT: dict[tuple[State, BoardEvent], State] = {
    (BOOT, BoardEvent.STARTED): IDLE,
    (BOOT, BoardEvent.STARTED_LOW): FAULT,
    (IDLE, BoardEvent.LIMITS): READY,
    (IDLE, BoardEvent.STOP): FAULT,
    (READY, BoardEvent.HELLO): IDLE,
    (READY, BoardEvent.ON): ACTIVE,
    (READY, BoardEvent.STOP): FAULT,
    (READY, BoardEvent.BYE): IDLE,
    (READY, BoardEvent.SILENCE): IDLE,
    (READY, BoardEvent.BAD): FAULT,
    (ACTIVE, BoardEvent.HELLO): IDLE,
    (ACTIVE, BoardEvent.OFF): READY,
    (ACTIVE, BoardEvent.STOP): FAULT,
    (ACTIVE, BoardEvent.BYE): IDLE,
    (ACTIVE, BoardEvent.WATCHDOG): FAULT,
    (ACTIVE, BoardEvent.BAD): FAULT,
    (FAULT, BoardEvent.RESET): IDLE,
    **{(state, BoardEvent.BROWN_OUT): BOOT for state in State},
}

#: Refused with WRONG_STATE.
REFUSED = {
    (IDLE, BoardEvent.ON),
    (IDLE, BoardEvent.OFF),
    (ACTIVE, BoardEvent.LIMITS),
    (ACTIVE, BoardEvent.HOME),
}

TICK_US = 1_000_000 // m.SAMPLE_HZ
SILENCE_US = 1_000_000  # us without a good frame, after which no host is there
START_US = 100_000  # us from power to Idle: self-test


@dataclass
class BoardCounts:
    """Messages that were not obeyed since power-up."""

    not_understood: int = 0  # a good frame with no message of ours in it
    old: int = 0  # commands that came twice, or after a newer one
    late: int = 0
    refused: int = 0


@dataclass
class Board:
    """One board. Times are microseconds of its own clock, which rises from power-up on.

    hello: what it is made of; state, faults, cause and starts are those below.
    """

    hello: m.Hello = FULL_BOARD
    state: State = State.BOOT
    currents: Four = ZERO  # mA, what the drivers give now
    faults: Fault = Fault.NONE
    cause: Fault = Fault.NONE
    homed: int = 0
    starts: int = 1
    #: (state before, event) -> how often: the coverage of the state machine
    seen: dict[tuple[State, BoardEvent], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._layout = m.layout_of(self.hello)
        self._encoders = joints_of(self.hello.encoders)
        self._brakes = joints_of(self.hello.brakes)
        self._sequence = 0
        self._low_at_start = False
        self._power_up(0)

    def _power_up(self, now_us: int) -> None:
        """Reset everything that does not outlive the supply."""
        self.decoder = FrameDecoder()
        self.counts = BoardCounts()
        self.homed = 0
        self._started_us = now_us
        self._offset = [0, 0, 0, 0]  # added to the counts as read: homing
        self._inputs = Watch(self.hello)
        self._detail = m.NO_DETAIL
        self._heard_us = now_us
        self._reported = Fault.NONE
        self._standing = False  # a condition of a fault is there now
        self._readings = Readings(force=(0,) * self.hello.force_channels)
        self._disconnect()

    def _disconnect(self) -> None:
        self.currents = ZERO
        self.limits = m.Limits(ZERO, ZERO)
        self.streaming = False
        self._fresh = Freshness()
        self._commanded_us = 0  # when the last fresh command came
        self._flags = Flag(0)

    def receive(self, data: bytes, now_us: int) -> bytes:
        """Handle bytes from the host; the bytes to answer. Nothing is heard in Boot."""
        answers = b""
        for payload in self.decoder.feed(data):
            message = m.unpack(payload)
            event = _event_of(message)
            if message is None or event is None:
                self.counts.not_understood += 1
                continue
            self._check_watchdog(now_us)
            self._heard_us = now_us
            if self.state == State.BOOT:
                self._count_event(event)
            else:
                answers += b"".join(encode_frame(m.pack(answer)) for answer in self._obey(message, event, now_us))
        return answers

    def tick(self, readings: Readings, now_us: int) -> bytes:
        """Do one tick at SAMPLE_HZ; the bytes to send (a fault report, a sample)."""
        self._readings = readings
        if self.state == State.BOOT:
            if now_us - self._started_us >= START_US:
                self._heard_us = now_us
                self._change(BoardEvent.STARTED_LOW if self._low_at_start else BoardEvent.STARTED)
                if self._low_at_start:
                    self._latch(Fault.BROWN_OUT, m.NO_DETAIL)
                self._low_at_start = False
            return b""
        self._sequence = (self._sequence + 1) % WRAP
        if readings.supply_cut:  # so that no current comes back with the supply
            self._fail(BoardEvent.STOP, Fault.HOST_REQUEST)
        self._check_watchdog(now_us)
        if now_us - self._heard_us >= SILENCE_US and self.state != State.ACTIVE and self.streaming:
            self._change(BoardEvent.SILENCE)
            self._disconnect()
        self._check(readings)
        out = b""
        if self.faults != self._reported and self.streaming:
            out += encode_frame(m.pack(self._report(now_us)))
        if self.streaming:
            out += encode_frame(self._layout.pack(self._sample(now_us)))
            self._flags &= ~Flag.LATE
        return out

    def lose_power(self, now_us: int, noticed: bool = True) -> None:
        """Brown-out: the currents are zero, and the board restarts with the fault latched.

        noticed = False: neither latched nor counted, as by a board that forgets its number of starts.
        """
        self._change(BoardEvent.BROWN_OUT)
        self._low_at_start = noticed
        self.faults = self.cause = Fault.NONE
        self.starts = (self.starts + noticed) % WRAP
        self._sequence = 0
        self._power_up(now_us)

    def _count_event(self, event: BoardEvent) -> None:
        self.seen[self.state, event] = self.seen.get((self.state, event), 0) + 1

    def _change(self, event: BoardEvent) -> bool:
        """Go to the next state; False: the event is refused in this state."""
        self._count_event(event)
        refused = (self.state, event) in REFUSED
        self.state = NEXT.get((self.state, event), self.state)
        if self.state != State.ACTIVE:
            self.currents = ZERO
        return not refused

    def _latch(self, fault: Fault, detail: int) -> None:
        self.cause = self.cause or fault
        if not self.faults:
            self._detail = detail
        self.faults |= fault

    def _fail(self, event: BoardEvent, fault: Fault, detail: int = m.NO_DETAIL) -> None:
        """Latch a fault; the currents are then zero."""
        self._change(event)
        self._latch(fault, detail)

    def _obey(self, message: tuple, event: BoardEvent, now_us: int) -> list[tuple]:
        """Obey one message; the answers."""
        if isinstance(message, m.Command):
            return self._command(message, event, now_us)
        if isinstance(message, m.Home) and (message.joints == 0 or message.joints & ~self.hello.encoders):
            return self._refuse(message, Refusal.BAD_VALUE)
        if event is BoardEvent.RESET and self.faults and self._standing:
            self._count_event(event)
            return self._refuse(message, Refusal.FAULT_STANDS)
        if not self._change(event):
            return self._refuse(message, Refusal.WRONG_STATE)
        match message:
            case m.AskHello(version):
                self._disconnect()
                refused = [] if version == m.VERSION else self._refuse(message, Refusal.VERSION)
                hello = self.hello._replace(state=self.state, faults=self.faults, cause=self.cause, starts=self.starts)
                return [hello, *refused]
            case m.SetLimits(current, speed):
                self.limits = m.Limits(tuple(map(min, current, self.hello.current_max_mA)), speed)
                self.streaming = True
                return [self.limits]
            case m.Home(joints, counts):
                for i in joints_of(joints):
                    self._offset[i] = counts[i] - self._readings.counts[i]
                self.homed |= joints
                return [m.Homed(joints, counts)]
            case m.ResetFault():
                if self.faults:
                    self._disconnect()
                self.faults = self.cause = Fault.NONE
                self._detail = m.NO_DETAIL
                return [self._report(now_us)]
            case m.Heartbeat(token):
                return [m.HeartbeatReply(token, now_us)]
            case m.Stop():
                self._latch(Fault.HOST_REQUEST, m.NO_DETAIL)
                return [self._report(now_us)]
        self._disconnect()  # Bye
        return []

    def _command(self, command: m.Command, event: BoardEvent, now_us: int) -> list[tuple]:
        if command.mode > 1:
            return self._refuse(command, Refusal.BAD_VALUE)
        age = self._fresh.judge(command.sequence, command.host_us, now_us)
        if age is Age.OLD:
            self.counts.old += 1
            return []
        if age is Age.LATE and event is BoardEvent.ON:  # Off is obeyed however late
            self.counts.late += 1
            self._flags |= Flag.LATE
            return []
        if not self._change(event):
            return self._refuse(command, Refusal.WRONG_STATE)
        self._fresh.take(command.sequence)
        self._commanded_us = now_us
        if self.state == State.ACTIVE:
            limit = self.limits.current_mA
            self.currents = tuple(min(command.current_mA[i], limit[i]) if i in self._brakes else 0 for i in range(4))
            clamped = self.currents != command.current_mA
            self._flags = (self._flags & ~Flag.CLAMPED) | (Flag.CLAMPED if clamped else Flag(0))
        return []

    def _refuse(self, message: tuple, reason: Refusal) -> list[tuple]:
        self.counts.refused += 1
        return [m.Refused(m.TYPES[type(message)], reason)]

    def _check_watchdog(self, now_us: int) -> None:
        """The watchdog, a tick early, so that currents are zero at 50 ms at the latest."""
        if self.state == State.ACTIVE and now_us - self._commanded_us > m.WATCHDOG_US - TICK_US:
            self._fail(BoardEvent.WATCHDOG, Fault.WATCHDOG)

    def _check(self, readings: Readings) -> None:
        """Conditions that latch a fault in Ready and Active, and keep one from being reset."""
        self._standing = readings.supply_cut
        for fault, detail in self._inputs.conditions(readings, self.limits):
            self._standing = True
            if self.state != State.IDLE and not self.faults & fault:
                self._fail(BoardEvent.BAD, fault, detail)

    def _report(self, now_us: int) -> m.FaultReport:
        self._reported = self.faults
        return m.FaultReport(self.faults, self.cause, self._detail, now_us)

    def _sample(self, now_us: int) -> m.Sample:
        r = self._readings
        return m.Sample(
            sequence=self._sequence,
            echo=self._fresh.last,
            board_us=now_us,
            state=self.state,
            flags=self.homed | self._flags | (Flag.CUT if r.supply_cut else 0),
            faults=self.faults,
            cause=self.cause,
            counts=tuple(_int32(r.counts[i] + self._offset[i]) for i in self._encoders),
            force=r.force,
            current_mA=tuple(r.current_mA[i] for i in self._brakes),
        )


_EVENTS = {
    m.AskHello: BoardEvent.HELLO,
    m.SetLimits: BoardEvent.LIMITS,
    m.Home: BoardEvent.HOME,
    m.ResetFault: BoardEvent.RESET,
    m.Heartbeat: BoardEvent.HEARTBEAT,
    m.Stop: BoardEvent.STOP,
    m.Bye: BoardEvent.BYE,
}


def _event_of(message: tuple | None) -> BoardEvent | None:
    """The event of a message; None: no host sends it (unknown, or our own, echoed)."""
    if isinstance(message, m.Command):
        return BoardEvent.ON if message.mode else BoardEvent.OFF
    return _EVENTS.get(type(message))


def _int32(value: int) -> int:
    """A count, or a difference of counts, wrapped as in the board's 32-bit counters."""
    return (value + (1 << 31)) % (1 << 32) - (1 << 31)
