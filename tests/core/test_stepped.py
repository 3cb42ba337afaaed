"""`phd.Simulation`: the same motion as a scene's, an independent solution's, and its energies add up."""

import numpy as np
import pytest

from core.device import load_device
from core.files import InputError
from core.simulator import simulation as simulator
from core.simulator.hand import new_hand
from core.simulator.simulation import Grid, Schedule
from core.simulator.stepped import Simulation
from experiments.simulate.scene import read_scene
from experiments.simulate.simulate import SceneRun

SCENE = """
device = "three-brake"
fidelity = "{fidelity}"
integrator = "{integrator}"
duration_s = 0.2
step_s = 1e-3
initial_tip_m = [0.05, 0.40]
initial_tip_velocity_m_s = [0.1, -0.05]
brakes.schedule = "schedule.csv"
force.constant_N = [3.0, 1.5]
"""


def schedule(rows: int = 30) -> np.ndarray:
    """Currents or torques (rows, 3) of A, E, B, each for 10 ms."""
    return np.random.default_rng(3).uniform(0.0, 0.5, (rows, 3)) * np.array([[1.0], [0.0]] * (rows // 2))


@pytest.mark.parametrize("integrator", ["event", "stepping", "karnopp"])
@pytest.mark.parametrize("fidelity", ["mr", "static", "ideal"])
def test_it_moves_as_a_scene_does(fidelity, integrator, tmp_path):
    values = schedule()
    lines = [f"{0.01 * k:.2f},{a!r},{e!r},{b!r}" for k, (a, e, b) in enumerate(values.tolist())]
    (tmp_path / "schedule.csv").write_text("\n".join(["t_s,A,E,B", *lines]) + "\n")
    scene = read_scene(tmp_path / "scene", SCENE.format(fidelity=fidelity, integrator=integrator))
    rows = SceneRun(scene).run_chunk(scene.rows)
    simulation = Simulation("three-brake", fidelity, integrator)
    simulation.reset((0.05, 0.40), (0.1, -0.05))
    for k in range(200):
        simulation.step(values[k // 10], (3.0, 1.5), 1e-3)
        state, row = simulation.state, rows[k + 1]
        assert state.tip_m == pytest.approx(row[1:3], abs=1e-13)
        assert state.velocity_m_s == pytest.approx(row[3:5], abs=1e-11)
        assert state.work_hand_J == pytest.approx(row[16], abs=1e-12)
        if (k + 1) % 10:  # else the scene has switched already
            assert state.torques_N_m == pytest.approx(row[5:9], abs=1e-9)
    assert simulation.time_s == pytest.approx(0.2)
    assert abs(simulation.state.unexplained_J) < 1e-8 < simulation.state.work_hand_J or integrator != "event"


def test_looking_and_copying_change_nothing_and_a_copy_goes_its_own_way():
    def pushed(look: bool) -> Simulation:
        simulation = Simulation("three-brake")
        simulation.reset((0.05, 0.40))
        for k in range(200):
            simulation.step(schedule()[k // 10], (3.0 * np.sin(0.05 * k), 2.0), 1e-3)
            if look:
                simulation.state, simulation.copy()  # noqa: B018
        return simulation

    simulation = pushed(look=True)
    plain = pushed(look=False)
    assert all(np.array_equal(a, b) for a, b in zip(simulation.state, plain.state, strict=True))
    other, before = simulation.copy(), simulation.state
    other.step([0.0, 0.0, 0.0], (5.0, 5.0))
    assert np.array_equal(simulation.state.tip_m, before.tip_m) and other.state.time_s > before.time_s
    simulation.step([0.0, 0.0, 0.0], (5.0, 5.0))
    assert np.array_equal(simulation.state.tip_m, other.state.tip_m)


def test_a_state_says_what_sticks_and_its_rates_are_those_of_its_angles():
    simulation = Simulation("three-brake", "ideal")
    simulation.reset((0.05, 0.40))
    simulation.step([5.0, 0.0, 0.0], (6.0, 0.0))
    before = simulation.state
    for _ in range(10):
        simulation.step([5.0, 0.0, 0.0], (6.0, 0.0), 1e-6)
    state = simulation.state
    assert state.stuck == "A" and state.rates_rad_s[0] == pytest.approx(0.0, abs=1e-12)
    assert (state.angles_rad - before.angles_rad) / 1e-5 == pytest.approx(state.rates_rad_s, abs=1e-3)
    assert 0.0 < abs(state.torques_N_m[0]) < state.yields_N_m[0] == 5.0


def test_a_reset_is_a_new_simulation():
    simulation = Simulation("three-brake")
    simulation.reset((0.05, 0.40))
    simulation.step([0.5, 0.5, 0.5], (4.0, 0.0), 0.1)
    simulation.reset((0.05, 0.40))
    assert simulation.state.time_s == simulation.state.work_hand_J == 0.0
    device = simulator.Simulation(load_device("three-brake"), (0.05, 0.40), fidelity="mr", hand=new_hand())
    (row,) = device.rows(1, Schedule(np.zeros(1), np.zeros((1, 4))), Grid(0, 0, 1, 1e-3))
    assert simulation.state.torques_N_m == pytest.approx(row[5:9])


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda s: Simulation("three-brake", "exact"), "fidelity must be one of ideal, static, mr, not 'exact'"),
        (lambda s: Simulation("three-brake", integrator="rk4"), "integrator must be one of"),
        (lambda s: Simulation("no-such"), "unknown device"),
        (lambda s: s.reset((5.0, 0.4)), "tip_m: the tip of three-brake cannot be at"),
        (lambda s: s.reset(0.4), "tip_m must be two numbers, in m"),
        (lambda s: s.reset((0.05, 0.4), (np.nan, 0.0)), "velocity_m_s must be at least"),
        (lambda s: s.step([0.1, 0.1]), "currents_A must be 3"),
        (lambda s: s.step([0.1, -0.1, 0.0]), "that of E must be from 0 to"),
        (lambda s: s.step([0.1, 99.0, 0.0]), "that of E must be from 0 to"),
        (lambda s: s.step([0.1, np.nan, 0.0]), "that of E must be from 0 to"),
        (lambda s: s.step([0.1, 0.1, 0.0], (np.inf, 0.0)), "force_N must be at most"),
        (lambda s: s.step([0.1, 0.1, 0.0], (1.0,)), "force_N must be two numbers"),
        (lambda s: s.step([0.1, 0.1, 0.0], step_s=0.0), "step_s must be at least"),
    ],
)
def test_wrong_input_is_refused_in_a_sentence_and_changes_nothing(call, message):
    simulation = Simulation("three-brake")
    before = simulation.state
    with pytest.raises(InputError, match=message):
        call(simulation)
    simulation.step([0.0, 0.0, 0.0], (0.0, 0.0))
    assert np.array_equal(simulation.state.tip_m, before.tip_m)
