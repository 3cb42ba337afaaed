"""The device as the passive master of a teleoperation, the paper's future work.

A hand on a spring moves into a wall that a delayed slave touches, and holds there. The brakes show the slave's force
by the controller `reflect`; for comparison, a motor would exert it as it is. The energy that each puts in is the work
of its force on the tip.
"""

import math
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from core import tick_log as log
from core.control.controllers import make_preset
from core.device import Device
from core.path import Segment
from core.simulator.hand import spring_hand
from core.simulator.simulated_device import SimulatedDevice
from core.tick_log import TICK_S
from core.workspace import Array
from experiments.analysis.sheet import BLUE, ORANGE, PAGE_IN, SHADED, heading, plain, sheet, title
from experiments.paper_figures.brake import parameters_of
from experiments.paper_figures.workspace import Workspace, workspace_of
from experiments.plan import PlannedTrial
from experiments.protocol import TrialRules
from experiments.slave import Slave
from experiments.trial.trial import Conditions, SimulatedTrial

DELAYS_S = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2)
SHOWN_DELAY_S = 0.05
DURATION_S, RISE_S = 2.5, 0.6  # the hand reaches its target after the rise
REACH_M = 0.03  # of the start before the wall, and of the hand's target behind it; less where there is less room
#: Our choice: a hand that holds on.
HAND_N_M, HAND_N_S_M, HAND_MOST_N, HAND_KG = 400.0, 10.0, 40.0, 1.0


class Course(NamedTuple):
    """One contact with the wall; ticks (n,)."""

    rows: Array  # (n, tick_log.WIDTH)
    depth: Array  # of the tip behind the wall, m
    slave: Array  # likewise
    wanted: Array  # force away from the wall that the slave sends, N
    exerted: Array  # force away from the wall on the tip, of brakes or motor, N
    put_in_J: float  # the most energy that brakes or motor have put in, up to any tick

    @property
    def share(self) -> float:
        """Of the wanted force that was exerted."""
        return float(np.sum(self.exerted) / np.sum(self.wanted))


def reach_in(workspace: Workspace) -> float:
    """How far (m) from the wall the handle starts, and how far behind it the hand's target is; the wall is at home."""
    return min(REACH_M, 0.4 * workspace.room_at(*workspace.home))


def contact(device: Device, workspace: Workspace, delay_s: float, motor: bool) -> Course:
    """Move the hand into the wall; the brakes show the slave's force, or a motor does. delay_s: each way."""
    x, wall = map(float, workspace.home)
    slave = Slave(wall_at_m=(x, wall), wall_normal=(0.0, -1.0), delay_s=delay_s)
    reach = reach_in(workspace)
    start = x, wall - reach
    stiffness, damping = (HAND_N_M, 0.0, HAND_N_M), (HAND_N_S_M, 0.0, HAND_N_S_M)
    hand = spring_hand(stiffness, damping, HAND_MOST_N, HAND_KG, start)
    preset = make_preset("", "none", {}) if motor else make_preset("", "reflect", {})
    way = Segment(start_m=start, end_m=(x, wall + 1.0))  # never reached
    planned = PlannedTrial(1, 1, device.name, 1, 1, 1)
    trial = SimulatedTrial(
        SimulatedDevice(device, start, hand), planned, Conditions(way, preset, "settled", TrialRules(slave=slave))
    )
    trial.arguments().run["phase"][0] = log.MOVE
    rows = np.empty((round(DURATION_S / TICK_S), log.WIDTH))
    for k in range(len(rows)):
        risen = min(k * TICK_S / RISE_S, 1.0)
        trial.aim(x, start[1] + reach * (1.0 - math.cos(math.pi * risen)))
        trial.run(rows[k : k + 1])
        if motor:
            hand.grips["held"][0] = rows[k, log.WANTED_FX : log.WANTED_FY + 1]
    wanted = rows[:, log.WANTED_FX : log.WANTED_FY + 1]
    exerted = wanted if motor else rows[:, log.SHOWN_FX : log.SHOWN_FY + 1]
    moved = np.diff(rows[:, log.TIP_X : log.TIP_Y + 1], axis=0)
    put_in = np.cumsum(np.sum(exerted[:-1] * moved, axis=1))
    return Course(
        rows, rows[:, log.TIP_Y] - wall, rows[:, log.SLAVE_Y] - wall, -wanted[:, 1], -exerted[:, 1],
        float(max(put_in.max(), 0.0)),
    )  # fmt: skip


def draw_passive_master(device: Device) -> Figure:
    """Draw one contact over time; then energy put in and share of the force shown over the delay, brakes and motor."""
    workspace = workspace_of(device.mechanism)
    text = (
        f"{parameters_of(device)} Simulation only; hand, slave and wall are our choice. A hand (spring of "
        f"{HAND_N_M:g} N/m, at most {HAND_MOST_N:g} N) goes {1e3 * reach_in(workspace):.0f} mm into a wall that a "
        "slave touches, and holds there. Brakes: controller reflect, full brake model. Motor: exerts the force that "
        "arrives as it is, brakes off. Shaded: the wall. Energy put in: the largest work of their forces on the tip up "
        "to any time."
    )
    figure, [[course, energy, share]] = sheet(text, (PAGE_IN, 3.9), (0.65, 0.2, 0.5, 0.95), (1, 3), (0.6, 0.0))
    contacts = {m: [contact(device, workspace, delay, m) for delay in DELAYS_S] for m in (False, True)}
    delays = 1e3 * np.array(DELAYS_S)
    looks = {False: ("brakes", BLUE, "o-"), True: ("motor", ORANGE, "s-")}
    at = DELAYS_S.index(SHOWN_DELAY_S)
    for motor, (name, colour, look) in looks.items():
        shown = contacts[motor][at]
        t = shown.rows[:, log.T]
        course.plot(t, 1e3 * shown.depth, color=colour, linewidth=1.6, label=f"Handle, {name}")
        course.plot(t, 1e3 * shown.slave, color=colour, linewidth=0.9, linestyle=(0, (4, 2)), label=f"Slave, {name}")
        energy.plot(delays, [c.put_in_J for c in contacts[motor]], look, color=colour, markersize=4)
        share.plot(delays, [100.0 * c.share for c in contacts[motor]], look, color=colour, markersize=4)
    low, high = course.get_ylim()
    course.axhspan(0.0, high, color=SHADED, linewidth=0.0, zorder=0)
    course.set(ylim=(low, high), xlabel="Time (s)", ylabel="Depth in the wall (mm)", xlim=(0.0, DURATION_S))
    energy.set(xlabel="Delay, each way (ms)", ylabel="Energy put in (J)")
    share.set(xlabel="Delay, each way (ms)", ylabel="Share of the force sent (%)", ylim=(0.0, 108.0))
    titles = f"{1e3 * SHOWN_DELAY_S:g} ms each way", "Energy put in", "Force exerted"
    for axes, words in zip((course, energy, share), titles, strict=True):
        plain(axes)
        title(axes, words)
    heading(figure, f"Passive master, {device.name}", course.get_legend_handles_labels()[0])
    return figure
