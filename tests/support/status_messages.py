"""What the loop of a device on the bench may say of it, for tests of the screens."""

import time

from fake_client import GREEN, pulse

from app.ipc import messages as m
from app.ipc.messages import DeviceStatus

ON_BENCH = {"real_device": True, "hand": "force sensor"}
WELL = (m.Check("Device", m.GOOD, "four-brake, board B-7"), m.Check(m.FORCE_SENSOR, m.GOOD, "zeroed"), *GREEN[2:])
NO_ZERO = m.Check(m.FORCE_SENSOR, m.DUE, "not zeroed yet", "Zero it: the session or the Device page (F3) guides you.")
NOT_ZEROED = (WELL[0], NO_ZERO, *GREEN[2:])
LOST = (
    m.Check("Device", m.BAD, "not connected", "No sample for 200 ms."),
    m.Check(m.FORCE_SENSOR, m.WAITING, "connecting …"),
    *GREEN[2:],
)
FRAMES = {"good": 812_400, "bad_cobs": 0, "bad_crc": 0, "too_long": 0, "resyncs": 0, "bytes": 48_000_000, "bad": 0}
REPORT = {
    "samples": 812_345, "lost": 12, "repeated": 0, "late_commands": 0, "refused": 0, "not_closed": 0, "lost_links": 0,
    "round_trip_s": 0.0016, "delay_ticks": 1, "frames": FRAMES, "board": "B-7", "firmware": "0.9.0", "protocol": 1,
    "starts": 1, "link": "UART at 2000 kbaud, by an ST-LINK",
    "clock": {"offset_s": 1234.5678, "drift": 12.3e-6, "residual_s": 35e-6, "blocks": 60}, "state": "READY",
    "counts_per_rev": [96_000, 96_000],
}  # fmt: skip


def status(report: dict | None = None, **changes) -> DeviceStatus:
    """A four-brake device that is well, but for these changes (of its report, of itself)."""
    now = time.time()
    well = DeviceStatus(
        "four-brake", "B-7", "", "", True, True, (0.02, 0.38), (3.0, -4.0), "AB", 6, {**REPORT, **(report or {})},
        "/dev/ttyACM0", (34_512, -1_208), (2.1, -1.3, 1.0, 1.3), now - 600.0, now - 500.0,
    )  # fmt: skip
    return well._replace(**changes)


def told(device: DeviceStatus | None, reported_s: float = 0.0) -> m.Pulse:
    """A pulse that brings it."""
    return pulse("")._replace(device=device and device._replace(reported_s=reported_s))
