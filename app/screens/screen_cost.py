"""What drawing costs: everything on, ticks at 1 kHz, 60 frames a second. Figures to report, never to pass or fail."""

import gc
import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from PySide6.QtWidgets import QApplication, QHBoxLayout, QVBoxLayout, QWidget

from app.live.messages import Timing
from app.screens import theme
from app.screens.energy_panel import EnergyPanel
from app.screens.layers import force_map
from app.screens.timing_strip import TimingStrip
from app.screens.traces import Traces
from app.screens.workspace import Workspace
from core import row
from core.device import Device, load_device
from core.path_file import PathFile, Segment, outline

FRAMES_PER_S, TICKS_PER_S = 60, 1000
PATH = Segment((-0.10, 0.40), (0.10, 0.40))


class ScreenCost(NamedTuple):
    """Of one run: how long it lasted (s), its frames, share of one core, ms a frame from ticks to picture."""

    seconds: float
    frames: int
    core_share: float
    p50_ms: float
    p99_ms: float
    max_ms: float
    width: int  # px, of the window
    height: int
    platform: str  # Qt's: "xcb", "offscreen" ..


def synthetic_trial(device: Device, path: PathFile, seconds: float = 8.0, seed: int = 1) -> np.ndarray:
    """Ticks (n, row.WIDTH) of a made-up trial: approach, hold, a wavering move along the path, end. Not mechanics."""
    generator = np.random.default_rng(seed)
    n, wait, rest = int(seconds * TICKS_PER_S), 1000, 300
    t = np.arange(n) / TICKS_PER_S
    s = np.clip((np.arange(n) - wait) / max(n - wait - rest, 1), 0.0, 1.0)
    points = np.asarray(outline(path, 0.002))
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    tip = np.column_stack([np.interp(s * along[-1], along, points[:, i]) for i in range(2)])
    tip[:, 1] += 0.004 * np.sin(math.pi * s) * np.sin(2.3 * t)
    tip[:, 0] += 0.002 * np.sin(math.pi * s) * np.sin(3.1 * t)
    rows = np.zeros((n, row.WIDTH))
    rows[:, row.T] = t
    rows[:, row.PHASE] = np.select([t < 0.5, s <= 0.0, s < 1.0], [row.APPROACH, row.HOLD, row.MOVE], row.END)
    rows[:, row.TIP_X : row.TIP_Y + 1] = tip
    velocity = np.gradient(tip, 1.0 / TICKS_PER_S, axis=0)
    rows[:, row.TIP_VX : row.TIP_VY + 1] = velocity
    push = 6.0 * np.sin(math.pi * s) * (1.0 + 0.3 * np.sin(5.0 * t)) + 0.1 * generator.normal(size=n)
    rows[:, row.HAND_FX], rows[:, row.HAND_FY] = push * np.cos(0.3 * np.sin(t)), push * np.sin(0.3 * np.sin(t))
    wanted = tip + rows[:, row.HAND_FX : row.HAND_FY + 1] / 150.0
    rows[:, row.TARGET_X : row.TARGET_Y + 1] = wanted
    moving = rows[:, row.PHASE] == row.MOVE
    on = [("AEBC".index(joint), np.sin(4.0 * t + 1.7 * k) > 0.2) for k, joint in enumerate(device.braked)]
    for i, acts in on:
        rows[:, row.CURRENT + i] = np.where(acts & moving, 0.3 + 0.2 * i, 0.0)
        rows[:, row.STUCK] += np.where(acts & moving & (np.sin(9.0 * t + i) > 0.3), 1 << i, 0)
    maps = np.array([force_map(device, *place) for place in tip[::20]]).repeat(20, axis=0)[:n]
    rates = np.einsum("nij,nj->ni", maps, velocity)
    for i, _ in on:
        rows[:, row.TORQUE + i] = -np.sign(rates[:, i]) * (0.35 + 1.5 * rows[:, row.CURRENT + i])
    rows[:, row.LATENESS_US] = 14.0 * np.exp(0.35 * generator.normal(size=n))
    rows[generator.random(n) < 5e-4, row.LATENESS_US] = 400.0
    rows[:, row.ENERGY_KINETIC] = np.sum(velocity**2, axis=1)
    power = np.hypot(*velocity.T) * 4.0
    rows[:, row.ENERGY_BRAKES] = np.cumsum(power) / TICKS_PER_S
    rows[:, row.ENERGY_HAND] = rows[:, row.ENERGY_BRAKES] + rows[:, row.ENERGY_KINETIC]
    return rows


class EverythingOn(QWidget):
    """The console's drawn parts in their places, without a bench."""

    def __init__(self, device: Device, path: PathFile) -> None:
        super().__init__()
        self.workspace, self.traces = Workspace((device,), {1: path}), Traces()
        self.timing, self.energy = TimingStrip(), EnergyPanel()
        for button in self.workspace.buttons.values():
            button.setChecked(True)
        right = QVBoxLayout()
        right.setSpacing(theme.GAP)
        right.addWidget(self.traces, 4)
        right.addWidget(self.timing, 1)
        right.addWidget(self.energy)
        layout = QHBoxLayout(self)
        layout.setSpacing(theme.GAP)
        layout.addWidget(self.workspace, 17)
        layout.addLayout(right, 10)
        self._device, self._path = device, path

    def begin(self, tip: tuple[float, float]) -> None:
        """A new trial."""
        self.workspace.show_trial(self._device, self._path, tip)
        self.traces.show_trial(self._device, self._path)
        self.timing.clear()
        self.energy.clear()

    def add(self, rows: np.ndarray) -> None:
        """Ticks (n, row.WIDTH) since the last frame."""
        for part in (self.workspace, self.traces, self.timing, self.energy):
            part.add(rows)


def measure(
    seconds: float = 20.0,
    size: tuple[int, int] = (1280, 720),
    device: str = "four-brake",
    progress: Callable[[float], None] = lambda share: None,
) -> ScreenCost:
    """Draw synthetic trials for so long, in a window of this size (px); needs a QApplication."""
    application = QApplication.instance()
    mechanism = load_device(device)
    rows = synthetic_trial(mechanism, PATH)
    window = EverythingOn(mechanism, PATH)
    window.resize(*size)
    window.show()
    window.begin((float(rows[0, row.TIP_X]), float(rows[0, row.TIP_Y])))
    for _ in range(30):
        application.processEvents()
    gc.collect()
    gc.freeze()  # as the app does: else looking through all that was imported costs 50 ms now and then
    frames: list[float] = []
    began, worked = time.perf_counter(), time.process_time()
    due, fed, trials = began, 0, 0
    while (now := time.perf_counter()) < began + seconds:
        if now < due:
            time.sleep(due - now)
        start = time.perf_counter()
        upto = int((start - began) * TICKS_PER_S) - trials * len(rows)
        if upto >= len(rows):
            trials, fed, upto = trials + 1, 0, 0
            window.begin((float(rows[0, row.TIP_X]), float(rows[0, row.TIP_Y])))
        if upto > fed:
            window.add(rows[fed:upto])
            fed = upto
        if len(frames) % 6 == 0:
            window.timing.show_timing(Timing(14.0, 31.0, 402.0, 0, f"synthetic, frame {len(frames)}"))
        application.processEvents()
        frames.append(1e3 * (time.perf_counter() - start))
        due = max(due + 1.0 / FRAMES_PER_S, time.perf_counter())
        progress((start - began) / seconds)
    elapsed, worked = time.perf_counter() - began, time.process_time() - worked
    gc.unfreeze()
    window.close()
    window.deleteLater()
    p50, p99 = np.percentile(frames, (50, 99)).tolist()
    platform = application.platformName()
    return ScreenCost(elapsed, len(frames), worked / elapsed, p50, p99, max(frames), *size, platform)
