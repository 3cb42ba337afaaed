"""Order of accuracy, agreement of the integrators, and motions known by a route of their own."""

import math

import numpy as np
import pytest
from devices import S1, S4, FiveBar, switching, yields
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from core.device import without_backlash
from core.simulator.hand import wave_hand
from core.simulator.hermite import hermite_zero, parabola_zero
from core.simulator.simulation import Grid, Ledger, Schedule, Simulation

START = (0.05, 0.40)
SCENES = ("S1", "S2", "S4")
HOLDS = np.zeros(1)


def run(
    bar: FiveBar, scene: str, step: float, duration: float = 2.0, integrator: str = "event", fidelity: str = "ideal"
) -> tuple[np.ndarray, Ledger]:
    """Rows every 5 ms, and the ledger, of one bench scene."""
    times, values = HOLDS, yields(bar, 0.3)[None]
    if scene == "S2":
        values = yields(bar, 0.3, A=5.6)[None]
    if scene == "S4":
        times, values = switching(bar, duration)
    if fidelity == "mr":
        values = values / 5.6  # A
    hand = wave_hand(S4 if scene == "S4" else S1)
    simulation = Simulation(without_backlash(bar.device), START, (0.0, 0.0), fidelity, integrator, hand)
    n = round(duration / 5e-3)
    rows = simulation.rows(n + 1, Schedule(times, values), Grid(0, n, round(5e-3 / step), step))
    return rows, simulation.ledger()


def rms(rows: np.ndarray, reference: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum((rows[:, 1:3] - reference[:, 1:3]) ** 2, axis=1))))


def order(steps: list[float], errors: list[float]) -> float:
    """Least-squares slope of log error over log step, without errors at rounding."""
    kept = [(np.log(h), np.log(e)) for h, e in zip(steps, errors, strict=True) if e > 1e-12]
    assert len(kept) >= 2
    return float(np.polyfit(*np.array(kept).T, 1)[0])


@pytest.mark.parametrize("scene", SCENES)
def test_event_keeps_its_order_across_stick_slip_events(bench, scene):
    """At least 3.5 over 5, 2, 1, 0.5 ms, and at most 1e-9 m at 1 ms."""
    steps = [5e-3, 2.5e-3, 1e-3, 5e-4]
    reference, ledger = run(bench, scene, 5e-5)
    assert ledger.events > 5
    errors = [rms(run(bench, scene, h)[0], reference) for h in steps]
    assert order(steps, errors) >= 3.5, errors
    assert errors[2] <= 1e-9


@pytest.mark.parametrize("scene", SCENES)
def test_stepping_is_first_order_and_tends_to_event(bench, scene):
    """Two integrators, one motion: the implicit step has no pattern to follow and no events to locate."""
    reference, _ = run(bench, scene, 1e-4, 0.5)
    errors = [rms(run(bench, scene, h, 0.5, "stepping")[0], reference) for h in (1e-3, 1e-4, 1e-5)]
    assert errors[1] < 0.2 * errors[0] and errors[2] < 0.2 * errors[1], errors
    assert errors[2] < 1e-4


@pytest.mark.parametrize("fidelity", ["ideal", "static", "mr"])
@pytest.mark.parametrize("integrator", ["event", "stepping"])
def test_a_run_in_pieces_equals_one_run(bench, integrator, fidelity):
    times, values = switching(bench, 0.3, 0.9, 0.05)

    def simulation() -> Simulation:
        return Simulation(bench.device, START, (0.0, 0.0), fidelity, integrator, wave_hand(S4))

    whole = simulation().rows(301, Schedule(times, values), Grid(0, 300, 1, 1e-3))
    one = simulation()
    pieces = [
        one.rows(n, Schedule(times, values), Grid(first, 300, 1, 1e-3))
        for first, n in ((0, 1), (1, 99), (100, 200), (300, 1))
    ]
    assert np.array_equal(np.vstack(pieces), whole)


@pytest.mark.parametrize("integrator", ["event", "stepping"])
def test_a_command_inside_a_step_splits_it(bench, integrator):
    """Rows on the common edges equal those of a run whose steps lie on the command's time."""
    times = np.array([0.0, 0.0104, 0.0206])
    values = np.array([yields(bench, y) for y in (0.3, 2.0, 0.1)])
    hand = wave_hand(S4)
    inside = Simulation(bench.device, START, integrator=integrator, hand=hand)
    rows = inside.rows(41, Schedule(times, values), Grid(0, 40, 1, 1e-3))
    aligned = Simulation(bench.device, START, integrator=integrator, hand=hand)
    fine = aligned.rows(201, Schedule(times, values), Grid(0, 200, 1, 2e-4))[::5]
    assert rows[:, 0] == pytest.approx(fine[:, 0], abs=1e-15)
    assert rows[:, 1:3] == pytest.approx(fine[:, 1:3], abs=1e-9 if integrator == "event" else 1e-4)
    late = Simulation(bench.device, START, integrator=integrator, hand=hand)
    held = late.rows(41, Schedule(np.array([0.0, 0.011, 0.021]), values), Grid(0, 40, 1, 1e-3))
    assert np.abs(held[:, 1:3] - fine[:, 1:3]).max() > 1e-6  # the split is seen: not the same as at the next edge


values, starts = st.floats(-1.0, 1.0), st.one_of(st.floats(1e-4, 0.02), st.floats(0.02, 1.0))


def dip(coefficients) -> float:
    """Least value of a polynomial from 0 to 1."""
    turns = np.roots(np.polyder(coefficients))
    inside = [x.real for x in turns if abs(x.imag) < 1e-12 and 0.0 < x.real < 1.0]
    return min(np.polyval(coefficients, [1.0, *inside]))


@pytest.mark.nojit
@settings(max_examples=200)
@given(starts, values, values, values, st.floats(1e-4, 1.0))
def test_a_cubic_or_a_parabola_that_falls_below_zero_inside_a_step_is_found_and_where(start, one, two, three, step):
    """From its ends and slopes, or its middle: such an event must not be missed, nor seen where there is none."""
    cubic = [2.0 * (start - two) + one + three, 3.0 * (two - start) - 2.0 * one - three, one, start]
    parabola = [2.0 * (start + two - 2.0 * one), 4.0 * one - 3.0 * start - two, start]
    for found, curve in (
        (hermite_zero(start, one / step, two, three / step, step), cubic),
        (parabola_zero(start, one, two, step), parabola),
    ):
        least = dip(curve)
        assume(abs(least) > 1e-6)
        assert (found == -1.0) == (least > 0.0)
        assert least > 0.0 or 0.0 < found <= step and math.isclose(np.polyval(curve, found / step), 0.0, abs_tol=1e-9)
