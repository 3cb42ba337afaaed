"""Never silently wrong: whatever the step, a result is right to a millimetre or carries a warning."""

import numpy as np
import pytest
from devices import THREE, FiveBar, rods

from core.device import Device
from core.simulator.hand import new_hand
from core.simulator.simulation import Grid, Ledger, Schedule, Simulation
from core.workspace import tip_is_free

STEPS = (1e-3, 5e-3, 2e-2)
ONE_ABOVE_THE_OTHER = FiveBar(
    name="one base above the other", base_a=(0.02893, -0.09505), base_b=(0.02499, -0.04198), tip=0.31, rotor=0.001,
    lengths=(0.16949, 0.35255, 0.32173, 0.37413), elbows="left", limits="margin = 0.05", braked="AEC",
    links=((0.259, 0.002, 1.36e-3), (1.030, 0.108, 2.13e-2), (0.307, 0.281, 0.0), (0.0143, 0.030, 1.48e-4)),
)  # fmt: skip


def free_place(device: Device, rng: np.random.Generator) -> tuple[float, float]:
    """A tip position clear of all stops."""
    while True:
        x, y = rng.uniform((-0.5, 0.05), (0.5, 0.65))
        if tip_is_free(device.mechanism, x, y):
            return float(x), float(y)


def tips_every_20_ms(simulation: Simulation, duration: float, step: float, torques) -> np.ndarray:
    """Tip positions (n, 2) every 20 ms."""
    n = round(duration / 0.02)
    rows = simulation.rows(
        n + 1, Schedule(np.zeros(1), np.array([torques], dtype=float)), Grid(0, n, round(0.02 / step), step)
    )
    return rows[:, 1:3]


@pytest.mark.parametrize("seed", range(12))
def test_a_coaxial_device_held_at_its_elbows_swings_about_its_base_without_loss(seed):
    """E and C on one axis rest together: that is no rest. Distance from the base and speed stay what they are."""
    rng = np.random.default_rng(seed)
    base, lengths = tuple(rng.uniform(-0.05, 0.05, 2).tolist()), tuple(rng.uniform(0.2, 0.4, 4).tolist())
    links = tuple(rods(rng.uniform(0.05, 0.6), (length,))[0] for length in lengths)
    device = FiveBar(
        base_a=base, base_b=base, lengths=lengths, links=links, tip=rng.uniform(0.1, 0.6), braked="EC",
        limits="margin = 0.05", name="random",
    ).device  # fmt: skip
    x, y = free_place(device, rng)
    out = np.array([x, y]) - base
    radius = float(np.linalg.norm(out))
    tangent = np.array([-out[1], out[0]]) / radius
    v = tangent * 0.4 + out / radius * rng.uniform(-0.5, 0.5)
    simulation = Simulation(device, (x, y), (v[0], v[1]), "ideal", "event")
    rows = simulation.run(0.4, 1e-3, (0.0, 3.0, 0.0, 3.0))
    held = rows[rows[:, 9] == 2 + 8]
    assert len(held) > 50, "the elbows come to rest"
    radii = np.hypot(*(held[:, 1:3] - base).T)
    speeds = np.hypot(*held[:, 3:5].T)
    assert np.ptp(radii) < 1e-12 and np.ptp(speeds) < 1e-9
    assert speeds[-1] > 0.1
    assert abs(simulation.ledger().residual) < 1e-8


def test_where_two_rows_are_parallel_for_an_instant_the_error_falls_with_the_step():
    """The held joint hands over to another there: the exact solver says so, without chatter and without a fallback."""
    hand = new_hand(forces=np.array([[-15.678, -0.861]]))

    def run(step: float) -> tuple[np.ndarray, Ledger]:
        simulation = Simulation(
            ONE_ABOVE_THE_OTHER.device, (0.10172, 0.35704), (-0.24103, 0.00037), "ideal", "event", hand
        )
        return tips_every_20_ms(simulation, 0.4, step, (2.5, 2.5, 0.0, 2.5)), simulation.ledger()

    reference, _ = run(1e-5)
    errors = []
    for step in (2e-2, 4e-3, 1e-3, 1e-4):
        tips, ledger = run(step)
        errors.append(np.abs(tips - reference).max())
        assert ledger.fallbacks == 0 and not ledger.warnings()
    assert all(fine <= max(coarse, 1e-9) for coarse, fine in zip(errors[:-1], errors[1:], strict=True)), errors
    assert errors[-1] < 1e-9


@pytest.mark.parametrize("step", STEPS)
def test_a_pulse_of_force_between_two_steps_is_felt(step):
    """0.2 ms of up to 4000 N inside one step: the same motion whatever the step."""
    times = np.array([0.0, 0.1004, 0.1005, 0.1006, 0.2])
    forces = np.array([[0, 0], [0, 0], [4000, 0], [0, 0], [0, 0]], dtype=float)
    tips = [
        tips_every_20_ms(Simulation(THREE.device, (0.05, 0.4), hand=new_hand(times, forces)), 0.2, h, [2.3] * 3 + [0])
        for h in (step, 1e-5)
    ]
    assert np.abs(tips[1][-1] - (0.05, 0.40)).max() > 1e-3
    assert np.abs(tips[0] - tips[1]).max() < 1e-6


def test_energy_that_karnopp_creates_is_warned_of():
    """A strong brake at a coarse step is thrown across the whole band, back and forth."""
    simulation = Simulation(THREE.device, (0.05, 0.40), (0.3, 0.1), "ideal", "karnopp")
    simulation.run(0.2, 5e-3, (5.6, 5.6, 5.6, 0.0))
    ledger = simulation.ledger()
    assert ledger.residual > 0.01 and ledger.warnings()
