"""Brakes, rows and masses for tests of control: of any device, or of none at all."""

import math

import numpy as np
from devices import FOUR

from core.mechanism import JOINTS, Brakes

K = (3.25, 0.35, -1.5625, 7.25, -0.3875)  # Eq. (2), N m, of the assumed brake
KNEE, CURRENT_MAX = 0.2, 1.0


def brakes_on(joints: str) -> Brakes:
    """Assumed brakes on the joints named by letter, none elsewhere."""
    present = np.array([float(joint in joints) for joint in JOINTS])
    return Brakes(*((present * numbers.T).T for numbers in FOUR.device.brakes[:-1]))


def gain(current: float) -> float:
    """K(I) of the assumed brake, N m."""
    if current < KNEE:
        return K[0] * current + K[1]
    return K[2] * current**2 + K[3] * current + K[4]


def random_rows(rng: np.random.Generator) -> np.ndarray:
    """g (4, 2) of no device at all: any directions, moment arms of 0.1 to 0.4 m."""
    angle = rng.uniform(-np.pi, np.pi, 4)
    return np.column_stack([np.cos(angle), np.sin(angle)]) / rng.uniform(0.1, 0.4, (4, 1))


def random_mass(rng: np.random.Generator) -> np.ndarray:
    """M_xx, M_xy, M_yy (kg) of a tip, lopsided by up to five to one."""
    turn, light, heavy = rng.uniform(0, np.pi), rng.uniform(0.8, 1.5), rng.uniform(1.5, 4.0)
    c, s = math.cos(turn), math.sin(turn)
    return np.array([c * c * light + s * s * heavy, c * s * (light - heavy), s * s * light + c * c * heavy])
