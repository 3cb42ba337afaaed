"""The board in C (hardware/reference) against the specification's vectors and, step by step, against the Python board.

Skipped where there is no C compiler. As a script it feeds a million bytes (more if a number is given) to both boards.
"""

import ctypes
import json
import random
import shutil
import struct
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import simulated_board
from simulated_board import FULL, NO_LIMIT, SimulatedBoard
from test_board_states import SEEN, happen, in_state
from test_wire_messages import VECTORS, layout, message_of

from hardware import messages
from hardware.board import SILENCE_US, TICK_US, Board
from hardware.board_states import Event, handling
from hardware.board_watch import Capability, Readings
from hardware.frames import encode_frame
from hardware.messages import WATCHDOG_US, Command, Fault, Refused, Sample, State, pack

SOURCES = Path(__file__).resolve().parent.parent / "hardware" / "reference"
COMPILER = shutil.which("cc")
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O1")
SANITIZERS = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")

pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler (cc): the board in C cannot be built")


def compiled(folder: Path, name: str, *flags: str, sources: Iterator[Path]) -> Path:
    """The program or library that these sources become."""
    result = folder / name
    subprocess.run([COMPILER, *FLAGS, *flags, *map(str, sources), "-o", str(result)], check=True)
    return result


def sanitizers(folder: Path) -> tuple[str, ...]:
    """What makes a program stop at undefined behaviour, where compiler and system have it."""
    source = folder / "nothing.c"
    source.write_text("int main(void) { return 0; }\n")
    made = subprocess.run([COMPILER, *SANITIZERS, str(source), "-o", str(folder / "nothing")], capture_output=True)
    works = made.returncode == 0 and subprocess.run([folder / "nothing"], capture_output=True).returncode == 0
    return SANITIZERS if works else ()


def board_program(folder: Path) -> Path:
    """try_board.c and the board, with sanitizers where there are any."""
    return compiled(folder, "try_board", *sanitizers(folder), sources=SOURCES.glob("*.c"))


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return board_program(tmp_path_factory.mktemp("board"))


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    folder = tmp_path_factory.mktemp("library")
    made = compiled(folder, "board.so", "-shared", "-fPIC", sources=SOURCES.glob("phd_*.c"))
    loaded = ctypes.CDLL(str(made))
    loaded.phd_crc32.restype = ctypes.c_uint32
    loaded.phd_unpack.restype = ctypes.c_bool
    for name in ("encode_frame", "decode", *(f"pack_{kind}" for kind in PACKED.values())):
        getattr(loaded, f"phd_{name}").restype = ctypes.c_size_t
    return loaded


# ---------------------------------------------------------------------------------- the same life for both boards

HEAD = struct.Struct("<BHH4HB8IH")  # of the record that the program says after each event


class Said(NamedTuple):
    """What the board in C did at one event."""

    state: State
    currents: tuple[int, ...]
    said: bytes


class RecordedBoard(Board):
    """The Python board, which writes down what it is told, for the board in C, and what it did."""

    def __post_init__(self) -> None:
        self.script: list[bytes] = []
        self.did: list[bytes] = []
        super().__post_init__()
        self._record(self._power(low=False, now_us=0))

    def receive(self, data: bytes, now_us: int) -> bytes:
        said = super().receive(data, now_us)
        self._record(struct.pack("<cQH", b"R", now_us, len(data)) + data, said)
        return said

    def tick(self, readings: Readings, now_us: int) -> bytes:
        said = super().tick(readings, now_us)
        force = (*readings.force, 0, 0, 0, 0, 0, 0)[:6]
        good = sum(1 << i for i in range(4) if readings.encoder_good[i])
        told = struct.pack("<cQ4i6i4hB", b"T", now_us, *readings.counts, *force, *readings.current_mA, good)
        self._record(told, said)
        return said

    def lose_power(self, now_us: int) -> None:
        super().lose_power(now_us)
        self._record(self._power(low=True, now_us=now_us))

    def _power(self, low: bool, now_us: int) -> bytes:
        c = self.capability
        return struct.pack("<cIBQ3B3B", b"P", self.starts, low, now_us, c.encoders, c.brakes, c.force_channels,
                           *c.firmware) + struct.pack("<4I4HIi24s16s", *c.counts_per_rev, *c.current_max_mA,
                           c.force_unit, c.force_full_scale, c.device, c.serial)  # fmt: skip

    def _record(self, told: bytes, said: bytes = b"") -> None:
        frames, counts = self.decoder.counts, self.counts
        self.script.append(told)
        self.did.append(HEAD.pack(
            self.state, self.faults, self.cause, *self.currents, self.homed, frames.good, frames.bad_cobs,
            frames.bad_crc, frames.too_long, counts.not_understood, counts.old, counts.late, counts.refused, len(said),
        ) + said)  # fmt: skip


def run(program: Path, boards: list[RecordedBoard]) -> list[Said]:
    """Let the board in C live through the same; it must do the same."""
    script = [told for board in boards for told in board.script]
    expected = [did for board in boards for did in board.did]
    done = subprocess.run([program], input=b"".join(script), capture_output=True, timeout=120)
    assert done.returncode == 0, done.stderr.decode()
    at = 0
    for k, did in enumerate(expected):
        got = done.stdout[at : at + len(did)]
        assert got == did, f"event {k} ({script[k][:1]!r} {script[k][1:].hex()}): C {got.hex()}, Python {did.hex()}"
        at += len(did)
    assert at == len(done.stdout)
    heads = [HEAD.unpack_from(did) for did in expected]
    return [Said(State(h[0]), h[3:7], did[HEAD.size :]) for h, did in zip(heads, expected, strict=True)]


def recorded(capability: Capability | None = None) -> SimulatedBoard:
    bench = SimulatedBoard(capability)
    bench.board = RecordedBoard(capability or Capability())
    return bench


def test_each_event_in_each_state_does_the_same(program: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulated_board, "Board", RecordedBoard)
    boards = []
    for state, event in SEEN:
        bench = in_state(state, event)
        bench.board.seen.clear()
        happen(bench, event)
        assert (state, event) in bench.board.seen
        bench.tick(3)
        boards.append(bench.board)
    run(program, boards)


def test_the_table_is_that_of_the_specification(library: ctypes.CDLL) -> None:
    words = {**{int(state): state.name for state in State}, 16: "same", 17: "refused", 18: "ignored", 19: "-"}
    table = ((ctypes.c_uint8 * len(State)) * len(Event)).in_dll(library, "phd_states")
    assert [[words[cell] for cell in row] for row in table] == [[handling(s, e) for s in State] for e in Event]


@pytest.mark.parametrize("phase_us", [0, 1, 500, 999])
def test_currents_are_zero_50_ms_after_the_last_command_whenever_it_came(program: Path, phase_us: int) -> None:
    bench = recorded()
    bench.connect()
    bench.now_us += phase_us
    bench.command()
    came_us = bench.now_us
    bench.now_us -= phase_us
    begin = len(bench.board.script)
    bench.tick(60)
    for k, did in enumerate(run(program, [bench.board])[begin:]):
        age_us = bench.now_us - (59 - k) * TICK_US - came_us
        assert any(did.currents) == (age_us <= WATCHDOG_US - TICK_US), f"{age_us} us"
        assert (did.state == State.FAULT) == (not any(did.currents))


def test_a_command_after_the_watchdog_finds_it_tripped_even_between_ticks(program: Path) -> None:
    for late_us, state in ((49_000, State.ACTIVE), (49_001, State.FAULT)):
        bench = recorded()
        bench.activate()
        bench.now_us += late_us
        bench.command()
        assert run(program, [bench.board])[-1].state == state


def test_encoders_that_go_round_at_full_speed_limit_are_no_fault_by_themselves(program: Path) -> None:
    """The homed counts go round, as two's complement does; the counts as read stay away from their ends."""
    bench = recorded()
    bench.connect(speed=(1000, 0, 1000, 0))
    bench.tell(messages.Home(0b0101, (2**31 - 3, 0, -(2**31), 0)))
    for k in range(30):
        bench.tick(counts=(k, 0, -k, 0))
        bench.command(mode=0)
    assert run(program, [bench.board])[-1].state == State.READY


# ------------------------------------------------------------------------------------------------- random sessions


def random_capability(rng: random.Random) -> Capability:
    return Capability(
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
        self.bench = recorded(random_capability(self.rng))
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
                return [pack(messages.AskHello(1)), pack(messages.ResetFault()), pack(messages.SetLimits(FULL, NO_LIMIT))]
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
            tuple(force + k for k in range(self.bench.board.capability.force_channels)) if abs(force) < 2**31 - 1
            else (force,) * self.bench.board.capability.force_channels,
            tuple(rng.choice([current, 0, 50]) if current == 0 else current for _ in range(4)),
            tuple(good or rng.random() < 0.5 for _ in range(4)),
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


def test_random_sessions_give_the_same_bytes_states_and_currents(program: Path) -> None:
    boards = [RandomHost(seed).live(1500) for seed in range(16)]
    did = run(program, boards)
    seen: Counter = Counter()
    for board in boards:
        seen.update(board.seen)
    assert set(seen) == set(SEEN), "not every pair of the table was met"
    assert sum(map(any, (one.currents for one in did))) > 1000, "hardly any current flowed"
    faults = {fault for board in boards for did in board.did for fault in Fault if HEAD.unpack_from(did)[2] == fault}
    assert faults == set(Fault), "not every cause was met"


# ---------------------------------------------------------------------------------------------------------- fuzzing


def fuzzed(n: int, seed: int) -> tuple[RecordedBoard, int]:
    """A board that met n bytes: noise, damaged frames, and true frames that hold anything; how many were true."""
    rng = np.random.default_rng(seed)
    noise = rng.integers(0, 256, n // 3, dtype=np.uint8)
    noise[rng.random(len(noise)) < 0.03] = 0  # or few pieces would have the length of a frame
    frame = np.frombuffer(encode_frame(pack(Command(7, 7, 1, (1, 2, 3, 4)))), np.uint8)
    damaged = np.tile(frame, (n // 3 // len(frame), 1))
    damaged[np.arange(len(damaged)), rng.integers(0, len(frame), len(damaged))] ^= np.uint8(1) << rng.integers(
        0, 8, len(damaged), dtype=np.uint8
    )
    true, size = [], 0
    while size < n // 3:
        kind = int(rng.integers(1, 9))
        length = {1: 1, 2: 24, 3: 21, 4: 17, 6: 4}.get(kind, 0) if rng.random() < 0.7 else int(rng.integers(0, 124))
        true.append(encode_frame(bytes([kind]) + rng.bytes(length)))
        size += len(true[-1])
    stream = b"".join((noise.tobytes(), b"\0", damaged.tobytes(), b"\0", *true))
    bench = recorded().start()
    cuts = np.unique(rng.integers(0, len(stream), n // 300)).tolist()
    for first, last in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        bench.board.receive(stream[first:last], bench.now_us)
        bench.tick()
    return bench.board, len(true)


def test_a_million_bytes_break_nothing_and_no_damaged_frame_is_taken_for_true(program: Path) -> None:
    board, true = fuzzed(1_000_000, 1)
    did = run(program, [board])
    assert board.decoder.counts.good == true
    assert {one.state for one in did} >= {State.IDLE, State.READY, State.FAULT}


# ---------------------------------------------------------------------------------------------------------- vectors

u8, u16, u32, u64, i32 = ctypes.c_uint8, ctypes.c_uint16, ctypes.c_uint32, ctypes.c_uint64, ctypes.c_int32


class CDecoder(ctypes.Structure):
    _fields_ = [("bytes", u8 * 129), ("n", ctypes.c_size_t), ("skipping", ctypes.c_bool)] + [
        (name, u32) for name in ("good", "bad_cobs", "bad_crc", "too_long")
    ]


class CCapability(ctypes.Structure):
    _fields_ = [("encoders", u8), ("brakes", u8), ("force_channels", u8), ("firmware", u8 * 3),
                ("counts_per_rev", u32 * 4), ("current_max_mA", u16 * 4), ("force_unit", u32),
                ("force_full_scale", i32), ("device", ctypes.c_char * 24), ("serial", ctypes.c_char * 16)]  # fmt: skip


class CLimits(ctypes.Structure):
    _fields_ = [("current_mA", u16 * 4), ("speed_counts_s", u32 * 4)]


class CRequest(ctypes.Structure):
    _fields_ = [("type", u8), ("version", u8), ("limits", CLimits), ("sequence", u32), ("host_us", u64), ("mode", u8),
                ("current_mA", u16 * 4), ("joints", u8), ("counts", u32 * 4), ("token", u32)]  # fmt: skip


class CSample(ctypes.Structure):
    _fields_ = [("sequence", u32), ("echo", u32), ("board_us", u64), ("state", u8), ("flags", u8), ("faults", u16),
                ("cause", u16), ("counts", u32 * 4), ("force", u32 * 6), ("current_mA", u16 * 4)]  # fmt: skip


PACKED = {"Hello": "hello", "Limits": "limits", "Sample": "sample", "Homed": "homed", "FaultReport": "fault_report",
          "HeartbeatReply": "heartbeat_reply", "Refused": "refused"}  # fmt: skip
VECTOR_NAMES = [vector["name"] for vector in VECTORS["frames"]]


def filled(kind: type, fields: dict):
    """A structure of C with these fields; numbers below zero become their two's complement."""
    known = dict(kind._fields_)
    made = kind()
    for name in known.keys() & fields.keys():
        value = fields[name]
        if isinstance(value, list):
            value = known[name](*value)
        setattr(made, name, value.encode() if isinstance(value, str) else value)
    return made


def arguments(message: str, fields: dict) -> list:
    """What the function that packs this message takes after the payload's place."""
    widths = {"token": u32, "board_us": u64, "starts": u32}
    numbers = {name: widths.get(name, u32)(value) for name, value in fields.items() if isinstance(value, int)}
    if message == "Hello":
        capability = ctypes.byref(filled(CCapability, fields))
        return [capability, *(numbers[name] for name in ("state", "faults", "cause", "starts"))]
    if message == "Limits":
        return [ctypes.byref(filled(CLimits, fields))]
    if message == "Homed":
        return [numbers["joints"], (u32 * 4)(*fields["counts"])]
    return list(numbers.values())


def sample_arguments(vector: dict) -> list:
    """A sample's fields stand where its joints are: the first joints here."""
    made = CCapability(2 ** vector["encoders"] - 1, 2 ** vector["brakes"] - 1, vector["force_channels"])
    return [ctypes.byref(made), ctypes.byref(filled(CSample, vector["fields"]))]


def decoded(library: ctypes.CDLL, stream: bytes) -> tuple[CDecoder, list[bytes]]:
    decoder, payloads = CDecoder(), []
    library.phd_decoder_init(ctypes.byref(decoder))
    for byte in stream:
        n = library.phd_decode(ctypes.byref(decoder), u8(byte))
        if n:
            payloads.append(bytes(decoder.bytes[:n]))
    return decoder, payloads


def test_the_checksum_has_the_published_check_value(library: ctypes.CDLL) -> None:
    assert library.phd_crc32(b"123456789", ctypes.c_size_t(9)) == 0xCBF43926


@pytest.mark.parametrize("vector", VECTORS["frames"], ids=VECTOR_NAMES)
def test_frames_of_the_vectors_both_ways(library: ctypes.CDLL, vector: dict) -> None:
    payload, frame = bytes.fromhex(vector["payload"]), bytes.fromhex(vector["frame"])
    room = (u8 * 130)()
    n = library.phd_encode_frame(payload, ctypes.c_size_t(len(payload)), room)
    assert bytes(room[:n]) == frame
    assert decoded(library, frame)[1] == [payload]


@pytest.mark.parametrize("vector", VECTORS["frames"], ids=VECTOR_NAMES)
def test_messages_of_the_vectors_in_the_direction_of_a_board(library: ctypes.CDLL, vector: dict) -> None:
    payload, fields = bytes.fromhex(vector["payload"]), vector["fields"]
    request = CRequest()
    understood = library.phd_unpack(payload, ctypes.c_size_t(len(payload)), ctypes.byref(request))
    assert understood == (payload[0] < 0x80)
    if vector["message"] in PACKED:
        room = (u8 * 124)()
        told = sample_arguments(vector) if vector["message"] == "Sample" else arguments(vector["message"], fields)
        n = getattr(library, f"phd_pack_{PACKED[vector['message']]}")(room, *told)
        assert bytes(room[:n]) == payload
        return
    source = request.limits if vector["message"] == "SetLimits" else request
    for name, value in fields.items():
        got = getattr(source, name)
        assert (list(got) == [v % 2**32 for v in value]) if isinstance(value, list) else got == value
    for wrong in (payload + b"\0", payload[:-1]):
        assert not library.phd_unpack(wrong, ctypes.c_size_t(len(wrong)), ctypes.byref(request))


@pytest.mark.parametrize("vector", VECTORS["streams"], ids=[vector["name"] for vector in VECTORS["streams"]])
def test_a_damaged_stream_is_counted_as_its_vector_says(library: ctypes.CDLL, vector: dict) -> None:
    decoder, payloads = decoded(library, bytes.fromhex(vector["bytes"]))
    assert len(payloads) == vector["good"]
    for count in ("good", "bad_crc", "bad_cobs", "too_long"):
        assert getattr(decoder, count) == vector[count]


if __name__ == "__main__":
    total = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    with tempfile.TemporaryDirectory() as name:
        built = board_program(Path(name))
        for seed in range(max(1, total // 1_000_000)):
            fuzz_board, sent = fuzzed(min(total, 1_000_000), seed)
            run(built, [fuzz_board])
            print(f"round {seed}: {fuzz_board.decoder.counts}, {sent} true frames sent; both boards did the same")
