"""Figs. 6 to 8: the model of one MR brake, its torque gain, Eq. (2), and its time constants, Eq. (4).

The paper's figures set measured data beside the model; `phd identify` does so with data of your own.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from core.brake import time_constant, torque_gain
from core.device import RAD_S_PER_RPM, Device, build_brakes
from core.device_file import BrakeFile, parse_brake
from core.mechanism import A
from core.simulator.state import pack_brakes
from core.workspace import Array
from experiments.analysis.figures import LINE, QUIET, TEXT, new_figure
from experiments.paper_figures.sheet import TITLE, foot_in, panels, parameters_of, plain, small_print, title

MODEL, MODEL_2 = "#0072b2", "#d55e00"  # of Okabe and Ito's set
TESTED_A = np.array([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])  # the paper's currents
TESTED_RPM = np.array([0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0])  # and speeds


class Brake(NamedTuple):
    """One brake to draw: its file, and as the kernels read it, at joint A."""

    file: BrakeFile
    record: np.record

    @property
    def name(self) -> str:
        return self.file.name

    @property
    def assumed(self) -> bool:
        return self.file.provenance == "assumed"

    def torque_gain(self, currents: Iterable[float]) -> Array:
        """K (n,), N m, at currents (n,), A."""
        return np.array([torque_gain(self.record, A, current) for current in currents])

    def time_constant(self, current: float, speed_rpm: float, rising: bool) -> float:
        """a, s."""
        return float(time_constant(self.record, A, current, speed_rpm * RAD_S_PER_RPM, rising))


def brake_of(text: str, where: str) -> Brake:
    """A brake from its file's text."""
    file = parse_brake(text, where)
    return Brake(file, pack_brakes(build_brakes({"A": file}), backlash=True)[0])


def brakes_of(devices: Iterable[Device]) -> list[Brake]:
    """The different brakes of some devices, in the order in which they are first named."""
    texts = {text: name for device in devices for name, text in device.brake_texts.items()}
    return [brake_of(text, f"brake file {name}") for text, name in texts.items()]


def draw_torque_gain(brake: Brake) -> Figure:
    """Fig. 6, the fit equation."""
    k1, k2, k3, k4, k5 = brake.file.k
    knee, largest = brake.file.knee_A, brake.file.current_max_A
    text = f"{parameters_of(brake)} Model only. Circles: the currents at which the paper measured the brake."
    figure = new_figure(5.6, 4.0)
    foot = small_print(figure, text) + 0.5
    axes = panels(figure, 1, 1, (0.65, 0.2, foot, 0.45))[0, 0]
    plain(axes)
    current = np.linspace(0.0, largest, 401)
    gain = brake.torque_gain(current)
    top = 1.08 * gain[-1]
    if 0.0 < knee < largest:
        axes.axvline(knee, color=QUIET, linewidth=0.9, linestyle=(0, (4, 3)))
        axes.annotate(f"knee, {knee:g} A", (knee, top), (4, -4), textcoords="offset points", va="top", color=QUIET)
    axes.plot(current, gain, color=MODEL, linewidth=2.0)
    tested = TESTED_A[TESTED_A <= largest]
    axes.plot(tested, brake.torque_gain(tested), "o", color=MODEL, markerfacecolor="white", markersize=6)
    white = {"boxstyle": "square,pad=0.2", "facecolor": "white", "edgecolor": "none"}
    axes.annotate(
        f"off-state torque $k_2$ = {k2:g} N m", (0.0, k2), (24, -1), textcoords="offset points", va="center",
        arrowprops={"arrowstyle": "-", "color": QUIET, "linewidth": 0.8, "shrinkB": 4}, bbox=white,
    )  # fmt: skip
    below = f"I < {knee:g} A:   K = {k1:g} I{_plus(k2)}"
    above = f"I ≥ {knee:g} A:   K = {_minus(k3)} I²{_plus(k4)} I{_plus(k5)}"
    axes.text(
        0.98, 0.26, f"{below}\n{above}", transform=axes.transAxes, ha="right", va="center", linespacing=1.7,
        fontsize=8.5, bbox=white,
    )  # fmt: skip
    axes.set_xlim(-0.02 * largest, 1.03 * largest)
    axes.set_ylim(0.0, top)
    axes.set_xlabel("current I (A)")
    axes.set_ylabel("torque gain K (N m)")
    title(axes, f"Torque gain, Eq. (2), {brake.name}")
    return figure


def _minus(value: float) -> str:
    return f"{value:g}".replace("-", "−")


def _plus(value: float) -> str:
    return f" {'−' if value < 0.0 else '+'} {abs(value):g}"


def draw_time_constants(brake: Brake) -> Figure:
    """Fig. 8 (the fitted surface of rising), and the same for falling."""
    text = (
        f"{parameters_of(brake)} Model only, over the currents and speeds that the paper tested (grid lines). From "
        f"{brake.file.omega_0_rpm:g} rpm on the constant is a_avg. Current: the one stepped to."
    )
    width, height = 7.4, 4.1
    figure = new_figure(width, height)
    foot = foot_in(text, width)
    small_print(figure, text)
    current = np.linspace(0.0, brake.file.current_max_A, 6)
    fine_rpm = np.geomspace(TESTED_RPM[0], TESTED_RPM[-1], 43)  # 6 between neighbours: the tested ones are among them
    x, y = np.meshgrid(np.linspace(0.0, brake.file.current_max_A, 31), np.log2(fine_rpm))
    surfaces = [
        np.array([[1e3 * brake.time_constant(i, 2.0**w, rising) for i, w in zip(*row, strict=True)]
                  for row in zip(x, y, strict=True)])
        for rising in (True, False)
    ]  # fmt: skip
    top = max(surface.max() for surface in surfaces)
    for k, (surface, way) in enumerate(zip(surfaces, ("rising", "falling"), strict=True)):
        left = 0.35 + 3.45 * k
        axes = figure.add_axes(
            (left / width, (foot - 0.05) / height, 3.45 / width, (height - foot - 0.25) / height),
            projection="3d", computed_zorder=False,
        )  # fmt: skip
        axes.plot_surface(
            x, y, surface, rcount=43, ccount=31, cmap="cividis", vmin=0.0, vmax=top, linewidth=0, antialiased=False,
            zorder=1,
        )  # fmt: skip
        for i in current:
            line = [1e3 * brake.time_constant(i, speed, way == "rising") for speed in fine_rpm]
            axes.plot(np.full_like(fine_rpm, i), np.log2(fine_rpm), line, color=TEXT, linewidth=0.7, zorder=2)
        for speed in TESTED_RPM:
            line = [1e3 * brake.time_constant(i, speed, way == "rising") for i in current]
            axes.plot(current, np.full_like(current, np.log2(speed)), line, color=TEXT, linewidth=0.7, zorder=2)
        axes.set_zlim(0.0, 1.05 * top)
        axes.set_yticks(np.log2(TESTED_RPM), [f"{speed:g}" for speed in TESTED_RPM])
        axes.set_xlabel("current (A)", labelpad=4)
        axes.set_ylabel("speed (rpm)", labelpad=5)
        axes.set_zlabel("time constant (ms)", labelpad=3)
        axes.tick_params(labelsize=7.5, pad=1)
        axes.view_init(elev=24, azim=35)
        axes.set_box_aspect((1.0, 1.25, 0.85), zoom=0.86)
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_pane_color("white")
            axis._axinfo["grid"].update(color=LINE, linewidth=0.6)
        figure.text(
            left / width, 1.0 - 0.3 / height, f"{way.capitalize()} time constant, Eq. (4), {brake.name}",
            fontsize=TITLE, parse_math=False,
        )  # fmt: skip
    return figure
