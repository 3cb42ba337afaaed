"""Scooter, a cobot on three steered castors, under a hand: free, along a path, and at a wall.

Castors turn and never roll sideways, so the hand moves it one way at a time, and supplies all the energy.
"""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from core.device import COBOT_FOLDER
from core.path import line
from experiments.analysis.sheet import BLUE, ORANGE, PAGE_IN, QUIET, TEXT, plain, sheet, title
from experiments.simulate.cobot_scene import ALONG_PATH, AT_WALL, FREE, CobotRun, CobotScene, load_cobot

SECONDS, STEP_S = 4.0, 1e-3
SHOWN_EVERY_M = 0.5  # of way
CASTOR_M = 0.05  # half the stroke that stands for a castor
ARROW_M = 0.3  # of the hand's force
WALL_Y_M = 0.4
EAST = line((0.0, 0.0), (2.0, 0.0))


def scenes() -> dict[str, CobotScene]:
    """The three scenes by their titles."""
    cobot = load_cobot("scooter", COBOT_FOLDER, "scooter")
    rows = round(SECONDS / STEP_S) + 1
    wall, aslant = np.array([0.0, WALL_Y_M, 0.0, -1.0]), (0.0, 0.15, 0.6)

    def scene(mode: int, pose: tuple[float, float, float], hand: tuple[float, float, float]) -> CobotScene:
        return CobotScene(
            cobot, pose, STEP_S, 1, rows, mode, EAST, 0.0, 0.3, wall, 100.0, np.zeros(1), np.array([hand])
        )  # fmt: skip

    return {
        "Free castors": scene(FREE, aslant, (8.0, 0.0, 0.3)),
        "Steered along the path y = 0": scene(ALONG_PATH, aslant, (8.0, 4.0, 0.0)),
        "Kept from a wall": scene(AT_WALL, (0.0, 0.0, 0.0), (8.0, 8.0, 0.0)),
    }


def draw_scooter() -> Figure:
    """Draw the path of the body, its castors as strokes, and the hand's force as an arrow, in all three scenes."""
    cobot = next(iter(scenes().values())).cobot
    text = (
        f"Assumed parameters: {cobot.name} ({cobot.mass_kg:g} kg, {cobot.inertia_kg_m2:g} kg m², servos of at most "
        f"{cobot.steering_rate_max_rad_s:g} rad/s) and all of the scenes, {SECONDS:g} s from rest. Simulation only. "
        f"Triangle: the body every {SHOWN_EVERY_M:g} m; strokes: its castors; line: its centre of mass, which is "
        "what is kept from the wall; arrow: the hand's force there (free castors: with a torque of 0.3 N m)."
    )
    figure, [panels] = sheet(text, (PAGE_IN, 2.5), (0.55, 0.1, 0.45, 0.4), (1, 3), (0.2, 0.0), sharey=True)
    for axes, (words, scene) in zip(panels, scenes().items(), strict=True):
        rows = CobotRun(scene).run_chunk(scene.rows)
        if scene.mode == AT_WALL:
            axes.axhspan(WALL_Y_M, 2.0, color=QUIET, alpha=0.35, linewidth=0.0)
        if scene.mode == ALONG_PATH:
            axes.axhline(0.0, color=ORANGE, linewidth=1.2)
        axes.plot(rows[:, 1], rows[:, 2], color=BLUE, linewidth=1.2)
        way = np.cumsum(np.hypot(*np.diff(rows[:, 1:3], axis=0, prepend=rows[:1, 1:3]).T))
        for row in rows[np.searchsorted(way, np.arange(0.0, way[-1], SHOWN_EVERY_M))]:
            _draw_body(axes, scene, row)
        push = scene.force[0, :2] * ARROW_M / math.hypot(*scene.force[0, :2])
        start = np.array(scene.pose[:2])
        axes.annotate("", start + push, start, arrowprops={"arrowstyle": "-|>", "color": ORANGE}, zorder=5)
        plain(axes)
        title(axes, words)
        axes.set(xlabel="x (m)", xticks=(0.0, 1.0, 2.0), aspect="equal", adjustable="box")
        axes.set(xlim=(-0.4, 2.6), ylim=(-0.6, 0.9))
    panels[0].set_ylabel("y (m)")
    return figure


def _draw_body(axes: Axes, scene: CobotScene, row: np.ndarray) -> None:
    """The triangle of the hubs, and each castor along the way that it rolls."""
    x, y, heading = row[1:4]
    turn = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
    hubs = np.array(scene.cobot.hubs_m) @ turn.T + (x, y)
    axes.fill(*hubs.T, facecolor="none", edgecolor=TEXT, linewidth=0.7, alpha=0.6)
    for hub, angle in zip(hubs, row[7 : 7 + len(hubs)] + heading, strict=True):
        stroke = CASTOR_M * np.array([math.cos(angle), math.sin(angle)])
        axes.plot(*np.transpose([hub - stroke, hub + stroke]), color=TEXT, linewidth=2.0, solid_capstyle="butt")
