"""The conductor's process: it has its data folder for itself, a place for windows to find it, and leaves nothing."""

import contextlib
import faulthandler
import json
import os
import signal
import sys
from pathlib import Path

from app.live.loop_process import LoopProcess
from app.live.place import NAME, Place, publish
from app.live.ring import Ring
from app.live.setup import Setup
from core.errors import InputError
from experiments.session_files import LOCK, hold_lock

TERMINATED = "the bench was told to end"
LOG = ".bench.log"  # of what should not happen


def main() -> None:
    """Be the conductor. One line of JSON on the standard output: where it is, or why it cannot be."""
    setup = Setup.from_json(sys.argv[1])
    data_dir, new = setup.data_dir, not setup.data_dir.exists()
    try:
        data_dir.mkdir(parents=True, exist_ok=True)
        lock = hold_lock(data_dir)
    except InputError as error:
        _answer({"refused": str(error)})
        return
    except OSError as error:
        _answer({"refused": f"{data_dir}: cannot be written to ({(error.strerror or str(error)).lower()})"})
        return
    log = os.open(data_dir / LOG, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(log, 2)
    faulthandler.enable()
    place = Place()
    try:
        ring = Ring(place.ring, create=True)
        loop = LoopProcess(ring, setup.real_time)  # it takes its time, and so do we
        listener, address = place.listen()
        from app.live.conductor import Conductor

        conductor = Conductor(setup, ring, loop, listener)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: setattr(conductor, "end", TERMINATED))
        publish(data_dir, address)
        _answer({"pid": address.pid})
        conductor.serve()
    finally:
        place.remove()
        _clear(data_dir, new)
        lock.release()


def _clear(data_dir: Path, new: bool) -> None:
    """Leave only what was recorded, and the log if there is anything in it."""
    (data_dir / NAME).unlink(missing_ok=True)
    if not (data_dir / LOG).stat().st_size:
        (data_dir / LOG).unlink()
    if new and {path.name for path in data_dir.iterdir()} == {LOCK}:
        (data_dir / LOCK).unlink()
        data_dir.rmdir()


def _answer(about: dict) -> None:
    """To whoever started us, who may be gone; nothing else ever comes this way."""
    with contextlib.suppress(BrokenPipeError):
        os.write(1, json.dumps(about).encode() + b"\n")
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 1)
    os.close(null)
