"""The board in C (hardware/firmware) built on this host, and a Python board that writes down what it lives through."""

import functools
import json
import random
import shutil
import struct
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

import pytest
from simulated_board import FULL, NO_LIMIT, SimulatedBoard

from hardware.emulated_board.board import FULL_BOARD, SILENCE_US, TICK_US, Board, Readings
from hardware.wire import messages
from hardware.wire.frames import encode_frame
from hardware.wire.messages import Command, Fault, Hello, State, pack

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "hardware" / "firmware"
VECTORS = json.loads((ROOT / "docs" / "protocol-vectors.json").read_text())
DIALOGUES = VECTORS["dialogues"]
COMPILER = shutil.which("cc")
CORE = "[pt]*.c"  # phd_*.c and try_board.c; main.c is for a board
Program = list[str]  # a command
FLAGS = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-O1")
SANITIZERS = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")

needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler (cc): the board in C cannot be built")


def compiled(folder: Path, name: str, *flags: str, sources: str, at: Path = SOURCES) -> Path:
    """The program or library that the sources of this pattern become."""
    result = folder / name
    files = [str(source) for source in sorted(at.glob(sources))]
    subprocess.run([COMPILER, *FLAGS, *flags, *files, "-o", str(result)], check=True)
    return result


def on_this_machine(folder: Path) -> Program:
    """A whole board as a program (try_board.c), with sanitizers where compiler and system have them."""
    if COMPILER is None:
        pytest.skip("no C compiler (cc): the board in C cannot be built")
    source = folder / "nothing.c"
    source.write_text("int main(void) { return 0; }\n")
    made = subprocess.run([COMPILER, *SANITIZERS, str(source), "-o", str(folder / "nothing")], capture_output=True)
    works = made.returncode == 0 and subprocess.run([folder / "nothing"], capture_output=True).returncode == 0
    return [str(compiled(folder, "try_board", *(SANITIZERS if works else ()), sources=CORE))]


def on_a_cortex_m4(_folder: Path | None = None) -> Program:
    """The same as Cortex-M4 machine code, in an emulator that passes stdin and stdout on."""
    return [*M4, str(made("try-m4.elf"))]


#: where the board in C runs
TARGETS = {"this-machine": on_this_machine, "Cortex-M4": on_a_cortex_m4}
M4 = ["qemu-system-arm", "-M", "mps2-an386", "-display", "none", "-monitor", "none", "-serial", "none",
      "-semihosting-config", "enable=on,target=native", "-kernel"]  # fmt: skip


def found(*programs: str) -> None:
    """Skip where one of them is not on this machine."""
    if missing := [program for program in programs if shutil.which(program) is None]:
        pytest.skip(f"no {', '.join(missing)} on this machine")


@functools.cache
def made(name: str) -> Path:
    """What the Makefile of the firmware makes of this name, once in a process."""
    found("make", "arm-none-eabi-gcc", "qemu-system-arm")
    _built.append(tempfile.TemporaryDirectory())
    folder = _built[-1].name
    command = ["make", "-s", "-C", SOURCES, f"BUILD={folder}", f"{folder}/{name}"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return Path(folder) / name


_built: list[tempfile.TemporaryDirectory] = []  # gone with the process


HEAD = struct.Struct("<BHH4HB8IH")


class Did(NamedTuple):
    """What a board did at one event, as the program says it."""

    state: State
    faults: Fault
    cause: Fault
    currents: tuple[int, ...]
    homed: int
    good: int  # frames
    dropped: tuple[int, ...]  # frames: bad COBS, bad CRC, too long
    not_understood: int
    old: int
    late: int
    refused: int
    answer: bytes


def did_of(said: bytes, at: int = 0) -> tuple[Did, int]:
    """What an answer of the board in C says, and how many bytes it sent to the host."""
    state, faults, cause, *rest, n = HEAD.unpack_from(said, at)
    return Did(
        State(state), Fault(faults), Fault(cause), tuple(rest[:4]), rest[4], rest[5], tuple(rest[6:9]), *rest[9:], b""
    ), n  # fmt: skip


def told_power(board: Board, low: bool, now_us: int) -> bytes:
    """A board is powered up, after a brown-out if low; this and the next two as try_board.c takes them."""
    c = board.hello
    return struct.pack("<cIBQ3B3B", b"P", board.starts, low, now_us, c.encoders, c.brakes, c.force_channels,
                       *c.firmware) + struct.pack("<4I4HIi24s16s", *c.counts_per_rev, *c.current_max_mA,
                       c.force_unit, c.force_full_scale, c.device, c.serial)  # fmt: skip


def told_bytes(data: bytes, now_us: int) -> bytes:
    return struct.pack("<cQH", b"R", now_us, len(data)) + data


def told_tick(readings: Readings, now_us: int) -> bytes:
    force = (*readings.force, 0, 0, 0, 0, 0, 0)[:6]
    good = sum(1 << i for i in range(4) if readings.encoder_good[i]) | 16 * readings.supply_cut
    return struct.pack("<cQ4i6i4hB", b"T", now_us, *readings.counts, *force, *readings.current_mA, good)


class RecordedBoard(Board):
    """The Python board, which writes down what it is told, for the board in C, and what it did."""

    def __post_init__(self) -> None:
        self.script: list[bytes] = []
        self.did: list[Did] = []
        super().__post_init__()
        self._record(told_power(self, False, 0))

    def receive(self, data: bytes, now_us: int) -> bytes:
        answer = super().receive(data, now_us)
        self._record(told_bytes(data, now_us), answer)
        return answer

    def tick(self, readings: Readings, now_us: int) -> bytes:
        answer = super().tick(readings, now_us)
        self._record(told_tick(readings, now_us), answer)
        return answer

    def lose_power(self, now_us: int, noticed: bool = True) -> None:
        super().lose_power(now_us, noticed)
        self._record(told_power(self, noticed, now_us))

    def _record(self, told: bytes, answer: bytes = b"") -> None:
        frames, counts = self.decoder.counts, self.counts
        self.script.append(told)
        self.did.append(Did(
            self.state, self.faults, self.cause, self.currents, self.homed, frames.good,
            (frames.bad_cobs, frames.bad_crc, frames.too_long), counts.not_understood, counts.old, counts.late,
            counts.refused, answer,
        ))  # fmt: skip


def lived(program: Program, script: list[bytes]) -> list[Did]:
    """What the board in C did when it was told this."""
    done = subprocess.run(program, input=b"".join(script), capture_output=True, timeout=250)
    assert done.returncode == 0, done.stderr.decode()
    did, at = [], 0
    while at < len(done.stdout):
        one, n = did_of(done.stdout, at)
        at += HEAD.size
        did.append(one._replace(answer=done.stdout[at : at + n]))
        at += n
    return did


def live_alike(program: Program, boards: list[RecordedBoard]) -> list[Did]:
    """Let the board in C live through what these did: it must do the same."""
    script = [told for board in boards for told in board.script]
    did = lived(program, script)
    assert len(did) == len(script)
    for k, (in_c, in_python) in enumerate(zip(did, (did for board in boards for did in board.did), strict=True)):
        assert in_c == in_python, f"event {k}: {script[k][:1]!r} {script[k][1:].hex()}"
    return did


def recorded(hello: Hello = FULL_BOARD) -> SimulatedBoard:
    """A simulated board whose life is written down."""
    return SimulatedBoard(hello, RecordedBoard)


def hello() -> Hello:
    """Of the board that the dialogues are with."""
    fields = VECTORS["dialogues_board"]
    return FULL_BOARD._replace(**{
        name: tuple(value) if isinstance(value, list) else value.encode() if isinstance(value, str) else value
        for name, value in fields.items()
    })  # fmt: skip


def hold(dialogue: dict, kind: type[Board]) -> Board:
    """A board that goes through a dialogue of the specification and does at each step what it says."""
    board = kind(hello())
    if dialogue["after_brown_out"]:
        board.lose_power(0)
    now_us = 0
    for k, step in enumerate(dialogue["steps"]):
        assert step["at_us"] >= now_us, "time goes on"
        now_us = step["at_us"]
        if "told" in step:
            said = board.receive(bytes.fromhex(step["told"]), now_us)
        else:
            rise = step.get("counts_step", (0, 0, 0, 0))
            for n in range(step["ticks"]):
                now_us = step["at_us"] + n * TICK_US
                counts = tuple(first + n * each for first, each in zip(step["counts"], rise, strict=True))
                good = tuple(map(bool, step["encoder_good"]))
                said = board.tick(Readings(counts, tuple(step["force"]), tuple(step["measured_mA"]), good), now_us)
        did = {"answer": said.hex(), "state": board.state.name, "current_mA": list(board.currents)}
        assert did == {name: step[name] for name in did}, f"{dialogue['name']}, step {k}"
    return board


def random_hello(rng: random.Random) -> Hello:
    return FULL_BOARD._replace(
        encoders=rng.choice([0b0101, 0b1111, 0b0011, 0b1100]), brakes=rng.randrange(16),
        force_channels=rng.randrange(7), counts_per_rev=tuple(rng.randrange(2**32) for _ in range(4)),
        current_max_mA=tuple(rng.choice([0, 500, 1000, 65535]) for _ in range(4)), force_unit=rng.randrange(2**32),
        force_full_scale=rng.choice([1000, 66_700, 2**31 - 1]), device=b"four-brake", serial=rng.randbytes(16),
        firmware=(1, 2, 3),
    )  # fmt: skip


class RandomHost:
    """A host of many moods: mostly as the specification asks, at times wrong in every way."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.bench = recorded(random_hello(self.rng))
        self.sequence = self.rng.choice([0, 2**31 - 20, 2**32 - 20])
        self.zero_us = self.rng.choice([0, 10**9, 2**64 - 5 * 10**6])  # of the host's clock
        self.bad_ticks = 0

    def messages(self) -> list[bytes]:
        """Payloads to send now."""
        rng, now_us = self.rng, self.bench.now_us
        four = tuple(rng.choice([0, 300, 1000, 65535]) for _ in range(4))
        match rng.choices(range(12), [60, 2, 4, 2, 2, 3, 3, 1, 1, 3, 2, 2])[0]:
            case 0:
                self.sequence = (self.sequence + rng.choice([1] * 8 + [0, -3, 2**31 - 1])) % 2**32
                host_us = (self.zero_us + now_us + rng.choice([0] * 9 + [-60_000])) % 2**64
                return [pack(Command(self.sequence, host_us, int(rng.random() < 0.8), four))]
            case 1:
                return [pack(messages.AskHello(rng.choice([1, 1, 1, 2])))]
            case 2:
                return [pack(messages.SetLimits(four, tuple(rng.choice([0, 50_000, 2**32 - 1]) for _ in range(4))))]
            case 3:
                return [pack(messages.Home(rng.randrange(32), tuple(rng.randint(-(2**31), 2**31 - 1) for _ in "AEBC")))]
            case 4:
                return [pack(messages.Heartbeat(rng.randrange(2**32)))]
            case 5:
                return [pack(messages.ResetFault())]
            case 6:  # as after a start
                anew = (messages.AskHello(1), messages.ResetFault(), messages.SetLimits(FULL, NO_LIMIT))
                return [pack(message) for message in anew]
            case 7:
                return [pack(messages.Stop())]
            case 8:
                return [pack(messages.Bye())]
            case 9:  # any fields at all
                kind, size = rng.choice([(1, 1), (2, 24), (3, 21), (4, 17), (6, 4)])
                return [bytes([kind]) + rng.randbytes(size)]
            case 10:  # proven, but no message
                return [bytes([rng.randrange(256)]) + rng.randbytes(rng.randrange(40))]
        return []

    def readings(self) -> Readings:
        """At rest or turning, and now and then something that lasts long enough to be a fault."""
        rng, last = self.rng, self.bench.readings
        if self.bad_ticks == 0 and rng.random() < 0.01:
            self.bad_ticks, self.bad = rng.choice([1, 4, 5, 9, 10, 12]), rng.randrange(5)
        step, current, force, good = 3, 0, rng.randint(-900, 900), True
        if self.bad_ticks:
            self.bad_ticks -= 1
            if self.bad == 0:
                step = 100_000
            elif self.bad == 1:
                current = rng.choice([-(2**15), 2**15 - 1])
            elif self.bad == 2:
                force = rng.choice([-(2**31), 2**31 - 1])
            elif self.bad == 3:
                good = False
        return Readings(
            tuple(c + rng.randint(-step, step) for c in last.counts),
            tuple(force + k for k in range(self.bench.board.hello.force_channels)) if abs(force) < 2**31 - 1
            else (force,) * self.bench.board.hello.force_channels,
            tuple(rng.choice([current, 0, 50]) if current == 0 else current for _ in range(4)),
            tuple(good or rng.random() < 0.5 for _ in range(4)),
            rng.random() < (0.9 if last.supply_cut else 0.002),
        )  # fmt: skip

    def live(self, steps: int) -> RecordedBoard:
        rng, bench = self.rng, self.bench
        for _ in range(steps):
            bench.now_us += rng.choice([TICK_US] * 20 + [1, 999, 20 * TICK_US])
            happens = rng.random()
            if happens < 0.0015:
                bench.board.lose_power(bench.now_us)
            elif happens < 0.003:
                bench.now_us += SILENCE_US - rng.randrange(2)
            elif happens < 0.01:
                bench.board.receive(rng.randbytes(rng.randrange(300)) + b"\0" * rng.randrange(2), bench.now_us)
            elif happens < 0.8:
                data = b"".join(encode_frame(payload) for payload in self.messages())
                cut = rng.randrange(len(data) + 1)
                bench.board.receive(data[:cut], bench.now_us)
                bench.board.receive(data[cut:], bench.now_us)
            bench.readings = self.readings()
            bench.board.tick(bench.readings, bench.now_us)
        return bench.board
