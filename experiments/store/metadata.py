"""Parts of the database and of the metadata of recordings: controllers, operators, versions, as JSON holds them."""

import importlib.metadata
import platform
from typing import Any

from core.control.controllers import ALGORITHMS, PARAMETERS, Preset
from core.own_files import OwnFile
from experiments.trial.population import Operators

LIBRARIES = ("numpy", "scipy", "numba", "pyarrow")


def preset_to_json(preset: Preset) -> dict[str, Any]:
    """A controller as plain words and numbers."""
    if preset.own is not None:
        own = {"sha256": preset.own.digest, "text": preset.own.text, "declared": preset.own.declared}
        return {"name": preset.name, "kind": preset.kind, "own": own, "parameters": list(preset.named.items())}
    return {"name": preset.name, "kind": preset.kind, **{name: preset.value(name) for name in PARAMETERS}}


def preset_from_json(about: dict[str, Any]) -> Preset:
    """A controller as a recording has it. KeyError if something is missing. No file of its own is run for it."""
    if "own" in about:
        values = {name: float(value) for name, value in about["parameters"]}
        own = OwnFile(about["kind"].removesuffix(".py"), about["own"]["text"], about["own"]["declared"])
        return Preset(about["name"], about["kind"], tuple(values.values()), own)
    names = [parameter.name for parameter in ALGORITHMS[about["kind"]].parameters]
    return Preset(about["name"], about["kind"], tuple(float(about[name]) for name in names))


def operators_from_json(about: dict[str, Any]) -> Operators | None:
    """The population of the simulated operator as stored; None: a person, or not stored."""
    stored = about.get("operators")
    return Operators(str(stored["population"]), tuple(stored["changed_after_findings"])) if stored else None


def versions() -> dict[str, str]:
    """The versions of this program, of Python, and of the libraries that decide numbers."""
    libraries = {name: version_of(name) for name in LIBRARIES}
    return {"phd": version_of("phd"), "python": platform.python_version(), **libraries}


def version_of(package: str) -> str:
    """The version of an installed package, or "not installed"."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
