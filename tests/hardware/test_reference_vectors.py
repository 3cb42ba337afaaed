"""The codec in C (hardware/firmware) against the vectors of the specification, and its table against the Python one.

Skipped where there is no C compiler. A board reads what a host sends and writes what a board sends: so do these tests.
"""

import ctypes

import pytest
from board_table import handling
from reference_board import compiled, needs_compiler
from test_wire_messages import VECTORS

from hardware.emulated_board.board import BoardEvent
from hardware.wire.messages import State

pytestmark = needs_compiler

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


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    folder = tmp_path_factory.mktemp("library")
    made = compiled(folder, "board.so", "-shared", "-fPIC", sources="phd_*.c")
    loaded = ctypes.CDLL(str(made))
    loaded.phd_crc32.restype = ctypes.c_uint32
    loaded.phd_unpack.restype = ctypes.c_bool
    for name in ("encode_frame", "decode", *(f"pack_{kind}" for kind in PACKED.values())):
        getattr(loaded, f"phd_{name}").restype = ctypes.c_size_t
    return loaded


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


def test_the_table_is_that_of_the_specification(library: ctypes.CDLL) -> None:
    words = {**{int(state): state.name for state in State}, 16: "same", 17: "refused", 18: "ignored", 19: "-"}
    table = ((ctypes.c_uint8 * len(State)) * len(BoardEvent)).in_dll(library, "phd_states")
    assert [[words[cell] for cell in row] for row in table] == [[handling(s, e) for s in State] for e in BoardEvent]
