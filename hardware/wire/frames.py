"""Frames on the wire: COBS around payload and CRC-32, a zero byte after each (docs/protocol.md, "Frames").

Zero bytes stand only between frames: after lost or torn bytes reading starts again at the next one. The decoder takes
any bytes and counts what was wrong.
"""

from dataclasses import dataclass

import corncobs
from fastcrc import crc32

MAX_PAYLOAD = 124  # bytes: message type and fields
CRC_BYTES = 4
#: bytes of a frame before its zero byte: COBS adds one to anything shorter than 254
MAX_ENCODED = MAX_PAYLOAD + CRC_BYTES + 1


@dataclass
class FrameCounts:
    """Frames since the decoder was made."""

    good: int = 0
    bad_cobs: int = 0  # the bytes between two zeros are no COBS, or too few for a type and a CRC
    bad_crc: int = 0
    too_long: int = 0  # more bytes than a frame can have, without a zero byte
    resyncs: int = 0  # good frames that came after something bad
    bytes: int = 0

    @property
    def bad(self) -> int:
        """Discarded frames."""
        return self.bad_cobs + self.bad_crc + self.too_long


def checksum(data: bytes) -> int:
    """CRC-32 as in Ethernet and zlib (CRC-32/ISO-HDLC; its value of "123456789" is 0xCBF43926)."""
    return crc32.iso_hdlc(data)


def encode_frame(payload: bytes) -> bytes:
    """One frame with its zero byte. ValueError if the payload is empty or longer than MAX_PAYLOAD."""
    if not 1 <= len(payload) <= MAX_PAYLOAD:
        raise ValueError(f"a payload has 1 to {MAX_PAYLOAD} bytes, not {len(payload)}")
    return corncobs.encode(payload + checksum(payload).to_bytes(CRC_BYTES, "little")) + b"\0"


class FrameDecoder:
    """Decodes bytes in pieces of any size into checked payloads."""

    def __init__(self) -> None:
        self.counts = FrameCounts()
        self._partial = b""  # what came since the last zero byte
        self._skipping = False  # until the next zero byte: what came was too long
        self._lost = False  # something bad came since the last good frame

    def feed(self, data: bytes) -> list[bytes]:
        """The payloads that these bytes complete, oldest first."""
        self.counts.bytes += len(data)
        *whole, rest = data.split(b"\0")
        payloads = []
        for piece in whole:
            payload = self._finish(self._partial + piece)
            self._partial = b""
            if payload is not None:
                payloads.append(payload)
        self._partial += rest
        if len(self._partial) > MAX_ENCODED:
            if not self._skipping:
                self._bad("too_long")
            self._skipping = True
            self._partial = b""
        return payloads

    def _finish(self, encoded: bytes) -> bytes | None:
        """The payload between two zero bytes; None: it is damaged."""
        if self._skipping:
            self._skipping = False
            return None
        if not encoded:
            return None  # two zero bytes in a row are no error: a sender may begin with one
        if len(encoded) > MAX_ENCODED:
            self._bad("too_long")
            return None
        try:
            decoded = corncobs.decode(encoded)
        except corncobs.DecodeError:
            self._bad("bad_cobs")
            return None
        if len(decoded) <= CRC_BYTES:
            self._bad("bad_cobs")
            return None
        payload = decoded[:-CRC_BYTES]
        if checksum(payload) != int.from_bytes(decoded[-CRC_BYTES:], "little"):
            self._bad("bad_crc")
            return None
        self.counts.good += 1
        self.counts.resyncs += self._lost
        self._lost = False
        return payload

    def _bad(self, kind: str) -> None:
        setattr(self.counts, kind, getattr(self.counts, kind) + 1)
        self._lost = True
