"""The controllers of the arena: the laws of all controllers, and their exact solutions against independent solvers."""

import itertools

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.optimize import linprog, lsq_linear

from core.control.algorithm import Tick
from core.control.controllers import decide, make_controller
from core.control.rule_sets import SETTLED
from core.control.velocity_field import Seen, new_memory
from core.device import load_device
from core.path import line
from core.simulator.simulation import Simulation
from core.simulator.state import pack_brakes
from experiments.analysis.metrics import BY_NAME
from experiments.plan import PlannedTrial
from experiments.protocol import load_protocol
from experiments.protocols.least_dissipation import least_power
from experiments.study.controller_check import laws_of
from experiments.study.unrecorded import person_of, run_measured, switched_on, trial_of
from experiments.trial.population import load_population

ARENA = load_protocol("arena")
PATH = line((-0.10, 0.40), (0.10, 0.40))
#: by kind; of two presets of one algorithm the first
SHIPPED = {preset.kind: preset for preset in reversed(ARENA.controllers.values())}
IN_FILES = tuple(kind for kind, preset in SHIPPED.items() if preset.own)


def one_tick(device, kind, velocity, push, at=(0.02, 0.42)):
    """Words of the decision, the tick and the controller of one tick of a resting device that is given a velocity."""
    simulation = Simulation(device, at, velocity)
    body, brakes = simulation.body[0], pack_brakes(device.brakes, backlash=False)[0]
    tick = Tick(Seen(*at, *velocity, *push), body.g[:4].copy(), body.mass.copy(), brakes, new_memory(), np.zeros(4))
    controller = make_controller(SHIPPED[kind], device.force_normalised_N)
    return SHIPPED[kind].decisions[decide(controller, PATH, tick)[0]], tick, controller


@pytest.mark.parametrize("kind", IN_FILES)
def test_the_laws_of_every_controller_are_kept_on_every_display(kind):
    laws = laws_of(replace(ARENA, paths={1: ARENA.paths[1]}), SHIPPED[kind])
    assert [law for law in laws if law.broken] == []


def chatter(kind):
    """Chatter (1/s) behind encoders, mean over every display and path."""
    assumed = replace(ARENA.assumptions, sensing="encoders")
    arena, found = replace(ARENA, assumptions=assumed, trial=replace(ARENA.trial, assumptions=assumed)), []
    person = person_of(load_population(), arena.seed, 1)
    for device, path in itertools.product(arena.devices, arena.paths):
        planned = PlannedTrial(1, 1, device.name, 1, path, 1)
        trial = trial_of(arena, person, 1, planned, switched_on(device, arena), SHIPPED[kind])
        found.append(run_measured(trial, "", [BY_NAME["chatter_per_s"]])[0].value("chatter_per_s"))
    return np.mean(found)


def test_no_controller_in_a_file_chatters_more_than_sdof():
    found, most = {kind: chatter(kind) for kind in IN_FILES}, chatter("sdof")
    assert {kind: value for kind, value in found.items() if value > most} == {}


def test_least_power_is_that_of_linear_programming():
    rng, compared = np.random.default_rng(31), 0
    for _ in range(150):
        across, cost, low = rng.normal(size=4) * 4.0, rng.uniform(0.0, 3.0, 4), rng.uniform(0.0, 0.5, 4)
        high = low + rng.uniform(0.0, 5.0, 4)
        across[rng.random(4) < 0.1], cost[rng.random(4) < 0.1] = 0.0, 0.0
        wanted = rng.normal() * 20.0
        torque = np.zeros(4)
        missed = least_power(tuple(across), tuple(cost), tuple(low), tuple(high), wanted, torque)
        assert np.all(torque >= low - 1e-12) and np.all(torque <= high + 1e-12)
        assert across @ torque + missed == pytest.approx(wanted, abs=1e-9)
        least, most = np.minimum(across * low, across * high).sum(), np.maximum(across * low, across * high).sum()
        nearest = np.clip(wanted, least, most)
        assert wanted - missed == pytest.approx(nearest, abs=1e-9), "as near as brakes can come"
        found = linprog(cost, A_eq=across[None], b_eq=[nearest], bounds=list(zip(low, high, strict=True)))
        if found.status == 0:
            compared += 1
            assert cost @ torque == pytest.approx(found.fun, abs=1e-6)
    assert compared > 120


def looked_ahead(tick, controller, distance, normal, tangent):
    """Cost of each pattern of brakes by bounded least squares, in the metric of the mass; inf: a brake lacks."""
    mass = np.array([[tick.mass[0], tick.mass[1]], [tick.mass[1], tick.mass[2]]])
    half = np.linalg.cholesky(mass)
    h, costs = controller.values[1] / 8, []
    size = np.hypot(*tick.g.T)
    k = tick.brakes.k
    most_on = k[:, 2] * tick.brakes.current_max**2 + k[:, 3] * tick.brakes.current_max + k[:, 4]
    for bits in range(16):
        on = np.array([bits >> i & 1 for i in range(4)], dtype=bool)
        if np.any(on & (tick.brakes.present == 0.0)):
            costs.append(np.inf)
            continue
        torque = np.where(on, np.maximum(np.minimum(controller.force_normalised / size, most_on), k[:, 1]), k[:, 1])
        rows = np.linalg.solve(half, tick.g.T) * torque  # brakes as forces in the metric, one column each
        v, place = np.array([tick.seen.vx, tick.seen.vy]), np.zeros(2)
        for _ in range(8):
            force = mass @ v / h + [tick.seen.fx, tick.seen.fy]
            held = lsq_linear(rows, np.linalg.solve(half, force), (-1.0, 1.0), method="bvls", tol=1e-14).x
            v = h * np.linalg.solve(mass, force - half @ rows @ held)
            place += h * v
        ended = abs(place @ normal - distance) - controller.values[2] * (place @ tangent)
        costs.append(ended + SETTLED.back_speed * controller.values[1] * on.sum())  # none was on before
    return np.array(costs)


@pytest.mark.parametrize("name", ["er-two-brake", "four-brake"])
def test_the_look_ahead_takes_the_pattern_that_an_independent_solver_finds_best(name):
    device, rng, taken = load_device(name), np.random.default_rng(32), set()
    for _ in range(8):
        velocity, push = rng.normal(size=2) * 0.1, (5.0 + rng.normal(), rng.normal() * 4.0)
        words, tick, controller = one_tick(device, "look_ahead.py", velocity, push)
        costs = looked_ahead(tick, controller, 0.02, np.array([0.0, -1.0]), np.array([1.0, 0.0]))
        letters = words.removeprefix("ahead ").replace("no brake", "")
        assert costs[sum(1 << "AEBC".index(joint) for joint in letters)] <= costs.min() + 1e-9
        taken.add(words)
    assert len(taken) > 1


def test_velocity_ratio_brakes_the_joint_of_two_that_is_too_fast():
    device, rng, braked = load_device("er-two-brake"), np.random.default_rng(33), set()
    for _ in range(100):
        velocity = np.array((rng.uniform(0.0, 0.2), rng.normal() * 0.1))
        words, tick, _ = one_tick(device, "velocity_ratio.py", velocity, (5.0, -2.0))
        angle = 0.5 * np.pi * 0.02 / PATH.blend_width
        beta = np.array((np.cos(angle), -np.sin(angle)))
        (a, b), (wanted_a, wanted_b) = (tick.g[[0, 2]] @ velocity, tick.g[[0, 2]] @ beta)
        if min(a / wanted_a, b / wanted_b) > 0.0 and min(abs(a), abs(b)) > 0.02:  # both turn as wanted
            rates, wanted = np.array((a, b)), np.array((wanted_a, wanted_b))
            off = np.sign(rates) * (rates - wanted * (rates @ wanted) / (wanted @ wanted))
            if np.any(off > SETTLED.back_speed * np.hypot(*tick.g[[0, 2]].T)):  # more than noise of the velocity
                assert words == ("ratio A" if a / wanted_a > b / wanted_b else "ratio B")
            braked.add(words)
    assert braked == {"ratio A", "ratio B", "none"}


def test_direct_force_cancels_an_outward_push_where_it_can_and_leaves_an_inward_one_alone():
    words, tick, _ = one_tick(load_device("four-brake"), "direct_force.py", (0.1, 0.02), (2.0, 12.0))
    assert words.startswith("direct") and tick.current.any()
    words, tick, _ = one_tick(load_device("four-brake"), "direct_force.py", (0.1, 0.02), (2.0, -12.0))
    assert (words, tick.current.any()) == ("none", False)
