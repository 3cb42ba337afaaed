"""What the controller of a simulated device with encoders sees is what it would see on the bench."""

from dataclasses import replace

import numpy as np
import pytest

from core.device import load_device
from core.device_file import Encoders
from core.simulator.hand import spring_hand
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.stick_slip_mode import look
from experiments.assumptions import Assumptions
from experiments.trial.encoder_sensing import new_sensing, see
from hardware.sensing.encoders import PoseSensing
from hardware.sensing.samples import MotionFilter

WAY = np.linspace(0.0, 1.0, 400)
TIPS = np.column_stack([-0.08 + 0.15 * WAY**2, 0.36 + 0.03 * np.sin(6.0 * WAY)])


def seen_along(device, **assumed):
    """What is seen at each tick of a way: tip, velocity (n, 4) and force (n, 2)."""
    simulation = SimulatedDevice(device, TIPS[0], spring_hand((100.0, 0.0, 100.0), (5.0, 0.0, 5.0)))
    sensing = new_sensing(device, Assumptions(sensing="encoders", **assumed))
    mechanism, _, _, states, _ = simulation.arguments()
    motion, force = [], []
    for n, tip in enumerate(TIPS):
        states[0].tip[:2], states[0].hand_force[:] = tip, (n, -n)
        look(mechanism[0], states[0])
        see(mechanism[0], states[0], sensing.sensors[0], sensing.seen[0])
        motion.append(sensing.seen[0].tip.copy())
        force.append(sensing.seen[0].hand_force.copy())
    return np.array(motion), np.array(force)


def on_the_bench(device):
    """The same by the sensing of a real device: tip and velocity (n, 4)."""
    counts = {i: getattr(device.sensing.encoders, joint) for i, joint in enumerate("AEBC")}
    joints = tuple(i for i, count in counts.items() if count)
    pose = PoseSensing(device, joints, tuple(count or 0 for count in counts.values()))
    motion, found = MotionFilter(), []
    for n, tip in enumerate(TIPS):
        all_counts = pose.counts_at(tip)
        sensed = pose.pose(tuple(all_counts[i] for i in joints)).tip
        found.append((*sensed, *motion.add(1e-3 * n, *sensed)[0]))
    return np.array(found)


@pytest.mark.parametrize("encoders", [Encoders(A=96000, B=96000), Encoders(A=9000, E=9000, B=20000, C=20000)], ids=str)
def test_tip_and_velocity_are_those_of_the_bench(encoders):
    device = load_device("four-brake")
    device = replace(device, sensing=replace_encoders(device, encoders))
    motion, _ = seen_along(device, delay_samples=0)
    bench = on_the_bench(device)
    assert np.abs(motion[:, :2] - bench[:, :2]).max() < 1e-6  # the counts' square
    assert np.abs(motion[15:, 2:] - bench[15:, 2:]).max() < 1e-4
    assert np.abs(motion[:, :2] - TIPS).max() > 5e-6, "it is in steps"


def replace_encoders(device, encoders):
    from msgspec.structs import replace as replaced

    return replaced(device.sensing, encoders=encoders)


def test_the_whole_sample_comes_later_and_a_longer_filter_lags_more():
    device = load_device("three-brake")
    now, force = seen_along(device, delay_samples=0)
    late, late_force = seen_along(device, delay_samples=7)
    assert np.array_equal(late[7:], now[:-7]) and np.array_equal(late_force[7:], force[:-7])
    true = np.gradient(TIPS[:, 0], 1e-3)
    for window in (5, 31):
        velocity = seen_along(device, delay_samples=0, filter_samples=window)[0][100:300, 2]
        behind = (window - 1) // 2
        late, now = true[100 - behind : 300 - behind], true[100:300]
        assert np.abs(velocity - late).mean() < 0.5 * np.abs(velocity - now).mean()


def test_what_rests_has_no_velocity():
    device = load_device("three-brake")
    simulation = SimulatedDevice(device, (0.0123, 0.4))
    sensing = new_sensing(device, Assumptions(sensing="encoders"))
    mechanism, _, _, states, _ = simulation.arguments()
    for _ in range(40):
        see(mechanism[0], states[0], sensing.sensors[0], sensing.seen[0])
        assert tuple(sensing.seen[0].tip[2:]) == (0.0, 0.0)
