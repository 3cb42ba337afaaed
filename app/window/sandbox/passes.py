"""The passes of Try as rows: one a setting, with the newest pass of each device."""

from collections.abc import Sequence
from typing import NamedTuple

from app.ipc import messages as m
from app.window.sandbox.controls import preset_of
from app.window.sandbox.dials import DIALS, Dial, dials_of
from experiments.plan import grouped
from experiments.protocol import Protocol


class SettingRow(NamedTuple):
    """A setting, and its newest pass on each device."""

    controller: int
    name: str
    setting: str  # what the controller's parameters are, and what else differs from the protocol
    path: int
    late: bool  # the time was up: its measures are of another part of the path
    passes: dict[str, m.Pass]  # device -> its newest pass


def rows_of(passes: Sequence[m.Pass], protocol: Protocol) -> list[SettingRow]:
    """Passes, the newest last -> rows, that of the newest pass first."""
    rows: dict[tuple, SettingRow] = {}
    for ended in reversed(passes):
        s = ended.settings
        setting, name = setting_of(ended, protocol), protocol.controllers[s.controller].name
        row = SettingRow(s.controller, name, setting, s.path, ended.status == "timeout", {})
        row = rows.setdefault(row[:-1], row)
        row.passes.setdefault(s.device, ended)
    return list(rows.values())


def setting_of(ended: m.Pass, protocol: Protocol) -> str:
    """What tells the settings of a controller apart: "gap 5 mm", "10 000 N s/m, literal rules, changed on the way"."""
    s, own = ended.settings, preset_of(ended.settings, protocol.controllers)
    parts = [
        words_of(dial, s)
        for dial in dials_of(protocol)
        if (dial.name in own.named and own.named[dial.name] != 0.0)
        or (dial in DIALS and dial.setting(s) != dial.setting(ended.initial))
    ]
    parts += [f"{getattr(s, name)} {name}" for name in ("rules", "sensing")
              if getattr(s, name) != getattr(ended.initial, name)]  # fmt: skip
    parts += ["changed on the way"] if ended.changed else []
    return ", ".join(parts)


def words_of(dial: Dial, s: m.SandboxSettings) -> str:
    """ "gap 5 mm"; a gain is known by its unit."""
    shown = f"{grouped(float(f'{dial.setting(s) * dial.scale:.4g}'))} {dial.unit}"
    return shown if dial.label == "Gain" else f"{dial.label.lower()} {shown}"


def about(ended: m.Pass, protocol: Protocol) -> str:
    """All settings of a pass, and how long it took."""
    s, took = ended.settings, ended.measures["duration_s"]
    seconds = f", {took:.1f} s" if took is not None else ""
    dials = ", ".join(words_of(dial, s) for dial in dials_of(protocol))
    return f"Pass {ended.number}{seconds}; {s.device}, path {s.path}, {s.rules} rules, {s.sensing} sensing, {dials}"
