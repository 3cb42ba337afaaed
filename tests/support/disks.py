"""Disks that take no more, or lose a bit."""

import os
from pathlib import Path

import pytest


def full(*_args, **_more):
    """In place of whatever writes."""
    raise OSError(28, "No space left on device")


def locked(*_args, **_more):
    """Likewise: a folder that was made read-only."""
    raise PermissionError(1, "Operation not permitted")


def fill_up(patch: pytest.MonkeyPatch, room: int) -> None:
    """The disk takes so many bytes more, and then none."""
    left, write = [room], os.write

    def write_until_full(handle: int, data: bytes) -> int:
        taken = min(len(data), left[0])
        left[0] -= taken
        return write(handle, data[:taken]) if taken else full()

    patch.setattr(os, "write", write_until_full)


def flip_a_bit(path: Path, place: int | None = None, bit: int = 1) -> None:
    """In the middle of a file, or at a byte of it."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2 if place is None else place] ^= 1 << bit
    path.write_bytes(content)
