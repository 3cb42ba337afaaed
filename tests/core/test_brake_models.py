"""Brake models that a study may assume: the lag on the signed torque, and torque ripple."""

from dataclasses import replace

import numpy as np
import pytest

from core.brake import torque_gain
from core.device import load_device
from core.linkage import tip_force_map
from core.simulator.hand import new_hand
from core.simulator.simulation import MR, STATIC, Simulation, apply
from core.simulator.state import pack_mechanism

THREE = load_device("three-brake")
CURRENTS = np.array([0.3, 0.1, 0.2, 0.0])
TIMES = np.arange(0.0, 4.0, 1e-3)
#: N; a hand that turns round again and again
FORCE = np.column_stack([12.0 * np.sin(2.6 * np.pi * TIMES), 9.0 * np.cos(1.8 * np.pi * TIMES)])


def with_model(signed: float = 0.0, ripple: float = 0.0, backlash: bool = True, step: float = 1e-3):
    """A shaken device and its rows (n, 10)."""
    device = replace(THREE, brakes=THREE.brakes._replace(signed=signed, ripple=ripple))
    simulation = Simulation(device, (0.0, 0.4), fidelity="mr", hand=new_hand(TIMES, FORCE), backlash=backlash)
    return simulation, simulation.run(1.5, step, CURRENTS)


def test_a_lag_on_the_signed_torque_adds_energy_and_says_so():
    simulation, _ = with_model(signed=1.0)
    ledger = simulation.ledger()
    assert ledger.added_by_brakes > 1e-5
    assert abs(ledger.residual) < 1e-7, "it is in the ledger, as heat taken back"
    assert len(ledger.warnings()) == 1 and "(brake model signed) the device is not passive" in ledger.warnings()[0]
    assert with_model()[0].ledger().added_by_brakes == 0.0 and not with_model()[0].ledger().warnings()


def powers(rows: np.ndarray) -> np.ndarray:
    """Power of each brake on the device in each row (n, 3), W: above zero where it drives."""
    mechanism, g = pack_mechanism(THREE.mechanism)[0], np.empty((4, 2))
    found = []
    for row in rows:
        tip_force_map(mechanism, row[1], row[2], g)
        found.append(row[5:8] * (g @ row[3:5])[:3])
    return np.array(found)


def test_after_a_reversal_the_signed_torque_drives_until_its_lag_has_turned_it():
    driving = powers(with_model(signed=1.0)[1]) > 1e-9
    assert (powers(with_model()[1]) < 1e-9).all()
    begins = np.count_nonzero(driving[1:] & ~driving[:-1])
    assert begins >= 2
    longest = driving.sum() / begins  # ms
    assert 5.0 < longest < 200.0, "about the rising time constant, Eq. (4)"


def test_the_signed_model_converges_with_the_step():
    ends = [with_model(signed=1.0, step=step)[1][-1, 1:3] for step in (1e-3, 5e-4, 1e-4)]
    assert np.abs(ends[0] - ends[2]).max() < 2e-4 and np.abs(ends[1] - ends[2]).max() < 5e-5


def swung(current: float, fidelity: int, ripple: float = 0.5) -> np.ndarray:
    """Yields of brake A (n,), N m, at places all around the base on which its angle takes a turn."""
    device = replace(THREE, brakes=THREE.brakes._replace(ripple=ripple))
    simulation = Simulation(device, (0.0, 0.4), fidelity=("ideal", "static", "mr")[fidelity])
    mechanism, brakes, _, states, _ = simulation.arguments()
    states[0].torque_yield[:] = [torque_gain(brakes[0], i, current) for i in range(4)]
    found = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False):
        states[0].tip[:2] = 0.4 * np.cos(angle), 0.4 * np.sin(angle)
        apply(mechanism[0], brakes[0], states[0], np.full(4, current), fidelity)
        found.append(states[0].torque_yield[0])
    return np.array(found)


@pytest.mark.parametrize("fidelity", [STATIC, MR])
@pytest.mark.parametrize("current", [0.0, 0.05, 0.4, 1.0])
def test_ripple_leaves_the_mean_and_never_makes_a_brake_drive(current, fidelity):
    yields = swung(current, fidelity)
    mean = THREE.brakes.k[0, 1]  # K(0)
    gain = Simulation(THREE, (0.0, 0.4)).arguments()[1][0]
    steady = torque_gain(gain, 0, current)
    assert yields.mean() == pytest.approx(steady, rel=1e-9)
    assert yields.min() > 0.0
    assert np.ptp(yields) == pytest.approx(2.0 * min(0.5, steady - mean), abs=1e-4)


def test_a_device_whose_torque_ripples_stays_passive():
    ledger = with_model(ripple=0.5)[0].ledger()
    assert ledger.added_by_brakes == 0.0 and not ledger.warnings()
    assert np.abs(with_model(ripple=0.5)[1] - with_model()[1]).max() > 1e-3
