"""Waiting for what a test needs, however long the machine takes."""

import time
from collections.abc import Callable

LONG_S = 240.0  # before a test fails; kernels may have to be compiled


def look_again() -> None:
    """Leave the processor to others for a moment."""
    time.sleep(0.005)


def wait_until(what: Callable[[], object], seconds: float = LONG_S, pause: Callable[[], object] = look_again) -> object:
    """Wait for something to come true; what it then is."""
    end = time.perf_counter() + seconds
    while not (found := what()):
        assert time.perf_counter() < end, "waited in vain"
        pause()
    return found
