"""Messages of the wire against the test vectors that firmware is tested with, in both directions."""

import json
import struct
from pathlib import Path

import pytest

from hardware.emulated_board.board import FULL_BOARD
from hardware.wire import messages
from hardware.wire.frames import MAX_PAYLOAD, FrameDecoder, encode_frame
from hardware.wire.messages import LAYOUTS, Layout, Sample, layout_of, pack, unpack

ROOT = Path(__file__).resolve().parents[2]
VECTORS = json.loads((ROOT / "docs" / "protocol-vectors.json").read_text())
FRAMES = [pytest.param(vector, id=vector["name"].replace(" ", "-")) for vector in VECTORS["frames"]]
STREAMS = [pytest.param(vector, id=vector["name"].replace(" ", "-")) for vector in VECTORS["streams"]]


def sample_layout(encoders: int, force_channels: int, brakes: int) -> Layout:
    """Of a board with so many of each."""
    bits = {"encoders": (1 << encoders) - 1, "brakes": (1 << brakes) - 1}
    return layout_of(FULL_BOARD._replace(**bits, force_channels=force_channels))


def layout(vector: dict) -> Layout:
    return sample_layout(vector["encoders"], vector["force_channels"], vector["brakes"])


def message_of(vector: dict) -> tuple:
    kind = getattr(messages, vector["message"])
    texts = ("device", "serial")
    return kind(**{
        name: tuple(value) if isinstance(value, list) else value.encode() if name in texts else value
        for name, value in vector["fields"].items()
    })  # fmt: skip


@pytest.mark.parametrize("vector", FRAMES)
def test_a_message_becomes_the_bytes_of_its_vector_and_they_the_message(vector: dict):
    message = message_of(vector)
    codec = layout(vector) if isinstance(message, Sample) else messages
    payload, frame = bytes.fromhex(vector["payload"]), bytes.fromhex(vector["frame"])
    assert codec.pack(message) == payload and encode_frame(payload) == frame
    assert FrameDecoder().feed(frame) == [payload] and codec.unpack(payload) == message


@pytest.mark.parametrize("vector", STREAMS)
def test_a_damaged_stream_is_counted_as_its_vector_says(vector: dict) -> None:
    stream = bytes.fromhex(vector["bytes"])
    for size in (1, 7, len(stream)):
        decoder = FrameDecoder()
        got = [p for start in range(0, len(stream), size) for p in decoder.feed(stream[start : start + size])]
        counts = decoder.counts
        assert len(got) == counts.good == vector["good"]
        assert (counts.bad_crc, counts.bad_cobs, counts.too_long) == tuple(
            vector[kind] for kind in ("bad_crc", "bad_cobs", "too_long")
        )


def test_every_message_has_a_vector() -> None:
    assert {vector["message"] for vector in VECTORS["frames"]} == {kind.__name__ for kind, _ in LAYOUTS.values()} | {
        "Sample"
    }


def test_a_sample_is_as_long_as_the_specification_says() -> None:
    assert "| 23 + 4 e + 4 f + 2 b |" in (ROOT / "docs" / "protocol.md").read_text()
    for e, f, b in ((2, 6, 4), (4, 0, 1)):
        assert sample_layout(e, f, b).bytes == 23 + 4 * e + 4 * f + 2 * b
    assert sample_layout(4, 6, 4).bytes <= MAX_PAYLOAD


def test_a_payload_of_the_wrong_length_or_type_is_no_message() -> None:
    for vector in VECTORS["frames"]:
        payload = bytes.fromhex(vector["payload"])
        for wrong in (payload + b"\0", payload[:-1] or b"\xff"):
            assert unpack(wrong) is None
    assert unpack(b"\x7f") is None


@pytest.mark.parametrize("current", [-1, 65536])
def test_a_value_that_its_field_cannot_hold_is_never_sent(current: int) -> None:
    with pytest.raises(struct.error):
        pack(messages.Command(1, 0, 1, (current, 0, 0, 0)))
