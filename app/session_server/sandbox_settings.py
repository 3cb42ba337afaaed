"""The settings of Try: what they are before anyone changes one, and which cannot be."""

import math

import numpy as np

from app.ipc.messages import SandboxSettings
from core.control.rule_sets import RULE_SETS
from core.device import Device
from core.files import InputError
from core.path import build_path
from experiments.assumptions import SENSINGS
from experiments.protocol import Protocol

ONLY_SIMULATED = ("device", "spring_N_m", "brake_strength", "backlash_deg", "sensing")


def initial_settings(protocol: Protocol, device: Device, path: int) -> SandboxSettings:
    """The settings of protocol and device, with the first controller that brakes."""
    p = protocol
    number = min(p.controllers, key=lambda n: (p.controllers[n].kind == "none", n))
    values: dict[str, float] = {}  # each as the chosen controller has it, else the largest
    for preset in p.controllers.values():
        values |= {name: max(value, values.get(name, value)) for name, value in preset.named.items()}
    backlash_deg = float(np.degrees(device.brakes.play.max()))
    return SandboxSettings(
        device.name, path, number, {**values, **p.controllers[number].named}, p.rules, own_blend_width(p, path),
        p.mouse.stiffness_N_m, 1.0, round(backlash_deg, 6), p.assumptions.sensing,
    )  # fmt: skip


def own_blend_width(protocol: Protocol, path: int) -> float:
    """The blend width of a path of the protocol, m."""
    return build_path(protocol.paths[path], "path").blend_width


def refuse_unknown(settings: SandboxSettings, protocol: Protocol) -> None:
    """InputError for a choice that protocol or program does not have."""
    p = protocol
    for name, value, allowed in (
        ("device", settings.device, [device.name for device in p.devices]), ("path", settings.path, p.paths),
        ("controller", settings.controller, p.controllers), ("rules", settings.rules, RULE_SETS),
        ("sensing", settings.sensing, SENSINGS),
    ):  # fmt: skip
        if value not in allowed:
            raise InputError(f"Try: {name} {value!r} is none of {', '.join(map(str, allowed))}.")


def refuse_impossible(settings: SandboxSettings, before: SandboxSettings, fixed: tuple[str, ...]) -> None:
    """InputError for parameters or numbers that cannot be, and for a change of a setting that is fixed."""
    if wrong := settings.values.keys() ^ before.values.keys():
        raise InputError(f"Try: {min(wrong)} is no parameter of this protocol's controllers, or is missing.")
    numbers = {name: getattr(settings, name) for name in ("spring_N_m", "brake_strength", "backlash_deg")}
    for name, number in (numbers | settings.values).items():
        if not 0.0 <= number < math.inf:
            raise InputError(f"Try: {name} {number!r} must be finite and not negative.")
    if not 0.0 < settings.blend_width_m < math.inf:
        raise InputError(f"Try: blend width {settings.blend_width_m!r} must be positive and finite, in m.")
    for name in fixed:
        if getattr(settings, name) != getattr(before, name):
            raise InputError(f"Try: {name} cannot be changed with this device and hand.")
