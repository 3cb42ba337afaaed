"""journal.jsonl of a session: what happened and when, one line an event, never rewritten."""

import contextlib
import json
import os
from datetime import UTC, datetime
from pathlib import Path

NAME = "journal.jsonl"


def write_event(folder: Path, event: str, sync: bool = True, **about: object) -> None:
    """Append one line; a line that a crash cut off is ended first. OSError, and no half line, on a full disk."""
    line = json.dumps({"time": datetime.now(UTC).isoformat(timespec="milliseconds"), "event": event, **about})
    handle = os.open(folder / NAME, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o644)
    try:
        end = os.lseek(handle, 0, os.SEEK_END)
        cut = False
        if end:
            os.lseek(handle, end - 1, os.SEEK_SET)
            cut = os.read(handle, 1) != b"\n"
        data = (b"\n" if cut else b"") + line.encode() + b"\n"
        written = 0
        try:
            while written < len(data):
                written += os.write(handle, data[written:])
            if sync:
                os.fsync(handle)
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(handle, end)
            raise
    finally:
        os.close(handle)


def read_events(folder: Path) -> list[dict]:
    """Every event that can be read, in order; a line that a crash cut off is passed over."""
    try:
        lines = (folder / NAME).read_bytes().splitlines()
    except FileNotFoundError:
        return []
    events = []
    for line in lines:
        with contextlib.suppress(ValueError):
            event = json.loads(line)
            if isinstance(event, dict):
                events.append(event)
    return events
