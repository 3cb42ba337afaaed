"""A six-axis device as the hand at the simulated handle: its deflection is the hand force (it is no force sensor)."""

import threading

from app.ipc.messages import BAD, GOOD, Check
from app.ipc.ring import Ring
from core.simulator.simulation import Simulation
from hardware.hid import HidHand

EVERY_S = 0.004  # twice as often as such a device reports


class HidInput:
    """Brings the newest force from the device's thread to the control loop, until `close`."""

    def __init__(self, ring: Ring, hand: HidHand) -> None:
        """hand: an attached device, which is this object's from now on."""
        self._ring, self._hand, self._ended = ring, hand, threading.Event()
        self._thread = threading.Thread(target=self._work, name="hand force", daemon=True)
        self._thread.start()

    def _work(self) -> None:
        while not self._ended.wait(EVERY_S):
            reading = self._hand.read()
            self._ring.push(reading.fx_N, reading.fy_N)

    @property
    def check(self) -> Check:
        """For the pre-flight row: which device, and that it is no force sensor."""
        reading = self._hand.read()
        if reading.connected:
            return Check("Hand", GOOD, reading.text)
        return Check("Hand", BAD, "unplugged", f"{reading.text[0].upper()}{reading.text[1:]}.")

    def close(self) -> None:
        """No force from now on."""
        self._ended.set()
        self._thread.join()
        self._ring.push(0.0, 0.0)
        self._hand.close()


def feel_force_alone(simulation: Simulation) -> None:
    """No spring between pointer and handle: the hand is the force that is pushed."""
    grip = simulation.hand.grips
    grip["spring"][0] = 1
    grip["stiffness"][0] = grip["damping"][0] = 0.0
