"""What the settings of Try make of device, controller and hand."""

import dataclasses
import math

import numpy as np
from msgspec.structs import replace

from app.ipc.messages import SandboxSettings
from app.session_server.sandbox_settings import initial_settings
from core.control.algorithm import Controller
from core.control.controllers import Preset, make_controller
from core.control.guard import make_around
from core.control.proportional import least_gain_felt
from core.device import Device
from core.path import build_path, outline
from core.simulator.simulated_device import SimulatedDevice
from core.workspace import tip_is_free
from experiments.assumptions import Assumptions
from experiments.inputs import INPUTS, OPERATOR
from experiments.protocol import Protocol, middle_of
from experiments.trial.encoder_sensing import decision_noise, new_sensing, sensed
from experiments.trial.trial import SimulatedTrial, Trial

SPACING_M = 0.005  # between points of the path at which the drag is computed


class SandboxModel:
    """Devices, controllers and hands of one protocol, by the settings of Try."""

    def __init__(self, protocol: Protocol, real: bool, hand: str) -> None:
        """real: the device is on the bench; hand: the name of what moves the handle (`experiments.inputs`)."""
        self._protocol, self._real, self._hand = protocol, real, hand

    def initial(self, device: str, path: int) -> SandboxSettings:
        """The settings of protocol and device."""
        return initial_settings(self._protocol, self._device(device), path)

    def check(self, s: SandboxSettings) -> None:
        """Make what the settings ask for. InputError: it cannot be made."""
        device = self._device(s.device)
        self._controller(s, device)
        new_sensing(device, self._assumed(s))

    def least_gain(self, s: SandboxSettings) -> float:
        """The gain, N s/m, below which a controller does less than the brakes' own drag."""
        places = np.asarray(outline(self._protocol.paths[s.path], SPACING_M))
        return s.brake_strength * least_gain_felt(self._device(s.device), places)

    def preset(self, s: SandboxSettings) -> Preset:
        """The controller with the parameters of the settings."""
        return self._protocol.controllers[s.controller].replaced(**s.values)

    def simulation(self, s: SandboxSettings, old: SimulatedDevice | None) -> SimulatedDevice:
        """The simulated device of the settings; a new one takes over the handle's position if it can reach it."""
        if old is not None and old.device.name == s.device:
            return old
        device, way = self._device(s.device), np.asarray(outline(self._protocol.paths[s.path], SPACING_M))
        x, y = way[2 * len(way) // 3].tolist()  # in neither circle
        if old is not None and tip_is_free(device.mechanism, *old.tip):
            x, y = old.tip
        return SimulatedDevice(device, (x, y), self._protocol.mouse.hand() if self._hand != OPERATOR else None)

    def apply(self, trial: Trial, s: SandboxSettings, before: SandboxSettings | None) -> None:
        """Give a trial the controller, brakes and spring of the settings; it moves on as it was.

        before: the settings with which it has run; None: it is new.
        """
        assumed = self._assumed(s)
        trial.path = trial.path._replace(blend_width=s.blend_width_m)
        if not isinstance(trial, SimulatedTrial):  # its controller knows the noise of its sensing
            return
        if before is None or s.sensing != before.sensing:  # else the encoders' last samples stay
            trial.sensing = new_sensing(trial.device, assumed)
        noise = decision_noise(trial.device, middle_of(trial.path), assumed)
        trial.controller, trial.preset = self._controller(s, trial.device, noise), self.preset(s)
        trial.simulation.retune(s.brake_strength, None if self._own_backlash(s) else math.radians(s.backlash_deg))
        if INPUTS[self._hand].by_pointer:
            grip, damping = trial.simulation.hand.grips, self._damping(s)
            grip["stiffness"][0], grip["damping"][0] = (s.spring_N_m, 0.0, s.spring_N_m), (damping, 0.0, damping)

    def _device(self, name: str) -> Device:
        """A device of the protocol; a simulated one under the assumptions."""
        device = self._protocol.device(name)
        return device if self._real else self._protocol.assumptions.applied_to(device)

    def _controller(self, s: SandboxSettings, device: Device, noise: float = 0.0) -> Controller:
        """The controller of the settings; noise: of the velocity that it sees, m/s. InputError: impossible numbers."""
        force = device.force_normalised_N * s.brake_strength
        path = build_path(self._protocol.paths[s.path], "path")
        seen = sensed(device, middle_of(path), self._assumed(s))
        around = make_around(self._protocol.trial.around, self._with_settings(device, s), seen)
        return make_controller(self.preset(s), force, s.rules, noise, around)

    def _with_settings(self, device: Device, s: SandboxSettings) -> Device:
        """The device with brake strength and backlash of the settings, for the guard."""
        play = device.brakes.play if self._own_backlash(s) else np.full(4, math.radians(s.backlash_deg))
        return dataclasses.replace(device, brakes=device.brakes.stronger(s.brake_strength)._replace(play=play))

    def _assumed(self, s: SandboxSettings) -> Assumptions:
        """The protocol's assumptions with the sensing of the settings."""
        return replace(self._protocol.assumptions, sensing=s.sensing)

    def _own_backlash(self, s: SandboxSettings) -> bool:
        """Whether each brake keeps the backlash of its file."""
        return s.backlash_deg == self.initial(s.device, s.path).backlash_deg

    def _damping(self, s: SandboxSettings) -> float:
        """Damping of the hand, N s/m, at the protocol's damping ratio for any spring."""
        mouse = self._protocol.mouse
        return mouse.damping_N_s_m * math.sqrt(s.spring_N_m / mouse.stiffness_N_m)
