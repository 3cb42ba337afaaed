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

    version: int  # of the protocol, the host's


class SetLimits(NamedTuple):
    """Connect: what the board shall enforce. Samples flow from now on."""

    current_mA: Four
    speed_counts_s: Four  # 0: no limit


class Command(NamedTuple):
    """Currents until the next command."""

    sequence: int  # rises by one with each command; the board obeys only newer ones
    host_us: int
    mode: int  # 0 off (currents zero), 1 on
    current_mA: Four


class Home(NamedTuple):
    """Set the encoders of these joints to these counts."""

    joints: int  # bits 1 A, 2 E, 4 B, 8 C
    counts: Four


class ResetFault(NamedTuple):
    """Reset the faults whose conditions are over."""


class Heartbeat(NamedTuple):
    """Asks for a reply; does not feed the watchdog."""

    token: int


class Stop(NamedTuple):
    """Brakes off, latched, at the host's request."""


class Bye(NamedTuple):
    """The host leaves."""


# ---------------------------------------------------------------------------------------------------- board -> host


class Hello(NamedTuple):
    """A board's identity and abilities."""

    version: int
    state: int
    faults: int
    cause: int  # the fault that came first, or 0
    firmware: tuple[int, int, int]
    encoders: int  # bits: which joints
    brakes: int  # bits: which joints
    force_channels: int  # 0..6
    sample_hz: int
    watchdog_ms: int
    counts_per_rev: Four
    current_max_mA: Four  # what its drivers can do
    force_unit: int  # micro-newtons (channels 0-2) or micro-newton metres (3-5) in a count
    force_full_scale: int  # counts at which a channel is saturated
    starts: int  # how often it was powered up, modulo 2^32: a change says that homing is lost
    device: bytes  # up to 24 bytes of UTF-8: the device it is wired to
    serial: bytes  # up to 16 bytes: this board


class Limits(NamedTuple):
    """The limits in force: the smaller of what was asked for and what the board can do."""

    current_mA: Four
    speed_counts_s: Four


class Sample(NamedTuple):
    """One tick of the board. Only what there is: counts (encoders,), force (force_channels,), currents (brakes,)."""

    sequence: int
    echo: int  # sequence of the last command that was taken in
    board_us: int
    state: int
    flags: int
    faults: int
    cause: int
    counts: tuple[int, ...]
    force: tuple[int, ...]
    current_mA: tuple[int, ...]  # measured


class Homed(NamedTuple):
    """The encoders were set."""

    joints: int
    counts: Four


class FaultReport(NamedTuple):
    """Sent when a fault latches and when faults are reset (faults 0)."""

    faults: int
    cause: int
    detail: int  # index of the joint or force channel; NO_DETAIL where there is none
    board_us: int


class HeartbeatReply(NamedTuple):
    token: int
    board_us: int


class Refused(NamedTuple):
    """A message was understood and not obeyed."""

    message: int  # its type
    reason: int


SAMPLE_TYPE = 0x83
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
    return Layout(SAMPLE_TYPE, Sample, f"I I Q B B H H {encoders}i {hello.force_channels}i {brakes}h")


def joints_of(bits: int) -> tuple[int, ...]:
    """Joint indices (A, E, B, C are 0..3) whose bits are set."""
    return tuple(i for i in range(4) if bits >> i & 1)
