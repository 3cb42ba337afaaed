"""Laws of the settled rules on the simulated device: nobody is held who pushes along the path."""

import numpy as np
import pytest

from core import row
from core.control import LOCKED, make_controller, new_memory
from core.device import load_device
from core.hand import new_hand
from core.path import line
from core.simulator import Simulation
from core.state import new_record
from experiments.operator import OPERATOR, draw_person, steady
from experiments.plan import SEGMENTS, PlannedTrial
from experiments.tick import new_run, run_ticks
from experiments.trial import Trial, new_simulation

DEVICES = {name: load_device(name) for name in ("three-brake", "four-brake")}
SPEED_AT_REST = 0.005  # m/s


def push(device, segment, number, tip, force, ticks, fidelity="static", rules="settled"):
    """The tick log of a hand force (N) that rises in 0.2 s, under a controller, from rest at `tip`, in `move`."""
    path = line(*SEGMENTS[segment])
    hand = new_hand(np.array([0.0, 0.2]), np.array([(0.0, 0.0), force]))
    simulation = Simulation(device, tip, fidelity=fidelity, hand=hand)
    controller = make_controller(number, device.force_normalised_N, rules, 5.0)
    run = new_run(simulation.fidelity, simulation.integrator, simulated_hand=False)
    run["phase"][0] = row.MOVE
    rows = np.zeros((ticks, row.WIDTH))
    s = simulation
    n = run_ticks(
        path, controller, s.mechanism, s.brakes, s.hand, s.state, s.trial,
        run, new_record(OPERATOR), np.zeros((1, 2)), new_memory(), rows,
    )  # fmt: skip
    return path, rows[:n]


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("name", DEVICES)
def test_a_hand_that_pushes_within_45_degrees_of_the_path_starts_to_move_along_it(name, number):
    generator = np.random.default_rng(number)
    for segment in SEGMENTS:
        for _ in range(12):
            path = line(*SEGMENTS[segment])
            along, across = generator.uniform(0.05, 0.85) * path.length, generator.uniform(-0.02, 0.02)
            tip = (
                path.x0 + along * path.tangent_x - across * path.tangent_y,
                path.y0 + along * path.tangent_y + across * path.tangent_x,
            )
            angle = generator.uniform(-np.pi / 4, np.pi / 4) + np.arctan2(path.tangent_y, path.tangent_x)
            force = 30.0 * np.array([np.cos(angle), np.sin(angle)])
            path, rows = push(DEVICES[name], segment, number, tip, force, 600)
            speed = rows[:, row.TIP_VX] * path.tangent_x + rows[:, row.TIP_VY] * path.tangent_y
            assert speed.max() > SPEED_AT_REST, (segment, tip, force)


@pytest.mark.parametrize("number", [2, 3, 4, 5])
@pytest.mark.parametrize("name", DEVICES)
def test_a_slow_hand_that_pushes_inward_is_never_locked(name, number):
    generator = np.random.default_rng(10 + number)
    for segment in SEGMENTS:
        path = line(*SEGMENTS[segment])
        for _ in range(8):
            across = generator.choice([-1.0, 1.0]) * generator.uniform(0.006, 0.02)
            tip = (
                path.x0 + 0.5 * path.length * path.tangent_x - across * path.tangent_y,
                path.y0 + 0.5 * path.length * path.tangent_y + across * path.tangent_x,
            )
            inward = -np.sign(across) * np.array([-path.tangent_y, path.tangent_x])
            path, rows = push(DEVICES[name], segment, number, tip, 20.0 * inward, 300)
            d = (rows[:, row.TIP_Y] - path.y0) * path.tangent_x - (rows[:, row.TIP_X] - path.x0) * path.tangent_y
            slow = np.hypot(rows[:, row.TIP_VX], rows[:, row.TIP_VY]) < SPEED_AT_REST
            still_out = np.sign(d) == np.sign(across)
            assert not np.isin(rows[slow & still_out, row.DECISION], list(LOCKED)).any()


def test_read_literally_the_rules_deadlock_where_the_settled_ones_do_not():
    """At rest, a push of 20 N along the path that leans outward by a degree: literal locks, settled lets go."""
    device = DEVICES["three-brake"]
    tip, force = (0.0, 0.402), (20.0 * np.cos(0.02), 20.0 * np.sin(0.02))
    _, literal = push(device, 1, 4, tip, force, 1000, rules="literal")
    _, settled = push(device, 1, 4, tip, force, 1000)
    assert np.isin(literal[1:, row.DECISION], list(LOCKED)).all()
    assert abs(literal[-1, row.TIP_X] - tip[0]) < 1e-4
    assert settled[-1, row.TIP_X] - tip[0] > 0.005


@pytest.mark.parametrize("name", DEVICES)
def test_the_noiseless_operator_finishes_every_trial_under_the_settled_rules(name):
    device = DEVICES[name]
    rows = np.zeros((80_000, row.WIDTH))
    for seed in range(4):
        person = steady(draw_person(np.random.default_rng(seed)))
        simulation = new_simulation(device, (0.0, 0.38))
        for segment in SEGMENTS:
            for number in (1, 2, 3, 4, 5):
                planned = PlannedTrial(1, 1, name, number, segment, 1)
                generator = np.random.default_rng([seed, segment])
                trial = Trial(simulation, planned, SEGMENTS[segment], "settled", 5.0, person, generator)
                trial.run(rows)
                assert trial.outcome()["status"] == "done", (seed, segment, number)
