"""The displays that come with the product side by side, all with the same brake: what Fig. 1 argues, as numbers.

Fewer or less evenly spread force lines leave wider gaps between them, so a full lock holds less, and SDOF control finds
no valid brake more often. Geometry along the two segments of the paper's protocol; SDOF control (without gap) by trials
of simulated operators, the same people on each display.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from core import tick_log
from core.device import Device, build_device, load_device, shipped_devices
from core.device_file import parse_brake
from core.path import build_path, point_at
from core.simulator.simulated_device import SimulatedDevice
from core.workspace import Array, brake_rows, held_in_any_direction
from experiments.analysis.metrics import trial_metrics
from experiments.analysis.sheet import BLUE, plain, sheet, title
from experiments.paper_figures.directions import force_lines, gaps
from experiments.plan import PlannedTrial
from experiments.protocol import PAPER, Protocol, load_protocol
from experiments.recording.schema import recording_of
from experiments.trial.population import load_population
from experiments.trial.tick import TICK_S
from experiments.trial.trial import Trial

BRAKE = "mrb-2107-3"  # the paper's, on every display
PEOPLE, REPETITIONS = 3, 3  # as in the paper
SPACING_M = 0.002  # between the places of a segment
LONGEST_TRIAL_S = 62.0  # with the times out of the paper's protocol


class Display(NamedTuple):
    """One display in numbers: (n,) places of the segments, (m,) trials."""

    device: Device
    widest_gap: Array  # (n,) rad, between neighbouring force lines
    holds: Array  # (n,) N, what a full lock holds in any direction
    path_error: Array  # (m,) m, under SDOF control
    unreachable: Array  # (m,) share of the ticks in which SDOF control had no valid brake


def displays() -> list[Device]:
    """The shipped devices, fewest brakes first, each with `BRAKE` wherever it has a brake."""
    text = load_device("three-brake").brake_texts[BRAKE]
    found = [load_device(name) for name in shipped_devices()]
    found = [build_device(device.text, dict.fromkeys(device.brake_texts, text), device.name) for device in found]
    return sorted(found, key=lambda device: (len(device.braked), device.name))


def measure_display(device: Device, protocol: Protocol) -> Display:
    """A display along the protocol's paths, and in the hands of the same people as any other."""
    paths = [build_path(path, "path") for path in protocol.paths.values()]
    places = np.array([point_at(path, s)[:2] for path in paths for s in np.arange(0.0, path.length, SPACING_M)])
    rows = brake_rows(device.mechanism, *places.T)[device.brakes.present > 0.0]
    brake = parse_brake(next(iter(device.brake_texts.values())), BRAKE)
    torque = np.full(len(rows), brake.torque_gain(brake.current_max_A))
    lines = force_lines(device.mechanism, device.braked, *places.T)
    found = [trial for number in range(PEOPLE) for trial in sdof_trials(device, protocol, number)]
    return Display(device, gaps(lines).max(axis=-1), held_in_any_direction(rows, torque), *np.array(found).T)


def sdof_trials(device: Device, protocol: Protocol, number: int) -> Iterator[tuple[float, float]]:
    """Path error (m) and unreachable share of each trial of a simulated operator under SDOF control."""
    preset = next(preset for preset in protocol.controllers.values() if preset.kind == "sdof")
    person = load_population().draw(np.random.default_rng(np.random.SeedSequence([protocol.seed, number])))
    first = build_path(next(iter(protocol.paths.values())), "path")
    rows = np.empty((round(LONGEST_TRIAL_S / TICK_S), tick_log.WIDTH))
    simulation = SimulatedDevice(device, point_at(first, 0.5 * first.length)[:2])
    for repetition in range(REPETITIONS):
        for segment, path in protocol.paths.items():
            key = [protocol.seed, number, segment, repetition]  # the same noise on every display
            generator = np.random.default_rng(np.random.SeedSequence(key))
            planned = PlannedTrial(1, 1, device.name, 1, segment, repetition)
            trial = Trial(simulation, planned, path, preset, protocol.rules, protocol.trial, person, generator)
            metrics = trial_metrics(recording_of(rows[: trial.run(rows)], device.braked), trial.path)
            yield metrics["path_error_m"] or math.nan, metrics["unreachable_share"] or 0.0


def draw_displays() -> Figure:
    """The comparison: a row for each display."""
    protocol = load_protocol(PAPER)
    found = [measure_display(device, protocol) for device in displays()]
    text = (
        f"Assumed parameters: every device, the brake {BRAKE} on all of them, the two segments, the simulated "
        f"operators ({PEOPLE} people, {REPETITIONS} trials on each segment, SDOF without gap, {protocol.rules} rules). "
        "Left: range along the segments, worst value as text. Right: each trial a circle, median (path error) or mean "
        "(share of ticks with a felt hand and no valid brake) as text."
    )
    size = 9.0, 1.6 + 0.35 * len(found)
    figure, [axes] = sheet(text, size, (1.15, 0.25, 0.5, 0.4), columns=4, between_in=(0.35, 0.0))
    panels: tuple[tuple[str, str, list[np.ndarray], Callable[[np.ndarray], float]], ...] = (
        ("Widest gap of force lines", "°", [np.degrees(one.widest_gap) for one in found], np.max),
        ("A full lock holds", "N", [one.holds for one in found], np.min),
        ("SDOF path error", "mm", [1e3 * one.path_error for one in found], np.median),
        ("SDOF, no valid brake", "%", [1e2 * one.unreachable for one in found], np.mean),
    )
    for place, (panel, (words, unit, values, one_number)) in enumerate(zip(axes, panels, strict=True)):
        plain(panel)
        title(panel, words)
        for row, series in enumerate(values):
            if place < 2:
                panel.plot([series.min(), series.max()], [row, row], "-|", color=BLUE, linewidth=2.0, markersize=9)
            else:
                panel.plot(series, np.full(len(series), row), "o", color=BLUE, markersize=4, alpha=0.5, mew=0.0)
            shown = f"{one_number(series):.1f} {unit}" if unit in ("mm", "%") else f"{one_number(series):.0f} {unit}"
            panel.text(1.0, row + 0.33, shown, transform=panel.get_yaxis_transform(), ha="right", va="center")
        panel.set(ylim=(len(found) - 0.5, -0.6), xlabel=unit, xlim=(0.0, 1.1 * max(series.max() for series in values)))
        names = [one.device.name for one in found] if place == 0 else []
        panel.set_yticks(range(len(found)), names or [""] * len(found))
    return figure
