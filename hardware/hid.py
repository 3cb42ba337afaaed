"""A six-axis HID device as the hand: its deflection is taken as a force, and marked as no force sensor.

A thread of its own drains the device to its newest report: a reader slower than the device would fall seconds behind.
An unplugged device gives no force and is searched for until it is back.
"""

import contextlib
import math
import threading
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from core.files import InputError, Table, parse_toml, read_text

_FILE = Path(__file__).with_name("hid_layouts.toml")
AXES = ("x", "y", "z", "rx", "ry", "rz")
WORD = "deflection, not a force sensor"
#: N at full deflection. Assumed: what a person pushes with ease.
FORCE_FULL_N = 20.0
#: s. Old units have an offset: the reading of the untouched cap so long after the start is subtracted. A device that is
#: plugged in again, perhaps with a hand on it, keeps its earlier offset.
BIAS_S = 0.5
#: Share of full scale. A larger reading means that a hand holds the cap: it is then not taken as the offset.
BIAS_MOST = 0.2
#: s. A deflected device reports every 8 to 16 ms; if it is silent for longer, its hand counts as gone.
SILENT_S = 0.25
LOOK_AGAIN_S = 0.5  # between looks for an unplugged device
WAIT_MS = 8  # longest wait for a report
MOST_REPORTS = 64  # drained at a time


class ReportLayout(Table, frozen=True):
    """A report format of six-axis devices."""

    name: str
    devices: tuple[str, ...]  # "vendor:product", hexadecimal
    length: dict[str, int]  # report number -> bytes, its number included
    axes: dict[str, tuple[int, int]]  # axis -> report number, byte after it


class ReportLayouts(Table, frozen=True):
    """The keys of hid_layouts.toml."""

    usage_page: int
    usage: int
    full_scale_counts: int
    layout: tuple[ReportLayout, ...]


class Attached(NamedTuple):
    """A known device that is plugged in."""

    path: bytes  # where the system has it
    ids: str  # "046d:c626"
    product: str
    layout: ReportLayout
    serial: str = ""

    @property
    def who(self) -> tuple[str, str]:
        """What identifies a device that is plugged in again; two of one kind without a number look the same."""
        return self.ids, self.serial


class HidReading(NamedTuple):
    """The force of the hand and the state of the device."""

    fx_N: float  # to the person's right
    fy_N: float  # away from the person
    connected: bool
    text: str  # for a screen: which device, what is wrong
    reports: int  # drained so far


@cache
def layouts() -> ReportLayouts:
    return parse_toml(read_text(_FILE), ReportLayouts, _FILE.name)


def attached(listed: list[dict]) -> list[Attached]:
    """The known six-axis devices in the list of `hid.enumerate()`, which may have a device several times."""
    by_ids = {ids: layout for layout in layouts().layout for ids in layout.devices}
    found = {}
    for entry in listed:
        ids, path = f"{entry['vendor_id']:04x}:{entry['product_id']:04x}", entry["path"]
        usage = (entry.get("usage_page", 0), entry.get("usage", 0))
        if ids in by_ids and usage in ((layouts().usage_page, layouts().usage), (0, 0)):
            name, serial = entry.get("product_string") or "six-axis device", entry.get("serial_number") or ""
            found[path] = Attached(path, ids, name, by_ids[ids], serial)
    return list(found.values())


def decode(layout: ReportLayout, report: bytes, counts: dict[str, int]) -> bool:
    """Put the axes of a report into `counts`; False: it has none (buttons, other lengths)."""
    if not report or layout.length.get(str(report[0])) != len(report):
        return False
    for axis, (number, byte) in layout.axes.items():
        if number == report[0]:
            counts[axis] = int.from_bytes(report[1 + byte : 3 + byte], "little", signed=True)
    return True


def _library() -> Any:
    try:
        import hidraw as library  # Linux: needs no rights beyond those on the device's node
    except ImportError:
        try:
            import hid as library
        except ImportError as error:
            raise InputError(f"six-axis devices cannot be read: {error}") from None
    return library


def list_hid() -> list[dict]:
    """Every device on the HID bus; InputError: the library is missing."""
    return _library().enumerate()


def open_hid(path: bytes) -> Any:
    """Open a device for reading; OSError if that fails."""
    device = _library().device()
    device.open_path(path)
    return device


class HidHand:
    """The newest deflection of a six-axis device as a force in the plane of the handle."""

    def __init__(
        self, push: Callable[[float, float], None] = lambda fx_N, fy_N: None,
        listing: Callable[[], list[dict]] = list_hid, opening: Callable[[bytes], Any] = open_hid,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:  # fmt: skip
        """push: called with each new force (N), on the thread that reads the device, and with none when that ends.

        listing, opening, clock: of the machine, but for tests.
        InputError if no known device is attached or it may not be read.
        """
        self._push, self._scale = push, FORCE_FULL_N / layouts().full_scale_counts
        self._listing, self._opening, self._clock = listing, opening, clock
        self._ended = threading.Event()
        self._lock = threading.Lock()
        self._newest, self._reports, self._beyond, self._problem = -math.inf, 0, 0, ""
        self._counts, self._bias = dict.fromkeys(AXES, 0), dict.fromkeys(AXES, 0)
        self._biases: dict[tuple[str, str], dict[str, int]] = {}  # of each device, also when it is plugged in again
        self._found, self._device = self._open_first()
        self._thread = threading.Thread(target=self._run, name="six-axis device", daemon=True)
        self._thread.start()

    def read(self) -> HidReading:
        """The hand now, along x and y within `FORCE_FULL_N`; more than full scale is an error of the device.

        No force while the device is unplugged, or silent although it was deflected.
        """
        full = layouts().full_scale_counts
        with self._lock:
            connected = self._device is not None
            x, y = (self._scale * min(max(counts, -full), full) for counts in self._deflection())
            fx, fy = (x, -y) if connected and self._clock() - self._newest <= SILENT_S else (0.0, 0.0)
            bias = self._scale * math.hypot(self._bias["x"], self._bias["y"])
            zero = f"; {bias:.1f} N taken off as its zero" if bias else ""
            many = self._beyond
            beyond = f"; reports beyond full deflection: {many}, held at {FORCE_FULL_N:g} N" if many else ""
            text = f"{self._found.product} ({WORD}{zero}{beyond})" if connected else self._problem
            return HidReading(fx, fy, connected, text, self._reports)

    def _deflection(self) -> list[int]:
        """Deflection along x and y, counts from the zero."""
        return [self._counts[axis] - self._bias[axis] for axis in ("x", "y")]

    def take_bias(self) -> bool:
        """Take the present reading as zero; False, and nothing changes, if a hand seems to hold the cap."""
        with self._lock:
            if max(map(abs, self._counts.values())) > BIAS_MOST * layouts().full_scale_counts:
                return False
            self._bias = self._biases[self._found.who] = dict(self._counts)
            return True

    def close(self) -> None:
        self._ended.set()
        self._thread.join()

    def _open_first(self) -> tuple[Attached, Any]:
        """Open the first known device that can be opened; InputError: none can."""
        devices = attached(self._listing())
        if not devices:
            raise InputError("no known six-axis device is attached (such as a SpaceMouse)")
        refusals = []
        for found in devices:
            try:
                device = self._opening(found.path)
                device.set_nonblocking(False)
                return found, device
            except OSError:
                refusals.append(f"{found.product} ({found.ids}) cannot be opened")
        raise InputError(f"{'; '.join(refusals)}: on Linux a udev rule must allow it (phd doctor prints it)")

    def _run(self) -> None:
        started, biased = self._clock(), False
        while not self._ended.is_set():
            if self._device is None:
                self._reconnect()
                started, biased = self._clock(), self._found.who in self._biases
                continue
            try:
                self._drain()
            except (OSError, ValueError) as error:
                self._disconnect(error)
                continue
            finally:
                self._push(*self.read()[:2])
            if not biased and self._clock() - started >= BIAS_S:
                biased = True
                self._biases.setdefault(self._found.who, self._bias)
                self.take_bias()
        self._push(0.0, 0.0)
        if self._device is not None:
            self._device.close()

    def _drain(self) -> None:
        """Wait for one report, then take all that are there; the newest of each kind counts."""
        wait_ms = WAIT_MS
        for _ in range(MOST_REPORTS):
            report = bytes(self._device.read(64, wait_ms))
            if not report:
                return
            with self._lock:
                if decode(self._found.layout, report, self._counts):
                    self._newest = self._clock()
                    self._reports += 1
                    self._beyond += max(map(abs, self._deflection())) > layouts().full_scale_counts
            wait_ms = 1  # for hidapi 0 would mean: as long as it takes

    def _disconnect(self, error: Exception) -> None:
        device = self._device
        with self._lock:
            self._device = None
            self._counts = dict.fromkeys(AXES, 0)
            self._problem = f"{self._found.product} was unplugged: plug it in again ({error or 'read error'})"
        with contextlib.suppress(OSError):  # it is gone: there is nothing left to close
            device.close()

    def _reconnect(self) -> None:
        try:
            found, device = self._open_first()
        except InputError:
            self._ended.wait(LOOK_AGAIN_S)
            return
        with self._lock:
            self._found, self._device, self._beyond = found, device, 0
            self._bias = self._biases.get(found.who, dict.fromkeys(AXES, 0))
