"""Figs. 9 and 10: what the brake model puts out for current steps, and under a sinusoidal motion of its joint."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from core.brake import begin_lag, lagged_yield
from core.device import RAD_S_PER_RPM
from core.mechanism import A
from core.workspace import Array
from experiments.analysis.figures import QUIET, TEXT, new_figure
from experiments.paper_figures.brake import MODEL, MODEL_2, Brake
from experiments.paper_figures.sheet import panels, parameters_of, plain, small_print, title

STEPS = ((0.0, 0.0), (0.2, 0.4), (1.2, 1.0), (2.2, 0.4), (3.2, 0.0))  # s, share of the largest current; our choice
STEPS_END_S = 4.4
STEP_SPEEDS_RPM = (0.5, 2.0, 16.0)
SPEED_COLOURS = ("#d55e00", "#0072b2", "#009e73")
SPEED_LINES = ("-", (0, (6, 1.5)), (0, (1.5, 1.2)))

AMPLITUDE_RAD, FREQUENCY_HZ, SINE_SHARE, SINE_STEP_S = math.radians(10.0), 0.5, 0.6, 1e-3  # our choice


def step_response(brake: Brake, steps: Sequence[tuple[float, float]], times: Array, speed_rpm: float) -> Array:
    """Yield torque (n,), N m, at rising times (n,), s, from the first step on, turning at a constant speed, Eq. (1).

    steps: (time, current), s and A; before the first one the current has been on for long.
    """
    rate = speed_rpm * RAD_S_PER_RPM
    lag = np.zeros((4, 5))
    torque = np.empty(len(times))
    now = float(brake.torque_gain([steps[0][1]])[0])
    ends = [step[0] for step in steps[1:]] + [math.inf]
    for (begin, current), end in zip(steps, ends, strict=True):
        duration = min(end, float(times[-1])) - begin
        if duration <= 0.0:
            break
        begin_lag(brake.record, A, current, now, rate, 0.0, duration, lag)
        for k in np.flatnonzero((times >= begin) & (times < end)):
            torque[k] = lagged_yield(lag, A, times[k] - begin)
        now = lagged_yield(lag, A, duration)
    return torque


def _two_panels(figure: Figure, foot: float) -> np.ndarray:
    """What is commanded above, the torque below, over the same time."""
    margins = (0.6, 0.2, foot + 0.5, 0.4)
    return panels(figure, 2, 1, margins, (0.0, 0.55), height_ratios=(1, 2.2), sharex=True)[:, 0]


def draw_current_steps(brake: Brake) -> Figure:
    """Fig. 9, the model's output."""
    figure = new_figure(6.4, 5.0)
    foot = small_print(figure, f"{parameters_of(brake)} Model only, Eqs. (1), (2) and (4), at constant speed.")
    upper, lower = _two_panels(figure, foot)
    largest = brake.file.current_max_A
    steps = [(t, share * largest) for t, share in STEPS]
    upper.step([*(t for t, _ in steps), STEPS_END_S], [*(i for _, i in steps), 0.0], where="post", color=TEXT)
    upper.set_ylim(0.0, 1.1 * largest)
    upper.set_ylabel("current (A)")
    title(upper, "Commanded current")
    times = np.linspace(0.0, STEPS_END_S, 881)
    for speed, colour, line in zip(STEP_SPEEDS_RPM, SPEED_COLOURS, SPEED_LINES, strict=True):
        torque = step_response(brake, steps, times, speed)
        label = f"{speed:g} rpm" + (" (a_avg)" if speed >= brake.file.omega_0_rpm else "")
        lower.plot(times, torque, color=colour, linestyle=line, linewidth=1.6, label=label)
    for _, current in steps:
        lower.axhline(brake.torque_gain([current])[0], color=QUIET, linewidth=0.7, linestyle=(0, (1, 3)), zorder=1)
    lower.set_ylim(0.0, 1.1 * brake.torque_gain([largest])[0])
    lower.set_xlim(0.0, STEPS_END_S)
    lower.set_xlabel("time (s)")
    lower.set_ylabel("torque (N m)")
    lower.legend(frameon=False, loc="upper right", handlelength=2.8)
    title(lower, "Brake torque; dotted: the torque gain K of each current")
    for axes in (upper, lower):
        plain(axes)
    return figure


def torque_with_play(brake: Brake, angles: Array, current: float) -> Array:
    """Torque (n,), N m, along joint angles (n,), rad, at a steady current: our model of the backlash.

    The play follows the joint; the brake holds its yield at the edge of the play and k_2 within. The play begins in
    the middle; the first torque is that of the first movement.
    """
    width, off = math.radians(brake.file.backlash_deg), brake.file.k[1]
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
    """The same by the paper's wording: the signed torque lags, Eq. (1), and its gain drops while in the backlash.

    When the torque crosses zero, boundaries one backlash to either side of the joint are set and the gain is k_2
    against the motion until the joint crosses one. step: s between the angles.
    """
    width, off = math.radians(brake.file.backlash_deg), brake.file.k[1]
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
    figure = new_figure(6.8, 5.2)
    current = SINE_SHARE * brake.file.current_max_A
    foot = small_print(
        figure,
        f"{parameters_of(brake)} Model only, joint moved by {math.degrees(AMPLITUDE_RAD):g}° sin(2π {FREQUENCY_HZ:g} "
        f"Hz t) at a steady {current:g} A; backlash {brake.file.backlash_deg:g}°. Ours: after each reversal the brake "
        "holds its off-state torque until the play is crossed, and always opposes the motion. Paper's wording: the "
        "signed torque lags, so it drives the joint after each reversal (shaded), which no brake can.",
    )
    step, period = SINE_STEP_S, 1.0 / FREQUENCY_HZ
    times = np.arange(round(3.5 * period / step) + 1) * step - 1.0 * period
    angles = AMPLITUDE_RAD * np.sin(2.0 * math.pi * FREQUENCY_HZ * times)
    ours, worded = torque_with_play(brake, angles, current), torque_as_worded(brake, angles, current, step)
    seen = times >= 0.0  # the first period settles
    times, angles, ours, worded = times[seen], angles[seen], ours[seen], worded[seen]
    driving = worded * np.gradient(angles) > 0.0

    upper, lower = _two_panels(figure, foot)
    upper.plot(times, np.degrees(angles), color=TEXT)
    upper.set_ylabel("angle (°)")
    title(upper, "Joint angle")
    lower.fill_between(times, worded, 0.0, where=driving, color=MODEL_2, alpha=0.25, linewidth=0)
    lower.plot(times, worded, color=MODEL_2, linestyle=(0, (5, 1.5)), linewidth=1.3, label="paper's wording")
    lower.plot(times, ours, color=MODEL, linewidth=1.6, label="ours")
    lower.axhline(0.0, color=QUIET, linewidth=0.7)
    lower.set_ylim(-1.35 * np.abs(ours).max(), 1.35 * np.abs(ours).max())
    lower.set_xlim(times[0], times[-1])
    lower.set_xlabel("time (s)")
    lower.set_ylabel("torque (N m)")
    lower.legend(frameon=False, loc="upper right", ncols=2, handlelength=2.8, borderaxespad=0.1)
    title(lower, "Brake torque")
    for axes in (upper, lower):
        plain(axes)
    return figure
