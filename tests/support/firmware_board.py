"""The board in C in the place of the Python board, as machine code of a Cortex-M4 in QEMU: try_board.c behind
semihosting, or the whole image with its drivers of the serial ports. The plant is the clock of either.
"""

import socket
import struct
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from reference_board import HEAD, Did, Program, did_of, told_bytes, told_power, told_tick

from hardware.emulated_board.board import WRAP, Board, Readings
from hardware.wire.frames import FrameDecoder, encode_frame

LONGEST_S = 60.0  # that an emulated processor may take for a tick on a machine that is busy


class Pipe:
    """A board program that is told one thing at a time by its stdin."""

    def __init__(self, program: Program) -> None:
        self.process = subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def tell(self, record: bytes) -> Did:
        assert self.process.stdin and self.process.stdout
        self.process.stdin.write(record + b"F")
        self.process.stdin.flush()
        did, n = did_of(self.process.stdout.read(HEAD.size))
        return did._replace(answer=self.process.stdout.read(n) if n else b"")

    def close(self) -> None:
        """End it."""
        for end in (self.process.stdin, self.process.stdout):
            assert end
            end.close()
        self.process.wait(LONGEST_S)


class Cost(NamedTuple):
    """What a step took on the processor."""

    stack: int  # bytes, deepest since reset
    clocks: int


COST = struct.Struct("<II")


class Image:
    """A whole firmware in QEMU, with the host's port and the plant's behind two sockets."""

    def __init__(self, image: Path, *options: str) -> None:
        self._folder = tempfile.TemporaryDirectory()
        where = [Path(self._folder.name) / name for name in ("host", "plant")]
        listening = [socket.socket(socket.AF_UNIX) for _ in where]
        for end, path in zip(listening, where, strict=True):
            end.bind(str(path))
            end.listen(1)
        ports = [part for path in where for part in ("-serial", f"unix:{path}")]
        self.process = subprocess.Popen(
            ["qemu-system-arm", "-M", "netduinoplus2", "-display", "none", "-monitor", "none", "-serial", "null",
             *ports, *options, "-kernel", image]
        )  # fmt: skip
        self._host, self._plant = (end.accept()[0] for end in listening)
        for end in listening:
            end.close()
        self._host.settimeout(LONGEST_S)
        self._plant.settimeout(LONGEST_S)
        self._frames = FrameDecoder()
        self.costs: list[tuple[bytes, Cost]] = []  # what was told, and what it took
        assert self._heard() == b"U"
        self._is_up = False

    def _heard(self) -> bytes:
        while True:
            for payload in self._frames.feed(self._plant.recv(4096)):
                return payload

    def tell(self, record: bytes) -> Did:
        if record[:1] == b"P":
            if self._is_up:
                self._plant.sendall(encode_frame(record))  # resets it
                assert self._heard() == b"U"
            self._is_up = True
        if record[:1] == b"R":
            self._host.sendall(record[11:])
            record = record[:11]
        self._plant.sendall(encode_frame(record))
        said = self._heard()
        self.costs.append((record[:1], Cost(*COST.unpack(said[-COST.size :]))))
        did, n = did_of(said)
        answer = b""
        while len(answer) < n:
            answer += self._host.recv(n - len(answer))
        return did._replace(answer=answer)

    def close(self) -> None:
        """End it."""
        self.process.kill()
        self.process.wait(LONGEST_S)
        self._host.close()
        self._plant.close()
        self._folder.cleanup()


class FirmwareBoard(Board):
    """Behind the methods of the Python board; `opened` says how it is reached."""

    opened: Callable[[], Pipe | Image]

    def __post_init__(self) -> None:
        self.firmware = type(self).opened()
        super().__post_init__()
        self._tell(told_power(self, False, 0))

    def _tell(self, record: bytes) -> bytes:
        did = self.firmware.tell(record)
        self.state, self.faults, self.cause, self.currents, self.homed, frames, counts = (
            did.state, did.faults, did.cause, did.currents, did.homed, self.decoder.counts, self.counts,
        )  # fmt: skip
        frames.good, (frames.bad_cobs, frames.bad_crc, frames.too_long) = did.good, did.dropped
        counts.not_understood, counts.old, counts.late, counts.refused = did[7:11]
        return did.answer

    def receive(self, data: bytes, now_us: int) -> bytes:
        return self._tell(told_bytes(data, now_us)) if data else b""

    def tick(self, readings: Readings, now_us: int) -> bytes:
        return self._tell(told_tick(readings, now_us))

    def lose_power(self, now_us: int, noticed: bool = True) -> None:
        self.starts = (self.starts + noticed) % WRAP
        self._tell(told_power(self, noticed, now_us))


def firmware_boards(opens: Callable[[], Pipe | Image]) -> type[FirmwareBoard]:
    """A kind of board each of which opens a firmware of its own, or the same one, as the function does."""
    return type("FirmwareBoard", (FirmwareBoard,), {"opened": staticmethod(opens)})
