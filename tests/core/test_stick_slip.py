"""Which brakes stick: the exact solver against brute force, the zonotope of a locked device, the load split."""

import functools
import itertools
import math

import numpy as np
import pytest
from devices import BENCH, BENCH_FOUR, BENCH_THREE, FIXED, FOUR, THREE, FiveBar, random_five_bar
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize

from core.mechanism import JOINTS, PLACES
from core.records import new_record
from core.simulator.hand import new_hand
from core.simulator.load_sharing import share_at_rest
from core.simulator.simulation import Grid, Schedule, Simulation
from core.simulator.state import BRAKING, new_body
from core.simulator.stick_slip import STILL, Joints, solve_at_rest

DIRECTIONS = [np.array([math.cos(a), math.sin(a)]) for a in np.radians(np.arange(0, 360, 10))]


def objective(a, mass, f, g, active, plus, minus) -> np.ndarray:
    """1/2 a.M a - f.a + sum of costs of each a (k, 2): what the motion minimises (inf where a stop forbids it)."""
    joints = np.flatnonzero(active)
    rates = a @ g[joints].T
    rates[np.abs(rates) <= 1e-11 * np.hypot(*g[joints].T) * (1e-3 + np.hypot(*a.T)[:, None])] = 0.0
    costs = np.where(rates == 0.0, 0.0, np.where(rates > 0.0, plus[joints], minus[joints]))
    return 0.5 * np.einsum("ki,ij,kj->k", a, mass, a) - a @ f + np.sum(costs * np.abs(rates), axis=1)


@functools.cache
def all_modes(n: int) -> np.ndarray:
    """Every way in which n joints slip (1, -1) or are held (0), (3^n, n)."""
    return np.array(list(itertools.product((1, -1, 0), repeat=n))).reshape(-1, n)


def by_enumeration(mass, f, g, active, plus, minus) -> np.ndarray:
    """The minimiser, from all 3^n modes (+, -, held) of the active joints."""
    joints = np.flatnonzero(active)
    rows, size = g[joints], np.hypot(*g[joints].T)
    across = np.abs(np.outer(rows[:, 0], rows[:, 1]) - np.outer(rows[:, 1], rows[:, 0])) > 1e-9 * np.outer(size, size)
    modes = all_modes(len(joints))
    costs = np.where(modes == 0, 0.0, np.where(modes > 0, plus[joints], minus[joints]))
    still = np.any((modes == 0) & ((modes == 0) @ across), axis=1)  # two independent joints held: a = 0
    possible = ~still & np.all(np.isfinite(costs), axis=1)
    modes, push = modes[possible], f - (modes * costs)[possible] @ rows
    found = push @ np.linalg.inv(mass)
    some = np.any(modes == 0, axis=1)
    along = rows[np.argmax(modes[some] == 0, axis=1)] @ [[0.0, 1.0], [-1.0, 0.0]]
    shares = np.sum(along * push[some], axis=1) / np.sum(along @ mass * along, axis=1)
    found[some] = along * shares[:, None]
    found = np.vstack((np.zeros(2), found))
    return found[np.argmin(objective(found, mass, f, g, active, plus, minus))]


def problem(seed: int, kind: str):
    """A random problem: mass, force, rows, active joints, costs against + and - motion, which rows are parallel."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(2, 2))
    mass = root @ root.T + rng.uniform(0.05, 2.0) * np.eye(2)
    g = rng.normal(size=(PLACES, 2)) * rng.uniform(1.0, 10.0, (PLACES, 1))
    lines = 0
    if kind == "coaxial":
        lines = THREE.device.mechanism.lines
        for j in (3, 4, 5, 6):
            g[j] = rng.normal() * g[1]
    elif kind == "coupled":  # rows of any two groups, as couplings give them
        group = rng.integers(0, 3, PLACES)
        for i, j in itertools.combinations(range(PLACES), 2):
            if group[i] == group[j]:
                g[j] = rng.choice([-2.0, -1.0, 1.0, 3.0]) * g[i] * rng.uniform(0.5, 2.0)
                lines |= 1 << (PLACES * i + j) | 1 << (PLACES * j + i)
    active = (rng.uniform(size=PLACES) < 0.8).astype(np.int64)
    plus = rng.uniform(0.0, 5.0, PLACES)
    minus = plus.copy() if kind == "symmetric" else rng.uniform(0.0, 5.0, PLACES)
    if kind == "zero":
        plus[rng.integers(PLACES)] = minus[rng.integers(PLACES)] = 0.0
        both = rng.integers(PLACES)
        plus[both] = minus[both] = 0.0
    if kind in ("stop", "coaxial", "coupled"):
        for j in rng.integers(0, PLACES, rng.integers(1, 3)):
            (plus if rng.uniform() < 0.5 else minus)[j] = math.inf
    f = rng.normal(size=2) * 10.0 ** rng.uniform(-0.5, 2.0)
    size = 10.0 ** rng.uniform(-4.0, 0.0)  # of all that pushes: the modes do not depend on it
    return mass, size * f, g, active, size * plus, size * minus, lines


def solve(mass, f, g, active, plus, minus, lines):
    sign = np.zeros(PLACES)
    whole = mass[0, 0], mass[0, 1], mass[1, 1]
    held, ax, ay = solve_at_rest(Joints(g, active, plus, minus, lines), whole, (f[0], f[1]), sign)
    return held, np.array([ax, ay]), sign


@pytest.mark.nojit
@settings(max_examples=80)
@given(st.integers(0, 2**32), st.sampled_from(["symmetric", "asymmetric", "zero", "stop", "coaxial", "coupled"]))
def test_motion_from_rest_is_the_best_of_all_stick_and_slip_modes(seed, kind):
    """Asymmetric, zero and infinite yields, and parallel rows on coaxial bases and of couplings."""
    mass, f, g, active, plus, minus, lines = problem(seed, kind)
    held, a, sign = solve(mass, f, g, active, plus, minus, lines)
    expected = by_enumeration(mass, f, g, active, plus, minus)
    assert a == pytest.approx(expected, abs=1e-9 * (1e-3 + np.linalg.norm(np.linalg.solve(mass, f))))
    assert (held == STILL) == (not np.any(a))
    for i in np.flatnonzero(active):
        if sign[i] != 0.0:
            assert sign[i] * (g[i] @ a) > 0.0
        else:
            assert abs(g[i] @ a) <= 1e-12 * np.linalg.norm(g[i]) * np.linalg.norm(a)
    near = a + np.random.default_rng(seed).normal(scale=1e-3, size=(20, 2))
    there, here = (objective(points, mass, f, g, active, plus, minus) for points in (near, a[None]))
    assert np.all(there >= here - 1e-12)


def hold_limit(g: np.ndarray, yields: np.ndarray, u: np.ndarray) -> float:
    """Largest force along u that brakes balance: the edge of the zonotope sum of [-y_i, y_i] g_i, by linear program."""
    equal = np.column_stack([g.T, u])
    bounds = [(-y, y) for y in yields] + [(0, None)]
    answer = linprog([0, 0, 0, 0, -1], A_eq=equal, b_eq=np.zeros(2), bounds=bounds)
    return float(-answer.fun)


def locked(bar: FiveBar, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A tip, the rows there, and a yield for each brake."""
    rng = np.random.default_rng(seed)
    p = np.array([0.05, 0.40]) if bar in FIXED else bar.open_tips(rng, 1)[0]
    return p, bar.rows(p), rng.uniform(1.0, 5.6, 4) * np.array([float(j in bar.braked) for j in "AEBC"])


@pytest.mark.parametrize("integrator", ["event", "stepping", "karnopp"])
def test_locked_device_holds_99_hundredths_of_the_zonotope_bound_and_yields_to_101(any_five_bar, integrator):
    """Below the bound the tip keeps its place to the last bit, above it moves at once."""
    tenth = 200 if integrator == "event" and any_five_bar in BENCH else 20  # ticks in a tenth of the time
    p, g, yields = locked(any_five_bar, 2)

    def pushed(force):
        hand = new_hand(forces=force[None])
        return Simulation(any_five_bar.device, tuple(p), integrator=integrator, hand=hand)

    for u in DIRECTIONS[:: 2 if integrator == "event" else 6]:
        limit = hold_limit(g, yields, u)
        rows = pushed(0.99 * limit * u).rows(11, Schedule(np.zeros(1), yields[None]), Grid(0, 10, tenth, 1e-3))
        assert np.all(rows[:, 1:3] == p) and np.all(rows[:, 3:5] == 0.0)
        rows = pushed(1.01 * limit * u).run(0.01, 1e-3, yields)
        assert np.linalg.norm(rows[-1, 1:3] - p) > 1e-8
        assert u @ (rows[-1, 1:3] - p) > 0.0


def least_squares_split(g, low, high, f) -> np.ndarray:
    """Torques that balance f within [low, high], least sum of ((torque - middle) / half-width)^2, by SLSQP."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    slopes = (half[:, None] * g).T
    found = minimize(
        lambda z: z @ z, np.zeros(len(g)), jac=lambda z: 2 * z, method="SLSQP", bounds=[(-1, 1)] * len(g),
        constraints={"type": "eq", "fun": lambda z: (middle + half * z) @ g + f, "jac": lambda z: slopes},
        options={"ftol": 1e-15, "maxiter": 200},
    )  # fmt: skip
    return middle + half * found.x


@pytest.mark.parametrize("bar", [BENCH_THREE, BENCH_FOUR, FOUR, random_five_bar(4)], ids=lambda bar: bar.name)
def test_stuck_brakes_balance_the_hand_with_the_least_relative_effort(bar):
    """Three and four stuck brakes: balance, within the yields, least sum of (tau_i / y_i)^2."""
    p, g, yields = locked(bar, 5)
    on = np.flatnonzero(yields)
    for u in DIRECTIONS[::6]:
        for share in (0.3, 0.97):
            f = share * hold_limit(g, yields, u) * u
            row = Simulation(bar.device, tuple(p), hand=new_hand(forces=f[None])).run(1e-3, 1e-3, yields)[0]
            torque = row[5:9]
            assert torque @ g == pytest.approx(-f, abs=1e-9 * np.linalg.norm(f))
            assert np.all(np.abs(torque) <= yields * (1 + 1e-9))
            expected = least_squares_split(g[on], -yields[on], yields[on], f)
            best, got = np.sum((expected / yields[on]) ** 2), np.sum((torque[on] / yields[on]) ** 2)
            assert got <= best * (1 + 1e-6) + 1e-12
            assert int(row[9]) == sum(1 << i for i in on)


def test_split_inside_the_backlash_is_measured_from_the_middle_of_each_range():
    """Unequal limits: torque in [-plus, minus], least sum of ((torque - middle) / half-width)^2."""
    rng = np.random.default_rng(8)
    bar = BENCH_FOUR
    p = np.array([0.05, 0.40])
    g = bar.rows(p)
    for _ in range(20):
        body, braking = new_body(*p)[0], new_record(BRAKING)[0]
        plus, minus = rng.uniform(0.3, 5.0, (2, 4))
        body.g[:4], braking.active[:4] = g, 1
        braking.cost_plus[:4], braking.cost_minus[:4] = plus, minus
        inside = -plus + rng.uniform(0.02, 0.98, 4) * (plus + minus)
        f = -inside @ g
        share_at_rest(body, braking, f[0], f[1])
        torque = braking.torque[:4].copy()
        assert torque @ g == pytest.approx(-f, abs=1e-8)
        assert np.all(torque >= -plus - 1e-8) and np.all(torque <= minus + 1e-8)
        middle, half = 0.5 * (minus - plus), 0.5 * (plus + minus)
        expected = least_squares_split(g, -plus, minus, f)
        assert np.sum(((torque - middle) / half) ** 2) <= np.sum(((expected - middle) / half) ** 2) * (1 + 1e-6)


@pytest.mark.parametrize("bar", [BENCH_FOUR, FOUR, THREE, random_five_bar(1)], ids=lambda bar: bar.name)
def test_a_still_joint_of_a_tip_that_starts_in_motion_is_not_driven_by_its_brake(bar):
    """One joint has no rate, the others slip: the still one sticks, or its whole yield is against the way it goes."""
    rng, asked = np.random.default_rng(1), 0
    for p in bar.open_tips(rng, 25):
        for j in range(4):
            g = bar.rows(p)[j]
            velocity = rng.choice((-0.3, 0.3)) * np.array((-g[1], g[0])) / np.hypot(*g)
            hand = new_hand(np.zeros(1), rng.normal(0.0, 20.0, (1, 2)))
            simulation = Simulation(bar.device, tuple(p), tuple(velocity), hand=hand)
            yields = rng.uniform(0.1, 3.0, 4) * [float(joint in bar.braked) for joint in JOINTS]
            simulation.rows(1, Schedule(np.zeros(1), yields[None]), Grid(0, 0, 1, 1e-3))
            body, braking = simulation.body[0], simulation.braking[0]
            if abs(body.rate[j]) < 1e-9:
                asked += 1
                turning = body.g[j] @ body.acceleration + body.bias[j]
                assert abs(turning) <= 1e-9 or braking.torque[j] == -math.copysign(yields[j], turning)
    assert asked >= 75


@pytest.mark.parametrize("bar", [BENCH_FOUR, FOUR, THREE], ids=lambda bar: bar.name)
def test_a_tip_that_comes_to_rest_as_a_joint_sticks_goes_on_as_any_resting_tip(bar):
    """Its motion is below rounding and along the row of a joint, so that nothing of it is left once the joint sticks.

    Every brake rests then: none may still push as if it slipped.
    """
    rng, asked = np.random.default_rng(2), set()
    for p in bar.open_tips(rng, 25):
        hand, yields = new_hand(np.zeros(1), rng.normal(0.0, 6.0, (1, 2))), rng.uniform(0.3, 3.0, (1, 4))

        def resolved(velocity):
            simulation = Simulation(bar.device, tuple(p), tuple(velocity), hand=hand)  # noqa: B023
            simulation.rows(1, Schedule(np.zeros(1), yields), Grid(0, 0, 1, 1e-3))  # noqa: B023
            return simulation.body[0], simulation.braking[0]

        rest, holding = resolved((0.0, 0.0))
        for j in range(4):
            body, braking = resolved(2.0**-45 * rest.g[j])
            if not np.any(body.tip[2:]):
                asked.add(int(rest.held))
                assert body.held == rest.held
                assert body.acceleration == pytest.approx(rest.acceleration, abs=1e-9)
                assert braking.torque == pytest.approx(holding.torque, abs=1e-9)
    assert len(asked) >= 3
