"""What the device page is told of a board that lives (emulated), and the steps that it asks for."""

import math
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from emulated import Emulated
from live import Window, live_window, wait_until

from app.ipc import messages as m
from app.ipc.messages import Setup

DEVICE = "four-brake"


def take_zero(seen: Window, done: Callable[[], object]) -> None:
    """The step is asked for, again where samples were missing on a machine with much else to do."""
    while not done():
        seen.client.send(m.Rig(m.ZERO))
        seen.within(5.0, lambda _: done())


def test_the_page_is_told_how_the_device_is_and_its_steps_are_done(tmp_path: Path) -> None:
    emulated = Emulated(tmp_path, "--device", DEVICE, "--hand", "still", "--seed", "3", "--not-homed")
    try:
        setup = Setup(tmp_path / "data", devices=(DEVICE,), link=str(emulated.port), sync=False)
        with live_window(setup) as seen:

            def device():
                seen.look()
                return seen.pulse.device if seen.pulse else None

            seen.until_stage(m.NO_SESSION)
            wait_until(lambda: device() and device().report.get("state") in ("READY", "ACTIVE"))
            told = device()
            assert (told.device, told.port, told.homed, told.zeroed) == (DEVICE, str(emulated.port), False, False)
            assert told.report["protocol"] == 1
            assert math.dist(seen.snapshot.tip, (0.0, 0.4)) < 0.3, "nobody knows where the handle is: its jig is shown"
            assert len(told.counts) == len(told.encoders) == len(told.report["counts_per_rev"])
            seen.client.send(m.Rig(m.HOME))  # without a session there is no journal to keep it
            seen.until(lambda s: s.said_bad and "session" in s.said)

            seen.client.send(m.Open("01"))
            seen.until_stage(m.RERIG)
            before = time.time()
            seen.client.send(m.Rig(m.HOME))
            wait_until(lambda: device().homed)
            assert before <= device().homed_at <= time.time() and device().zeroed_at == 0.0
            home = seen.opened.paths[1]
            middle = [0.5 * (a + b) for a, b in zip(home.start_m, home.end_m, strict=True)]
            assert device().tip == pytest.approx(middle, abs=1e-3), "the encoders stand where the jig holds the handle"
            take_zero(seen, lambda: device().zeroed_at)
            seen.until_stage(m.READY)
            first = device().zeroed_at
            take_zero(seen, lambda: device().zeroed_at > first)  # again, between two trials
            seen.client.send(m.Rig(m.CONNECT))
            wait_until(lambda: device().device and not device().zeroed)
            seen.until_stage(m.RERIG)
            samples = device().report["samples"]
            wait_until(lambda: device().report.get("samples", 0) > samples)
    finally:
        emulated.end()


def test_a_simulated_device_has_no_steps(tmp_path: Path) -> None:
    with live_window(Setup(tmp_path / "data", sync=False)) as seen:
        seen.open()
        seen.client.send(m.Rig(m.ZERO))
        seen.until(lambda s: s.said_bad and "simulated" in s.said)
        wait_until(lambda: seen.look() or seen.pulse)
        assert seen.pulse.device is None
