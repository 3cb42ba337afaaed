"""The conductor's process: it has its data folder for itself, a place for windows to find it, and leaves nothing.

What cannot be run is refused before any window can be joined to it.
"""

import contextlib
import faulthandler
import json
import os
import signal
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from app.ipc.address import NAME, Place, publish
from app.ipc.ring import Ring
from app.ipc.setup import OPERATOR, Setup
from app.session_server.loop_process import LoopProcess
from core import tick_log
from core.errors import InputError

if TYPE_CHECKING:
    from experiments.protocol import Protocol

TERMINATED = "the bench was told to end"
LOG = ".bench.log"  # of what should not happen


def main() -> None:
    """Be the conductor. One line of JSON on the standard output: where it is, or why it cannot be."""
    setup = Setup.from_json(sys.argv[1])
    early = tempfile.TemporaryFile()  # what the loop says should not happen, before it is known where that belongs
    os.dup2(early.fileno(), 2)
    try:
        place = Place()
    except OSError as error:
        _answer({"refused": f"{error.filename}: {error.strerror or error}"})
        return
    try:
        ring = Ring(place.ring, create=True, width=tick_log.BENCH_WIDTH if setup.link else tick_log.WIDTH)
        loop = LoopProcess(ring, setup.real_time, setup.link)  # it takes its time, and so do all the imports below
        try:
            _conduct(setup, place, ring, loop, early)
        finally:
            if not loop.closed:
                loop.kill()
    finally:
        place.remove()


def _conduct(setup: Setup, place: Place, ring: Ring, loop: LoopProcess, early: BinaryIO) -> None:
    from app.ipc.spare_scipy import spare_scipy
    from app.session_server.server import Conductor
    from experiments.session.files import LOCK, hold_lock

    data_dir = setup.data_dir
    new = [path for path in (data_dir / LOCK, data_dir, *data_dir.parents) if not path.exists()]
    try:
        data_dir.mkdir(parents=True, exist_ok=True)
        lock = hold_lock(data_dir)
    except InputError as error:
        _answer({"refused": str(error), "taken": True})
        return
    except OSError as error:
        _answer({"refused": f"{data_dir}: cannot be written to ({(error.strerror or str(error)).lower()})"})
        _leave_nothing(new)
        return
    spare_scipy()
    served = False
    try:
        protocol = read_protocol(setup)
        log = os.open(data_dir / LOG, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        os.dup2(log, 2)
        faulthandler.enable()
        listener, address = place.listen(setup.to_json())
        conductor = Conductor(setup, protocol, ring, loop, listener)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: setattr(conductor, "end", TERMINATED))
        publish(data_dir, address)
        _answer({"pid": address.pid})
        served = True
        conductor.serve()
    except InputError as error:
        _answer({"refused": str(error)})
    except OSError as error:
        _answer({"refused": f"{data_dir}: cannot be written to ({(error.strerror or str(error)).lower()})"})
        raise
    finally:
        with contextlib.suppress(OSError):  # a disk that fails now has been told of
            _clear(data_dir, early)
        lock.release()
        if not served or not any(data_dir.glob("sub-*")):
            _leave_nothing(new)


def read_protocol(setup: Setup) -> "Protocol":
    """The protocol of new sessions. InputError if it cannot be run, or has nothing to do for the participant named."""
    from experiments.protocol import load_protocol
    from experiments.session import files

    protocol = load_protocol(
        setup.protocol, devices=setup.devices, rules=setup.rules, low_gain=setup.low_gain, seed=setup.seed
    )
    kept = files.kept_sessions(setup.data_dir)
    if not setup.participant and not any(kept.values()):
        files.free_participant(setup.data_dir, protocol.participants)  # somebody is left
    if setup.participant and setup.participant not in kept:
        if setup.hand != OPERATOR:
            protocol.refuse_stranger(setup.participant)
        folder = files.session_folder(setup.data_dir, setup.participant)
        if (folder / files.STORED).exists():
            files.read_stored(folder)  # one that is damaged is said to be
        files.refuse_existing(setup.data_dir, setup.participant)
    return protocol


def _clear(data_dir: Path, early: BinaryIO) -> None:
    """Leave only what was recorded, and the log if there is anything in it."""
    (data_dir / NAME).unlink(missing_ok=True)
    log = data_dir / LOG
    early.seek(0)
    if log.exists() and (said := early.read()):
        with log.open("ab") as file:
            file.write(said)
    if log.exists() and not log.stat().st_size:
        log.unlink()


def _leave_nothing(new: list[Path]) -> None:
    """Remove what was not there before (lock, folder, its parents), as far as it is empty."""
    for path in new:
        with contextlib.suppress(OSError):
            if path.is_dir():
                path.rmdir()
            else:
                path.unlink()


def _answer(about: dict) -> None:
    """To whoever started us, who may be gone; nothing else ever comes this way."""
    with contextlib.suppress(BrokenPipeError):
        os.write(1, json.dumps(about).encode() + b"\n")
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 1)
    os.close(null)
