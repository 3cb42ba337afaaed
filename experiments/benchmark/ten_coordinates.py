"""The paper's own form of the dynamics, Eq. (5): M(q) qddot = Q + A' lambda, with A qdot = 0.

Ten coordinates, eight constraints, as a readable reference for the reduced form of core/dynamics.py (the same physics
by another route; it is not built for speed).

    q = theta_AE, theta_BC, ED x, y, theta, CD x, y, theta, handle x, y (x, y of a link at its centre of mass)

All angles are absolute, so M is constant: diagonal, but for the rotor of a brake at an elbow, which turns at the
difference of two links' rates, and that of a coupling. The four vector constraints A qdot = 0: elbow E as a point of AE
and of ED, elbow C as a point of BC and of CD, the handle as the end of ED and as the end of CD. Joint order A, E, B, C;
SI and radians.
"""

from typing import NamedTuple

import numpy as np

from core.device import Device, centre_and_inertia
from core.linkage import joint_angles
from core.mechanism import JOINTS, PLACES, A, B
from core.simulator.state import pack_mechanism

THETA_AE, THETA_BC, ED, CD, HANDLE = 0, 1, 2, 5, 8  # ED and CD: x, then y, then theta
COORDINATES, CONSTRAINTS = 10, 8


class Bodies(NamedTuple):
    """The bodies of Eq. (5): the links one by one, order AE, ED, BC, CD where there are four."""

    base: np.ndarray  # (2, 2) m, A and B
    length: np.ndarray  # (4,) m
    com: np.ndarray  # (4,) m, from the proximal joint along the link
    mass: np.ndarray  # (4,) kg
    inertia: np.ndarray  # (4,) kg m2, about the centre of mass
    elbow_mass: np.ndarray  # (2,) kg, brake housing at E (on link AE) and at C (on link BC)
    rotor: np.ndarray  # (4,) kg m2, of each brake, on its own rate
    tip_mass: float  # kg
    rates: np.ndarray  # (4, 10) rate of each brake on qdot; its transpose carries torques into generalised forces
    lines: int  # which of those rates vanish together, as in `Mechanism`


class Solution(NamedTuple):
    """Eq. (5) solved for one moment."""

    acceleration: np.ndarray  # (10,) m/s2, rad/s2
    multipliers: np.ndarray  # (8,) N: x, y of the forces at E (on AE), at D (on ED), at C (on BC), at D (on CD)
    torque: np.ndarray  # (4,) N m of each brake, given or holding


def bodies_of(device: Device) -> Bodies:
    """The links of a device, from its file."""
    file = device.file
    g, m = file.geometry, file.mass
    links, lengths = (m.AE, m.ED, m.BC, m.CD), (g.L_AE_m, g.L_ED_m, g.L_BC_m, g.L_CD_m)
    brakes = JOINT_RATES.copy()
    for joint, coupling in file.coupled.items():
        brakes[JOINTS.index(joint)] = coupling.A * JOINT_RATES[A] + coupling.B * JOINT_RATES[B]
    shape = np.array([centre_and_inertia(link, length) for link, length in zip(links, lengths, strict=True)])
    return Bodies(
        base=np.array([g.base_A_m, g.base_B_m]),
        length=np.array(lengths),
        com=shape[:, 0],
        mass=np.array([link.mass_kg for link in links]),
        inertia=shape[:, 1],
        elbow_mass=np.array([m.joint_E_kg, m.joint_C_kg]),
        rotor=np.array([m.rotor_inertia_kg_m2 if joint in file.braked else 0.0 for joint in JOINTS]),
        tip_mass=m.tip_kg,
        rates=brakes,
        lines=device.mechanism.lines,
    )


def mass_matrix(bodies: Bodies) -> np.ndarray:
    """M (10, 10) of Eq. (5), constant."""
    b = bodies
    mass = np.zeros((COORDINATES, COORDINATES))
    for arm, (proximal, distal) in enumerate(((THETA_AE, ED), (THETA_BC, CD))):
        near, far = 2 * arm, 2 * arm + 1  # index of the link, and of the joint at its near end
        mass[proximal, proximal] = (
            b.inertia[near] + b.mass[near] * b.com[near] ** 2 + b.elbow_mass[arm] * b.length[near] ** 2
        )
        mass[distal, distal] = mass[distal + 1, distal + 1] = b.mass[far]
        mass[distal + 2, distal + 2] = b.inertia[far]
    mass[HANDLE, HANDLE] = mass[HANDLE + 1, HANDLE + 1] = b.tip_mass
    return mass + b.rates.T @ (b.rotor[:, None] * b.rates)


def constraint_matrix(bodies: Bodies, q: np.ndarray) -> np.ndarray:
    """A (8, 10) of Eq. (5), A qdot = 0: rows x, y of elbow E, of D on arm 1, of elbow C, of D on arm 2."""
    b, a = bodies, np.zeros((CONSTRAINTS, COORDINATES))
    for arm, (proximal, distal) in enumerate(((THETA_AE, ED), (THETA_BC, CD))):
        near, far, k = 2 * arm, 2 * arm + 1, 4 * arm
        across = _normal(q[distal + 2])
        a[k : k + 2, proximal] = b.length[near] * _normal(q[proximal])
        a[k : k + 2, distal : distal + 2] = -np.eye(2)
        a[k : k + 2, distal + 2] = b.com[far] * across
        a[k + 2 : k + 4, distal : distal + 2] = np.eye(2)
        a[k + 2 : k + 4, distal + 2] = (b.length[far] - b.com[far]) * across
        a[k + 2 : k + 4, HANDLE:] = -np.eye(2)
    return a


def constraint_bias(bodies: Bodies, q: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Adot qdot (8,), m/s2: A qddot = -Adot qdot keeps the constraints."""
    b, bias = bodies, np.zeros(CONSTRAINTS)
    for arm, (proximal, distal) in enumerate(((THETA_AE, ED), (THETA_BC, CD))):
        near, far, k = 2 * arm, 2 * arm + 1, 4 * arm
        inward = -_unit(q[distal + 2]) * rate[distal + 2] ** 2
        bias[k : k + 2] = -b.length[near] * _unit(q[proximal]) * rate[proximal] ** 2 + b.com[far] * inward
        bias[k + 2 : k + 4] = (b.length[far] - b.com[far]) * inward
    return bias


def _unit(theta: float) -> np.ndarray:
    return np.array([np.cos(theta), np.sin(theta)])


def _normal(theta: float) -> np.ndarray:
    return np.array([-np.sin(theta), np.cos(theta)])


#: (4, 10) rate of each joint A, E, B, C on qdot.
JOINT_RATES = np.zeros((4, COORDINATES))
JOINT_RATES[0, THETA_AE] = JOINT_RATES[2, THETA_BC] = 1.0
JOINT_RATES[1, ED + 2] = JOINT_RATES[3, CD + 2] = 1.0
JOINT_RATES[1, THETA_AE] = JOINT_RATES[3, THETA_BC] = -1.0


def generalised_forces(bodies: Bodies, hand_force: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Q (10,) of Eq. (5) from the hand force (2,), N, on the handle and the brake torques (4,), N m."""
    q = bodies.rates.T @ torque
    q[HANDLE:] += hand_force
    return q


def coordinates(device: Device, tip: np.ndarray) -> np.ndarray:
    """q (10,) with the handle at a tip (2,), m."""
    b, theta = bodies_of(device), np.zeros(4)
    joint_angles(pack_mechanism(device.mechanism)[0], tip[0], tip[1], theta)
    q = np.zeros(COORDINATES)
    q[[THETA_AE, THETA_BC, ED + 2, CD + 2]] = theta[0], theta[2], theta[0] + theta[1], theta[2] + theta[3]
    q[HANDLE:] = tip
    for far, distal in ((1, ED), (3, CD)):
        q[distal : distal + 2] = tip - (b.length[far] - b.com[far]) * _unit(q[distal + 2])
    return q


def rates(bodies: Bodies, q: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """qdot (10,) that the constraints allow with the handle moving at `velocity` (2,), m/s."""
    a = constraint_matrix(bodies, q)
    return np.append(np.linalg.solve(a[:, :HANDLE], -a[:, HANDLE:] @ velocity), velocity)


def solve(
    bodies: Bodies, q: np.ndarray, rate: np.ndarray, hand_force: np.ndarray, torque: np.ndarray,
    stuck: tuple[int, ...] = (),
) -> Solution:  # fmt: skip
    """Accelerations and multipliers, Eq. (5), with each stuck brake (indices into A, E, B, C) as one more constraint.

    `torque` (4,), N m, acts on the brakes that are not stuck. Several stuck brakes share the load so that the sum of
    their torques' squares is least, as core/simulator/load_sharing.py for brakes that can hold the same.
    """
    given = np.where(np.isin(np.arange(4), stuck), 0.0, torque)
    force = generalised_forces(bodies, hand_force, given)
    mass, closure = mass_matrix(bodies), constraint_matrix(bodies, q)
    # two independent stuck brakes hold the tip and with it all others
    leading = [j for j in stuck if not any(bodies.lines >> (PLACES * i + j) & 1 for i in stuck if i < j)][:2]
    rows = np.vstack([closure, bodies.rates[leading]])
    right = np.concatenate([force, -constraint_bias(bodies, q, rate), np.zeros(len(leading))])
    n = len(rows)
    whole = np.block([[mass, -rows.T], [rows, np.zeros((n, n))]])
    found = np.linalg.solve(whole, right)
    acceleration, multipliers, torques = found[:COORDINATES], found[COORDINATES : COORDINATES + CONSTRAINTS], given
    if stuck:
        exerted = mass @ acceleration - force  # by all constraints together
        torques = given + _share(bodies, closure, exerted, stuck)
        rest = exerted - bodies.rates.T @ (torques - given)
        multipliers = np.linalg.lstsq(closure.T, rest, rcond=None)[0]
    return Solution(acceleration, multipliers, torques)


def _share(bodies: Bodies, closure: np.ndarray, exerted: np.ndarray, stuck: tuple[int, ...]) -> np.ndarray:
    """Torques (4,), N m, of the stuck joints: with the closure forces they add up to `exerted`; least squares."""
    free = np.linalg.svd(closure)[2][CONSTRAINTS:].T  # (10, 2): the motions that the linkage allows
    joints, torque = list(stuck), np.zeros(4)
    torque[joints] = np.linalg.lstsq((bodies.rates[joints] @ free).T, free.T @ exerted, rcond=1e-12)[0]
    return torque
