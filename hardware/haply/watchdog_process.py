"""Motors at zero once the program that drives a Haply falls silent, hangs or dies: the board has no watchdog itself.

A process of its own, `watchdog_process.py PORT`: it inherits the open port as a file of this number. A byte on its
stdin says that the program lives; the end of stdin, that it has gone. It imports nothing of ours, so it starts at once.
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
