"""Assumptions: a file may change any of them; a wrong one is one sentence; with encoders the bench's own view."""

from dataclasses import replace

import numpy as np
import pytest
from protocols import assuming as with_assumptions

from core.brake import time_constant, torque_gain
from core.device import load_device
from core.device_file import Encoders
from core.files import InputError
from core.simulator.hand import spring_hand
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.state import pack_brakes
from core.simulator.stick_slip_mode import update_kinematics
from experiments.assumptions import Assumptions
from experiments.protocol import Protocol, load_protocol, protocol_from_json, protocol_to_json
from experiments.trial.encoder_sensing import new_sensing, see
from hardware.sensing.encoders import PoseSensing
from hardware.sensing.samples import MotionFilter

PAPER = load_protocol()


def assuming(lines: str) -> Protocol:
    """The paper's protocol with another table of assumptions."""
    about = protocol_to_json(PAPER)
    return protocol_from_json({**about, "text": with_assumptions(lines)}, "mine.toml")


def test_what_differs_from_the_defaults_stands_in_the_note_and_is_stored():
    protocol = assuming('sensing = "encoders"\nlag_factor = 3.0\nlow_gain = 120.0')
    assert protocol.note() == (
        "Protocol paper: settled rules, low gain 120 N s/m (Table I prints 5), lag factor 3, sensing encoders, "
        "device, brakes and paths assumed"
    )
    assert PAPER.assumptions == PAPER.trial.assumptions == Assumptions(sensing="encoders") and PAPER.low_gain == 500.0
    again = protocol_from_json(protocol_to_json(protocol), "stored")
    assert again.assumptions == protocol.assumptions == Assumptions(sensing="encoders", lag_factor=3.0, low_gain=120.0)


WRONG = {
    "unknown word": ('sensing = "best"', "assumptions.sensing must be one of ideal, encoders, not 'best'"),
    "no lag at all": ("lag_factor = 0.0", "assumptions.lag_factor must be greater than 0, not 0.0"),
    "too long a filter": ("filter_samples = 64", "assumptions.filter_samples must be at most 63, not 64"),
    "low gain": ('low_gain = "low"', "assumptions.low_gain must be a number or \"no vibration\", not 'low'"),
}


@pytest.mark.parametrize("lines, says", WRONG.values(), ids=WRONG)
def test_a_wrong_assumption_is_refused_in_one_sentence(lines, says):
    with pytest.raises(InputError) as refusal:
        assuming(lines)
    assert says in str(refusal.value) and "\n" not in str(refusal.value)


THREE = PAPER.devices[0]
CURRENTS = (0.0, 0.05, 0.2, 0.6, 1.0)


def brakes_under(**assumed):
    """What the kernels read of the three-brake device's brakes."""
    return pack_brakes(Assumptions(**assumed).applied_to(THREE).brakes, backlash=True)[0]


def gains(brakes) -> list[float]:
    """K of brake A at `CURRENTS`, N m."""
    return [torque_gain(brakes, 0, current) for current in CURRENTS]


def test_the_lag_factor_multiplies_both_time_constants_and_nothing_else():
    usual, slow = brakes_under(), brakes_under(lag_factor=3.0)
    for rising in (True, False):
        for rate in (0.0, 0.01, 0.3, 2.0):
            expected = 3.0 * time_constant(usual, 0, 0.6, rate, rising)
            assert time_constant(slow, 0, 0.6, rate, rising) == pytest.approx(expected, rel=1e-12)
    assert gains(slow) == gains(usual)


def test_the_drag_factor_changes_the_torque_without_current_and_leaves_the_fields():
    usual, heavy = gains(brakes_under()), gains(brakes_under(drag_factor=2.0))
    assert heavy[0] == 2.0 * usual[0]
    assert [more - less for more, less in zip(heavy, usual, strict=True)] == pytest.approx([usual[0]] * 5)
    device = Assumptions(drag_factor=0.0).applied_to(THREE)
    assert device.assumed and device.force_normalised_N == pytest.approx((5.3 - 0.35) / 0.3048)


WAY = np.linspace(0.0, 1.0, 400)
TIPS = np.column_stack([-0.08 + 0.15 * WAY**2, 0.36 + 0.03 * np.sin(6.0 * WAY)])


def seen_along(device, **assumed):
    """What is seen at each tick of a way: tip, velocity (n, 4) and force (n, 2)."""
    simulation = SimulatedDevice(device, TIPS[0], spring_hand((100.0, 0.0, 100.0), (5.0, 0.0, 5.0)))
    sensing = new_sensing(device, Assumptions(sensing="encoders", **assumed))
    mechanism, bodies = simulation.mechanism, simulation.body
    motion, force = [], []
    for n, tip in enumerate(TIPS):
        bodies[0].tip[:2], bodies[0].hand_force[:] = tip, (n, -n)
        update_kinematics(mechanism[0], bodies[0])
        see(mechanism[0], bodies[0], sensing.sensors[0], sensing.seen[0])
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
