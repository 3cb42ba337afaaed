"""Motors at zero once the program that drives a Haply falls silent, hangs or dies: the board has no watchdog itself.

A process of its own, `watchdog_process.py PORT`, with the open port as a file that it inherits. A byte on its stdin says
that the program lives; the end of stdin, that it has gone. It knows the bytes of `wire` and imports nothing of it, so
that it is there within some 20 ms.
"""

import os
import select
import sys

SILENT_S = 0.02  # without a byte: motors at zero, again and again until one comes
RESET, NO_TORQUE = bytes((0, 0)), bytes((2, 5, *[0] * 8))


def main(port: int) -> None:
    """Watch stdin; port: an open file."""
    while True:
        ready, _, _ = select.select([0], [], [], SILENT_S)
        if not ready:
            os.write(port, NO_TORQUE)
        elif not os.read(0, 4096):
            break
    os.write(port, NO_TORQUE + RESET)


if __name__ == "__main__":
    try:
        main(int(sys.argv[1]))
    except OSError:  # the port is gone, and the motors' supply with it or out of reach
        sys.exit(1)
