"""A process that keeps a processor busy until its input ends: what `measure` lets run beside the loop."""

import os
import sys
import threading

from app.ipc.scheduling import leave_core


def main() -> None:
    """Compute, on any core as a foreign program would: what we start keeps off the loop's otherwise."""
    leave_core(-1)
    threading.Thread(target=_end_with_input, daemon=True).start()
    number = 1
    while True:
        number = number * 1_664_525 % 4_294_967_291


def _end_with_input() -> None:
    sys.stdin.buffer.read()
    os._exit(0)
