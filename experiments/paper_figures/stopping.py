"""How far the handle still comes once the guard of obstacles locks all brakes: what a designer buys a brake by.

The guard's bound (`core.control.guard`) over the speed of the handle, for several pushes that go on all the while, and
beside it what the simulator does with a handle that is pushed straight on, in its worst direction.
"""

import math

import numpy as np
from matplotlib.figure import Figure

from core.control.guard import Around, Guard, least_held, make_around, stopping_distance
from core.device import Device
from core.simulator.hand import spring_hand
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.stick_slip import FREE, STILL
from core.workspace import Array
from experiments.analysis.sheet import BLUE, GREEN, ORANGE, legend_at, plain, sheet, title
from experiments.paper_figures.brake import parameters_of
from experiments.paper_figures.workspace import workspace_of

PUSHES_N = {2.0: BLUE, 10.0: GREEN, 18.0: ORANGE}  # the least is not 0: without a push a play is never turned through
SPEEDS_M_S = np.linspace(0.0, 0.6, 13)
SIMULATED_M_S = (0.0, 0.2, 0.4, 0.6)
ANGLES = np.linspace(0.0, 2.0 * math.pi, 8, endpoint=False)
MOST_M = 0.15
STOPPED_S = 0.5


def bounds(device: Device, tip: tuple[float, float], push: float, play: bool) -> Array:
    """The guard's bound (m) at each of `SPEEDS_M_S`, in the worst direction of the motion; infinite over `MOST_M`."""
    simulated = pushed(device, tip, play)
    around, state = make_around(Around(guard=Guard(push_N=push)), device.brakes)[0], simulated.state[0]
    found = [
        max(
            stopping_distance(
                around, simulated.brakes[0], state.g, state.mass, v * math.cos(a), v * math.sin(a), MOST_M
            )
            for a in ANGLES
        )
        for v in SPEEDS_M_S
    ]
    return np.array(found)


def simulated_way(device: Device, tip: tuple[float, float], push: float, speed: float) -> float:
    """How far (m) the simulated handle comes from `speed` (m/s), pushed on in its direction; of all, the worst one."""
    ways = []
    for angle in ANGLES:
        along = np.array([math.cos(angle), math.sin(angle)])
        simulated = pushed(device, tip, play=True)
        simulated.state["tip"][0, 2:] = speed * along
        simulated.state["held"][0] = FREE if speed else STILL
        simulated.hand.grips["held"][0] = push * along
        furthest = 0.0
        for n in range(round(STOPPED_S / 1e-3)):
            simulated.move(simulated.brakes["current_max"][0], 1e-3 * n, 1e-3)
            furthest = max(furthest, math.dist(tip, simulated.tip))
        ways.append(furthest)
    return max(ways)


def pushed(device: Device, tip: tuple[float, float], play: bool) -> SimulatedDevice:
    """At rest at `tip` (m), brakes off."""
    simulated = SimulatedDevice(device, tip, spring_hand((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    if not play:
        simulated.brakes["play"][0] = 0.0
    simulated.settle(np.zeros(4), 0.0)
    return simulated


def draw_stopping(device: Device) -> Figure:
    """Stopping distance over speed, with the play of the brakes and without."""
    workspace = workspace_of(device.mechanism)
    tip = (float(workspace.home[0]), float(workspace.home[1]))
    held = least_held(device.mechanism, device.brakes, np.array([tip]))
    text = (
        f"{parameters_of(device)} Handle at ({100.0 * tip[0]:.0f}, {100.0 * tip[1]:.0f}) cm, where a full lock holds "
        f"{held:.0f} N in any direction: a push of more cannot be stopped. Lines: upper bound of the guard for a hand "
        "that pushes no harder than that all the while, brakes off until now, in the worst direction. Circles: the "
        "simulated handle, pushed straight on, in its worst direction, with the play."
    )
    figure, [axes] = sheet(text, (8.0, 3.9), (0.65, 0.25, 0.5, 0.95), 1, 2, (0.6, 0.0), sharey=True)
    for panel, play, words in ((axes[0], True, "With the play of the brakes"), (axes[1], False, "Without play")):
        for push, colour in PUSHES_N.items():
            if push >= held:
                continue
            way = 1e3 * bounds(device, tip, push, play)
            panel.plot(SPEEDS_M_S, np.where(np.isfinite(way), way, np.nan), color=colour, label=f"push {push:g} N")
            if play:
                circles = [1e3 * simulated_way(device, tip, push, speed) for speed in SIMULATED_M_S]
                panel.plot(SIMULATED_M_S, circles, "o", color=colour, markersize=4, mfc="white", clip_on=False)
        panel.set(xlabel="speed of the handle (m/s)", xlim=(0.0, SPEEDS_M_S[-1]), ylim=(0.0, 1e3 * MOST_M))
        plain(panel)
        title(panel, words)
    axes[0].set_ylabel("stopping distance (mm)")
    width, height = figure.get_size_inches()
    name = f"Stopping distance, {device.name}"
    figure.text(0.65 / width, 1.0 - 0.28 / height, name, fontsize=10.5, parse_math=False)
    legend_at(figure, axes[0].get_legend_handles_labels()[0], 0.65, 0.36, columnspacing=1.5)
    return figure
