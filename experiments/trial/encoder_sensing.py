"""What the controller of a simulated device sees where its joints carry encoders, as on the bench.

Each joint angle is a whole number of counts, and the tip follows from them. Its velocity is the slope of the parabola
by least squares through the last samples (`MotionFilter` of hardware/sensing/samples): half the window old. The whole
sample, with the force, reaches the controller some ticks later. The force itself is the hand's: the noise of
the bench's sensor (0.02 N) is far below the thresholds of the rules.

All of it follows from the tip's motion since the first tick, so a recording, whose columns are the true motion, gives
it again to the last bit.
"""

import math
from typing import NamedTuple

import numpy as np

from core.control.guard import Sensed
from core.device import Device
from core.device_interface import encoder_step, velocity_noise
from core.kernels import kernel
from core.linkage import joint_angles
from core.records import new_record
from core.simulator.state import new_body
from core.simulator.stick_slip_mode import update_kinematics
from core.tick_log import TICK_S
from experiments.assumptions import ENCODERS, Assumptions, encoder_counts

_RING = 128  # samples, a power of two: more than the longest window and delay together
_LAST = _RING - 1

SENSING = np.dtype(
    [
        ("on", "i8"),  # 0: the controller sees the truth
        ("steps", "f8", (4,)),  # 1/rad, counts of each joint's encoder
        ("pairs", "i8", (2, 2)),  # joints whose angles give the tip; two encoders: the same pair twice
        ("window", "i8"),  # samples
        ("delay", "i8"),  # samples
        ("taken", "i8"),  # samples so far
        ("ring", "f8", (_RING, 4)),  # past samples: tip, m, and force, N
        ("theta", "f8", (4,)),  # rad, work space
    ]
)


class EncoderSensing(NamedTuple):
    """The sensors of a simulated device, and what its controller sees: a body of which motion and force are filled."""

    sensors: np.ndarray
    seen: np.ndarray


def new_sensing(device: Device, assumptions: Assumptions) -> EncoderSensing:
    """Before the first sample."""
    record = new_record(SENSING)
    if assumptions.sensing == ENCODERS:
        counts = encoder_counts(device)
        joints = [i for i, count in enumerate(counts) if count]
        pairs = np.reshape(joints if len(joints) == 4 else 2 * joints, (2, 2))
        window, delay = assumptions.filter_samples, assumptions.delay_samples
        steps = np.array(counts) / (2.0 * math.pi)
        record = new_record(SENSING, on=1, steps=steps, pairs=pairs, window=window, delay=delay)
    return EncoderSensing(record.view(np.ndarray), new_body(0.0, 0.0).view(np.ndarray))


def decision_noise(device: Device, tip: tuple[float, float], assumptions: Assumptions) -> float:
    """Noise (m/s, rms) of the velocity that the controller of a simulated device sees."""
    return velocity_noise(device, tip, assumptions.filter_samples) if assumptions.sensing == ENCODERS else 0.0


def sensed(device: Device, tip: tuple[float, float], assumptions: Assumptions) -> Sensed:
    """How far the motion that the controller of a simulated device sees may be from the true one.

    The steps of the encoders: twice what they are at `tip` (m).
    """
    if assumptions.sensing != ENCODERS:
        return Sensed()
    delay, window = TICK_S * assumptions.delay_samples, assumptions.filter_samples
    encoders = device.sensing.encoders if device.sensing else None
    error = encoder_step(device, tip, encoders.counts) if encoders else 0.0  # half a count, twice
    slope = 3.0 * window / (TICK_S * (window * window - 1.0))  # largest sum of the filter's weights, 1/s
    return Sensed(delay, delay + TICK_S * (window - 1), error, slope * error)


#: Assumed of a real device, whose velocity is filtered alike (hardware/sensing/samples).
AS_ON_THE_BENCH = Assumptions(sensing=ENCODERS)


@kernel
def see(mechanism, body, sensing, seen):
    """Stage: take a sample of the device; the one that reaches the controller now becomes `seen`."""
    n, ring = sensing.taken, sensing.ring
    x, y = counted_tip(mechanism, body, sensing)
    for k in range(_RING if n == 0 else 1):  # as if it had rested there before
        sample = ring[(n + k) & _LAST]
        sample[0], sample[1] = x, y
        sample[2], sample[3] = body.hand_force[0], body.hand_force[1]
    sensing.taken = n + 1
    newest = ring[(n - sensing.delay) & _LAST]
    window = sensing.window
    vx = vy = 0.0
    for k in range(1, window):
        sample, weight = ring[(n - sensing.delay - k) & _LAST], 0.5 * (window - 1) - k
        vx += weight * (sample[0] - newest[0])  # exact zeros while nothing moves
        vy += weight * (sample[1] - newest[1])
    scale = 12.0 / (window * (window * window - 1.0) * TICK_S)
    seen.tip[0], seen.tip[1], seen.tip[2], seen.tip[3] = newest[0], newest[1], scale * vx, scale * vy
    seen.hand_force[0], seen.hand_force[1] = newest[2], newest[3]
    update_kinematics(mechanism, seen)


@kernel
def counted_tip(mechanism, body, sensing):
    """The tip (m) by the counts of the encoders, from the true one and its rows g: exact to the counts' square."""
    g, theta = body.g, sensing.theta
    joint_angles(mechanism, body.tip[0], body.tip[1], theta)
    x, y = body.tip[0], body.tip[1]
    for k in range(2):
        i, j = sensing.pairs[k, 0], sensing.pairs[k, 1]
        a = math.floor(theta[i] * sensing.steps[i] + 0.5) / sensing.steps[i] - theta[i]
        b = math.floor(theta[j] * sensing.steps[j] + 0.5) / sensing.steps[j] - theta[j]
        half = 0.5 / (g[i, 0] * g[j, 1] - g[i, 1] * g[j, 0])
        x += half * (g[j, 1] * a - g[i, 1] * b)
        y += half * (g[i, 0] * b - g[j, 0] * a)
    return x, y
