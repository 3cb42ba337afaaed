"""Order of accuracy, with the lag of Eq. (1) too; agreement of integrators; the paper's friction model, Eq. (6)."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from devices import BENCH_FOUR, BENCH_THREE, S1, S4, FiveBar, stops_of, switching, yields
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from core.device import Device, load_device, without_backlash
from core.mechanism import JOINTS
from core.simulator.hand import new_hand, wave_hand
from core.simulator.hermite import hermite_zero, parabola_zero
from core.simulator.simulation import Grid, Ledger, Schedule, Simulation
from core.simulator.solver_numbers import DELTA_OMEGA

START = (0.05, 0.40)
SCENES = ("S1", "S2", "S4")
HOLDS = np.zeros(1)
STEPS_S = (4e-3, 2e-3, 1e-3, 5e-4)
ROUNDING_M = 3e-14
UNCUT = 1e12  # no step is cut for its error


def run(
    bar: FiveBar, scene: str, step: float, duration: float = 2.0, integrator: str = "event"
) -> tuple[np.ndarray, Ledger]:
    """Tips every 5 ms, and the ledger, of one bench scene."""
    times, values = HOLDS, yields(bar, 0.3)[None]
    if scene == "S2":
        values = yields(bar, 0.3, A=5.6)[None]
    if scene == "S4":
        times, values = switching(bar, duration)
    hand = wave_hand(S4 if scene == "S4" else S1)
    simulation = Simulation(without_backlash(bar.device), START, (0.0, 0.0), "ideal", integrator, hand)
    n = round(duration / 5e-3)
    rows = simulation.rows(n + 1, Schedule(times, values), Grid(0, n, round(5e-3 / step), step))
    return rows[:, 1:3], simulation.ledger()


def rms(tips: np.ndarray, reference: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum((tips - reference) ** 2, axis=1))))


def order(steps: Sequence[float], errors: list[float], rounding: float = 1e-12) -> float:
    """Least-squares slope of log error over log step, without errors at rounding."""
    kept = [(np.log(h), np.log(e)) for h, e in zip(steps, errors, strict=True) if e > rounding]
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


# --------------------------------------------------------------------------------------------- the lag within a step


def moving(name: str, seed: int, jump: float = 1.0) -> tuple[Device, dict]:
    """A device in motion that its brakes slow down, currents switched every 20 ms; a_avg of its brakes `jump` times."""
    device, rng = load_device(name), np.random.default_rng(seed)
    rise, fall = device.brakes.rise.copy(), device.brakes.fall.copy()
    rise[:, 0] *= jump
    fall[:, 0] *= jump
    angle = rng.uniform(0.0, 2.0 * np.pi)
    along = np.array([np.cos(angle), np.sin(angle)])
    scene = {
        "tip": (-0.01 * along[0], 0.40 - 0.01 * along[1]),
        "velocity": tuple(0.35 * along),
        "force": -rng.uniform(0.5, 1.5) * along,
        "currents": rng.uniform(0.0, 0.03, (4, 4)) * device.brakes.current_max,
    }
    return replace(device, brakes=device.brakes._replace(rise=rise, fall=fall)), scene


def tips(device: Device, scene: dict, step: float, tolerance: float = 1.0) -> tuple[np.ndarray, Simulation]:
    """Tips (21, 2) over 80 ms."""
    hand = new_hand(forces=scene["force"][None])
    simulation = Simulation(without_backlash(device), scene["tip"], scene["velocity"], "mr", "event", hand)
    simulation.body["tolerance"][0] = tolerance
    rows = simulation.rows(21, Schedule(np.arange(4) * 0.02, scene["currents"]), Grid(0, 20, round(4e-3 / step), step))
    return rows[:, 1:3], simulation


@pytest.mark.parametrize("jump", [1.0, 2.0], ids=["as shipped", "jump at omega_0"])
@pytest.mark.parametrize("name", ["three-brake", "four-brake", "pter"])
def test_the_order_is_four_where_no_step_is_cut(name, jump):
    """In the mean over six motions; joints come to omega_0 from above and from below, and one or the other stops."""
    orders = []
    for seed in range(6):
        device, scene = moving(name, seed, jump)
        reference, _ = tips(device, scene, 2e-5)
        errors = [rms(tips(device, scene, h, UNCUT)[0], reference) for h in STEPS_S]
        orders.append(order(STEPS_S, errors, ROUNDING_M))
    assert np.mean(orders) >= 3.6 and min(orders) >= 3.0, orders


@pytest.mark.parametrize("name", ["er-two-brake", "three-brake", "four-brake", "pter"])
def test_a_step_that_is_too_long_for_the_lag_is_cut(name):
    """From rest, where Eq. (4) changes most within a step, and with a time constant as short as the step."""
    device, rng = load_device(name), np.random.default_rng(1)
    for _ in range(3):
        scene = {
            "tip": (rng.uniform(-0.05, 0.05), rng.uniform(0.36, 0.44)), "velocity": (0.0, 0.0),
            "force": rng.uniform(-8.0, 8.0, 2), "currents": rng.uniform(0.0, 0.3, (4, 4)) * device.brakes.current_max,
        }  # fmt: skip
        reference, simulation = tips(device, scene, 2e-5)
        for step in (4e-3, 1e-3):
            found, cut = tips(device, scene, step)
            assert np.abs(found - reference).max() <= 2e-8
            assert cut.data.ledger["fallbacks"][0] == 0
        uncut, _ = tips(device, scene, 4e-3, UNCUT)
        assert np.array_equal(uncut, reference) or np.abs(uncut - reference).max() > np.abs(found - reference).max()


@pytest.mark.parametrize("held", [False, True], ids=["slipping", "one brake full"])
def test_the_ledger_closes_while_yields_change(held):
    device, scene = moving("four-brake", 3)
    if held:
        scene["currents"][:, 0] = 1.0
    _, simulation = tips(device, scene, 1e-3)
    assert simulation.ledger().events > 0 or not held
    assert abs(simulation.ledger().residual) <= 1e-9
    assert simulation.ledger().added_by_brakes <= 1e-15


def test_a_rate_that_crosses_an_edge_and_comes_back_within_a_step_is_seen():
    """Above the floor of Eq. (4) for less than a step of 2.5 ms, between two places below it."""
    times, torques = switching(BENCH_FOUR, 0.3)

    def end(step: float) -> np.ndarray:
        simulation = Simulation(without_backlash(BENCH_FOUR.device), (0.05, 0.40), fidelity="mr", hand=wave_hand(S4))
        return simulation.rows(61, Schedule(times, torques / 5.6), Grid(0, 60, round(5e-3 / step), step))[:, 1:3]

    assert np.abs(end(2.5e-3) - end(2e-5)).max() < 2e-8


# ---------------------------------------------------------------------------------------------------------- `karnopp`


def swung(bar, step, integrator="karnopp", wave=S1, commands=None, delta_omega=DELTA_OMEGA):
    """A simulation after a second under a waving hand, and its rows."""
    simulation = Simulation(bar.device, START, integrator=integrator, hand=wave_hand(wave))
    simulation.body["delta_omega"][0] = delta_omega
    return simulation, simulation.run(1.0, step, yields(bar, 0.3) if commands is None else commands)


def test_stuck_joint_creeps_no_faster_than_its_band_and_in_proportion_to_it(bench):
    """A joint that is caught inside the band keeps the rate it had there; Eq. (6) only stops its acceleration."""
    gone = []
    for band in (1e-2, 1e-3, 1e-4):
        g = bench.rows(np.array(START))
        along = np.linalg.solve(g[:2], 0.5 * np.array([band, band]))  # A and E turn at half the band, B somewhat
        along *= 0.5 * band / np.abs(g @ along).max()
        simulation = Simulation(bench.device, START, tuple(along), integrator="karnopp")
        simulation.body["delta_omega"][0] = band
        rows = simulation.run(1.0, 1e-3, yields(bench, 5.6))
        rates = np.array([bench.rows(p) @ v for p, v in zip(rows[::100, 1:3], rows[::100, 3:5], strict=True)])
        assert np.all(np.abs(rates) < band)
        gone.append(np.linalg.norm(rows[-1, 1:3] - START))
    assert gone[0] / gone[1] == pytest.approx(10.0, rel=0.05)
    assert gone[1] / gone[2] == pytest.approx(10.0, rel=0.05)
    assert gone[2] > 0.0


def test_motion_tends_to_that_of_the_exact_solver_as_step_and_band_shrink(bench):
    exact = swung(bench, 1e-4, "event")[1]
    errors = []
    for step, band in ((2e-3, 4e-3), (5e-4, 1e-3), (1e-4, 2e-4)):
        rows = swung(bench, step, delta_omega=band)[1]
        every = round(step / 1e-4)
        errors.append(rms(rows[:, 1:3], exact[::every, 1:3]))
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.15 * errors[0]
    assert errors[2] < 5e-5


@pytest.mark.parametrize("wave, locked", [(S1, {}), (S1, {"A": 5.6}), (S4, {"A": 5.6, "B": 5.6})])
def test_brakes_add_no_energy_beyond_what_the_band_allows(bench, wave, locked):
    """Inside the band a stuck brake may push with the motion: at most yield x band. Nowhere else."""
    commands = yields(bench, 0.3, **locked)
    simulation, rows = swung(bench, 1e-3, wave=wave, commands=commands)
    rates = np.array([bench.rows(row[1:3]) @ row[3:5] for row in rows])
    assert all(np.abs(rates[:, JOINTS.index(joint)]).max() < DELTA_OMEGA for joint in locked), "it sticks"
    ledger = simulation.ledger()
    assert ledger.added_by_brakes <= commands.max() * DELTA_OMEGA * 1e-3 + 1e-15
    for heat, limit in zip(ledger.heat, commands, strict=True):
        assert heat >= -limit * DELTA_OMEGA * 1.0
    assert ledger.kinetic <= ledger.work_hand + 1e-4


@pytest.mark.parametrize("bar", [BENCH_THREE, BENCH_FOUR], ids=lambda bar: bar.name)
@pytest.mark.parametrize("push", [(-40.0, 5.0), (0.0, 40.0)])
def test_tip_never_passes_a_hard_stop(bar, push):
    hand = new_hand(forces=np.array([push]))
    simulation = Simulation(bar.device, START, hand=hand, integrator="karnopp")
    rows = simulation.run(1.0, 1e-3, yields(bar, 0.3))
    assert np.all(np.isfinite(rows))
    assert simulation.ledger().lost_at_stops > 0.0
    assert stops_of(bar.device, *rows[::10, 1:3]).min() > -1e-6
