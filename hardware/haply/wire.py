"""The bytes between a computer and a Haply board (M3): what its client library and firmware do, as facts.

Sources, read and not copied: the client library HaplyHAPI 1.0.1 on PyPI (`Board`, `Device`), and the board's firmware
1.5.0 (Haply_Arduino_Firmware.h, and the loop of its sketch). It is USB, so the baud rate means nothing. Numbers are
32-bit floats, little-endian.

    to the board    0, device: forget every motor and encoder
                    1, device, motors, direction of each, encoders, direction of each, 0, 0, and of each encoder its
                       angle now (degrees) and its counts per revolution: set up
                    2, device, torque of each motor (N m): drive, and ask
    from the board  device, angle of each encoder (degrees): the answer to each 2

Motors and encoders are bits, bit i for port i + 1; the two zeros say that there is no analog and no PWM pin. What has
one value each comes in the order of the ports. The board sets the torques of a 2 and reads its encoders at once; it
holds them until the next 2. There are no checksums, no numbers of frames, and **no watchdog**: a board that hears
nothing keeps its torques. It drives its motors by voltage, up to 0.123 N m, and measures no current.

On the 2diy's third version, joint A is at port 2 and joint B at port 1. The M0 board counts half the encoder's steps.
Not verified on a device: that positive torque turns a joint towards positive angles.
"""

import struct

DEVICE = 5  # number of the device on the board, any
BOTH, COUNTER_CLOCKWISE = 0b11, 1
RESET = bytes((0, 0))
TORQUES, ANGLES = struct.Struct("<2B2f"), struct.Struct("<B2f")
LARGEST_DEG = 720.0  # Our choice: no joint of the 2diy turns so far; an answer beyond is none


def set_up(counts_per_rev: tuple[int, int]) -> bytes:
    """Two motors and two encoders, their angles 0 now; counts of A and B."""
    directions = (COUNTER_CLOCKWISE, COUNTER_CLOCKWISE)
    head = bytes((1, DEVICE, BOTH, *directions, BOTH, *directions, 0, 0))
    at_a, at_b = counts_per_rev
    return head + struct.pack("<4f", 0.0, at_b, 0.0, at_a)


def drive(torque_a: float, torque_b: float) -> bytes:
    """These torques, N m."""
    return TORQUES.pack(2, DEVICE, torque_b, torque_a)


NO_TORQUE = drive(0.0, 0.0)


def counts_of(answer: bytes, counts_per_rev: tuple[int, int]) -> tuple[int, int] | None:
    """The counts of A and B in an answer; None: the bytes are no answer of a Haply."""
    device, angle_b, angle_a = ANGLES.unpack(answer)
    if device != DEVICE or not (abs(angle_a) <= LARGEST_DEG and abs(angle_b) <= LARGEST_DEG):  # false for NaN
        return None
    turns = angle_a * counts_per_rev[0] / 360.0, angle_b * counts_per_rev[1] / 360.0
    if max(abs(turn - round(turn)) for turn in turns) > 0.05:
        return None
    return round(turns[0]), round(turns[1])
