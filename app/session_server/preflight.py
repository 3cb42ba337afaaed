"""The pre-flight row: what has to be right before a trial may start. One `Check` each, as in `phd doctor`."""

import os
import shutil
import statistics
import tempfile
import time
from pathlib import Path
from typing import IO, TYPE_CHECKING

from app.ipc.messages import BAD, BRAKES_OFF, CAUTION, GOOD, WAITING, Check, DeviceStatus, Setup, Timing
from app.ipc.scheduling import ADVICE, Scheduling
from core.faults import FAULTS, advice, after
from experiments.inputs import INPUTS, OPERATOR
from experiments.plan import counted

if TYPE_CHECKING:
    from experiments.protocol import Protocol
    from hardware.hid import Reading

#: bytes. Our choice: a trial takes 7 MB at most, a session of 60 well under the lower one
LOW, TOO_LOW = 2_000_000_000, 200_000_000
SLOW_SYNC_S = 0.1
#: µs. Our choice: what a loop without privilege keeps on an idle machine; later ticks are still in the recording
LATE_US = 200.0


def check_device(simulated: bool, why_off: str) -> Check:
    """Whether currents may flow. why_off: the cause of a brakes-off, or ""."""
    if why_off:
        what = advice(why_off) or FAULTS["brakes-off"].advice
        return Check("Device", BAD, BRAKES_OFF, f"Brakes off: {why_off}. {what}")
    return Check("Device", GOOD, "simulated" if simulated else "connected")


def check_real(status: DeviceStatus | None, why_off: str) -> Check:
    """Whether the device on the bench is there and fit, and currents may flow."""
    if status is None:
        return Check("Device", WAITING, "connecting", "The board on the bench is being reached.")
    if status.problem:
        problem = f"{status.problem[0].upper()}{status.problem[1:]}. {advice(status.problem)}"
        return Check("Device", BAD, "not connected", problem.strip())
    if why_off or status.fault:
        return check_device(False, why_off or after("the board: ", status.fault))
    if not status.homed:
        return Check("Device", BAD, "not homed", "Home the encoders: until then the place of the handle is unknown.")
    return Check("Device", GOOD, f"{status.device}, board {status.board}")


def check_sensor(status: DeviceStatus | None) -> Check:
    """Whether the hand force is measured."""
    if status is None or not status.device or status.problem:
        return Check("Hand", WAITING, "force sensor", "The board on the bench is being reached.")
    if status.force_channels == 0:
        advice = "The controllers cannot feel the hand: they see motion alone, and nothing releases a trapped hand."
        return Check("Hand", CAUTION, "no force sensor", advice)
    if not status.zeroed:
        return Check("Hand", BAD, "force not zeroed", "The force sensor has no zero yet.")
    return Check("Hand", GOOD, "force sensor")


def check_hand(hand: str, reading: "Reading | None") -> Check:
    """hand: of `INPUTS`. reading: of a six-axis device; None: the hand is another one."""
    if reading is None:
        return Check("Hand", GOOD, INPUTS[hand].title.lower())
    if reading.connected:
        return Check("Hand", GOOD, reading.text)
    return Check("Hand", BAD, "unplugged", f"{reading.text[0].upper()}{reading.text[1:]}.")


def check_loop(tried: Timing | None, dead: bool, scheduling: Scheduling | None, last: Timing | None = None) -> Check:
    """tried: how it kept its deadlines for a moment without work; None: not yet. last: over the last trial, if any."""
    if dead:
        return Check("Loop", WAITING, "starting again")
    if tried is None or scheduling is None:
        return Check("Loop", WAITING, "preparing")
    kept = last or tried
    # Ticks that were missed are the finding, however small a share: the 99th percentile may be 0 µs all the same.
    text = f"1 kHz, {counted(kept.missed, 'tick')} missed" if kept.missed else f"1 kHz, p99 {kept.p99_us:.0f} µs"
    if kept.p99_us <= LATE_US and kept.missed == 0:
        return Check("Loop", GOOD, text)
    advice = "Ticks come late: close other programs."
    return Check("Loop", CAUTION, text, advice if scheduling.real_time else f"{advice} {ADVICE}")


def check_disk(folder: Path, sync: bool = False) -> Check:
    """Whether the data folder, which need not exist yet, can be written to and has room.

    sync: also how long a write takes to reach the disk itself.
    """
    there = folder
    while not there.exists() and there != there.parent:
        there = there.parent
    try:
        free = shutil.disk_usage(there).free
        with tempfile.TemporaryFile(dir=there) as file:
            waits = [_time_to_write(file, sync) for _ in range(5 if sync else 1)]
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        return Check("Disk", BAD, reason, f"{folder} cannot be written to: {reason}. Choose another --data-dir.")
    text = f"{free / 1e9:.0f} GB free" if free >= 1e10 else f"{free / 1e9:.1f} GB free"
    wait_s = statistics.median(waits)
    if sync:
        text = f"{folder}: {text}, {1e3 * wait_s:.1f} ms to bring a write to the disk"
    room = f"Make room on the disk of {folder}"
    if free < TOO_LOW:
        return Check("Disk", BAD, text, f"{room}: there must be {TOO_LOW / 1e9:g} GB.")
    if free < LOW:
        return Check("Disk", CAUTION, text, f"{room}.")
    if sync and wait_s > SLOW_SYNC_S:
        return Check("Disk", CAUTION, text, "Record on a local disk, not on a network drive or a memory stick.")
    return Check("Disk", GOOD, text)


def _time_to_write(file: IO[bytes], sync: bool) -> float:
    began = time.perf_counter()
    file.write(bytes(65536))
    file.flush()
    if sync:
        os.fsync(file.fileno())
    return time.perf_counter() - began


def check_recording(broken: str, undone: str, last: str, streams: int) -> Check:
    """broken: why no more can be recorded, or ""; last: what was last recorded and verified, "run 12", or "".

    undone: what the disk has not taken yet, or ""; streams: recordings that are whole, but no Parquet files yet.
    """
    if broken:
        return Check("Recording", BAD, "failed", f"{broken}.")
    if undone:
        return Check("Recording", BAD, "incomplete", f"{undone}.")
    if streams:
        advice = "What was recorded is whole, as a stream; it becomes a Parquet file when the disk takes it."
        return Check("Recording", CAUTION, f"{streams} not converted", advice)
    return Check("Recording", GOOD, f"{last} verified" if last else "ready")


def with_advice(name: str, reason: str) -> str:
    """What the experimenter reads of a trial (or, without a name, of the device) and a reason ("": there is none)."""
    if not reason:
        return ""
    what = f"{name}: {reason}" if name else f"{reason[0].upper()}{reason[1:]}"
    return f"{what}. {advice(reason)}".strip()


def done_without(setup: Setup, protocol: "Protocol") -> str:
    """What the protocol asks for and a simulated operator's sessions have not, as a sentence; "": nothing is amiss."""
    asked = {
        "no blinding": protocol.blind, "no practice": protocol.practice_trials > 0,
        "no questionnaire": protocol.questionnaire.on,
    }  # fmt: skip
    missing = [what for what, is_asked in asked.items() if is_asked]
    if setup.hand != OPERATOR or not missing:
        return ""
    return f"A simulated operator moves the handle: {' and '.join(missing)}, whatever the protocol says."
