"""The format of sweep files, and the cells that one spans: every controller x device x population x rule set.

    name = "gap and gain"
    protocol = "paper"                  # its paths and rules of a trial; devices and rules where they are left out here
    operators = 10                      # people in each cell, the same ones in all
    repetitions = 3                     # of each path, by each of them
    populations = ["average"]
    devices = ["three-brake"]           # names, or paths from the sweep file's folder
    [[controller]]                      # lists are swept, all combinations of them
    kind = "sdof"
    gap_m = [0.0, 0.0025, 0.005]
"""

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec

from core.control.controllers import KINDS, Preset
from core.control.rule_sets import RULE_SETS
from core.device import Device
from core.errors import InputError
from core.files import NotNegative, Positive, Table, one_of, parse_toml, read_text
from core.path_file import PathFile
from experiments.protocol import load_protocol
from experiments.protocol_file import Count, Text, TrialRules, plain_text
from experiments.trial.population import Population, load_population

Names = Annotated[tuple[Text, ...], msgspec.Meta(min_length=1)]
MOST_JOBS = 1_000_000


class SweptController(Table, frozen=True):
    """One algorithm, each parameter with every value that it is to have."""

    kind: str
    gap_m: Annotated[tuple[NotNegative, ...], msgspec.Meta(min_length=1)] = (0.0,)
    gain_N_s_m: tuple[Positive, ...] = ()  # of "proportional" alone

    def __post_init__(self) -> None:
        one_of(self.kind, tuple(KINDS), "kind")
        if (self.kind == "proportional") != bool(self.gain_N_s_m):
            raise ValueError(f"gain_N_s_m is {'not for' if self.gain_N_s_m else 'required for'} {self.kind!r}")
        if self.kind == "none" and self.gap_m != (0.0,):
            raise ValueError("gap_m is not for 'none', which never controls")

    def presets(self) -> list[Preset]:
        """Every combination of its values."""
        combinations = itertools.product(self.gap_m, self.gain_N_s_m or (0.0,))
        return [Preset(self.kind, KINDS[self.kind], float(gap), float(gain)) for gap, gain in combinations]


class SweepFile(Table, frozen=True):
    """One sweep as its file says it."""

    name: Text
    controller: Annotated[tuple[SweptController, ...], msgspec.Meta(min_length=1)]
    protocol: Text = "paper"
    operators: Count = 3
    repetitions: Count = 3
    seed: Annotated[int, msgspec.Meta(ge=0)] = 1
    populations: Names = ("average",)
    devices: Names | None = None
    rules: Names | None = None

    def __post_init__(self) -> None:
        plain_text(self.name, "name")
        for one in self.rules or ():
            one_of(one, tuple(RULE_SETS), "rules")
        for key in ("populations", "devices", "rules"):
            values = getattr(self, key) or ()
            if len(set(values)) < len(values):
                raise ValueError(f"{key}: the same one stands there twice")


@dataclass(frozen=True)
class Job:
    """What one process does at a time: every path and repetition of one person in one cell."""

    number: int  # in the order of the table
    preset: Preset
    device: Device
    population: Population
    rules: str
    operator: int
    seed: int
    repetitions: int
    paths: dict[int, PathFile]
    trial: TrialRules


@dataclass(frozen=True)
class Sweep:
    """A sweep, checked and spread out."""

    name: str
    texts: dict[str, str]  # every file that decides it, in full
    assumed: bool
    jobs: tuple[Job, ...]


def load_sweep(path: Path) -> Sweep:
    """The sweep of a file. InputError, one sentence with file and key, for anything that cannot be run."""
    text = read_text(path)
    file = parse_toml(text, SweepFile, str(path))
    devices = None if file.devices is None else [_beside(path, name) for name in file.devices]
    protocol = load_protocol(_beside(path, file.protocol), devices=devices)
    populations = [load_population(_beside(path, name)) for name in file.populations]
    for key, names in (("populations", [one.name for one in populations]),):
        if len(set(names)) < len(names):
            raise InputError(f"{path}: {key}: two have the same name ({', '.join(names)})")
    presets = [preset for controller in file.controller for preset in controller.presets()]
    if len(set(presets)) < len(presets):
        raise InputError(f"{path}: controller: the same controller stands there twice")
    rules = file.rules or (protocol.rules,)
    cells = itertools.product(populations, protocol.devices, rules, presets, range(1, file.operators + 1))
    count = len(populations) * len(protocol.devices) * len(rules) * len(presets) * file.operators
    if count > MOST_JOBS:
        raise InputError(f"{path}: {count} people in cells are more than the {MOST_JOBS} that one sweep may have")
    jobs = tuple(
        Job(number, preset, device, population, ruled, operator, file.seed, file.repetitions, protocol.paths,
            protocol.trial)
        for number, (population, device, ruled, preset, operator) in enumerate(cells, start=1)
    )  # fmt: skip
    texts = {"sweep": text, f"protocol {protocol.name}": protocol.text}
    texts |= {f"population {one.name}": one.text for one in populations}
    for device in protocol.devices:
        texts |= {f"device {device.name}": device.text}
        texts |= {f"brake {name} of {device.name}": brake for name, brake in device.brake_texts.items()}
    assumed = protocol.assumed or any(one.assumed for one in populations)
    return Sweep(file.name, texts, assumed, jobs)


def _beside(path: Path, name: str) -> str | Path:
    """A file beside the sweep's where there is one of that name, else the shipped thing of that name."""
    there = path.parent / name
    return there if there.is_file() else name
