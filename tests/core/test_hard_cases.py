"""The hard cases, each with the law it must keep: never a NaN, never energy from a brake, never beyond a stop.

Never silently wrong either: whatever the step, a result is right or carries a warning.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from devices import FOUR, S1, THREE, FiveBar, rods, stops_of, yields

from core.simulator.hand import Hand, new_hand, spring_hand
from core.simulator.simulation import Grid, Ledger, Schedule, Simulation

START = (0.05, 0.40)
#: J; the largest energy a brake may add in a step: rounding of its heat, which is summed from powers of one sign
FROM_A_BRAKE = 1e-15

ONE_ABOVE_THE_OTHER = FiveBar(
    name="one base above the other", base_a=(0.02893, -0.09505), base_b=(0.02499, -0.04198), tip=0.31, rotor=0.001,
    lengths=(0.16949, 0.35255, 0.32173, 0.37413), elbows="left", limits="margin = 0.05", braked="AEC",
    links=((0.259, 0.002, 1.36e-3), (1.030, 0.108, 2.13e-2), (0.307, 0.281, 0.0), (0.0143, 0.030, 1.48e-4)),
)  # fmt: skip


def tethered(wave: np.ndarray, stiffness: float = 60.0, damping: float = 3.0) -> Hand:
    """A hand that shakes the handle, on a soft spring that keeps it in the workspace."""
    hand = spring_hand((stiffness, 0.0, stiffness), (damping, 0.0, damping), target=START)
    hand.grips["wave"][0], hand.grips["waves"][0] = wave, 1
    return hand


def check(simulation: Simulation, rows: np.ndarray) -> None:
    """The laws that hold in every case."""
    assert np.all(np.isfinite(rows))
    ledger = simulation.ledger()
    assert ledger.added_by_brakes <= FROM_A_BRAKE
    assert min(ledger.heat) >= 0.0 and ledger.lost_at_stops >= 0.0
    assert stops_of(simulation.device, *rows[:: max(1, len(rows) // 250), 1:3]).min() >= -1e-9


@pytest.mark.parametrize("share", [1 - 1e-15, 1.0, 1 + 1e-15, 1 + 1e-9, 1 + 1e-6])
def test_start_at_the_yield_limit_moves_no_further_than_the_excess_pushes(bench, share):
    """The edge of what the brakes hold: a force along g_A that one brake alone balances, to the last bit and beyond."""
    g = bench.rows(np.array(START))
    for i, joint in enumerate("AEB"):
        force = share * 2.0 * g[i]
        simulation = Simulation(bench.device, START, hand=new_hand(forces=force[None]))
        rows = simulation.run(0.05, 1e-3, yields(bench, 0.0, **{joint: 2.0}))
        xx, xy, yy = simulation.body["mass"][0]
        lightest = np.linalg.eigvalsh([[xx, xy], [xy, yy]])[0]
        pushed = 0.5 * max(share - 1, 1e-15) * np.linalg.norm(force) / lightest * 0.05**2
        angle = [bench.angles(p)[i] for p in rows[:, 1:3]]
        assert abs(angle[-1] - angle[0]) <= 20 * pushed + 1e-12
        check(simulation, rows)


def push(newtons: float, twelfth: int) -> Hand:
    """A constant force in one of twelve directions."""
    angle = twelfth * math.pi / 6 + 0.1
    return new_hand(forces=newtons * np.array([[math.cos(angle), math.sin(angle)]]))


@pytest.mark.parametrize("integrator", ["event", "stepping"])
def test_arms_folded_and_stretched_stay_inside_the_hard_stops(any_five_bar, integrator):
    """Pushed in 12 directions against every stop there is, in slow and fast impacts, with and without friction."""
    start = tuple(any_five_bar.open_tips(np.random.default_rng(1), 1)[0])
    struck = 0
    for k in range(12):
        simulation = Simulation(any_five_bar.device, start, integrator=integrator, hand=push((5.0, 30.0)[k % 2], k))
        friction = (0.0, 0.3)[k // 2 % 2]
        rows = simulation.run(1.5, 1e-3, yields(any_five_bar, friction))
        check(simulation, rows)
        assert np.abs(rows[:, 5:9]).max() <= friction * (1 + 1e-9), "a stop bears what a brake cannot"
        ledger = simulation.ledger()
        struck += ledger.lost_at_stops > 0.0
        assert abs(ledger.residual) < (1e-3 if integrator == "event" else 0.5) * (0.1 + abs(ledger.work_hand))
    assert struck >= 6


@pytest.mark.parametrize("integrator", ["event", "stepping"])
def test_sliding_along_a_stop_loses_no_energy_but_by_friction(integrator):
    """Ledger and motion agree the better the smaller the step, stops included."""
    left = []
    for step in (1e-3, 1e-4):
        simulation = Simulation(FOUR.device, START, integrator=integrator, hand=push(30.0, 3))
        rows = simulation.run(1.0, step, np.zeros(4))
        check(simulation, rows)
        left.append(abs(simulation.ledger().residual))
    assert left[1] < max(0.3 * left[0], 1e-9)


@pytest.mark.parametrize("integrator", ["event", "stepping"])
@pytest.mark.parametrize(("fidelity", "damping"), [("ideal", 0.0), ("ideal", 50.0), ("mr", 0.0)])
def test_mouse_jump_on_a_stiff_spring_makes_no_energy(five_bar, integrator, fidelity, damping):
    """0.3 m in one tick on 1e5 N/m (100 m/s, a tenth of a metre a step): energy stays near what the jump stored."""
    for jump in ((0.3, 0.0), (-0.3, 0.0), (0.0, -0.3), (0.0, 0.3)):
        hand = spring_hand((1e5, 0.0, 1e5), (damping, 0.0, damping), target=START)
        simulation = Simulation(five_bar.device, START, (0.0, 0.0), fidelity, integrator, hand)
        commands = yields(five_bar, 0.3)[None]
        rows = simulation.rows(50, Schedule(np.zeros(1), commands), Grid(0, -1, 1, 1e-3))
        assert np.all(rows[:, 1:3] == START), "a spring at rest leaves it where it is"
        target = np.add(START, jump)
        hand.grips["target"][0, :2] = target
        rows = simulation.rows(300, Schedule(np.zeros(1), commands), Grid(50, -1, 1, 1e-3))
        check(simulation, rows)
        stored = 0.5e5 * np.sum((rows[:, 1:3] - target) ** 2, axis=1)
        kinetic = [five_bar.kinetic(row[1:3], row[3:5]) for row in rows]
        assert np.max(stored + kinetic) <= 1.1 * 0.5e5 * 0.3**2


@pytest.mark.parametrize("integrator", ["event", "stepping"])
@pytest.mark.parametrize("ratio", [1e-4, 1e4])
def test_tip_ten_thousand_times_heavier_or_lighter_than_the_links(bench, ratio, integrator):
    light = replace(bench, links=rods(0.3 if ratio < 1 else 3e-5, bench.lengths), tip=3e-5 if ratio < 1 else 0.3)
    light = replace(light, rotor=0.0, name="lopsided")
    for simulation in (
        Simulation(light.device, START, (0.1, 0.0), "ideal", integrator, tethered(S1)),
        Simulation(light.device, START, (0.1, 0.0), "mr", integrator, tethered(S1)),
    ):
        commands = yields(light, 0.2)
        rows = simulation.run(5.0, 1e-3, commands)
        check(simulation, rows)
        ledger = simulation.ledger()
        assert abs(ledger.residual) < (1e-5 if integrator == "event" else 0.1) * (1.0 + ledger.work_hand)


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
    bar = FiveBar(
        base_a=base, base_b=base, lengths=lengths, links=links, tip=rng.uniform(0.1, 0.6), braked="EC",
        limits="margin = 0.05", name="random",
    )  # fmt: skip
    tip = bar.open_tips(rng, 1)[0]
    out = tip - base
    radius = float(np.linalg.norm(out))
    tangent = np.array([-out[1], out[0]]) / radius
    v = tangent * 0.4 + out / radius * rng.uniform(-0.5, 0.5)
    simulation = Simulation(bar.device, tuple(tip), tuple(v))
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
        simulation = Simulation(ONE_ABOVE_THE_OTHER.device, (0.10172, 0.35704), (-0.24103, 0.00037), hand=hand)
        return tips_every_20_ms(simulation, 0.4, step, (2.5, 2.5, 0.0, 2.5)), simulation.ledger()

    reference, _ = run(1e-5)
    errors = []
    for step in (2e-2, 4e-3, 1e-3, 1e-4):
        tips, ledger = run(step)
        errors.append(np.abs(tips - reference).max())
        assert ledger.fallbacks == 0 and not ledger.warnings()
    assert all(fine <= max(coarse, 1e-9) for coarse, fine in zip(errors[:-1], errors[1:], strict=True)), errors
    assert errors[-1] < 1e-9


@pytest.mark.parametrize("step", [1e-3, 5e-3, 2e-2])
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


@pytest.mark.parametrize(
    "lengths, x", [((0.27, 0.30, 0.33, 0.36), -0.05), ((0.33, 0.36, 0.27, 0.30), 0.05)], ids=["arm A", "arm B"]
)
def test_near_a_stretched_elbow_an_implicit_step_makes_no_energy(lengths, x):
    """The mass matrix changes a hundredfold there; without a hand or friction, so that energy may only fall."""
    bar = replace(FOUR, base_a=(-0.05, 0.0), base_b=(0.05, 0.0), lengths=lengths, limits="margin = 0.01")
    rng, seen = np.random.default_rng(1), 0
    for _ in range(12):
        way, angle = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(1.45, 1.65)
        tip = np.array((x, 0.0)) + 0.57 * rng.uniform(0.9991, 0.9998) * np.array((math.cos(angle), math.sin(angle)))
        velocity = 0.5 * math.cos(way), 0.5 * math.sin(way)
        rows = Simulation(bar.device, tuple(tip), velocity, integrator="stepping").run(0.05, 1e-3, np.zeros(4))
        energy = np.array([bar.kinetic(row[1:3], row[3:5]) for row in rows])
        near = np.array([np.abs(bar.sines(row[1:3])[:2]).min() < 0.09 for row in rows])
        rise = (np.diff(energy) / energy[:-1])[near[1:] & near[:-1]]
        assert rise.max(initial=0.0) < 1e-9
        seen += len(rise)
    assert seen > 60
