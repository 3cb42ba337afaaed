"""The pointer's spring as it is shipped: stiff against the brakes' drag, harmless when the pointer leaps."""

import math

import numpy as np
import pytest

from core import tick_log
from core.simulator.simulated_device import SimulatedDevice
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.trial.trial import Conditions, SimulatedTrial

PAPER = load_protocol()
SIDES = np.radians([0.0, 90.0, 180.0, 270.0])
CASES = [(device, path) for device in PAPER.devices for path in PAPER.paths]
LEAP_M = 0.3


def pulled(device, path: int, places: np.ndarray) -> tuple[np.ndarray, SimulatedDevice]:
    """The log and the device after the pointer has gone through places (ticks, 2), the handle at the first of them."""
    model = SimulatedDevice(device, tuple(places[0]), PAPER.mouse.hand())
    planned = PlannedTrial(0, 0, device.name, 1, path, 1)
    trial = SimulatedTrial(
        model, planned, Conditions(PAPER.paths[path], PAPER.controllers[1], PAPER.rules, PAPER.trial)
    )
    rows = np.zeros((len(places), tick_log.WIDTH))
    for n, (x, y) in enumerate(places):
        trial.aim(x, y)
        trial.run(rows[n : n + 1])
    return rows, model


@pytest.mark.parametrize(("device", "path"), CASES)
def test_a_pointer_brought_to_the_start_brings_the_handle_into_its_circle_from_every_side(device, path) -> None:
    start = np.array(PAPER.paths[path].start_m)
    share = np.minimum(np.arange(1100) / 800.0, 1.0)  # 5 cm in 0.8 s, a minimum jerk, then rest
    share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    for side in SIDES:
        away = 0.05 * np.array([math.cos(side), math.sin(side)])
        rows, _ = pulled(device, path, start + away * (1.0 - share)[:, None])
        off = rows[-1, [tick_log.TIP_X, tick_log.TIP_Y]] - start
        assert math.hypot(*off) < 0.85 * PAPER.trial.start_radius_m


@pytest.mark.parametrize("device", PAPER.devices)
def test_a_leap_of_the_pointer_is_slower_than_a_throw_and_comes_to_rest_where_it_points(device) -> None:
    start = np.array(PAPER.paths[1].start_m)
    places = np.repeat([start, start + (LEAP_M, 0.0)], (100, 1500), axis=0)
    rows, model = pulled(device, 1, places)
    speed = np.hypot(rows[:, tick_log.TIP_VX], rows[:, tick_log.TIP_VY])
    assert speed.max() < 3.0 and speed[-500:].max() < 0.01
    assert math.hypot(*(rows[-1, [tick_log.TIP_X, tick_log.TIP_Y]] - places[-1])) < 0.003
    assert np.hypot(rows[:, tick_log.HAND_FX], rows[:, tick_log.HAND_FY]).max() <= PAPER.mouse.force_max_N * (1 + 1e-9)
    ledger = model.ledger()
    assert ledger.fallbacks == 0 and ledger.added_by_brakes <= 0.0 and abs(ledger.residual) < 1e-6
