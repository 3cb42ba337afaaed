"""The simulated device that trials run on: it stays as the last trial left it.

A trial's ticks are made by the tick kernel itself; the emulated board takes its ticks one by one (`settle`, `move`).
"""

from dataclasses import replace
from typing import Any

import numpy as np

from core.device import Device
from core.kernels import kernel
from core.mechanism import PLACES, STOP_E
from core.simulator.hand import Hand
from core.simulator.simulation import Ledger, Simulation, advance, apply
from core.simulator.state import CARRIED, MR, Data, Model, carried, pack_brakes
from core.simulator.stick_slip import STILL
from core.simulator.stick_slip_mode import resolve, update_kinematics


class SimulatedDevice(Simulation):
    """Implements `core.device_interface.AnyDevice`."""

    def __init__(
        self, device: Device, tip: tuple[float, float], hand: Hand | None = None, fidelity: str = "mr"
    ) -> None:
        """At rest at `tip` (m), brakes off. hand: whose spring or force moves it; None: a hand without force.

        fidelity: "mr", or "static": brakes without lag and backlash.
        """
        super().__init__(device, tip, fidelity=fidelity, integrator="event", hand=hand)
        self._before = self.ledger()

    @property
    def tip(self) -> tuple[float, float]:
        """The place of the handle, m."""
        x, y = self.body["tip"][0, :2].tolist()
        return x, y

    def begin(self) -> None:
        """Begin a trial. Our choice: the handle comes to rest where it is; yields and backlash stay as they were."""
        body = self.body
        body["tip"][0, 2:] = 0.0
        body["carry"][0] = 0.0
        body["held"][0] = STILL
        self._ledger["added_by_brakes"][0] = 0.0
        update_kinematics(self.mechanism[0], body[0])
        self._before = self.ledger()

    def settle(self, currents: np.ndarray, t: float) -> None:
        """Find which brakes slip at t (s) with these currents (4,), A: forces and acceleration are then known."""
        settle(self.model, self.data, currents, t)

    def move(self, currents: np.ndarray, t: float, step: float) -> None:
        """A step from t on, s; the currents may be other ones than it was settled with."""
        move(self.model, self.data, currents, t, step)

    def retune(self, strength: float, backlash_rad: float | None) -> None:
        """Exchange the brakes for others with `strength` times the K(I) of the device's, all with this play.

        backlash_rad: None: each brake's own. The motion goes on; the yields follow with their lag, Eq. (1); each rotor
        keeps its share of the play. So nothing jumps, and no energy appears.
        """
        lagged = self.fidelity == MR
        fresh = pack_brakes(self.device.brakes.stronger(strength), backlash=lagged)
        if backlash_rad is not None and lagged:
            fresh["play"] = np.where(fresh["present"] > 0.0, backlash_rad, 0.0)
        before, now, braking = self.brakes["play"][0].copy(), fresh["play"][0], self.braking
        share = np.divide(braking["play"][0], before, out=np.full(4, 0.5), where=before > 0.0)
        braking["play"][0] = share * now
        braking["edge"][0] = np.where((before > 0.0) & (now > 0.0), braking["edge"][0], 0.0)
        self.body["settled"][0] = 0
        self.brakes[0] = fresh[0]

    def recorded_start(self) -> dict[str, Any]:
        """The state that a trial starts from, as JSON holds it without rounding: with its ticks it replays the trial.

        state: of the device after the last trial (yields, backlash, stops, ledger); arm: constants of the hand.
        """
        grip, fields = self.hand.grips, carried(self.data)
        parts = carried_parts(PLACES if self.device.mechanism.coupled else STOP_E)
        return {
            "state": {name: fields[name][0][part].tolist() for name, part in parts.items()},
            "arm": {name: grip[name][0].tolist() for name in ("spring", "damping", "mass")},
        }

    def end_record(self) -> dict[str, Any]:
        """The simulator's counts since `begin`."""
        now, before = self.ledger(), self._before
        return {
            "events": now.events - before.events,
            "fallbacks": now.fallbacks - before.fallbacks,
            "energy_residual_J": now.residual - before.residual,
            "energy_added_max_J": now.added_by_brakes,
            "warnings": ledger_warnings(before, now),
        }


@kernel
def settle(model, data, currents, t):
    """See `SimulatedDevice.settle`."""
    model = Model(model.mechanism[0], model.brakes[0], model.fidelity, model.integrator)
    data = Data(data.hand, data.body[0], data.braking[0], data.ledger[0], data.scratch[0])
    apply(model, data.braking, currents)
    resolve(model, data, t)


@kernel
def move(model, data, currents, t, step):
    """See `SimulatedDevice.move`."""
    settle(model, data, currents, t)
    model = Model(model.mechanism[0], model.brakes[0], model.fidelity, model.integrator)
    advance(model, Data(data.hand, data.body[0], data.braking[0], data.ledger[0], data.scratch[0]), currents, t, step)


def ledger_warnings(before: Ledger, after: Ledger) -> list[str]:
    """Why the motion between two of the simulator's ledgers may be wrong; none where they agree with it."""
    between = replace(
        after,
        work_hand=after.work_hand - before.work_hand,
        heat=(sum(after.heat) - sum(before.heat),),
        lost_at_stops=after.lost_at_stops - before.lost_at_stops,
        residual=after.residual - before.residual,
    )
    return list(between.warnings())


def start_again(simulation: Simulation, start: dict[str, Any]) -> None:
    """Bring a device and its hand to a recorded start of this version."""
    fields = carried(simulation.data)
    for name, part in carried_parts(len(start["state"]["contact"])).items():
        fields[name][0, part] = start["state"][name]
    for name in ("spring", "damping", "mass"):
        simulation.hand.grips[name][0] = start["arm"][name]


def is_start(start: dict[str, Any]) -> bool:
    """Whether a recorded start is of this version: it holds every field of the device's state, and no other."""
    shapes = {name: np.shape(value) for name, value in start["state"].items()}
    return any(
        shapes == {name: np.empty(CARRIED[name])[part].shape for name, part in carried_parts(places).items()}
        for places in (STOP_E, PLACES)
    )


def carried_parts(places: int) -> dict[str, Any]:
    """The part of each carried field that so many places use: only a device with couplings has all `PLACES`."""
    return {name: slice(places) if shape[:1] == (PLACES,) else ... for name, shape in CARRIED.items()}
