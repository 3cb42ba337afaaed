"""The scenes S1-S4 and the two devices of `phd bench`, as data."""

import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from core.brake import current_for_torque
from core.device import Device, load_device
from core.mechanism import JOINTS
from core.simulator.hand import Hand, new_hand, wave_hand
from core.simulator.state import pack_brakes

START = (0.05, 0.40)  # m; all scenes start there, at rest
STEPS_S = (5e-3, 2e-3, 1e-3, 5e-4, 1e-4)
#: s. Errors are taken at these times, which every step divides.
COMPARE_S = 1e-2
ORDER_SWITCHED = "ABEC"  # S4 alone counts its brakes in this order
LOCKED, SLIPPING, SWITCHED, SWITCH_S = 5.6, 0.3, 5.0, 0.01  # N m, s


@cache
def bench_devices() -> tuple[Device, Device]:
    """Three-brake with all arms 0.30 m, four-brake with bases 0.10 m apart: the device files beside this one."""
    folder = Path(__file__).parent
    return load_device(folder / "bench-three-brake.toml"), load_device(folder / "bench-four-brake.toml")


@dataclass(frozen=True)
class BenchScene:
    """One scene on one device: what the hand does and the commands to the brakes."""

    name: str
    device: Device
    duration_s: float
    wave: np.ndarray  # (2, 3): amplitude N, rate rad/s, phase rad of each axis; all zero: `constant` alone
    constant: np.ndarray  # (2,) N
    times: np.ndarray  # (n,) s
    torques: np.ndarray  # (n, 4) N m, yields from each time on

    def until(self, seconds: float) -> "BenchScene":
        """Its beginning."""
        begun = self.times < seconds
        shorter = min(self.duration_s, seconds)
        return replace(self, duration_s=shorter, times=self.times[begun], torques=self.torques[begun])

    def hand(self) -> Hand:
        """The hand as the simulator takes it."""
        return wave_hand(self.wave) if self.wave.any() else new_hand(forces=self.constant[None])

    def force(self, t: float) -> np.ndarray:
        """Hand force (2,), N, at a time."""
        return self.constant + self.wave[:, 0] * np.sin(self.wave[:, 1] * t + self.wave[:, 2])

    def commands(self, fidelity: str) -> np.ndarray:
        """The commands (n, 4): the yields (ideal), or currents that hold them in steady state (A)."""
        if fidelity == "ideal":
            return self.torques
        brakes = pack_brakes(self.device.brakes, backlash=False)[0]
        return np.array([[current_for_torque(brakes, i, row[i]) for i in range(4)] for row in self.torques])

    @property
    def comparisons(self) -> int:
        """Times at which errors are taken, without t = 0."""
        return round(self.duration_s / COMPARE_S)


def _waves(x: tuple[float, float], y: tuple[float, float]) -> np.ndarray:
    """(ax sin 2 pi fx t, ay sin(2 pi fy t - pi / 2) = -ay cos 2 pi fy t) from (amplitude N, frequency Hz)."""
    return np.array([[x[0], 2 * math.pi * x[1], 0.0], [y[0], 2 * math.pi * y[1], -0.5 * math.pi]])


def bench_scenes(device: Device) -> tuple[BenchScene, ...]:
    """S1 free, S2 one locked, S3 all locked, S4 switching."""

    def yields(slipping: float, **others: float) -> np.ndarray:
        return np.array([others.get(j, slipping) if j in device.braked else 0.0 for j in JOINTS])

    still, once = np.zeros((2, 3)), np.zeros(1)
    wave, no_force = _waves((6.0, 2.0), (6.0, 1.4)), np.zeros(2)
    order = [joint for joint in ORDER_SWITCHED if joint in device.braked]
    times = np.arange(round(2.0 / SWITCH_S)) * SWITCH_S
    switching = np.array([yields(SLIPPING, **{order[k % len(order)]: SWITCHED}) for k in range(len(times))])
    return (
        BenchScene("S1", device, 2.0, wave, no_force, once, yields(SLIPPING)[None]),
        BenchScene("S2", device, 2.0, wave, no_force, once, yields(SLIPPING, A=LOCKED)[None]),
        BenchScene("S3", device, 1.0, still, np.array([10.0, 0.0]), once, yields(LOCKED)[None]),
        BenchScene("S4", device, 2.0, _waves((15.0, 1.0), (-10.0, 0.7)), no_force, times, switching),
    )
