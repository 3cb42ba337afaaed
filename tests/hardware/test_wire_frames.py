"""Frames of the wire: COBS, CRC-32, and a decoder that no bytes can lead astray."""

import random
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.wire.frames import MAX_PAYLOAD, FrameDecoder, encode_frame
from hardware.wire.messages import (
    AskHello,
    Bye,
    Command,
    Heartbeat,
    Home,
    ResetFault,
    SetLimits,
    Stop,
    pack,
)

payloads = st.binary(min_size=1, max_size=MAX_PAYLOAD)


def stuffed(data: bytes) -> bytes:
    """COBS by other hands, for data shorter than 254 bytes: each zero becomes the way to the next one."""
    out = b""
    for piece in data.split(b"\0"):
        out += bytes([len(piece) + 1]) + piece
    return out


def host_frames() -> list[bytes]:
    """A true frame of every message that a host sends: what structure-aware damage begins with."""
    messages = (
        AskHello(1), SetLimits((1000, 750, 0, 65535), (0, 229_183, 0, 1)), Command(7, 7, 1, (1, 2, 3, 4)),
        Home(5, (-1, 0, 38_400, 0)), ResetFault(), Heartbeat(2**32 - 1), Stop(), Bye(),
    )  # fmt: skip
    return [encode_frame(pack(message)) for message in messages]


def damage(frame: bytes, other: bytes, rng: random.Random) -> bytes:
    """One thing that happens to a frame on its way, aimed at what holds it together; never the frame itself."""
    at, bad = rng.randrange(len(frame) - 1), bytearray(frame)
    match rng.randrange(8):
        case 0:
            bad[at] ^= 1 << rng.randrange(8)  # a bit
        case 1:
            bad[0] = rng.randrange(1, 256)  # the first COBS code
        case 2:
            bad[at], bad[at - 1] = bad[at - 1], bad[at]  # two bytes in the wrong order
        case 3:
            del bad[at : at + rng.randint(1, 4)]  # bytes lost
        case 4:
            bad[at:at] = rng.randbytes(rng.randint(1, 4))  # bytes from elsewhere
        case 5:
            bad[at:] = other[at:]  # two frames torn and joined
        case 6:
            bad[-5:-1] = rng.randbytes(4)  # another checksum
        case 7:
            bad = bytearray(stuffed(rng.randbytes(rng.randint(5, 120))) + b"\0")  # COBS without a checksum
    return bytes(bad)


def noise_and_damage(rng: np.random.Generator, seed: int, noise: int, damaged: int) -> bytes:
    """So many random bytes, then at least so many of frames of all kinds that were damaged, none of them true."""
    random_bytes = rng.integers(0, 256, noise, dtype=np.uint8)
    random_bytes[rng.random(noise) < 0.03] = 0  # frames' ends are common, or few pieces would have a frame's length
    frames, spoil, pieces, size = host_frames(), random.Random(seed), [b"\0"], 0
    while size < damaged:
        bad = damage(spoil.choice(frames), spoil.choice(frames), spoil)
        if all(piece + b"\0" not in frames for piece in bad.split(b"\0")):  # or it would be a true one
            pieces.append(bad if bad.endswith(b"\0") else bad + b"\0")
            size += len(pieces[-1])
    return random_bytes.tobytes() + b"".join(pieces)


@given(st.lists(payloads, max_size=6), st.randoms(use_true_random=False))
def test_frames_come_back_whole_however_the_stream_is_cut(sent: list[bytes], rng: random.Random) -> None:
    stream = b"".join(encode_frame(payload) for payload in sent)
    decoder, got = FrameDecoder(), []
    while stream:
        n = rng.randint(1, 40)
        got += decoder.feed(stream[:n])
        stream = stream[n:]
    assert got == sent
    assert decoder.counts.good == len(sent) and decoder.counts.bad == 0


@given(st.binary(max_size=400), payloads)
def test_a_frame_after_any_garbage_is_read_once_a_zero_byte_stands_between(garbage: bytes, payload: bytes) -> None:
    decoder = FrameDecoder()
    before = decoder.feed(garbage + b"\0")
    assert before == []  # 400 bytes of garbage hold a true CRC once in a billion times
    assert decoder.feed(encode_frame(payload)) == [payload]
    assert decoder.counts.resyncs == (1 if decoder.counts.bad else 0)


@settings(max_examples=50)
@given(payloads)
def test_no_single_flipped_bit_passes(payload: bytes) -> None:
    frame = encode_frame(payload)
    for bit in range(8 * len(frame)):
        damaged = bytearray(frame)
        damaged[bit // 8] ^= 1 << bit % 8
        assert payload not in FrameDecoder().feed(bytes(damaged) + b"\0")


@pytest.mark.parametrize("size", [0, MAX_PAYLOAD + 1])
def test_a_payload_that_no_frame_can_hold_is_refused(size: int) -> None:
    with pytest.raises(ValueError, match="1 to 124 bytes"):
        encode_frame(b"x" * size)


def test_a_stream_without_zero_bytes_needs_no_memory() -> None:
    decoder = FrameDecoder()
    tracemalloc.start()
    for _ in range(1000):
        assert decoder.feed(b"\x55" * 100) == []
    assert tracemalloc.get_traced_memory()[0] < 10_000 and decoder.counts.too_long == 1
    tracemalloc.stop()
    assert decoder.feed(b"\0" + encode_frame(b"hello")) == [b"hello"]
