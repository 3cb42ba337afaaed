"""One connection to a board, from Hello to Bye: messages over a port, and what they say of the line's health."""

import json
import socket
import time
from pathlib import Path
from typing import Protocol, TypeVar

from core.device import Device
from core.device_interface import DeviceError
from core.faults import cause
from core.files import InputError
from core.mechanism import JOINTS
from hardware.emulated_board.sensors import CONTROL, EMULATED, sensing_of
from hardware.wire.frames import FrameCounts, FrameDecoder, encode_frame
from hardware.wire.messages import (
    SAMPLE_HZ,
    VERSION,
    WATCHDOG_US,
    AskHello,
    Flag,
    Four,
    Hello,
    Home,
    Limits,
    Refusal,
    Refused,
    ResetFault,
    Sample,
    SampleLayout,
    SetLimits,
    joints_of,
    layout_of,
    pack,
    unpack,
)

ANSWER_S = 0.5  # longest wait for an answer
HELLO_S = 1.5  # .. for a board that may just be starting
AGAIN_S = 0.1  # a question without answer is put again after this
REWIRE_S = 0.2  # an emulated board is wired to another device and has started. Our choice
#: rad/s, at which a joint is too fast (assumed; 9 m/s at the end of a 0.3 m link)
SPEED_MAX = 30.0
TURN = 6.283185307179586

#: s. The clock stood still for longer than this (or as long in several steps). Below what makes a board call a command
#: late (freshness.LATE_US) by what the way of a command may vary.
STOOD_STILL_S = 0.04
LEARN_S = 1.0  # of board time, after which the quickest sample's way is known
DRIFT = 2e-4  # most that the two clocks run apart: four crystals of 50 ppm. Assumed
LATE_S = 0.2  # all commands late for so long

#: why a board refused, for whoever asked
REFUSAL_WORDS = {
    Refusal.WRONG_STATE: "it does not do that in the state it is in",
    Refusal.BAD_VALUE: "it cannot take what it was told",
    Refusal.FAULT_STANDS: "what caused its fault is still there",
    Refusal.VERSION: "it speaks another version of the protocol",
}
#: .. and what it would not do
ASKED_WORDS = {
    SetLimits: "take the limits of the brakes",
    Home: "take the homing",
    ResetFault: "forget its fault",
    AskHello: "connect",
}

Answer = TypeVar("Answer")


class Wire(Protocol):
    """What a connection needs of a port; all raise DeviceError where it has died."""

    name: str
    not_taken: int  # writes that found no room in time

    def read(self) -> bytes:
        """What has come; waits at most some ms."""

    def write(self, data: bytes) -> None:
        """Send."""

    def close(self) -> None:
        """Close; never waits for long."""


class Connection:
    """Messages to and from one board."""

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self._decoder = FrameDecoder()
        self._layout: SampleLayout | None = None
        self.not_understood = 0  # whole frames that hold no message of this protocol

    @property
    def frames(self) -> FrameCounts:
        """What came over the wire."""
        return self._decoder.counts

    def send(self, message: tuple) -> None:
        """One message to the board."""
        self.wire.write(encode_frame(pack(message)))

    def read(self) -> list[tuple]:
        """The messages that have come, samples among them once limits were set; waits some ms for the first byte."""
        messages = []
        for payload in self._decoder.feed(self.wire.read()):
            message = (self._layout.unpack(payload) if self._layout else None) or unpack(payload)
            if message is not None:
                messages.append(message)
            elif self._layout:  # before, a sample's layout is not known
                self.not_understood += 1
        return messages

    def ask(self, question: tuple, kind: type[Answer], patience_s: float = ANSWER_S) -> Answer:
        """The board's answer of this kind; what else comes meanwhile is dropped. DeviceError: refused, or none came."""
        end = time.monotonic() + patience_s
        again, late = 0.0, False
        while not late:
            now = time.monotonic()
            late = now >= end  # who was held up for so long still reads what has come
            if now >= again:
                self.send(question)
                again = now + AGAIN_S
            for message in self.read():
                if isinstance(message, kind):
                    return message
                if isinstance(message, Refused) and message.message == pack(question)[0]:
                    raise DeviceError(refusal(question, message.reason))
        raise DeviceError(cause("no-board", name=self.wire.name))

    def hello(self, device: Device) -> Hello:
        """Who is there, checked against the device file; ends what connection there was. InputError: another board."""
        self._layout = None
        self.wire.write(b"\0")
        hello = self.ask(AskHello(VERSION), Hello, HELLO_S)
        if wired_to(hello) != shortened(device) and rewire_emulated(hello, self.wire.name, device):
            hello = self.ask(AskHello(VERSION), Hello, HELLO_S)
        check_hello(hello, device)
        return hello

    def set_limits(self, hello: Hello, device: Device) -> Limits:
        """Let samples flow; the limits in force."""
        asked = limits_of(hello, device)
        limits = self.ask(asked, Limits)
        if limits.current_mA != asked.current_mA:
            raise DeviceError(
                f"the board has set other current limits, {limits.current_mA} mA, than {asked.current_mA}"
            )
        self._layout = layout_of(hello)
        return limits


def refusal(question: tuple, reason: int) -> str:
    """That the board would not do what it was asked, in one sentence."""
    words = {int(known): text for known, text in REFUSAL_WORDS.items()}
    asked = ASKED_WORDS.get(type(question), f"answer {type(question).__name__}")
    return f"the board would not {asked}: {words.get(reason, f'its reason, {reason}, is not known here')}"


def limits_of(hello: Hello, device: Device) -> SetLimits:
    """What the board shall enforce: the currents of the brake files, and a speed for each encoder."""
    a, e, b, c = currents_of(device)
    speeds = [round(SPEED_MAX / TURN * n) for n in hello.counts_per_rev]
    return SetLimits((a, e, b, c), (speeds[0], speeds[1], speeds[2], speeds[3]))


def currents_of(device: Device) -> Four:
    """The brake files' largest currents, mA; 0 at joints without a brake."""
    a, e, b, c = (round(1000.0 * float(most)) for most in device.brakes.current_max)
    return a, e, b, c


def wired_to(hello: Hello) -> str:
    """The name of the device that a board is wired to."""
    return hello.device.decode(errors="replace")


def shortened(device: Device) -> str:
    """A device's name as a board has room for it."""
    return device.name.encode()[:24].decode(errors="replace")


def rewire_emulated(hello: Hello, port: str, device: Device) -> bool:
    """Ask an emulated board, by the socket beside its port, to be wired to a device; False: it is a real board."""
    control = Path(port).with_name(CONTROL)
    if not hello.serial.startswith(EMULATED.encode()) or not control.is_socket():
        return False
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as orders:
            orders.sendto(json.dumps({"device": device.name}).encode(), str(control))
    except OSError:  # it has just ended: the board that answered is the one to be refused
        return False
    time.sleep(REWIRE_S)
    return True


def check_hello(hello: Hello, device: Device) -> None:
    """InputError, in one sentence, where this board is not what the device file says."""
    where = f"the board ({hello.serial.decode(errors='replace') or 'without a number'})"
    if hello.version != VERSION:
        raise InputError(f"{where} speaks version {hello.version} of the protocol, this program version {VERSION}")
    if hello.sample_hz != SAMPLE_HZ or not 0 < hello.watchdog_ms <= WATCHDOG_US // 1000:
        raise InputError(f"{where} samples at {hello.sample_hz} Hz with a watchdog of {hello.watchdog_ms} ms")
    wired = wired_to(hello)
    if not wired:
        raise InputError(f"{where} does not say which device it is wired to: its firmware must name {device.name!r}")
    if wired != shortened(device):
        raise InputError(f"{where} is wired to the device {wired!r}, not to {device.name!r}")
    encoders = sensing_of(device)[0]
    wanted: Four = tuple(getattr(encoders, joint) or 0 for joint in JOINTS)  # type: ignore[assignment]
    has = tuple(n if hello.encoders >> i & 1 else 0 for i, n in enumerate(hello.counts_per_rev))
    if has != wanted or hello.encoders > 0b1111:
        raise InputError(f"{where} has encoders {_listed(has)}, device {device.name} says {_listed(wanted)}")
    missing = [JOINTS[i] for i in range(4) if device.brakes.present[i] and i not in joints_of(hello.brakes)]
    if missing or hello.brakes > 0b1111 or hello.force_channels > 6:
        raise InputError(f"{where} drives no brake at {', '.join(missing) or 'those joints'}")
    for joint, wanted_mA, most_mA in zip(JOINTS, currents_of(device), hello.current_max_mA, strict=False):
        if wanted_mA > most_mA:  # it would brake less than the controllers count on
            raise InputError(
                f"{where} gives the brake at {joint} at most {1e-3 * most_mA:g} A, the brake file of device "
                f"{device.name} says {1e-3 * wanted_mA:g} A"
            )


def _listed(counts: tuple[int, ...]) -> str:
    return ", ".join(f"{JOINTS[i]} = {n}" for i, n in enumerate(counts) if n) or "none"


class FreshnessWatch:
    """Whether the board still takes for fresh what is sent: the host's end of docs/protocol.md, "Commands".

    A board calls a command late by its own clock and the host's. Where the host's clock stood still (a virtual machine
    that was paused, a suspend that was given up), every command is late from then on, for minutes. Only a new
    connection helps: with it freshness begins anew, and the currents are zero until some are asked for.
    """

    def __init__(self) -> None:
        self._began = self._last = 0.0  # board s
        self._least: float | None = None  # s: host time less board time of the quickest samples. None: no sample yet
        self._late: tuple[float, int] | None = None  # since when (host s) commands are late, and the echo since then

    def doubt(self, sample: Sample, came_s: float) -> str:
        """Why the connection must begin anew, one sentence; "": the board can tell what is fresh. came_s: host time."""
        stood = self._stood_still(1e-6 * sample.board_us, came_s)
        if stood > STOOD_STILL_S:
            return f"this computer's clock stood still for {1e3 * stood:.0f} ms, the board is being connected anew"
        if self._late is None or self._late[1] != sample.echo:  # one was taken in
            self._late = (came_s, sample.echo) if sample.flags & Flag.LATE else None
        elif came_s - self._late[0] > LATE_S:
            return "the board takes every command for late, it is being connected anew"
        return ""

    def _stood_still(self, board_s: float, came_s: float) -> float:
        """How much earlier a sample came than the quickest before it, s: nothing is quicker but by a clock."""
        behind = came_s - board_s
        if self._least is None or board_s < self._last:  # the first one, or the board's clock went back
            self._began, self._least = board_s, behind
        drifted = DRIFT * (board_s - self._last)
        self._last = board_s
        if board_s - self._began < LEARN_S:
            self._least = min(self._least, behind)
            return 0.0
        earlier = self._least - behind
        self._least += min(max(-earlier, -drifted), drifted)
        return earlier
