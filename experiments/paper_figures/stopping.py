"""How far the handle comes once the guard of obstacles locks all brakes: what a designer buys a brake by.

Lines: the guard's bound (`core.control.guard`) over the speed of the handle, for several pushes that go on all the
while. Circles: what the simulator does with a handle that is pushed straight on, in its worst direction.
"""

import math
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from core.control.guard import Around, Guard, least_held, make_around, stopping_distance, tick_at
from core.device import Device
from core.simulator.hand import spring_hand
from core.simulator.simulated_device import SimulatedDevice
from core.simulator.stick_slip import FREE, STILL
from core.workspace import Array
from experiments.analysis.sheet import BLUE, BROWN, ORANGE, PAGE_IN, heading, plain, sheet, title
from experiments.numbers import place_cm
from experiments.paper_figures.brake import parameters_of
from experiments.paper_figures.workspace import workspace_of

PUSHES_N = {2.0: BLUE, 10.0: BROWN, 18.0: ORANGE}  # the least is not 0: without a push a play is never turned through
SPEEDS_M_S = np.linspace(0.0, 0.6, 13)
STARTING_M_S = 1e-6  # in place of 0: a handle at rest has no direction
SIMULATED_M_S = (0.0, 0.2, 0.4, 0.6)
ANGLES = np.linspace(0.0, 2.0 * math.pi, 8, endpoint=False)
MOST_M = 0.15
STOPPED_S = 0.5


def bounds(device: Device, tip: tuple[float, float], push: float, play: bool) -> Array:
    """The guard's bound (n,), m, at each of `SPEEDS_M_S`, in the worst direction of motion; infinite: it has none."""
    if not play:
        device = replace(device, brakes=device.brakes._replace(play=np.zeros(4)))
    around = make_around(Around(guard=Guard(push_N=push)), device)[0]
    ways = [
        max(stopping_distance(around, tick_at(device, tip, (v * math.cos(a), v * math.sin(a)))) for a in ANGLES)
        for v in np.maximum(SPEEDS_M_S, STARTING_M_S)
    ]
    return np.array(ways)


def simulated_way(device: Device, tip: tuple[float, float], push: float, speed: float) -> float:
    """How far (m) the simulated handle comes from `speed` (m/s) under a push (N) along it; the worst of `ANGLES`."""
    ways = []
    for angle in ANGLES:
        along = np.array([math.cos(angle), math.sin(angle)])
        simulated = SimulatedDevice(device, tip, spring_hand((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
        simulated.settle(np.zeros(4), 0.0)
        simulated.body["tip"][0, 2:] = speed * along
        simulated.body["held"][0] = FREE if speed else STILL
        simulated.hand.grips["held"][0] = push * along
        furthest = 0.0
        for n in range(round(STOPPED_S / 1e-3)):
            simulated.move(simulated.brakes["current_max"][0], 1e-3 * n, 1e-3)
            furthest = max(furthest, math.dist(tip, simulated.tip))
        ways.append(furthest)
    return max(ways)


def draw_stopping(device: Device) -> Figure:
    """Draw the stopping distance over the speed, with the play of the brakes and without."""
    workspace = workspace_of(device.mechanism)
    tip = (float(workspace.home[0]), float(workspace.home[1]))
    held = least_held(device.mechanism, device.brakes, np.array([tip]))
    text = (
        f"{parameters_of(device)} Handle at {place_cm(tip)}, where a full lock "
        f"holds {held:.0f} N in any direction; it cannot stop a harder push. Lines: the guard's bound for any hand "
        "that pushes with no more than that, with the brakes off until now, in the worst direction of its motion; a "
        "line ends where the guard has no bound. Circles: the simulated handle, pushed straight on in its worst "
        "direction, with backlash."
    )
    figure, [axes] = sheet(text, (PAGE_IN, 3.9), (0.65, 0.25, 0.5, 0.95), (1, 2), (0.6, 0.0), sharey=True)
    for panel, play, words in (
        (axes[0], True, "With the backlash of the brakes"),
        (axes[1], False, "Without backlash"),
    ):
        for push, colour in PUSHES_N.items():
            if push >= held:
                continue
            way = 1e3 * bounds(device, tip, push, play)
            panel.plot(SPEEDS_M_S, np.where(np.isfinite(way), way, np.nan), color=colour, label=f"Push {push:g} N")
            if play:
                circles = [1e3 * simulated_way(device, tip, push, speed) for speed in SIMULATED_M_S]
                panel.plot(SIMULATED_M_S, circles, "o", color=colour, markersize=4, mfc="white", clip_on=False)
        panel.set(xlabel="Speed of the handle (m/s)", xlim=(0.0, SPEEDS_M_S[-1]), ylim=(0.0, 1e3 * MOST_M))
        plain(panel)
        title(panel, words)
    axes[0].set_ylabel("Stopping distance (mm)")
    heading(figure, f"Stopping distance, {device.name}", axes[0].get_legend_handles_labels()[0])
    return figure
