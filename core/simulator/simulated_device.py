"""The simulated device that trials run on: full brake model, and it stays as the last trial left it."""

from typing import Any

from core.device import Device
from core.simulator.hand import Hand
from core.simulator.simulation import Simulation
from core.simulator.stick_slip import STILL
from core.simulator.stick_slip_mode import look


class SimulatedDevice(Simulation):
    """Implements `core.device_interface.AnyDevice`; its ticks are made by the tick kernel itself."""

    def __init__(self, device: Device, tip: tuple[float, float], hand: Hand | None = None) -> None:
        """At rest at `tip` (m), brakes off. hand: whose spring or force moves it; None: a hand without force."""
        super().__init__(device, tip, fidelity="mr", integrator="event", hand=hand)
        self._before = self.ledger()

    @property
    def tip(self) -> tuple[float, float]:
        """Where the handle is, m."""
        x, y = self.state["tip"][0, :2].tolist()
        return x, y

    def begin(self) -> None:
        """Our choice: between trials the handle comes to rest where it is; yields and backlash stay as they were."""
        state = self.state
        state["tip"][0, 2:] = 0.0
        state["carry"][0] = 0.0
        state["held"][0] = STILL
        state["added_by_brakes"][0] = 0.0
        look(self.mechanism[0], state[0])
        self._before = self.ledger()

    def end_record(self) -> dict[str, Any]:
        """What the simulator counted since `begin`."""
        now, before = self.ledger(), self._before
        return {
            "events": now.events - before.events,
            "fallbacks": now.fallbacks - before.fallbacks,
            "energy_residual_J": now.residual - before.residual,
            "energy_added_max_J": now.added_by_brakes,
        }
