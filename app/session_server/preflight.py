"""The pre-flight checks: what must be right before a trial may start. One `Check` each, as in `phd doctor`."""

import os
import shutil
import statistics
import tempfile
import threading
import time
from pathlib import Path
from typing import IO

from app.ipc.jobs import Compiling
from app.ipc.messages import BAD, BRAKES_OFF, CAUTION, DUE, FORCE_SENSOR, GOOD, WAITING, Check, DeviceStatus, Setup
from core.faults import advice
from experiments.atomic_files import reason_of
from experiments.inputs import INPUTS, OPERATOR
from experiments.protocol import Protocol
from hardware.hid import HidReading

#: bytes. Our choice: a trial takes 7 MB at most, a session of 60 well under the lower one
LOW, TOO_LOW = 2_000_000_000, 200_000_000
WRITES = 3  # writes that are timed; the median counts
#: s for a write to reach the disk: worth a caution; too slow for a session. Assumed: with the second, 60 trials wait
#: for half an hour and more
SLOW_SYNC_S, TOO_SLOW_SYNC_S = 0.1, 2.0
#: writes that are waited for from Start to the first tick, and from the last tick to the next start. Counted
SYNCS_TO_START, SYNCS_TO_END = 1, 6
DISK_S = 5.0  # between two looks at the disk, while nothing runs
PATIENCE_S, TOO_LONG_S = 1.0, 10.0  # s that a measurement of the disk takes: said so; in red. Assumed


def check_device(simulated: bool, why_off: str) -> Check:
    """Whether currents may flow. why_off: cause of a brakes-off, or ""."""
    if why_off:
        problem = f"Brakes off. {why_off[0].upper()}{why_off[1:]}. {advice(why_off)}"
        return Check("Device", BAD, BRAKES_OFF, problem.strip())
    return Check("Device", GOOD, "simulated" if simulated else "connected")


def check_real(status: DeviceStatus | None, why_off: str, connecting: bool = False) -> Check:
    """Whether the device on the bench is ready and currents may flow. connecting: its board is being looked for."""
    if status is None or (connecting and status.problem):
        return Check("Device", WAITING, "connecting …", "The board on the bench is being reached.")
    if status.problem:
        problem = f"{status.problem[0].upper()}{status.problem[1:]}. {advice(status.problem)}"
        return Check("Device", BAD, "not connected", problem.strip())
    if why_off or status.fault:
        return check_device(False, why_off or status.fault)
    if not status.homed:
        return Check(
            "Device",
            DUE,
            "not homed yet",
            "Home the encoders: the session or the Device page (F3) guides you.",
        )
    return Check("Device", GOOD, f"{status.device}, board {status.board}")


def check_sensor(status: DeviceStatus | None) -> Check:
    """Whether the force of the hand is measured."""
    if status is None or not status.device or status.problem:
        return Check(FORCE_SENSOR, WAITING, "connecting …", "The board on the bench is being reached.")
    if status.force_channels == 0:
        advice = "Without it the controllers see motion alone, and a trapped hand is not released."
        return Check(FORCE_SENSOR, CAUTION, "none", advice)
    if not status.zeroed:
        return Check(FORCE_SENSOR, DUE, "not zeroed yet", "Zero it: the session or the Device page (F3) guides you.")
    return Check(FORCE_SENSOR, GOOD, "zeroed")


def check_hand(hand: str, reading: HidReading | None) -> Check:
    """Whether the hand can move the handle. hand: of `INPUTS`; reading: of a six-axis device, None: another hand."""
    if reading is None:
        return Check("Hand", GOOD, INPUTS[hand].title.lower())
    if reading.connected:
        return Check("Hand", GOOD, reading.text)
    return Check("Hand", BAD, "unplugged", f"{reading.text[0].upper()}{reading.text[1:]}.")


def check_compiling(now: Compiling) -> Check:
    """The kernels of the loop are not on this computer yet."""
    how_far = f"{now.number} of {now.of}" + (", linking" if now.linking else "")
    return Check("Loop", WAITING, f"compiling, {how_far}", "This is done once on a computer, in a minute or two.")


def check_disk(folder: Path) -> Check:
    """Whether the data folder, which need not exist yet, can be written to, has room, and is fast enough.

    Times `WRITES` writes as a session makes them. One rule for sessions and `phd doctor`.
    """
    return measure_disk(folder)[0]


def measure_disk(folder: Path) -> tuple[Check, float]:
    """The same check, and the seconds that a write takes to reach the disk (0: it fails)."""
    existing = folder
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    try:
        free = shutil.disk_usage(existing).free
        with tempfile.TemporaryFile(dir=existing) as file:
            sync_s = statistics.median(_time_to_write(file) for _ in range(WRITES))
    except OSError as error:
        reason = reason_of(error)
        advice = f"{folder} cannot be written to: {reason}. Choose another data folder."
        return Check("Disk", BAD, reason, advice), 0.0
    text = f"{free / 1e9:.0f} GB free" if free >= 1e10 else f"{free / 1e9:.1f} GB free"
    text += f", {duration_words(sync_s)} a write"
    room = f"Make room on the disk of {folder}"
    if free < TOO_LOW:
        return Check("Disk", BAD, text, f"{room}: there must be {TOO_LOW / 1e9:g} GB."), sync_s
    if free < LOW:
        return Check("Disk", CAUTION, text, f"{room}."), sync_s
    if sync_s > SLOW_SYNC_S:
        slow = (
            f"A write to the disk of {folder} takes {duration_words(sync_s)}, so a trial waits about "
            f"{duration_words(SYNCS_TO_START * sync_s)} for its start and {duration_words(SYNCS_TO_END * sync_s)} "
            "after its end. Record on a local disk, not on a network drive or a memory stick."
        )
        return Check("Disk", BAD if sync_s > TOO_SLOW_SYNC_S else CAUTION, text, slow), sync_s
    return Check("Disk", GOOD, text), sync_s


def duration_words(seconds: float) -> str:
    """ "3 ms", "0.4 s", "12 s"."""
    if seconds < 1e-3:
        return "under 1 ms"
    return f"{1e3 * seconds:.0f} ms" if seconds < 0.1 else f"{seconds:.1f} s" if seconds < 10.0 else f"{seconds:.0f} s"


def _time_to_write(file: IO[bytes]) -> float:
    began = time.perf_counter()
    file.write(bytes(4096))
    file.flush()
    os.fsync(file.fileno())
    return time.perf_counter() - began


class DiskWatch:
    """The disk of a session server, measured on a thread of its own: a disk that hangs delays nothing else."""

    def __init__(self, folder: Path) -> None:
        """folder: that the session server has taken. It is measured at once."""
        self._folder = folder
        self._check: Check | None = None  # None: not measured yet
        self.sync_s = 0.0  # that it takes to bring a write to the disk
        self._thread: threading.Thread | None = None
        self._changed_s = time.perf_counter()  # when a measurement began, or the last one ended
        self._begin()

    def _begin(self) -> None:
        self._changed_s = time.perf_counter()
        self._thread = threading.Thread(target=self._measure, name="disk", daemon=True)
        self._thread.start()

    def _measure(self) -> None:
        if self._folder.is_dir():
            self._check, self.sync_s = measure_disk(self._folder)
        else:
            advice = f"{self._folder} is gone. Bring it back, or choose another data folder."
            self._check, self.sync_s = Check("Disk", BAD, "the folder is gone", advice), 0.0

    def watch(self) -> None:
        """Measure every `DISK_S`, while nothing else needs the disk."""
        if self._thread is not None:
            if self._thread.is_alive():
                return
            self._thread, self._changed_s = None, time.perf_counter()
        elif time.perf_counter() - self._changed_s > DISK_S:
            self._begin()

    @property
    def known(self) -> bool:
        """Whether it was measured, or takes so long that the experimenter is told."""
        return self._check is not None or self._overdue

    @property
    def slow(self) -> bool:
        """Whether a write is so slow that the experimenter is told before."""
        return self.sync_s > SLOW_SYNC_S or self._overdue

    @property
    def _overdue(self) -> bool:
        """Whether the running measurement takes unusually long."""
        return self._waited_s > max(PATIENCE_S, 2 * WRITES * self.sync_s)

    @property
    def _waited_s(self) -> float:
        measuring = self._thread is not None and self._thread.is_alive()
        return time.perf_counter() - self._changed_s if measuring else 0.0

    @property
    def check(self) -> Check:
        if self._overdue:
            waited_s = self._waited_s
            took = f"{WRITES} short writes have taken {waited_s:.0f} s so far"
            advice = f"Waiting for the disk of {self._folder}: {took}."
            return Check("Disk", BAD if waited_s > TOO_LONG_S else WAITING, f"waiting, {waited_s:.0f} s", advice)
        return self._check or Check("Disk", WAITING, "being measured")


def check_recording(broken: str, not_written: str, last: str) -> Check:
    """Whether all recordings are on the disk.

    broken: why no more can be recorded, or ""; last: the trial recorded and verified last, "trial 12", or "".

    not_written: what could not be written yet, or "".
    """
    if broken:
        return Check("Recording", BAD, "failed", f"{broken}.")
    if not_written:
        return Check("Recording", BAD, "incomplete", f"{not_written}.")
    return Check("Recording", GOOD, f"{last} verified" if last else "ready")


def with_advice(name: str, reason: str) -> str:
    """A notice about a trial (or, without a name, the device): the reason and what to do; "" without a reason."""
    if not reason:
        return ""
    why = reason.removeprefix(f"{BRAKES_OFF}: ")  # the window says that they are
    notice = f"{name}: {why}" if name else f"{why[0].upper()}{why[1:]}"
    return f"{notice}. {advice(reason)}".strip()


def ignored_features(setup: Setup, protocol: Protocol) -> str:
    """Which features of the protocol a simulated operator's sessions ignore, as a sentence; "": none."""
    features = {
        "no blinding": protocol.blind, "no practice": protocol.practice_trials > 0,
        "no questionnaire": protocol.questionnaire.on, "no instructions": bool(protocol.instruction),
    }  # fmt: skip
    missing = [name for name, is_used in features.items() if is_used]
    if setup.hand != OPERATOR or not missing:
        return ""
    return f"A simulated operator moves the handle: {' and '.join(missing)}, whatever the protocol says."
