"""The reduced equations of motion against Eq. (5) with its ten coordinates: one physics by two routes."""

from functools import cache
from itertools import combinations

import numpy as np
import pytest
from devices import FiveBar

from core.mechanism import JOINTS
from core.simulator.simulation import Simulation
from core.simulator.stick_slip import FREE, STILL
from core.simulator.stick_slip_mode import finish, set_costs, update_kinematics
from experiments.benchmark.ten_coordinates import (
    CD,
    ED,
    HANDLE,
    THETA_AE,
    THETA_BC,
    bodies_of,
    constraint_bias,
    constraint_matrix,
    coordinates,
    generalised_forces,
    mass_matrix,
    rates,
    solve,
)

ROUNDING = 1e-10  # relative; the linear system of Eq. (5) has a condition number of some 1e4


def moments(bar: FiveBar, n: int = 3):
    """Random tips, velocities, hand forces (N) and slipping torques (N m)."""
    rng = np.random.default_rng(5)
    for p in bar.open_tips(rng, n):
        yield p, rng.normal(scale=0.5, size=2), rng.normal(scale=8.0, size=2), rng.normal(scale=2.0, size=4)


def patterns():
    """Every set of stuck joints."""
    return [stuck for n in range(5) for stuck in combinations(range(4), n)]


def at_rest(bar: FiveBar, stuck: tuple[int, ...]) -> bool:
    """True where this set of stuck joints holds the tip itself."""
    return any(i < j and not parallel(bar, i, j) for i in stuck for j in stuck)


@cache
def parallel(bar: FiveBar, i: int, j: int) -> bool:
    """Whether the rows of two brakes are parallel at every tip (some random ones)."""
    pairs = [bar.rows(p)[[i, j]] for p in bar.open_tips(np.random.default_rng(3), 4)]
    return all(abs(np.linalg.det(pair)) < 1e-9 * np.prod(np.linalg.norm(pair, axis=1)) for pair in pairs)


def carried_along(bar: FiveBar, stuck: tuple[int, ...]) -> list[int]:
    """Brakes at rest because a stuck one shares their line (E and C on coaxial bases): they cannot slip."""
    return [j for j in range(4) if j not in stuck and any(parallel(bar, i, j) for i in stuck)]


def moment_of(bar, p, v, stuck):
    """q and qdot at a tip, with a velocity that the stuck joints allow."""
    bodies = bodies_of(bar.device)
    q = coordinates(bar.device, p)
    if at_rest(bar, stuck):
        v = np.zeros(2)
    elif stuck:
        g = bar.rows(p)[stuck[0]]
        v = v - g * (g @ v) / (g @ g)
    return bodies, q, rates(bodies, q, v), v


def reduced(bar: FiveBar, p, v, hand_force, torque, stuck, hold):
    """Acceleration (2,) and torques (4,) by the reduced form: the kernels of the simulator, the pattern given."""
    simulation = Simulation(bar.device, tuple(p), tuple(v))
    body, braking = simulation.body[0], simulation.braking[0]
    braking.torque_yield[:] = hold
    update_kinematics(simulation.mechanism[0], body)
    set_costs(simulation.brakes[0], body, braking)
    for i in range(4):
        slips = i not in stuck
        braking.active[i] = int(i not in carried_along(bar, stuck))
        body.sign[i] = -1.0 if slips else 0.0
        braking.cost_plus[i] = braking.cost_minus[i] = torque[i] if slips else hold[i]
    body.sign[4] = 0.0
    body.held = FREE if not stuck else STILL if at_rest(bar, stuck) else stuck[0]
    if body.held == STILL:  # the slipping joints of a resting tip: their torque is one more load on it
        for i in range(4):
            braking.active[i] = int(i in stuck)
        hand_force = hand_force + sum(torque[i] * bar.rows(p)[i] for i in range(4) if i not in stuck)
    finish(simulation.mechanism[0], body, braking, hand_force[0], hand_force[1], 0.0)
    given = np.array([0.0 if i in stuck else torque[i] for i in range(4)])
    return body.acceleration.copy(), np.where(np.isin(np.arange(4), stuck), braking.torque[:4], given)


def test_the_centres_of_the_distal_links_lie_on_them(any_five_bar):
    bodies = bodies_of(any_five_bar.device)
    for p, *_ in moments(any_five_bar):
        q = coordinates(any_five_bar.device, p)
        for arm, (proximal, distal) in enumerate(((THETA_AE, ED), (THETA_BC, CD))):
            near, far = 2 * arm, 2 * arm + 1
            elbow = bodies.base[arm] + bodies.length[near] * np.array([np.cos(q[proximal]), np.sin(q[proximal])])
            centre = elbow + bodies.com[far] / bodies.length[far] * (p - elbow)
            assert q[distal : distal + 2] == pytest.approx(centre, abs=1e-13)


@pytest.mark.parametrize("stuck", patterns(), ids=lambda s: "".join(JOINTS[j] for j in s) or "none")
def test_motion_equals_that_of_the_reduced_form_and_multipliers_and_torques_balance_every_body(any_five_bar, stuck):
    """Accelerations and holding torques; then Eq. (5) line by line, the constraints kept, no work by multipliers."""
    bar, hold = any_five_bar, np.full(4, 60.0)
    carried = carried_along(bar, stuck)
    for p, v, force, torque in moments(bar):
        bodies, q, rate, v = moment_of(bar, p, v, stuck)
        torque = np.abs(torque)
        torque[carried] = 0.0
        found = solve(bodies, q, rate, force, torque, stuck)
        acceleration, torques = reduced(bar, p, v, force, torque, stuck, hold)
        rounding = ROUNDING * (1.0 + np.abs(found.acceleration).max())
        assert found.acceleration[HANDLE:] == pytest.approx(acceleration, abs=rounding)
        assert found.torque == pytest.approx(torques, abs=1e-8 * (1.0 + np.abs(torques).max()))
        a = constraint_matrix(bodies, q)
        left = mass_matrix(bodies) @ found.acceleration
        right = generalised_forces(bodies, force, found.torque) + a.T @ found.multipliers
        assert left == pytest.approx(right, abs=ROUNDING * (1.0 + np.abs(left).max()))
        assert np.abs(a @ found.acceleration + constraint_bias(bodies, q, rate)).max() < rounding
        assert np.abs((bodies.rates @ found.acceleration)[list(stuck)]).max(initial=0.0) < 1e-8
        assert abs((a.T @ found.multipliers) @ rate) < 1e-9 * (1.0 + np.abs(found.multipliers).max())
