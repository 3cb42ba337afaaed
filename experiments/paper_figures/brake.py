"""Figs. 6 to 10: the model of one MR brake: its torque gain, Eq. (2), its time constants, Eq. (4), and its motion.

The paper's figures set measured data beside the model; `phd identify` does so with data of your own.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from core.brake import lagged_yield, time_constant, torque_gain
from core.device import RAD_S_PER_RPM, Device, build_brakes
from core.device_file import BrakeFile, parse_brake
from core.mechanism import A
from core.simulator.state import pack_brakes
from core.workspace import Array
from experiments.analysis.sheet import (
    BLUE,
    BROWN,
    MIDDLE,
    ORANGE,
    PAGE_IN,
    QUIET,
    TEXT,
    TITLE,
    plain,
    plain_3d,
    sheet,
    title,
)

TESTED_A = np.array([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])  # the paper's currents
TESTED_RPM = np.array([0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0])  # and speeds
STEPS = ((0.0, 0.0), (0.2, 0.4), (1.2, 1.0), (2.2, 0.4), (3.2, 0.0))  # s, share of the largest current; our choice
STEPS_END_S = 4.4
#: rpm, colour and line of each speed in Fig. 9.
STEP_SPEEDS = ((0.5, ORANGE, "-"), (2.0, BLUE, (0, (6, 1.5))), (16.0, BROWN, (0, (1.5, 1.2))))
AMPLITUDE_RAD, FREQUENCY_HZ, SINE_SHARE, SINE_STEP_S = math.radians(10.0), 0.5, 0.6, 1e-3  # our choice
WHITE = {"boxstyle": "square,pad=0.2", "facecolor": "white", "edgecolor": "none"}


class Brake(NamedTuple):
    """A brake to draw: its file, and its record for the kernels, where it stands at joint A."""

    file: BrakeFile
    record: np.record

    @property
    def name(self) -> str:
        return self.file.name

    @property
    def assumed(self) -> bool:
        return self.file.assumed

    @property
    def command(self) -> str:
        """What is commanded: a current, unless the file names another unit."""
        return "current" if self.file.command_unit == "A" else "command"

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


def parameters_of(*sources: Device | Brake) -> str:
    """One or two sentences for the small print: whose parameters are drawn, and which of them are assumed."""
    assumed = ", ".join(source.name for source in sources if source.assumed)
    others = ", ".join(source.name for source in sources if not source.assumed)
    sentences = (f"Assumed parameters: {assumed}." if assumed else "", f"Parameters of {others}." if others else "")
    return " ".join(filter(None, sentences))


def draw_torque_gain(brake: Brake) -> Figure:
    """Fig. 6, the fit equation."""
    k1, k2, k3, k4, k5 = brake.file.equation_2
    by_table = brake.file.torque_table is not None
    knee, largest = 0.0 if by_table else brake.file.knee_A, brake.file.current_max_A
    measured = brake.file.command_unit == "A"  # a field is no current of the paper's
    circles = " Circles: the currents at which the paper measured the brake." if measured else ""
    text = f"{parameters_of(brake)} Model only.{circles}"
    figure, [[axes]] = sheet(text, (PAGE_IN, 4.2), (0.65, 0.2, 0.5, 0.45))
    plain(axes)
    current, unit = np.linspace(0.0, largest, 401), brake.file.command_unit
    gain = brake.torque_gain(current)
    top = 1.08 * gain[-1]
    if 0.0 < knee < largest:
        axes.axvline(knee, color=QUIET, linewidth=0.9, linestyle=(0, (4, 3)))
        axes.annotate(f"knee, {knee:g} {unit}", (knee, top), (4, -4), textcoords="offset points", va="top", color=QUIET)
    axes.plot(current, gain, color=BLUE, linewidth=2.0)
    tested = TESTED_A[TESTED_A <= largest] if measured else np.empty(0)
    axes.plot(tested, brake.torque_gain(tested), "o", color=BLUE, markerfacecolor="white", markersize=6)
    axes.annotate(
        f"off-state torque $k_2$ = {k2:g} N m", (0.0, k2), (24, -1), textcoords="offset points", va="center",
        arrowprops={"arrowstyle": "-", "color": QUIET, "linewidth": 0.8, "shrinkB": 4}, bbox=WHITE,
    )  # fmt: skip
    below = f"I < {knee:g} {unit}:   K = {k1:g} I{_plus(k2)}\n" if knee > 0.0 else ""
    above = f"I ≥ {knee:g} {unit}:   K = {k3:g} I²{_plus(k4)} I{_plus(k5)}"
    formula = "torque table" if by_table else f"{below}{above}"
    axes.text(
        0.98, 0.26, formula.replace("-", "−"), transform=axes.transAxes, ha="right", va="center",
        linespacing=1.7, fontsize=MIDDLE, bbox=WHITE,
    )  # fmt: skip
    axes.set(xlim=(-0.02 * largest, 1.03 * largest), ylim=(0.0, top))
    axes.set(xlabel=f"{brake.command} I ({unit})", ylabel="Torque gain K (N m)")
    title(axes, f"Torque gain, Eq. (2), {brake.name}")
    return figure


def _plus(value: float) -> str:
    return f" {'−' if value < 0.0 else '+'} {abs(value):g}"


def draw_time_constants(brake: Brake) -> Figure:
    """Fig. 8 (the fitted surface of rising), and the same for falling."""
    text = (
        f"{parameters_of(brake)} Model only, over the currents and speeds that the paper tested (grid lines). From "
        f"{brake.file.omega_0_rpm:g} rpm on the constant is a_avg. Current: the one stepped to."
    )
    projection = {"projection": "3d", "computed_zorder": False}
    figure, [row] = sheet(text, (PAGE_IN, 4.0), (0.35, 0.15, -0.05, 0.3), (1, 2), subplot_kw=projection)
    fine_rpm = np.geomspace(TESTED_RPM[0], TESTED_RPM[-1], 43)  # 6 between neighbours: the tested ones are among them
    x, y = np.meshgrid(np.linspace(0.0, brake.file.current_max_A, 31), np.log2(fine_rpm))
    constant_ms = np.vectorize(lambda i, w, rising: 1e3 * brake.time_constant(i, 2.0**w, rising))
    surfaces = [constant_ms(x, y, rising) for rising in (True, False)]
    top = max(surface.max() for surface in surfaces)
    for axes, surface, way in zip(row, surfaces, ("rising", "falling"), strict=True):
        axes.plot_surface(
            x, y, surface, rcount=43, ccount=31, cmap="cividis", vmin=0.0, vmax=top, linewidth=0, antialiased=False,
            zorder=1,
        )  # fmt: skip
        current, speed = np.linspace(0.0, brake.file.current_max_A, 6), np.log2(TESTED_RPM)
        lines = [(np.full_like(fine_rpm, i), np.log2(fine_rpm)) for i in current]
        for i, w in [*lines, *((current, np.full_like(current, w)) for w in speed)]:
            axes.plot(i, w, constant_ms(i, w, way == "rising"), color=TEXT, linewidth=0.7, zorder=2)
        axes.set_zlim(0.0, 1.05 * top)
        axes.set_yticks(speed, [f"{rpm:g}" for rpm in TESTED_RPM])
        axes.set_xlabel(f"{brake.command} ({brake.file.command_unit})", labelpad=4)
        axes.set_ylabel("Speed (rpm)", labelpad=5)
        axes.set_zlabel("time constant (ms)", labelpad=3)
        axes.tick_params(labelsize=7.5, pad=1)
        plain_3d(axes)
        left, above = axes.get_position().x0, 1.0 - 0.3 / figure.get_figheight()
        axes.set_box_aspect((1.0, 1.25, 0.85), zoom=0.86)
        words = f"{way.capitalize()} time constant, Eq. (4), {brake.name}"
        figure.text(left, above, words, fontsize=TITLE, parse_math=False)
    return figure


def step_response(brake: Brake, steps: Sequence[tuple[float, float]], times: Array, speed_rpm: float) -> Array:
    """Yield torque (n,), N m, at rising times (n,), s, from the first step on, turning at a constant speed, Eq. (1).

    steps: (time, current), s and A; before the first one the current has been on for long.
    """
    rate = speed_rpm * RAD_S_PER_RPM
    torque = np.empty(len(times))
    now = float(brake.torque_gain([steps[0][1]])[0])
    ends = [step[0] for step in steps[1:]] + [math.inf]
    for (begin, current), end in zip(steps, ends, strict=True):
        duration = min(end, float(times[-1])) - begin
        if duration <= 0.0:
            break
        gain = torque_gain(brake.record, A, current)
        constant = time_constant(brake.record, A, current, rate, gain > now)
        for k in np.flatnonzero((times >= begin) & (times < end)):
            torque[k] = lagged_yield(gain, now, times[k] - begin, constant)
        now = lagged_yield(gain, now, duration, constant)
    return torque


def _over_time(text: str, height_in: float) -> tuple[Figure, Axes, Axes]:
    """Two axes over the same time: the command above, the torque below."""
    figure, grid = sheet(
        text,
        (PAGE_IN, height_in),
        (0.6, 0.2, 0.5, 0.4),
        (2, 1),
        between_in=(0.0, 0.55),
        height_ratios=(1, 2.2),
        sharex=True,
    )
    upper, lower = grid[:, 0]
    lower.set(xlabel="Time (s)", ylabel="Torque (N m)")
    plain(upper)
    plain(lower)
    return figure, upper, lower


def draw_current_steps(brake: Brake) -> Figure:
    """Fig. 9, the model's output."""
    text = f"{parameters_of(brake)} Model only, Eqs. (1), (2) and (4), at constant speed."
    figure, upper, lower = _over_time(text, 5.0)
    largest = brake.file.current_max_A
    steps = [(t, share * largest) for t, share in STEPS]
    upper.step([*(t for t, _ in steps), STEPS_END_S], [*(i for _, i in steps), 0.0], where="post", color=TEXT)
    upper.set(ylim=(0.0, 1.1 * largest), ylabel=f"{brake.command} ({brake.file.command_unit})")
    title(upper, "Commanded current")
    times = np.linspace(0.0, STEPS_END_S, 881)
    for speed, colour, line in STEP_SPEEDS:
        torque = step_response(brake, steps, times, speed)
        label = f"{speed:g} rpm" + (" (a_avg)" if speed >= brake.file.omega_0_rpm else "")
        lower.plot(times, torque, color=colour, linestyle=line, linewidth=1.6, label=label)
    for gain in brake.torque_gain(current for _, current in steps):
        lower.axhline(gain, color=QUIET, linewidth=0.7, linestyle=(0, (1, 3)), zorder=1)
    lower.set(xlim=(0.0, STEPS_END_S), ylim=(0.0, 1.1 * brake.torque_gain([largest])[0]))
    lower.legend(frameon=False, loc="upper right", handlelength=2.8)
    title(lower, "Brake torque; dotted: the torque gain K of each current")
    return figure


def torque_with_play(brake: Brake, angles: Array, current: float) -> Array:
    """Torque (n,), N m, along joint angles (n,), rad, at a steady current: our model of the backlash.

    The play follows the joint; the brake holds its yield at the edge of the play and k_2 within. The play begins in
    the middle; the first torque is that of the first movement.
    """
    width, off = math.radians(brake.file.backlash_deg), brake.file.equation_2[1]
    held = float(brake.torque_gain([current])[0])
    play = 0.5 * width
    torque = np.empty(len(angles))
    for k, turned in enumerate(np.diff(angles), 1):
        play = min(max(play + turned, 0.0), width)
        at_edge = play == width if turned > 0.0 else play == 0.0
        torque[k] = -math.copysign(held if at_edge else min(off, held), turned) if turned != 0.0 else torque[k - 1]
    torque[0] = torque[1]
    return torque


def torque_as_worded(brake: Brake, angles: Array, current: float, step: float) -> Array:
    """Torque (n,), N m, by the paper's wording: the signed torque lags, Eq. (1), its gain drops in the backlash.

    When the torque crosses zero, boundaries one backlash to either side of the joint are set and the gain is k_2
    against the motion until the joint crosses one. step: s between the angles.
    """
    width, off = math.radians(brake.file.backlash_deg), brake.file.equation_2[1]
    held = float(brake.torque_gain([current])[0])
    centre, inside = angles[0], False
    torque = np.empty(len(angles))
    torque[0] = now = -math.copysign(held, angles[1] - angles[0])
    for k, turned in enumerate(np.diff(angles), 1):
        inside = inside and abs(angles[k] - centre) < width
        target = -math.copysign(off if inside else held, turned)
        constant = brake.time_constant(current, abs(turned) / step / RAD_S_PER_RPM, abs(target) > abs(now))
        was, now = now, target + (now - target) * math.exp(-step / constant)
        if was * now < 0.0:
            centre, inside = angles[k], True
        torque[k] = now
    return torque


def draw_sinusoidal_motion(brake: Brake) -> Figure:
    """Fig. 10, the model's output."""
    current, unit = SINE_SHARE * brake.file.current_max_A, brake.file.command_unit
    text = (
        f"{parameters_of(brake)} Model only, joint moved by {math.degrees(AMPLITUDE_RAD):g}° sin(2π {FREQUENCY_HZ:g} "
        f"Hz t) at a steady {current:g} {unit}; backlash {brake.file.backlash_deg:g}°. Ours: after each reversal the "
        "brake holds its off-state torque until the backlash is crossed, and always opposes the motion. Paper's "
        "wording: the signed torque lags, so it drives the joint after each reversal (shaded), which no brake can."
    )
    step, period = SINE_STEP_S, 1.0 / FREQUENCY_HZ
    times = np.arange(round(3.5 * period / step) + 1) * step - 1.0 * period
    angles = AMPLITUDE_RAD * np.sin(2.0 * math.pi * FREQUENCY_HZ * times)
    ours, worded = torque_with_play(brake, angles, current), torque_as_worded(brake, angles, current, step)
    seen = times >= 0.0  # the first period settles
    times, angles, ours, worded = times[seen], angles[seen], ours[seen], worded[seen]

    figure, upper, lower = _over_time(text, 5.2)
    upper.plot(times, np.degrees(angles), color=TEXT)
    upper.set_ylabel("Angle (°)")
    title(upper, "Joint angle")
    driving = worded * np.gradient(angles) > 0.0
    lower.fill_between(times, worded, 0.0, where=driving, color=ORANGE, alpha=0.25, linewidth=0)
    lower.plot(times, worded, color=ORANGE, linestyle=(0, (5, 1.5)), linewidth=1.3, label="paper's wording")
    lower.plot(times, ours, color=BLUE, linewidth=1.6, label="ours")
    lower.axhline(0.0, color=QUIET, linewidth=0.7)
    highest = 1.35 * np.abs(ours).max()
    lower.set(xlim=(times[0], times[-1]), ylim=(-highest, highest))
    lower.legend(frameon=False, loc="upper right", ncols=2, handlelength=2.8, borderaxespad=0.1)
    title(lower, "Brake torque")
    return figure
