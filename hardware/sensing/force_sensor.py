"""From the counts of the force channels to the hand force, by what the device file says of the sensor.

load (6,) = calibration (6 x 6, the identity without one) x unit x (counts - zero); its first two components, turned by
how the sensor is mounted, are what it reads; hand force = reading + inertia_beyond_kg x acceleration of the tip.
"""

import math
from collections.abc import Sequence

import numpy as np

from core.device import Device
from core.device_file import ForceSensor
from core.device_interface import DeviceError, DeviceSample, ZeroRecord
from core.files import InputError


class ForceSensing:
    """Counts to newtons, in the frame of the device."""

    def __init__(self, device: Device, channels: int, unit: int) -> None:
        """channels: how many the board sends; unit: micro-newtons a count. InputError: they do not fit the file."""
        self._sensor = device.sensing.force if device.sensing else None
        self._sensor = self._sensor or (ForceSensor(on="handle") if channels else None)
        if self._sensor and channels < 2:
            raise InputError(
                f"device {device.name}: its file has a force sensor, but the board sends {channels} channels"
            )
        if device.calibration is not None and channels != 6:
            raise InputError(
                f"device {device.name}: a 6 x 6 calibration needs six force channels, but the board sends {channels}"
            )
        matrix = np.eye(channels) if device.calibration is None else device.calibration
        self._plane = 1e-6 * unit * matrix[:2] if channels else np.zeros((2, 0))
        self.zero = np.zeros(channels)  # counts with nothing on the handle

    def hand_force(
        self, counts: Sequence[int], theta: tuple[float, ...], acceleration: tuple[float, float]
    ) -> tuple[float, float]:
        """The hand force (N) at joint angles theta (4,) with a tip acceleration (m/s2); none without a sensor."""
        if self._sensor is None:
            return 0.0, 0.0
        fx, fy = self._plane @ (np.asarray(counts, dtype=float) - self.zero)
        turned, beyond = sensor_angle(self._sensor, theta), self._sensor.inertia_beyond_kg
        cos, sin = math.cos(turned), math.sin(turned)
        return (
            float(cos * fx - sin * fy) + beyond * acceleration[0],
            float(sin * fx + cos * fy) + beyond * acceleration[1],
        )


def sensor_angle(sensor: ForceSensor, theta: tuple[float, ...]) -> float:
    """How far the sensor's x axis is turned from the frame's, rad; theta (4,) rad, A, E, B, C.

    Our choice: the handle itself does not turn (the hand holds it upright), so a sensor on it is turned by a constant.
    """
    if sensor.on == "ED":
        return float(theta[0] + theta[1] + sensor.rotation_rad)
    if sensor.on == "CD":
        return float(theta[2] + theta[3] + sensor.rotation_rad)
    return sensor.rotation_rad


ZERO_SAMPLES = 500
STILL_M = 1e-3  # a handle that moved further was touched


def zero_of(taken: Sequence[DeviceSample], before: ZeroRecord) -> ZeroRecord:
    """The zero in samples; before: the one that was taken off their currents. DeviceError: the handle moved."""
    moved = float(np.max(np.ptp(np.array([sample.tip for sample in taken]), axis=0)))
    if not math.isfinite(moved):
        raise DeviceError("zero: nobody can tell whether the handle is still; home the encoders first")
    if moved > STILL_M:
        raise DeviceError("zero: the handle moved; nobody may touch it meanwhile")
    counts = np.array([sample.force_counts for sample in taken], dtype=float)
    a, e, b, c = (np.array([sample.current for sample in taken]).mean(axis=0) + before.current).tolist()
    mean, spread = counts.mean(axis=0).tolist(), counts.std(axis=0).tolist()
    return ZeroRecord(len(taken), tuple(mean), tuple(spread), (a, e, b, c))
