"""The lag of Eq. (1) within a step: fourth order with the motion, across the edges of Eq. (4), too."""

from dataclasses import replace

import numpy as np
import pytest
from devices import BENCH_FOUR, S4, switching

from core.device import Device, load_device, without_backlash
from core.simulator.hand import new_hand, wave_hand
from core.simulator.simulation import Grid, Schedule, Simulation

STEPS_S = (4e-3, 2e-3, 1e-3, 5e-4)
ROUNDING_M = 3e-14
UNCUT = 1e12  # no step is cut for its error


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


def order(errors: list[float]) -> float:
    kept = [(np.log(h), np.log(e)) for h, e in zip(STEPS_S, errors, strict=True) if e > ROUNDING_M]
    return float(np.polyfit(*np.array(kept).T, 1)[0])


@pytest.mark.parametrize("jump", [1.0, 2.0], ids=["as shipped", "jump at omega_0"])
@pytest.mark.parametrize("name", ["three-brake", "four-brake", "pter"])
def test_the_order_is_four_where_no_step_is_cut(name, jump):
    """In the mean over six motions; joints come to omega_0 from above and from below, and one or the other stops."""
    orders = []
    for seed in range(6):
        device, scene = moving(name, seed, jump)
        reference, _ = tips(device, scene, 2e-5)
        found = [tips(device, scene, h, UNCUT)[0] for h in STEPS_S]
        orders.append(order([float(np.sqrt(np.mean(np.sum((one - reference) ** 2, axis=1)))) for one in found]))
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
