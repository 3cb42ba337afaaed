"""A bench without processes: one made-up trial after another at 1 kHz, to measure what drawing costs. Not mechanics."""

import math
import time
from pathlib import Path

import numpy as np

from app.ipc import messages as m
from core import tick_log
from core.device import Device, load_device
from core.path import PathFile, Segment, build_path, outline
from core.workspace import brake_rows
from experiments.plan import make_plan
from experiments.protocol import load_protocol
from experiments.session.playback import fill_field

TICKS_PER_S = 1000
TRIAL_S, PULSE_S = 4.0, 0.1  # so short that every measurement sees a trial begin
CHECKS = tuple(m.Check(name, m.GOOD, "synthetic") for name in ("Device", "Hand", "Loop", "Disk", "Recording"))


def synthetic_trial(device: Device, path: PathFile, seconds: float = 8.0, seed: int = 1) -> np.ndarray:
    """Ticks (n, WIDTH) of a made-up trial: approach, hold, a wavering move along the path, end. Not mechanics."""
    generator = np.random.default_rng(seed)
    n, wait, rest = int(seconds * TICKS_PER_S), 1000, 300
    t = np.arange(n) / TICKS_PER_S
    s = np.clip((np.arange(n) - wait) / max(n - wait - rest, 1), 0.0, 1.0)
    points = np.asarray(outline(path, 0.002))
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    tip = np.column_stack([np.interp(s * along[-1], along, points[:, i]) for i in range(2)])
    tip[:, 1] += 0.004 * np.sin(math.pi * s) * np.sin(2.3 * t)
    tip[:, 0] += 0.002 * np.sin(math.pi * s) * np.sin(3.1 * t)
    rows = np.zeros((n, tick_log.WIDTH))
    rows[:, tick_log.T] = t
    rows[:, tick_log.PHASE] = np.select(
        [t < 0.5, s <= 0.0, s < 1.0], [tick_log.APPROACH, tick_log.HOLD, tick_log.MOVE], tick_log.END
    )
    rows[:, tick_log.TIP_X : tick_log.TIP_Y + 1] = tip
    rows[:, tick_log.PATH_DISTANCE], rows[:, tick_log.TRAVEL_SENSE] = tip[:, 1] - 0.4, 1.0
    velocity = np.gradient(tip, 1.0 / TICKS_PER_S, axis=0)
    rows[:, tick_log.TIP_VX : tick_log.TIP_VY + 1] = velocity
    push = 6.0 * np.sin(math.pi * s) * (1.0 + 0.3 * np.sin(5.0 * t)) + 0.1 * generator.normal(size=n)
    rows[:, tick_log.HAND_FX], rows[:, tick_log.HAND_FY] = (
        push * np.cos(0.3 * np.sin(t)),
        push * np.sin(0.3 * np.sin(t)),
    )
    wanted = tip + rows[:, tick_log.HAND_FX : tick_log.HAND_FY + 1] / 150.0
    rows[:, tick_log.TARGET_X : tick_log.TARGET_Y + 1] = wanted
    moving = rows[:, tick_log.PHASE] == tick_log.MOVE
    on = [("AEBC".index(joint), np.sin(4.0 * t + 1.7 * k) > 0.2) for k, joint in enumerate(device.braked)]
    for i, acts in on:
        rows[:, tick_log.CURRENT + i] = np.where(acts & moving, 0.3 + 0.2 * i, 0.0)
        rows[:, tick_log.STUCK] += np.where(acts & moving & (np.sin(9.0 * t + i) > 0.3), 1 << i, 0)
    maps = np.array([brake_rows(device.mechanism, *place) for place in tip[::20]]).repeat(20, axis=0)[:n]
    rates = np.einsum("nij,nj->ni", maps, velocity)
    for i, _ in on:
        rows[:, tick_log.TORQUE + i] = -np.sign(rates[:, i]) * (0.35 + 1.5 * rows[:, tick_log.CURRENT + i])
    rows[:, tick_log.LATENESS_US] = 14.0 * np.exp(0.35 * generator.normal(size=n))
    rows[generator.random(n) < 5e-4, tick_log.LATENESS_US] = 400.0
    rows[:, tick_log.ENERGY_KINETIC] = np.sum(velocity**2, axis=1)
    power = np.hypot(*velocity.T) * 4.0
    rows[:, tick_log.ENERGY_BRAKES] = np.cumsum(power) / TICKS_PER_S
    rows[:, tick_log.ENERGY_HAND] = rows[:, tick_log.ENERGY_BRAKES] + rows[:, tick_log.ENERGY_KINETIC]
    fill_field(build_path(path, "path"), rows)
    return rows


class SyntheticBench:
    """What windows need of a bench: they are told of one trial after the other, and given its ticks as time passes."""

    alive, taken, setup = True, True, m.Setup(Path("synthetic"))

    def __init__(self, device: str = "four-brake") -> None:
        protocol = load_protocol(devices=(device,))
        plan = make_plan(protocol, "01")
        self._planned = next(trial for trial in plan if trial.segment == 1)
        self.opened = m.Opened("01", protocol, plan, "0" * 64, "synthetic", False, "mouse")
        path = protocol.paths[1]
        assert isinstance(path, Segment)
        self._rows = synthetic_trial(load_device(device), path, TRIAL_S)
        self._told = False
        self._began_s = self._pulsed_s = time.perf_counter()
        self._fed = 0
        self.asked_s = self.asked_cpu_s = 0.0  # when, and at what processor time, it was last asked what is new

    def receive(self) -> list:
        """A new trial when the last one is over; a pulse ten times a second."""
        self.asked_s, self.asked_cpu_s = time.perf_counter(), time.thread_time()
        now, tip = self.asked_s, (float(self._rows[0, tick_log.TIP_X]), float(self._rows[0, tick_log.TIP_Y]))
        ready = m.Snapshot(m.READY, coming=self._planned, tip=tip, checks=CHECKS)
        said: list = [] if self._told else [self.opened]
        if not self._told or now - self._began_s > TRIAL_S:
            said += [ready, ready._replace(stage=m.RUNNING, running=self._planned)]
            self._told, self._began_s, self._fed = True, now, 0
        if now - self._pulsed_s > PULSE_S:
            self._pulsed_s = now
            proof = m.Proof("run-001.arrows", self._fed, 300 * self._fed, 0.1)
            said.append(m.Pulse(proof, m.Timing(14.0, 31.0, 402.0, 0, f"synthetic, {self._fed} ticks"), 0))
        return said

    def ticks(self) -> np.ndarray:
        """Those since the last call."""
        upto = min(int((time.perf_counter() - self._began_s) * TICKS_PER_S), len(self._rows))
        new, self._fed = self._rows[self._fed : upto], max(upto, self._fed)
        return new

    @property
    def ring(self) -> "SyntheticBench":
        return self

    def let_go(self) -> None:
        """Nothing is held."""

    def aim(self, x: float, y: float, grip: float = 1.0) -> None:
        """Nothing follows the pointer."""

    def send(self, intent: object) -> None:
        """Nothing is asked for."""

    def brakes_off(self, cause: str) -> None:
        """There are none."""

    def stop(self, reason: str) -> None:
        """Nothing runs."""
