"""The Haply 2diy behind the device interface: its bytes, its brakes' energy, limits, and what takes torques off."""

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from haply_mock import MockHaply, Served

from core.device import load_device
from core.device_interface import AnyDevice, DeviceError, RealDevice
from core.files import InputError
from hardware.emulated_board.device import HeldHand
from hardware.haply import device as driver
from hardware.haply import guarded_port, watchdog_process, wire
from hardware.haply.device import HaplyDevice
from hardware.haply.guarded_port import GuardedPort
from hardware.haply.rendered_brake import RenderedBrake
from hardware.serial_device import device_at

DEVICE = load_device("haply-2diy")
TIP = (0.0, 0.11)
STEP = math.tau / 4880
HOLDS, SPEED = 0.08, 10.0  # N m, rad/s
FULL, NO = (1.3, 0.0, 1.3, 0.0), (0.0,) * 4


def haply(hand: HeldHand | None = None, **mock) -> tuple[HaplyDevice, MockHaply]:
    """A driver and the mock that it is open on, homed."""
    board = MockHaply(DEVICE, hand or HeldHand(TIP), TIP, **mock)
    link = HaplyDevice(DEVICE, "mock", clock=board.now, open_port=board.open, sleep=board.sleep)
    link.open()
    link.home(TIP)
    return link, board


def light_hand(force: tuple[float, float] = (0.0, 0.0)) -> HeldHand:
    """One that pushes, with an arm's damping and no stiffness: it goes where it is pushed."""
    hand = HeldHand(TIP)
    grip = hand.hand.grips
    grip["stiffness"][0], grip["damping"][0], grip["mass"][0], grip["held"][0] = 0.0, (5.0, 0.0, 5.0), 0.0, force
    return hand


# ------------------------------------------------------------------------------------------------- bytes and interface


def test_the_bytes_are_those_of_the_client_library() -> None:
    """Written out by hand from the layout in `wire`: port 1 is B, port 2 is A."""
    zero, per_rev = "00000000", "00809845"  # 0.0 and 4880.0
    assert wire.set_up((4880, 4880)).hex() == "01050301010301010000" + 2 * (zero + per_rev)
    assert wire.drive(0.5, -2.0).hex() == "0205" + "000000c0" + "0000003f"
    assert wire.NO_TORQUE == watchdog_process.NO_TORQUE and wire.RESET == watchdog_process.RESET == b"\0\0"
    answer = bytes.fromhex("05" + "0000b442" + "000034c2")  # 90 and -45 degrees
    assert wire.counts_of(answer, (4880, 4880)) == (-610, 1220)
    for wrong in ("04" + 2 * zero, "05" + "0000c07f" + zero, "05" + "0000484a" + zero, "05" + "0000003d" + zero):
        assert wire.counts_of(bytes.fromhex(wrong), (4880, 4880)) is None


def test_it_is_a_real_device_by_its_link_and_no_other_device_is_taken() -> None:
    device = device_at(DEVICE, "haply:/dev/ttyACM0")
    names = {name for kind in (AnyDevice, RealDevice) for name in (*vars(kind), *kind.__annotations__)}
    assert {name for name in names if name[0] != "_" and not hasattr(device, name)} == set()
    assert device.port == "/dev/ttyACM0"
    with pytest.raises(InputError, match="motors and encoders at A and B alone, as haply-2diy"):
        device_at(load_device("three-brake"), "haply:/dev/ttyACM0")
    with pytest.raises(InputError, match="no board answers there"):
        haply(speaks=False)


def test_pose_and_force_of_the_hand_are_those_of_the_device() -> None:
    link, board = haply(hand := light_hand())
    forces = []
    for n in range(600):
        hand.hand.grips["held"][0] = 0.4 * min(n / 200, 1.0), 0.2
        sample = link.exchange(FULL)
        forces.append(sample.hand_force)
    assert sample.closed and sample.homed and sample.current == FULL
    assert math.dist(sample.tip, board.plant.tip) < 2e-4
    assert np.mean(forces[-100:], axis=0) == pytest.approx((0.4, 0.2), abs=0.05)  # friction holds 0.03 N
    assert np.ptp(forces[-100:], axis=0).max() < 0.5  # a count that comes and goes moves the handle by 96 um


# ------------------------------------------------------------------------------------------------------------- energy


def most_given(turn, holds, ticks: int, stiffness: float = 5.0) -> tuple[float, float, RenderedBrake]:
    """The most that a brake gives to a hand that turns the joint as it likes: since the start, since any moment.

    turn(n, acting torque, angle): rad, in the tick; holds (ticks,): N m. The angles are true, the brake reads steps; a
    torque acts from the reading after the one that it answers. What a hold had stored at a moment is not counted.
    """
    brake = RenderedBrake(HOLDS, stiffness, SPEED, STEP)
    angle, acting, given = 0.4 * STEP, 0.0, [0.0]
    stored = [0.0]
    brake.read(0.0, 0.0)
    for n in range(ticks):
        coming = brake.torque(holds[n])
        turned = min(max(turn(n, acting, angle), -SPEED * 1e-3), SPEED * 1e-3)
        given.append(given[-1] + acting * turned)
        angle += turned
        stored.append(brake.stored)
        brake.read(round(angle / STEP) * STEP, coming)
        acting = coming
    total = np.array(given)
    least = np.minimum.accumulate(total + np.array(stored))
    return float(total.max()), float((total - least).max()), brake


def to_the_edge(n: int, acting: float, angle: float, most: float = SPEED * 1e-3) -> float:
    """With the torque as far as it goes just before the encoder's next edge: most work for what the brake reads."""
    way = math.copysign(most, acting if acting else 1.0 if n % 2 else -1.0)
    return (math.floor((angle + way) / STEP) + (0.499 if way > 0 else 0.501)) * STEP - angle


ADVERSARIES = {
    "with the torque": lambda n, acting, angle: math.copysign(1.0, acting or (1.0 if n % 2 else -1.0)),
    "rocks every tick": lambda n, acting, angle: 1.0 if n % 2 else -1.0,
    "rocks every second tick": lambda n, acting, angle: 1.0 if n // 2 % 2 else -1.0,
    "to the encoder's edge": to_the_edge,
    "by one count": lambda n, acting, angle: math.copysign(1.9 * STEP, acting or (1.0 if n % 2 else -1.0)),
    "deflects, then lets go": lambda n, acting, angle: 0.0016 if n % 40 < 20 else math.copysign(1.0, acting),
}


@pytest.mark.parametrize("adversary", ADVERSARIES)
@pytest.mark.parametrize("stiffness", [5.0, 50.0])
def test_no_hand_gets_more_energy_than_the_allowance(adversary: str, stiffness: float) -> None:
    """Also where the hold is ten times too stiff for its sampling: the guard alone is what keeps the law."""
    for holds in (np.full(3000, HOLDS), np.tile([HOLDS] * 10 + [0.0] * 10, 150)):
        total, window, brake = most_given(ADVERSARIES[adversary], holds, 3000, stiffness)
        assert brake.beyond == 0.0
        assert max(total, window) <= brake.allowance
        assert brake.allowance < 2.0 * HOLDS * (SPEED * 1e-3 + 2.0 * STEP)  # two ticks at full torque


def test_hands_and_commands_by_chance_get_no_more_either() -> None:
    for seed in range(40):
        random = np.random.default_rng(seed)
        size = 10.0 ** random.uniform(-4.0, -2.0)
        steps, along = random.normal(size=1000) * size, random.random(1000) < random.random()
        holds = np.repeat(random.choice([0.0, 0.02, HOLDS], size=1000), random.integers(1, 30))[:1000]
        total, window, brake = most_given(
            lambda n, acting, angle, s=steps, a=along: math.copysign(s[n], acting) if a[n] and acting else s[n],
            holds, 1000, 10.0 ** random.uniform(0.0, 2.0),
        )  # fmt: skip
        assert max(total, window) <= brake.allowance and brake.beyond == 0.0, seed


def test_a_guard_that_has_acted_is_counted_and_a_hand_that_pays_or_a_new_trial_gives_the_brake_back() -> None:
    _, _, brake = most_given(ADVERSARIES["with the torque"], np.full(30, HOLDS), 30)
    assert brake.guarded > 10 and brake.credit < 0.2 * brake.allowance
    angle = 0.0
    for _ in range(300):
        angle += 0.003
        brake.read(angle, torque := brake.torque(HOLDS))
    assert torque == -HOLDS and brake.credit >= brake.allowance
    link, _ = stressed()
    link.brakes[0].credit = 0.0
    link.begin()
    assert link.brakes[0].credit == link.brakes[0].allowance


# ------------------------------------------------------------------------------------------------------- hold and slip


def test_a_hold_neither_creeps_nor_gives_and_slips_at_the_brakes_torque() -> None:
    link, board = haply(hand := light_hand())
    hand.hand.grips["held"][0] = 0.5, 0.0
    at = []
    for _ in range(2000):
        link.exchange(FULL)
        at.append(board.plant.tip[0])
    assert 1e-4 < at[-1] < 1e-3
    assert abs(at[-1] - at[500]) < 1e-4  # a step of the encoder
    hand.hand.grips["held"][0] = 2.5, 0.0
    for _ in range(100):
        link.exchange(FULL)
    assert np.abs(board.plant.torques) == pytest.approx([0.078, 0.078], abs=1e-5)  # K(1.3 A) less the friction
    before = board.plant.work.copy()
    hand.hand.grips["held"][0] = 0.0, 0.0
    for _ in range(300):
        link.exchange(NO)
    assert not board.plant.torques.any()
    assert np.all(board.plant.work - before <= 1e-3 * np.array(link.report()["allowed_mJ"]))


# ----------------------------------------------------------------------------------------------- what takes torques off


def stressed() -> tuple[HaplyDevice, MockHaply]:
    """A locked handle with a hand against it: the motors have torques."""
    hand = HeldHand(TIP)
    link, board = haply(hand)
    hand.hand.grips["target"][0, 0] = 0.001
    for _ in range(100):
        link.exchange(FULL)
    assert board.plant.torques.all()
    return link, board


def test_a_stop_a_fast_joint_a_hot_motor_and_a_late_host_take_the_torques_off(monkeypatch) -> None:
    link, board = stressed()
    link.stop()
    assert not board.plant.torques.any()
    assert (sample := link.exchange(FULL)) and "stopped by the host" in sample.fault and sample.current == NO
    link.reset()
    for _ in range(50):
        link.exchange(FULL)
    assert board.plant.torques.any()

    board.sleep(0.03)  # the host was held up: what acted meanwhile is not known
    link.exchange(FULL)
    assert not board.plant.torques.any() and not link.exchange(FULL).fault

    board.plant.hand.hand.grips["stiffness"][0], board.plant.hand.hand.grips["force_max"][0] = (2e3, 0.0, 2e3), 60.0
    board.plant.hand.hand.grips["target"][0, 0] = 0.03
    sample = [link.exchange(FULL) for _ in range(100)][-1]
    assert "a joint turned faster than its limit" in sample.fault and not board.plant.torques.any()

    link, board = stressed()
    monkeypatch.setattr(driver, "HOT_C", max(link.warmth))
    assert [link.exchange(FULL) for _ in range(2)][-1].fault and not board.plant.torques.any()
    with pytest.raises(DeviceError, match="let it cool"):
        monkeypatch.setattr(driver, "COOL_C", driver.ROOM_C)
        link.reset()


@pytest.mark.parametrize("current", [math.nan, -1.0, math.inf, 50.0])
def test_a_current_that_is_none_or_too_large_is_no_torque_or_the_largest(current: float) -> None:
    link, board = stressed()
    board.plant.hand.hand.grips["target"][0, 0] = 0.02
    for _ in range(100):
        link.exchange((current, 0.0, current, 0.0))
    assert np.all(np.abs(board.plant.torques) <= 0.0781)
    assert board.plant.torques.any() == (current == 50.0)


def test_garbage_takes_the_torques_off_and_is_survived_and_much_of_it_ends_the_connection() -> None:
    link, board = stressed()
    board.garbage = bytes(range(9))
    assert link.exchange(FULL) is None
    link.exchange(FULL)
    assert not board.plant.torques.any() and link.report()["bad_answers"] == 1
    assert [link.exchange(FULL) for _ in range(50)][-1].homed and board.plant.torques.any()
    board.garbage = b"\xff" * 9 * 20
    for _ in range(20):
        link.exchange(FULL)
    assert "is no Haply's" in link.problem and not board.plant.torques.any()


def test_a_device_that_is_unplugged_or_silent_is_lost_and_comes_back_without_homing() -> None:
    for begins, ends in ((("unplugged", True), ("unplugged", False)), (("speaks", False), ("speaks", True))):
        link, board = stressed()
        setattr(board, *begins)
        heard = len(board.heard)
        assert [link.exchange(FULL) for _ in range(60)][-1] is None and link.problem
        asked = [message for message in board.heard[heard:] if message[0] == 2]
        assert all(message == wire.NO_TORQUE for message in asked[1:])
        setattr(board, *ends)
        board.sleep(1.0)
        sample = next(s for _ in range(1000) if (s := link.exchange(FULL)))
        assert not sample.homed and link.problem == "" and link.report()["lost_links"] == 1


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals; a Haply is refused there")
def test_over_a_serial_port_a_device_that_is_unplugged_is_lost_and_its_watchdog_ends() -> None:
    served = Served(MockHaply(DEVICE, light_hand((0.3, 0.0)), TIP))
    link = HaplyDevice(DEVICE, served.port, clock=served.mock.now)
    link.open()
    link.home(TIP)
    seen = [sample for _ in range(50) if (sample := link.exchange(FULL))]
    assert seen[-1].homed and any(has for _, has in served.torques_at)
    watchdog = link._wire._watchdog
    served.close()
    assert [link.exchange(FULL) for _ in range(5)][-1] is None
    assert "the board was unplugged" in link.problem and watchdog.poll() is not None
    link.close()


# ----------------------------------------------------------------------------------------------------------- watchdog


def waited(served: Served, since: float) -> float:
    """s after which the mock heard of no torque, and of none after."""
    end = time.perf_counter() + 5.0
    while time.perf_counter() < end:
        after = [(at, has) for at, has in served.torques_at if at > since]
        if after and not after[-1][1]:
            return next(at for at, has in after if not has) - since
        time.sleep(0.005)
    raise AssertionError("the torques stayed")


PROGRAM = """
import os, signal, sys, time
from hardware.haply.guarded_port import GuardedPort
from hardware.haply.wire import RESET, drive, set_up
port = GuardedPort(sys.argv[1])
port.write(RESET + set_up((4880, 4880)))
time.sleep(0.1)
for _ in range(20):
    port.write(drive(0.03, 0.03))
    port.read()
print(flush=True)
os.kill(os.getpid(), int(sys.argv[2]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals; a Haply is refused there")
def test_torques_go_when_the_host_stalls_leaves_or_is_killed_and_no_torque_flows_without_a_watchdog() -> None:
    served = Served(MockHaply(DEVICE, light_hand(), TIP))
    try:
        port = GuardedPort(served.port)
        port.write(wire.RESET + wire.set_up((4880, 4880)) + wire.drive(0.03, 0.03))
        time.sleep(0.1)  # the watchdog is there, and has spoken
        port.write(wire.drive(0.03, 0.03))
        waited(served, time.perf_counter())  # nothing is written: a stalled host
        port.write(wire.drive(0.03, 0.03))
        port._watchdog.kill()
        port._watchdog.wait()
        since = time.perf_counter()
        with pytest.raises(DeviceError, match="its watchdog has ended"):
            port.write(wire.drive(0.03, 0.03))
        port.close()
        waited(served, since)
        for number in (signal.SIGKILL, signal.SIGSTOP):
            command = [sys.executable, "-c", PROGRAM, served.port, str(int(number))]
            host = subprocess.Popen(command, stdout=subprocess.PIPE, cwd=Path(guarded_port.__file__).parents[2])
            assert host.stdout and host.stdout.readline()
            waited(served, time.perf_counter() - 0.01)
            os.kill(host.pid, signal.SIGKILL)
            host.wait()
            host.stdout.close()
    finally:
        served.close()
