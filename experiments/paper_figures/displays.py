"""The shipped displays side by side, all with the same brake: what Fig. 1 argues, as numbers.

Fewer or less evenly spread force lines leave wider gaps between them, so a full lock holds less, and SDOF control
finds no valid brake more often. A display that cannot reach the paper's paths is left out.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from core import tick_log
from core.device import Device, build_device, load_device, shipped_devices
from core.path import build_path, point_at
from core.simulator.simulated_device import SimulatedDevice
from core.tick_log import TICK_S
from core.workspace import Array, brake_rows, held_in_any_direction, tip_is_free
from experiments.analysis.metrics import trial_metrics
from experiments.analysis.sheet import BLUE, PAGE_IN, plain, sheet, title
from experiments.numbers import fixed
from experiments.paper_figures.brake import WHITE
from experiments.paper_figures.directions import force_lines, gaps
from experiments.plan import PlannedTrial
from experiments.protocol import PAPER, Protocol, load_protocol, middle_of_first
from experiments.recording import recording_of
from experiments.trial.population import load_population
from experiments.trial.trial import Conditions, SimulatedTrial

BRAKE = "mrb-2107-3"  # the paper's, on every display
PEOPLE, REPETITIONS = 3, 3  # as in the paper
SPACING_M = 0.002  # between the places of a path
LONGEST_TRIAL_S = 62.0  # with the times out of the paper's protocol


class Display(NamedTuple):
    """One display in numbers: (n,) places of the paths, (m,) trials."""

    device: Device
    widest_gap: Array  # (n,) rad, between neighbouring force lines
    holds: Array  # (n,) N, what a full lock holds in any direction
    path_error: Array  # (m,) m, under SDOF control
    unreachable: Array  # (m,) share of the ticks in which SDOF control had no valid brake


def displays(protocol: Protocol) -> list[Device]:
    """The shipped devices that reach the protocol's paths, fewest brakes first, every brake replaced by `BRAKE`."""
    text = load_device("three-brake").brake_texts[BRAKE]
    shipped = [load_device(name) for name in shipped_devices()]
    reaching = [device for device in shipped if tip_is_free(device.mechanism, *places_on_paths(protocol).T).all()]
    alike = [build_device(device.text, dict.fromkeys(device.brake_texts, text), device.name) for device in reaching]
    return sorted(alike, key=lambda device: (len(device.braked), device.name))


def places_on_paths(protocol: Protocol) -> Array:
    """Points (n, 2), m, along the protocol's paths, `SPACING_M` apart."""
    paths = [build_path(path, "path") for path in protocol.paths.values()]
    return np.array([point_at(path, s)[:2] for path in paths for s in np.arange(0.0, path.length, SPACING_M)])


def measure_display(device: Device, protocol: Protocol) -> Display:
    """Measure a display along the protocol's paths; the simulated people are the same for every display."""
    places = places_on_paths(protocol)
    rows = brake_rows(device.mechanism, *places.T)[device.brakes.present > 0.0]
    brake = next(iter(device.brake_files.values()))
    torque = np.full(len(rows), brake.torque_gain(brake.current_max_A))
    lines = force_lines(device.mechanism, device.braked, *places.T)
    trials = [trial for number in range(PEOPLE) for trial in sdof_trials(device, protocol, number)]
    return Display(device, gaps(lines).max(axis=-1), held_in_any_direction(rows, torque), *np.array(trials).T)


def sdof_trials(device: Device, protocol: Protocol, number: int) -> Iterator[tuple[float, float]]:
    """Path error (m) and unreachable share of each trial of a simulated operator under SDOF control."""
    preset = next(preset for preset in protocol.controllers.values() if preset.kind == "sdof")
    person = load_population().draw(np.random.default_rng(np.random.SeedSequence([protocol.seed, number])))
    rows = np.empty((round(LONGEST_TRIAL_S / TICK_S), tick_log.WIDTH))
    simulation = SimulatedDevice(device, middle_of_first(protocol.paths))
    for repetition in range(REPETITIONS):
        for path_number, path in protocol.paths.items():
            key = [protocol.seed, number, path_number, repetition]  # the same noise on every display
            generator = np.random.default_rng(np.random.SeedSequence(key))
            planned = PlannedTrial(1, 1, device.name, 1, path_number, repetition)
            trial = SimulatedTrial(
                simulation, planned, Conditions(path, preset, protocol.rules, protocol.trial), person, generator
            )
            metrics = trial_metrics(recording_of(rows[: trial.run(rows)], device.braked), trial.path)
            yield metrics["path_error_m"] or math.nan, metrics["unreachable_share"] or 0.0


def draw_displays() -> Figure:
    """Draw the comparison, a row for each display."""
    protocol = load_protocol(PAPER)
    measured = [measure_display(device, protocol) for device in displays(protocol)]
    text = (
        f"Assumed parameters: every device, the brake {BRAKE} on all of them, the two paths, the simulated "
        f"operators ({PEOPLE} people, {REPETITIONS} trials on each path, SDOF without gap, {protocol.rules} rules). "
        "Left: range along the paths, worst value as text. Right: each trial a circle, median (path error) or mean "
        "(share of ticks with a felt hand and no valid brake) as text."
    )
    size = PAGE_IN, 1.8 + 0.5 * len(measured)
    figure, [axes] = sheet(text, size, (1.0, 0.15, 0.5, 0.55), (1, 4), between_in=(0.2, 0.0))
    panels: tuple[tuple[str, str, list[np.ndarray], Callable[[np.ndarray], float]], ...] = (
        ("Widest gap\nof force lines", "°", [np.degrees(display.widest_gap) for display in measured], np.max),
        ("A full lock\nholds", "N", [display.holds for display in measured], np.min),
        ("SDOF\npath error", "mm", [1e3 * display.path_error for display in measured], np.median),
        ("SDOF,\nno valid brake", "%", [1e2 * display.unreachable for display in measured], np.mean),
    )
    for panel, (heading, unit, values, middle_or_worst) in zip(axes, panels, strict=True):
        plain(panel)
        title(panel, heading)
        for row, series in enumerate(values):
            if unit in ("°", "N"):
                panel.plot([series.min(), series.max()], [row, row], "-|", color=BLUE, linewidth=2.0, markersize=9)
            else:
                panel.plot(series, np.full(len(series), row), "o", color=BLUE, markersize=4, alpha=0.5, mew=0.0)
            number = fixed(middle_or_worst(series), 1 if unit in ("mm", "%") else 0)
            shown = f"{number}°" if unit == "°" else f"{number} {unit}"
            beside = panel.get_yaxis_transform()
            panel.text(1.0, row + 0.4, shown, transform=beside, ha="right", va="center", bbox=WHITE)
        largest = max(series.max() for series in values)
        panel.set(ylim=(len(measured) - 0.35, -0.5), xlabel=unit, xlim=(0.0, 1.1 * largest))
        panel.set_yticks(range(len(measured)), [""] * len(measured))
    axes[0].set_yticklabels([display.device.name for display in measured])
    return figure
