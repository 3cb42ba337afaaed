"""The reduced equations of motion against two routes of their own: Lagrange's by differences, and Eq. (5)."""

import numpy as np
import pytest
from devices import FiveBar, random_five_bar, slope
from hypothesis import given, settings
from hypothesis import strategies as st

from core.dynamics import motion
from core.simulator.state import pack_mechanism

pytestmark = pytest.mark.nojit


def states(bar: FiveBar, n: int = 5) -> list[tuple[np.ndarray, np.ndarray]]:
    """Random tips and velocities."""
    rng = np.random.default_rng(11)
    return [(p, rng.normal(scale=0.5, size=2)) for p in bar.open_tips(rng, n)]


def mass_and_bias(bar: FiveBar, p: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """M (2, 2) and b (2,) of the code under test."""
    m = motion(pack_mechanism(bar.device.mechanism)[0], p[0], p[1], v[0], v[1])
    return np.array([[m.mass_xx, m.mass_xy], [m.mass_xy, m.mass_yy]]), np.array([m.bias_x, m.bias_y])


def mass_from_kinetic(bar: FiveBar, p: np.ndarray) -> np.ndarray:
    """M (2, 2) from the kinetic energy summed over bodies, which is quadratic in v."""
    x, y = np.eye(2)
    xx, yy = 2 * bar.kinetic(p, x), 2 * bar.kinetic(p, y)
    xy = bar.kinetic(p, x + y) - 0.5 * (xx + yy)
    return np.array([[xx, xy], [xy, yy]])


def test_kinetic_energy_is_the_sum_over_the_bodies(any_five_bar):
    """Four links, elbow masses, rotors on their own joint rates, tip."""
    for p, v in states(any_five_bar):
        mass, _ = mass_and_bias(any_five_bar, p, v)
        assert 0.5 * v @ mass @ v == pytest.approx(any_five_bar.kinetic(p, v), rel=1e-12)


def test_tip_mass_matrix_is_the_second_derivative_of_kinetic_energy(any_five_bar):
    for p, v in states(any_five_bar):
        expected = mass_from_kinetic(any_five_bar, p)
        assert mass_and_bias(any_five_bar, p, v)[0] == pytest.approx(expected, rel=1e-11, abs=1e-11)
        assert np.linalg.eigvalsh(expected)[0] > 0.0


def test_velocity_terms_are_those_of_lagrange(any_five_bar):
    """b = Mdot v - grad T, both by differences of the kinetic energy."""
    for p, v in states(any_five_bar):
        change = slope(lambda q: mass_from_kinetic(any_five_bar, q), p, v) @ v
        gradient = [slope(lambda q, v=v: any_five_bar.kinetic(q, v), p, axis) for axis in np.eye(2)]
        expected = change - gradient
        bias = mass_and_bias(any_five_bar, p, v)[1]
        assert bias == pytest.approx(expected, rel=1e-7, abs=1e-7 * (1.0 + np.linalg.norm(expected)))


def test_velocity_terms_do_no_work_beyond_the_change_of_mass(any_five_bar):
    """Energy theorem: v . b = 1/2 v . Mdot v."""
    for p, v in states(any_five_bar):
        half = 0.5 * v @ slope(lambda q: mass_from_kinetic(any_five_bar, q), p, v) @ v
        assert v @ mass_and_bias(any_five_bar, p, v)[1] == pytest.approx(half, rel=1e-6, abs=1e-7)


def check_against_ten_coordinates(bar: FiveBar, p, v, force, torque) -> None:
    mass, bias = mass_and_bias(bar, p, v)
    a = bar.acceleration(p, v, force, torque)
    tip_force = force + torque @ bar.rows(p)
    size = np.linalg.norm(mass @ a) + np.linalg.norm(bias) + np.linalg.norm(tip_force)
    assert np.linalg.norm(mass @ a + bias - tip_force) < 1e-12 * size


def test_reduced_form_equals_ten_coordinates_with_eight_constraints(any_five_bar):
    """Eq. (5) solved as it stands, rotors and joint torques included: M a + b = F + sum of g_i tau_i."""
    rng = np.random.default_rng(13)
    for p, v in states(any_five_bar):
        check_against_ten_coordinates(any_five_bar, p, v, rng.normal(scale=10.0, size=2), rng.normal(size=4))


@settings(max_examples=60)
@given(seed=st.integers(0, 40), state=st.integers(0, 10**6), fast=st.floats(0.0, 5.0))
def test_reduced_form_equals_ten_coordinates_for_any_five_bar(seed, state, fast):
    bar, rng = random_five_bar(seed), np.random.default_rng(state)
    p = bar.open_tips(rng, 1)[0]
    v = fast * rng.normal(size=2)
    check_against_ten_coordinates(bar, p, v, rng.normal(scale=10.0, size=2), rng.normal(scale=3.0, size=4))
