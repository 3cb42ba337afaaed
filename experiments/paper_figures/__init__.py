"""The paper's Figs. 1 and 4 to 14, remade from our models, and its future work; no data of the paper are drawn.

Each module draws a group of figures; `draw_all` names their files and writes them, all or none.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import matplotlib
from matplotlib.figure import Figure

from core.device import Device
from experiments.analysis.sheet import STYLE, figure_bytes
from experiments.atomic_files import refuse_existing_files, refusing, write_new_files
from experiments.paper_figures.brake import (
    brakes_of,
    draw_current_steps,
    draw_sinusoidal_motion,
    draw_time_constants,
    draw_torque_gain,
)
from experiments.paper_figures.control import draw_five_forces, draw_sdof_choice, draw_velocity_field
from experiments.paper_figures.directions import UNACHIEVABLE, draw_sketch
from experiments.paper_figures.displays import draw_displays
from experiments.paper_figures.maps import MAPS, draw_map
from experiments.paper_figures.passive_master import draw_passive_master
from experiments.paper_figures.scooter import draw_scooter
from experiments.paper_figures.spring_release import draw_releases
from experiments.paper_figures.stopping import draw_stopping
from experiments.paper_figures.workspace import draw_sdof_paths
from experiments.progress import Progress, no_progress

FORMS = ("png", "pdf")
#: Device -> the number of its SDOF paths in the paper; those of other devices are named after both figures.
SDOF_FIGURE = {"three-brake": "fig04", "four-brake": "fig05"}
SDOF_PATHS = "paths with one brake locked"
RELEASES = "spring release from rest, each brake locked in turn and none"
PASSIVE_MASTER = "a delayed slave's force shown by brakes, and by a motor"
STOPPING = "how far the handle comes once the guard of obstacles locks"
#: Of each brake: name of the file, what it shows, and the function that draws it.
BRAKE_FIGURES = (
    ("fig06_torque_gain", "torque over current, Eq. (2)", draw_torque_gain),
    ("fig07-08_time_constants", "time constants over current and speed, Eq. (4)", draw_time_constants),
    ("fig09_current_steps", "brake torque after current steps at constant speed", draw_current_steps),
    ("fig10_sinusoidal_motion", "brake torque under sinusoidal motion with backlash", draw_sinusoidal_motion),
)


class Picture(NamedTuple):
    """One figure before it is drawn."""

    name: str  # of its files, without the ending
    shows: str  # in a few words
    draw: Callable[[], Figure]


class Drawn(NamedTuple):
    """One figure and the files that hold it."""

    name: str
    shows: str
    files: list[Path]


def pictures(devices: Sequence[Device]) -> list[Picture]:
    """Every figure for some devices (at least one), in the paper's order."""
    names = [device.name for device in devices]
    brakes = brakes_of(devices)
    endings = [f"_{slug}" for slug in _slugs(brake.name for brake in brakes)] if len(brakes) > 1 else [""]
    most_brakes = max(devices, key=lambda device: len(device.braked))
    everywhere = f"directions of force out of reach over the workspace: {', '.join(names)}"
    selection = f"how SDOF control chooses a brake: {most_brakes.name}"
    stopping = Picture("stopping_distance", f"{STOPPING}: {most_brakes.name}", partial(draw_stopping, most_brakes))
    five_forces = "how proportional control chooses a brake, the five forces of Eq. (14)"

    def of_each_device(figure: str, shows: str, draw: Callable[[Device], Figure]) -> list[Picture]:
        return [
            Picture(f"{figure}_{slug}", f"{shows}: {device.name}", partial(draw, device))
            for device, slug in zip(devices, _slugs(names), strict=True)
        ]

    figures = [
        Picture("fig01_unachievable_directions", "directions of force out of reach, the sketch", draw_sketch),
        Picture("fig01_unachievable_directions_workspace", everywhere, partial(draw_map, UNACHIEVABLE, devices)),
        Picture("displays", "the shipped displays compared, all with the same brake", draw_displays),
    ]
    for picture, name in zip(of_each_device("sdof_paths", SDOF_PATHS, draw_sdof_paths), names, strict=True):
        figures.append(picture._replace(name=f"{SDOF_FIGURE.get(name, 'fig04-05')}_{picture.name}"))
    for figure, shows, draw in BRAKE_FIGURES:
        for brake, ending in zip(brakes, endings, strict=True):
            figures.append(Picture(figure + ending, f"{shows}: {brake.name}", partial(draw, brake)))
    figures += of_each_device("fig11_spring_release", RELEASES, draw_releases)
    figures += [
        Picture("fig12_velocity_field", "desired directions around the path y = 40 cm", draw_velocity_field),
        Picture("fig13_sdof_selection", selection, partial(draw_sdof_choice, most_brakes)),
        Picture("fig14_proportional_selection", five_forces, draw_five_forces),
    ]
    figures += of_each_device("passive_master", PASSIVE_MASTER, draw_passive_master)
    scooter = Picture("scooter", "Scooter with free castors, along a path and at a wall", draw_scooter)
    return [*figures, stopping, scooter]


def pictures_of_map(which: str, devices: Sequence[Device]) -> list[Picture]:
    """One of `MAPS` for some devices, beside each other."""
    shows = f"{which} across the motion over the workspace: {', '.join(device.name for device in devices)}"
    return [Picture(f"map_{which}", shows, partial(draw_map, MAPS[which], devices))]


def _slugs(names: Iterable[str]) -> list[str]:
    """Names as parts of file names, all different."""
    slugs: list[str] = []
    for name in names:
        slug = re.sub(r"[^A-Za-z0-9._-]+", "-", name)
        slugs.append(f"{slug}-{len(slugs) + 1}" if slug in slugs else slug)
    return slugs


def draw_all(
    devices: Sequence[Device], out_folder: str | Path, which_map: str | None = None, progress: Progress = no_progress
) -> list[Drawn]:
    """Draw every figure, or one map alone, as PNG and PDF into a folder; the same devices give the same bytes.

    InputError, and no file left behind, if one of the files exists already or the folder cannot be written.
    `progress` gets the share done (0 to 1).
    """
    folder = Path(out_folder)
    wanted = pictures_of_map(which_map, devices) if which_map else pictures(devices)
    drawn = [Drawn(p.name, p.shows, [folder / f"{p.name}.{form}" for form in FORMS]) for p in wanted]
    files = [file for figure in drawn for file in figure.files]
    refuse_existing_files(files)
    with refusing(folder, "the figures cannot be written"):
        folder.mkdir(parents=True, exist_ok=True)  # before the drawing: what would be refused after it
    contents: list[bytes] = []
    for k, picture in enumerate(wanted):
        with matplotlib.rc_context(STYLE):
            figure = picture.draw()
        contents += [figure_bytes(figure, form) for form in FORMS]
        progress((k + 1) / len(wanted))
    write_new_files(dict(zip(files, contents, strict=True)))
    return drawn
