"""A six-axis HID device as the hand: its deflection stands for a hand force. It is not a force sensor, and says so.

The device is read on a thread of its own and always drained to its newest report: a reader slower than the device
falls seconds behind. Unplugged, it gives no force and is looked for until it is back.
"""

import math
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from core.errors import InputError
from hardware.hid_layouts import AXES, Attached, Layout, attached, decode, layouts

WORD = "deflection, not a force sensor"
#: N at full deflection. Assumed: what a person pushes with ease.
FORCE_FULL_N = 20.0
#: s. Old units miss zero: what the cap says while nobody touches it, right after the start, is taken off. Plugged in
#: again in the middle of a trial, with a hand on it, a device keeps what it had.
BIAS_S = 0.5
#: Share of full scale. A larger bias means that somebody holds the cap: then none is taken.
BIAS_MOST = 0.2
#: s. A deflected device reports every 8 to 16 ms; if it is silent for longer, its hand counts as gone.
SILENT_S = 0.25
LOOK_AGAIN_S = 0.5  # between looks for an unplugged device
WAIT_MS = 8  # longest wait for a report
MOST_REPORTS = 64  # drained at a time


class Reading(NamedTuple):
    """What the hand does now, and how the device is."""

    fx_N: float  # to the person's right
    fy_N: float  # away from the person
    connected: bool
    text: str  # for a screen: which device, what is wrong
    age_s: float  # since its newest report; inf before the first
    reports: int  # drained so far
    unplugged: int  # times that it went away


def list_hid() -> list[dict]:
    """Everything on the HID bus; InputError where the library is missing."""
    return _library().enumerate()


def _library() -> Any:
    try:
        import hidraw as library  # Linux: needs no rights beyond those on the device's node
    except ImportError:
        try:
            import hid as library
        except ImportError as error:
            raise InputError(f"six-axis devices cannot be read: {error}") from None
    return library


def open_hid(path: bytes) -> Any:
    """Open a device for reading; OSError if it is gone or not ours to read."""
    device = _library().device()
    device.open_path(path)
    return device


class HidHand:
    """The newest deflection of one six-axis device, as a force in the plane of the handle."""

    def __init__(
        self,
        force_full_N: float = FORCE_FULL_N,
        listing: Callable[[], list[dict]] = list_hid,
        opening: Callable[[bytes], Any] = open_hid,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """InputError if no known device is attached or it may not be read."""
        self._scale = force_full_N / layouts().full_scale_counts
        self._listing, self._opening, self._clock = listing, opening, clock
        self._ended = threading.Event()
        self._lock = threading.Lock()
        self._newest, self._reports, self._unplugged = -math.inf, 0, 0
        self._counts, self._bias = dict.fromkeys(AXES, 0), dict.fromkeys(AXES, 0)
        self._biases: dict[tuple[str, str], dict[str, int]] = {}  # of every device seen: none is taken anew on replug
        self._found, self._device = self._look()
        self._problem = ""
        self._thread = threading.Thread(target=self._work, name="six-axis device", daemon=True)
        self._thread.start()

    def read(self) -> Reading:
        """The hand now. No force while the device is away, or silent although it was deflected."""
        with self._lock:
            age = self._clock() - self._newest
            pushed = {axis: self._counts[axis] - self._bias[axis] for axis in ("x", "y")}
            connected = self._device is not None
            felt = connected and age <= SILENT_S
            text = f"{self._found.product} ({WORD}{self._bias_words()})" if connected else self._problem
            fx, fy = (self._scale * pushed["x"], -self._scale * pushed["y"]) if felt else (0.0, 0.0)
            return Reading(fx, fy, connected, text, age, self._reports, self._unplugged)

    def _bias_words(self) -> str:
        """How large the bias is in the plane of the handle; nothing where there is none."""
        bias = self._scale * math.hypot(self._bias["x"], self._bias["y"])
        return f"; {bias:.1f} N taken off as its zero" if bias else ""

    def take_bias(self) -> bool:
        """Call what the cap says now its zero; False, and nothing changes, if somebody seems to hold it."""
        with self._lock:
            limit = BIAS_MOST * layouts().full_scale_counts
            if any(abs(count) > limit for count in self._counts.values()):
                return False
            self._bias = self._biases[self._found.who] = dict(self._counts)
            return True

    def close(self) -> None:
        """End the thread and let the device go."""
        self._ended.set()
        self._thread.join()

    def _look(self) -> tuple[Attached, Any]:
        """The first known device that can be opened; InputError says what is wrong."""
        there = attached(self._listing())
        if not there:
            raise InputError("no six-axis device is attached that is known here (a SpaceMouse, for instance)")
        refusals = []
        for found in there:
            try:
                device = self._opening(found.path)
                device.set_nonblocking(False)
                return found, device
            except OSError:
                refusals.append(f"{found.product} ({found.ids}) cannot be opened")
        raise InputError(
            f"{'; '.join(refusals)}: on Linux a udev rule must allow it (phd doctor prints it), "
            "on macOS the maker's driver holds it"
        )

    def _work(self) -> None:
        started = self._clock()
        biased = False
        while not self._ended.is_set():
            if self._device is None:
                self._look_again()
                started, biased = self._clock(), self._found.who in self._biases
                continue
            try:
                self._drain(self._device, self._found.layout)
            except (OSError, ValueError) as error:
                self._lost(error)
                continue
            if not biased and self._clock() - started >= BIAS_S:
                biased = True
                self._biases.setdefault(self._found.who, self._bias)
                self.take_bias()
        if self._device is not None:
            self._device.close()

    def _drain(self, device: Any, layout: Layout) -> None:
        """Wait for one report, then take all that are there; the newest of each kind counts."""
        wait_ms = WAIT_MS
        for _ in range(MOST_REPORTS):
            report = bytes(device.read(64, wait_ms))
            if not report:
                return
            with self._lock:
                if decode(layout, report, self._counts):
                    self._newest = self._clock()
                    self._reports += 1
            wait_ms = 1  # for hidapi 0 would mean: as long as it takes

    def _lost(self, error: Exception) -> None:
        device = self._device
        with self._lock:
            self._device = None
            self._unplugged += 1
            self._counts = dict.fromkeys(AXES, 0)
            self._problem = f"{self._found.product} was unplugged: plug it in again ({error or 'read error'})"
        try:
            device.close()
        except OSError:
            pass  # it is gone: there is nothing left to close

    def _look_again(self) -> None:
        try:
            found, device = self._look()
        except InputError:
            self._ended.wait(LOOK_AGAIN_S)
            return
        with self._lock:
            self._found, self._device = found, device
            self._bias = self._biases.get(found.who, dict.fromkeys(AXES, 0))
