"""A six-axis device as the hand at the simulated handle, with a device that is played."""

from collections.abc import Iterator
from functools import partial

import pytest
from hid_bus import Bus
from protocols import PAPER
from waiting import wait_until

from app.ipc import messages as m
from app.ipc.ring import Ring
from app.loop.real_time import take_aim
from app.session_server.device_setup import SimulatedSetup
from core import tick_log
from core.simulator.hand import grip_force
from core.simulator.simulated_device import SimulatedDevice
from experiments.inputs import HID
from hardware.hid import WORD, HidHand


@pytest.fixture
def played() -> Iterator[tuple[Ring, Bus, SimulatedSetup]]:
    ring, bus = Ring(ticks=64), Bus()
    setup = on_bus(ring, bus)
    yield ring, bus, setup
    setup.close()
    assert bus.closed == bus.opened


def on_bus(ring: Ring, bus: Bus) -> SimulatedSetup:
    hand = partial(HidHand, listing=bus.listing, opening=bus.opening, clock=lambda: bus.now)
    return SimulatedSetup(ring, HID, {HID: hand})


def newest(ring: Ring) -> tuple[float, float]:
    count = int(ring.control.push_count)
    return tuple(ring.control.pushes[(count - 1) % len(ring.control.pushes)])


def test_the_deflection_is_the_force_at_the_handle_and_the_pointer_has_no_say(played) -> None:
    ring, bus, setup = played
    bus.push("01 af00 5e01 0000")  # half to the right, all of it towards the person
    wait_until(lambda: ring.control.push_count and newest(ring) == (10.0, -20.0))
    simulation = SimulatedDevice(PAPER.devices[0], (0.0, 0.35), PAPER.mouse.hand())
    setup.take_handle(simulation)
    ring.aim(0.0, 0.35)
    grip = simulation.hand.grips[0]
    take_aim(ring.control, grip, simulation.body[0].tip, tick_log.MOVE, PAPER.mouse.force_max_N)
    assert grip_force(grip, 0.0, 0.35, 0.2, 0.1) == (10.0, -20.0) and not ring.control.taken


def test_an_unplugged_device_gives_no_force_and_blocks_the_start_until_it_is_back(played) -> None:
    ring, bus, setup = played
    check = setup.checks("")[1]
    assert check.state == m.GOOD and WORD in check.text
    bus.push("01 5e01 0000 0000")
    wait_until(lambda: ring.control.push_count and newest(ring) == (20.0, 0.0))
    bus.plugged = False
    wait_until(lambda: newest(ring) == (0.0, 0.0))
    check = setup.checks("")[1]
    assert check.state == m.BAD and "plug it in again" in check.advice
    bus.plugged = True
    wait_until(lambda: setup.checks("")[1].state == m.GOOD)


def test_closing_leaves_no_force_behind() -> None:
    ring, bus = Ring(ticks=64), Bus()
    setup = on_bus(ring, bus)
    bus.push("01 5e01 0000 0000")
    wait_until(lambda: ring.control.push_count and newest(ring) == (20.0, 0.0))
    setup.close()
    assert newest(ring) == (0.0, 0.0)
