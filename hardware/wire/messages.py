"""The messages of the bench board, byte by byte (docs/protocol.md, "Messages"): little-endian, no padding.

A payload is one type byte and the fields. What has an entry for each joint is in the order A, E, B, C; only a Sample is
as long as the board's Hello says. Values are as on the wire: mA, counts, microseconds of the sender's clock.
"""

import struct
from enum import IntEnum, IntFlag
from itertools import chain, islice
from typing import Any, NamedTuple

VERSION = 1
WATCHDOG_US = 50_000  # us, after which currents are zero when no fresh command came
SAMPLE_HZ = 1000


class State(IntEnum):
    BOOT = 0
    IDLE = 1
    READY = 2
    ACTIVE = 3
    FAULT = 4


class Fault(IntFlag):
    """Latched faults, named as in `core.faults`; the cause is the one that came first."""

    NONE = 0
    WATCHDOG = 1
    OVER_CURRENT = 2
    OVER_SPEED = 4
    BAD_ENCODER = 8
    FORCE_SATURATED = 16
    BROWN_OUT = 32
    HOST_REQUEST = 64


class Refusal(IntEnum):
    """Why a message was refused."""

    WRONG_STATE = 1
    BAD_VALUE = 2
    FAULT_STANDS = 3
    VERSION = 4


class Flag(IntFlag):
    """Flags of a sample, beside the low four: the encoder of that joint has been homed since power-up."""

    CLAMPED = 16  # the last command asked for more than a limit
    LATE = 32  # a command that had waited too long was not obeyed since the last sample
    CUT = 64  # an emergency stop beside the board has cut the amplifiers' supply


Four = tuple[int, ...]  # for each joint, in the order A, E, B, C
NO_DETAIL = 255


# ---------------------------------------------------------------------------------------------------- host -> board


class AskHello(NamedTuple):
    """Who are you? Ends an existing connection: currents zero, no samples."""

    version: int  # of the protocol


class SetLimits(NamedTuple):
    """Connect: what the board shall enforce. Samples flow from now on."""

    current_mA: Four  # largest
    speed_counts_s: Four  # largest; 0: no limit


class Command(NamedTuple):
    """Currents until the next command."""

    sequence: int  # from 1 on
    host_us: int  # host time
    mode: int  # 0 off, 1 on
    current_mA: Four  # with mode 1


class Home(NamedTuple):
    """Set the encoders of these joints to these counts."""

    joints: int  # bits
    counts: Four  # at which their encoders stand now


class ResetFault(NamedTuple):
    """Reset the faults whose conditions are over."""


class Heartbeat(NamedTuple):
    """Asks for a reply; does not feed the watchdog."""

    token: int  # any


class Stop(NamedTuple):
    """Brakes off, latched, at the host's request."""


class Bye(NamedTuple):
    """The host leaves."""


# ---------------------------------------------------------------------------------------------------- board -> host


class Hello(NamedTuple):
    """A board's identity and abilities."""

    version: int  # of the protocol
    state: int  # 0 Boot, 1 Idle, 2 Ready, 3 Active, 4 Fault
    faults: int  # latched, bits
    cause: int  # the first of them, or 0
    firmware: tuple[int, int, int]  # major, minor, patch
    encoders: int  # joints with one, bits: two or four
    brakes: int  # joints with one, bits
    force_channels: int  # 0 to 6
    sample_hz: int  # 1000
    watchdog_ms: int  # 50
    counts_per_rev: Four  # of the joint; 0: no encoder
    current_max_mA: Four  # of the amplifier; 0: no brake
    force_unit: int  # micro-newtons a count (channels 0 to 2), micro-newton metres a count (3 to 5)
    force_full_scale: int  # counts, either sign, at which a channel is saturated
    starts: int  # number of power-ups, or a random number at each: a change says that homing is lost
    device: bytes  # its name, UTF-8, filled with zero bytes
    serial: bytes  # number, likewise


class Limits(NamedTuple):
    """The limits in force: the smaller of what was asked for and what the board can do."""

    current_mA: Four  # in force
    speed_counts_s: Four  # in force


class Sample(NamedTuple):
    """One tick of the board. Only what there is: counts (encoders,), force (force_channels,), currents (brakes,)."""

    sequence: int  # 1 at the first tick after Boot, rises by one each tick, sent or not
    echo: int  # sequence of the last command taken in; 0: none
    board_us: int  # when encoders and force were read; rises from power-up
    state: int  # as in Hello
    flags: int  # 1, 2, 4, 8: encoder of A, E, B, C homed; 16 command clamped; 32 late command; 64 supply cut
    faults: int  # latched, bits
    cause: int  # the first of them, or 0
    counts: tuple[int, ...]  # of the encoders; they go round at 2^31
    force: tuple[int, ...]  # counts of the force channels
    current_mA: tuple[int, ...]  # measured, either sign


class Homed(NamedTuple):
    """The encoders were set."""

    joints: int  # as in Home
    counts: Four  # as in Home


class FaultReport(NamedTuple):
    """Sent when a fault latches and when faults are reset (faults 0)."""

    faults: int  # latched
    cause: int  # the first
    detail: int  # of the cause: joint 0 to 3, channel 0 to 5, else 255
    board_us: int  # board time


class HeartbeatReply(NamedTuple):
    token: int  # of the Heartbeat
    board_us: int  # board time


class Refused(NamedTuple):
    """A message was understood and not obeyed."""

    message: int  # its type
    reason: int  # 1 wrong state, 2 bad value, 3 the fault's cause is still there, 4 version


SAMPLE_TYPE, SAMPLE_HEAD = 0x83, "I I Q B B H H"  # type; layout of what every board's sample begins with
#: type -> class and layout; in a layout "4H" is one field of four values
LAYOUTS: dict[int, tuple[type, str]] = {
    0x01: (AskHello, "B"),
    0x02: (SetLimits, "4H 4I"),
    0x03: (Command, "I Q B 4H"),
    0x04: (Home, "B 4i"),
    0x05: (ResetFault, ""),
    0x06: (Heartbeat, "I"),
    0x07: (Stop, ""),
    0x08: (Bye, ""),
    0x81: (Hello, "B B H H 3B B B B H H 4I 4H I i I 24s 16s"),
    0x82: (Limits, "4H 4I"),
    0x84: (Homed, "B 4i"),
    0x85: (FaultReport, "H H B Q"),
    0x86: (HeartbeatReply, "I Q"),
    0x8F: (Refused, "B B"),
}
TYPES = {kind: number for number, (kind, _) in LAYOUTS.items()}


class Layout:
    """How the fields of one message stand in its payload, after the byte of its type."""

    def __init__(self, number: int, kind: Any, fields: str) -> None:
        self._head, self._kind = bytes([number]), kind
        self._struct = struct.Struct("<" + fields)
        self.bytes = 1 + self._struct.size  # of a payload
        #: of each field how many values it has; None: one, by itself
        self._widths = [None if len(code) == 1 or code[-1] == "s" else int(code[:-1]) for code in fields.split()]

    def pack(self, message: tuple) -> bytes:
        """The payload of a message. struct.error where a value does not fit its field."""
        each = zip(message, self._widths, strict=True)
        return self._head + self._struct.pack(*chain.from_iterable((v,) if width is None else v for v, width in each))

    def unpack(self, payload: bytes) -> tuple | None:
        """The message of a payload; None: of another type, or not as long as its type says."""
        if len(payload) != self.bytes or payload[0] != self._head[0]:
            return None
        flat = iter(self._struct.unpack_from(payload, 1))
        values = [next(flat) if width is None else tuple(islice(flat, width)) for width in self._widths]
        return self._kind._make(v.rstrip(b"\0") if isinstance(v, bytes) else v for v in values)


_LAYOUTS = {number: Layout(number, kind, fields) for number, (kind, fields) in LAYOUTS.items()}
_BY_KIND = {kind: _LAYOUTS[number] for kind, number in TYPES.items()}


def pack(message: tuple) -> bytes:
    """The payload of any message but a Sample. struct.error where a value does not fit its field."""
    return _BY_KIND[type(message)].pack(message)


def unpack(payload: bytes) -> tuple | None:
    """The message of a payload, or None: unknown type, or not as long as its type says. Of a Sample: `layout_of`."""
    layout = _LAYOUTS.get(payload[0])
    return layout.unpack(payload) if layout else None


def layout_of(hello: Hello) -> Layout:
    """The sample layout of the board that sent this Hello."""
    encoders, brakes = hello.encoders.bit_count(), hello.brakes.bit_count()
    return Layout(SAMPLE_TYPE, Sample, f"{SAMPLE_HEAD} {encoders}i {hello.force_channels}i {brakes}h")


def joints_of(bits: int) -> tuple[int, ...]:
    """Joint indices (A, E, B, C are 0..3) whose bits are set."""
    return tuple(i for i in range(4) if bits >> i & 1)
