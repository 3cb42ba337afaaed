"""A six-axis device as the hand at the simulated handle, with a device that is played."""

import time
from collections.abc import Iterator

import pytest
from protocols import PAPER

from app.ipc import messages as m
from app.ipc.ring import Ring
from app.loop.real_time import take_aim
from app.session_server.device_setup import SimulatedSetup
from core import tick_log
from core.files import InputError
from core.simulator.hand import grip_force
from core.simulator.simulated_device import SimulatedDevice
from experiments.inputs import HID
from hardware.hid import WORD, HidHand, Reading


class Played:
    """A hand that reads what the test wants."""

    reading = Reading(0.0, 0.0, True, f"SpaceNavigator ({WORD})", 0.0, 1, 0)
    closed = False

    def read(self) -> Reading:
        return self.reading

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def played() -> Iterator[tuple[Ring, Played, SimulatedSetup]]:
    ring, hand = Ring(ticks=64), Played()
    setup = SimulatedSetup(ring, HID, lambda: hand)
    yield ring, hand, setup
    setup.close()
    assert hand.closed


def until(what) -> None:
    end = time.perf_counter() + 60.0
    while not what():
        assert time.perf_counter() < end
        time.sleep(0.002)


def newest(ring: Ring) -> tuple[float, float]:
    count = int(ring.control.push_count)
    return tuple(ring.control.pushes[(count - 1) % len(ring.control.pushes)])


def test_the_deflection_is_the_force_at_the_handle_and_the_pointer_has_no_say(played) -> None:
    ring, hand, setup = played
    hand.reading = hand.reading._replace(fx_N=3.0, fy_N=-4.0)
    until(lambda: ring.control.push_count and newest(ring) == (3.0, -4.0))
    simulation = SimulatedDevice(PAPER.devices[0], (0.0, 0.35), PAPER.mouse.hand())
    setup.take_handle(simulation)
    ring.aim(0.0, 0.35)
    grip = simulation.hand.grips[0]
    take_aim(ring.control, grip, simulation.state[0].tip, tick_log.MOVE, PAPER.mouse.force_max_N)
    assert grip_force(grip, 0.0, 0.35, 0.2, 0.1) == (3.0, -4.0) and not ring.control.taken


def test_an_unplugged_device_gives_no_force_and_blocks_the_start_until_it_is_back(played) -> None:
    ring, hand, setup = played
    check = setup.checks("")[1]
    assert check.state == m.GOOD and WORD in check.text
    hand.reading = Reading(0.0, 0.0, False, "SpaceNavigator was unplugged: plug it in again", 1.0, 9, 1)
    until(lambda: ring.control.push_count and newest(ring) == (0.0, 0.0))
    check = setup.checks("")[1]
    assert check.state == m.BAD and "plug it in again" in check.advice
    hand.reading = Played.reading
    assert setup.checks("")[1].state == m.GOOD


def test_closing_leaves_no_force_behind() -> None:
    ring, hand = Ring(ticks=64), Played()
    hand.reading = hand.reading._replace(fx_N=9.0)
    setup = SimulatedSetup(ring, HID, lambda: hand)
    until(lambda: ring.control.push_count > 2)
    setup.close()
    assert newest(ring) == (0.0, 0.0)


def test_without_such_a_device_it_is_refused_in_one_sentence() -> None:
    with pytest.raises(InputError, match="no six-axis device is attached"):
        SimulatedSetup(Ring(ticks=64), HID, hid=lambda: HidHand(listing=lambda: []))
