"""Stands in for experiments.protocol and the session that knows it, until they are here; then this file goes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from core.control import PRESETS
from core.device import load_device
from core.path_file import Segment
from experiments import plan as plans
from experiments import session as today
from experiments.journal import write_event
from experiments.session_files import open_trials, read_stored, rows_of, sessions_in
from experiments.trial import MouseHand, Trial


@dataclass(frozen=True)
class Protocol:
    name: str
    devices: tuple
    paths: dict
    controllers: dict
    rules: str
    low_gain: float
    seed: int
    mouse: MouseHand
    trial: Any = None
    breaks: Any = None
    cues: Any = None
    feedback: str = "none"
    show_linkage: bool = False
    questionnaire: bool = False
    blind: bool = False
    participants: tuple = ()

    @property
    def assumed(self):
        return any(device.assumed for device in self.devices)

    def note(self):
        return today.Choices(self.seed, self.rules, self.low_gain).note(self.assumed)

    def device(self, name):
        return next(device for device in self.devices if device.name == name)


def load_protocol(name_or_path="paper", *, devices=None, rules=None, low_gain=None, seed=None):
    loaded = tuple(load_device(d) for d in devices or ("three-brake", "four-brake"))
    paths = {number: Segment(s.start, s.end) for number, s in plans.SEGMENTS.items()}
    return Protocol(
        "paper",
        loaded,
        paths,
        dict(PRESETS),
        rules or "settled",
        low_gain or 5.0,
        1 if seed is None else seed,
        MouseHand(),
    )


def new_trial(simulation, planned, path_file, preset, rules, trial_rules, person=None, generator=None):
    segment = plans.Segment(path_file.start_m, path_file.end_m)
    return Trial(simulation, planned, segment, rules, 5.0, person, generator)


def unfinished_sessions(data_dir: Path):
    found = []
    for folder in sessions_in(data_dir) if data_dir.is_dir() else []:
        if (folder / "session.json").exists() and open_trials(read_stored(folder).plan, rows_of(folder)):
            found.append(folder.parent.name.removeprefix("sub-"))
    return found


class Session(today.Session):
    break_due = False
    blind = False
    practice = ()

    def __init__(self, data_dir, participant, protocol, person=None, sync=True, blind=None):
        choices = today.Choices(protocol.seed, protocol.rules, protocol.low_gain)
        super().__init__(data_dir, participant, protocol.devices, choices, person, sync)

    @property
    def protocol(self):
        return load_protocol(devices=tuple(self.devices), rules=self.choices.rules, seed=self.choices.seed)

    def next_practice(self):
        return self.next_planned()._replace(run=0, block=0)

    def begin(self, planned):
        if planned.block:
            return super().begin(planned)
        raise NotImplementedError

    def note(self, text):
        self.journal("note", text=text)

    def skip(self, reason):
        raise NotImplementedError

    def redo(self, run, reason):
        raise NotImplementedError


__all__ = ["Session", "load_protocol", "new_trial", "unfinished_sessions", "np", "write_event"]
