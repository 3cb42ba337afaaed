"""The frames of the board in C (hardware/firmware) against the vectors of the specification, and its table against the
Python one. What its messages hold, byte by byte, is compared with the Python board's in test_reference_board.py.

Skipped where there is no C compiler.
"""

import ctypes

import pytest
from board_table import handling
from reference_board import compiled, needs_compiler
from test_wire_messages import VECTORS

from hardware.emulated_board.board import BoardEvent
from hardware.wire.messages import State

pytestmark = needs_compiler

u8, u32 = ctypes.c_uint8, ctypes.c_uint32


class CDecoder(ctypes.Structure):
    _fields_ = [("bytes", u8 * 129), ("n", ctypes.c_size_t), ("skipping", ctypes.c_bool)] + [
        (name, u32) for name in ("good", "bad_cobs", "bad_crc", "too_long")
    ]


VECTOR_NAMES = [vector["name"] for vector in VECTORS["frames"]]


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    folder = tmp_path_factory.mktemp("library")
    drivers = folder / "drivers.c"
    drivers.write_text("void phd_set_currents(void) {} void phd_send(void) {}")
    made = compiled(folder, "board.so", "-shared", "-fPIC", "-Wno-strict-prototypes", str(drivers), sources="phd_*.c")
    loaded = ctypes.CDLL(str(made))
    for name in ("encode_frame", "decode"):
        getattr(loaded, f"phd_{name}").restype = ctypes.c_size_t
    return loaded


def decoded(library: ctypes.CDLL, stream: bytes) -> tuple[CDecoder, list[bytes]]:
    decoder, payloads = CDecoder(), []
    for byte in stream:
        n = library.phd_decode(ctypes.byref(decoder), u8(byte))
        if n:
            payloads.append(bytes(decoder.bytes[:n]))
    return decoder, payloads


@pytest.mark.parametrize("vector", VECTORS["frames"], ids=VECTOR_NAMES)
def test_frames_of_the_vectors_both_ways(library: ctypes.CDLL, vector: dict) -> None:
    payload, frame = bytes.fromhex(vector["payload"]), bytes.fromhex(vector["frame"])
    room = (u8 * 130)()
    n = library.phd_encode_frame(payload, ctypes.c_size_t(len(payload)), room)
    assert bytes(room[:n]) == frame
    assert decoded(library, frame)[1] == [payload]


@pytest.mark.parametrize("vector", VECTORS["streams"], ids=[vector["name"] for vector in VECTORS["streams"]])
def test_a_damaged_stream_is_counted_as_its_vector_says(library: ctypes.CDLL, vector: dict) -> None:
    decoder, payloads = decoded(library, bytes.fromhex(vector["bytes"]))
    assert len(payloads) == vector["good"]
    for count in ("good", "bad_crc", "bad_cobs", "too_long"):
        assert getattr(decoder, count) == vector[count]


def test_the_table_is_that_of_the_specification(library: ctypes.CDLL) -> None:
    words = {**{int(state): state.name for state in State}, 16: "same", 17: "refused", 18: "ignored", 19: "-"}
    table = ((ctypes.c_uint8 * len(State)) * len(BoardEvent)).in_dll(library, "phd_states")
    assert [[words[cell] for cell in row] for row in table] == [[handling(s, e) for s in State] for e in BoardEvent]
