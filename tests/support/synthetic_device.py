"""Devices for tests of control, made without the code under test: brakes on chosen joints, rows g by differences.

The rows come from joint angles (law of cosines) differenced in x and y, a route independent of the linkage.
"""

import math

import numpy as np

from core.mechanism import JOINTS, Brakes

K = (3.25, 0.35, -1.5625, 7.25, -0.3875)  # Eq. (2), N m, of the assumed brake
KNEE, CURRENT_MAX = 0.2, 1.0

#: base A, base B, proximal, distal (m), braked joints, normalised force (N): the two assumed devices
DEVICES = {
    "three-brake": ((0.0, 0.0), (0.0, 0.0), 0.3048, 0.3048, "AEB", 17.4),
    "four-brake": ((-0.0762, 0.0), (0.0762, 0.0), 0.2794, 0.3048, "AEBC", 19.0),
}


def brakes_on(joints: str) -> Brakes:
    """Assumed brakes on the joints named by letter, none elsewhere."""
    present = np.array([float(joint in joints) for joint in JOINTS])
    return Brakes(
        present=present,
        current_max=CURRENT_MAX * present,
        k=np.outer(present, K),
        knee=KNEE * present,
        omega_0=0.84 * present,
        floor=0.013 * present,
        rise=np.outer(present, np.full(7, 0.03)),
        fall=np.outer(present, np.full(7, 0.02)),
        play=np.zeros(4),
    )


def gain(current: float) -> float:
    """K(I) of the assumed brake, N m."""
    if current < KNEE:
        return K[0] * current + K[1]
    return K[2] * current**2 + K[3] * current + K[4]


def joint_angles(device: str, x: float, y: float) -> np.ndarray:
    """theta (4,) rad of an assumed device, elbows out."""
    base_a, base_b, proximal, distal, _, _ = DEVICES[device]
    angles = []
    for (bx, by), out in ((base_a, -1.0), (base_b, 1.0)):
        reach = math.hypot(x - bx, y - by)
        at_base = math.acos((proximal**2 + reach**2 - distal**2) / (2 * proximal * reach))
        at_elbow = math.acos((proximal**2 + distal**2 - reach**2) / (2 * proximal * distal))
        angles += [math.atan2(y - by, x - bx) - out * at_base, out * (math.pi - at_elbow)]
    return np.array(angles)


def rows(device: str, x: float, y: float) -> np.ndarray:
    """g (4, 2): rate of each joint = g . v."""
    h = 1e-5
    dx = joint_angles(device, x + h, y) - joint_angles(device, x - h, y)
    dy = joint_angles(device, x, y + h) - joint_angles(device, x, y - h)
    return np.column_stack([dx, dy]) / (2 * h)


def random_rows(rng: np.random.Generator) -> np.ndarray:
    """g (4, 2) of no device at all: any directions, moment arms of 0.1 to 0.4 m."""
    angle = rng.uniform(-np.pi, np.pi, 4)
    return np.column_stack([np.cos(angle), np.sin(angle)]) / rng.uniform(0.1, 0.4, (4, 1))


def random_mass(rng: np.random.Generator) -> np.ndarray:
    """M_xx, M_xy, M_yy (kg) of a tip, lopsided by up to five to one."""
    turn, light, heavy = rng.uniform(0, np.pi), rng.uniform(0.8, 1.5), rng.uniform(1.5, 4.0)
    c, s = math.cos(turn), math.sin(turn)
    return np.array([c * c * light + s * s * heavy, c * s * (light - heavy), s * s * light + c * c * heavy])
