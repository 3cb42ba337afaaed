"""A bus with one six-axis device that is played."""

import threading
from collections import deque

NAVIGATOR = {"path": b"/dev/hidraw7", "vendor_id": 0x046D, "product_id": 0xC626, "usage_page": 1, "usage": 8,
             "product_string": "SpaceNavigator"}  # fmt: skip


class Bus:
    """A bus with one device: `push` makes reports come, `plugged` says whether it is there, `now` is the time."""

    def __init__(self, entry: dict = NAVIGATOR) -> None:
        self.entry, self.plugged, self.now, self.opened, self.closed = entry, True, 0.0, 0, 0
        self.reports: deque[bytes] = deque()
        self._come = threading.Event()

    def listing(self) -> list[dict]:
        return [self.entry] if self.plugged else []

    def opening(self, path: bytes) -> "Bus":
        if not self.plugged:
            raise OSError("open failed")
        self.opened += 1
        return self

    def set_nonblocking(self, on: bool) -> None:
        assert not on

    def read(self, most: int, wait_ms: int) -> list[int]:
        if not self.plugged:
            raise OSError("read error")
        if not self.reports:
            self._come.wait(wait_ms / 1000.0)
            self._come.clear()
        return list(self.reports.popleft()) if self.reports else []

    def close(self) -> None:
        self.closed += 1

    def push(self, *reports: str) -> None:
        self.reports.extend(bytes.fromhex(report) for report in reports)
        self._come.set()
