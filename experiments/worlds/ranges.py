"""Ranges files: what each assumption of a simulated study may be, and the worlds that are drawn from them.

An assumption is a choice or number that a simulated study makes and the paper does not print; a world is one set of
assumptions. A range is {low, high} (`log = true`: even in the logarithm), a list of choices, or one value that all
worlds have, with its source ("assumed" where nothing stands behind it). Where every range is one value, worlds differ
in their people alone. The tables of a file, and what their keys are:

    [rules] [population]    the range itself: rule sets; populations, shipped or files
    [assumptions.KEY]       a key of the table [assumptions] of protocols
    [operator.KEY]          a number of a population file, for everyone
    [operator_factor.KEY]   a factor on it; KEY may be how several begin: `stiffness`
    [device."TABLE.KEY"]    a number of the device files that have it, as "mass.joint_C_kg"
"""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from scipy.stats.qmc import LatinHypercube

from core.files import InputError, Table, parse_toml, read_text, shipped_or_file, toml_text
from experiments.assumptions import Assumptions
from experiments.protocol import Protocol, load_protocol, protocol_from_json, protocol_to_json
from experiments.protocol_file import Count, Text
from experiments.study.jobs import local_or_shipped
from experiments.trial.operator import Person
from experiments.trial.population import Population, load_population, population_of

SHIPPED_FOLDER = Path(__file__).resolve().parent / "ranges"
DIGITS = 6  # of a number that is drawn
Value = str | float | int | bool


class AssumptionRange(Table, frozen=True):
    """The values that an assumption may take (one, {low, high} or choices), and their source."""

    source: Text
    value: Value | None = None  # the same in all worlds
    low: float | None = None
    high: float | None = None
    log: bool = False
    choices: Annotated[tuple[Value, ...], msgspec.Meta(min_length=2)] | None = None
    settled_by: str = ""  # what would settle it
    label: str = ""  # in reports and pictures, with its unit

    def __post_init__(self) -> None:
        given = [key for key in ("value", "low", "high", "choices") if getattr(self, key) is not None]
        if given not in (["value"], ["low", "high"], ["choices"]):
            raise ValueError("must hold value, or low and high, or choices")
        if self.log and self.low is None:
            raise ValueError("log is for low and high alone")
        if self.choices is not None and len(set(self.choices)) < len(self.choices):
            raise ValueError("choices must differ")
        if self.low is not None and self.high is not None:
            if not self.low < self.high:
                raise ValueError(f"low ({self.low:g}) must be less than high ({self.high:g})")
            if self.log and not self.low > 0.0:
                raise ValueError(f"low must be greater than 0 where log is true, not {self.low:g}")

    def at(self, share: float) -> Value:
        """The value at this share (0 .. 1) of the range."""
        if self.value is not None:
            return self.value
        if self.choices is not None:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        assert self.low is not None and self.high is not None
        if self.log:
            return float(f"{self.low * (self.high / self.low) ** share:.{DIGITS}g}")
        return float(f"{self.low + share * (self.high - self.low):.{DIGITS}g}")

    @property
    def ends(self) -> tuple[Value, ...]:
        """The ends of the range: if both make a study, the whole range does."""
        return self.choices if self.choices is not None else tuple(dict.fromkeys((self.at(0.0), self.at(1.0))))


class RangesFile(Table, frozen=True):
    """A ranges file as it stands."""

    name: Text
    protocol: Text = "paper"
    operators: Count = 3
    rules: AssumptionRange | None = None
    population: AssumptionRange | None = None
    assumptions: dict[str, AssumptionRange] = {}
    operator: dict[str, AssumptionRange] = {}
    operator_factor: dict[str, AssumptionRange] = {}
    device: dict[str, AssumptionRange] = {}


@dataclass(frozen=True)
class Ranges:
    """A ranges file, checked: every end of every range makes a study that can be run."""

    name: str
    text: str
    protocol: Protocol
    operators: int
    populations: Mapping[str, str]  # name in the file -> the population file in full
    ranges: Mapping[str, AssumptionRange]  # by column: "rules", "assumptions.low_gain", ..
    fixed: Mapping[str, AssumptionRange]  # those with one value, by the same names; no columns

    def drawn(self, n: int, seed: int) -> np.ndarray:
        """The shares (n, ranges) at which n worlds lie: a Latin hypercube."""
        if not self.ranges:
            return np.empty((n, 0))
        return LatinHypercube(len(self.ranges), rng=np.random.default_rng(seed)).random(n)

    @property
    def labels(self) -> list[str]:
        """The assumptions in words, in the order of `ranges`."""
        return [self.label(column) for column in self.ranges]

    def label(self, column: str) -> str:
        """An assumption in words."""
        assumption = self.ranges.get(column) or self.fixed[column]
        return assumption.label or column.rpartition(".")[2].replace("_", " ")

    def values(self, shares: Sequence[float]) -> dict[str, Value]:
        """The assumptions of a world at these shares, by column."""
        pairs = zip(self.ranges.items(), shares, strict=True)
        return {name: assumption.at(float(share)) for (name, assumption), share in pairs}

    def study(self, values: Mapping[str, Value], seed: int) -> tuple[Protocol, Population]:
        """What `phd study` would run for a world; columns that are left out are as in the files. InputError if wrong"""
        tables: dict[str, dict[str, Value]] = {}
        for column, value in (
            {column: assumption.at(0.0) for column, assumption in self.fixed.items()} | dict(values)
        ).items():
            table, _, key = column.partition(".")
            tables.setdefault(table, {})[key] = value
        where = f"world of {self.name}"
        overrides = self.protocol.overrides | {"seed": seed}
        if "rules" in tables:
            overrides["rules"] = tables["rules"][""]
        if "assumptions" in tables:
            plain = msgspec.to_builtins(self.protocol.assumptions)
            overrides["assumptions"] = {**plain, **tables["assumptions"]}
        about = {**protocol_to_json(self.protocol), "overrides": overrides}
        if "device" in tables:
            about["devices"] = [
                {**device, "file": _changed_device(device["file"], tables["device"])} for device in about["devices"]
            ]
        chosen = str(tables["population"][""]) if "population" in tables else next(iter(self.populations))
        text = self.populations[chosen]
        if "operator" in tables or "operator_factor" in tables:
            text = _changed_people(text, tables.get("operator", {}), tables.get("operator_factor", {}))
        return protocol_from_json(about, where), population_of(text, f"{where}: population {chosen}")


def load_ranges(name_or_path: str | Path) -> Ranges:
    """Shipped ranges by name, or a file. InputError, one sentence with file and key, for what cannot be run."""
    path = shipped_or_file(name_or_path, SHIPPED_FOLDER, Path(), "unknown ranges")
    text = read_text(path)
    file = parse_toml(text, RangesFile, str(path))
    given = {table: assumption for table in ("rules", "population") if (assumption := getattr(file, table)) is not None}
    for table in ("assumptions", "operator", "operator_factor", "device"):
        given |= {f"{table}.{key}": assumption for key, assumption in getattr(file, table).items()}
    if not given:
        raise InputError(f"{path}: holds no range")
    names = [str(population) for population in file.population.ends] if file.population else ["average"]
    populations = {name: load_population(local_or_shipped(path, name)).text for name in names}
    ranges = {column: assumption for column, assumption in given.items() if assumption.value is None}
    fixed = {column: assumption for column, assumption in given.items() if assumption.value is not None}
    protocol = load_protocol(local_or_shipped(path, file.protocol))
    found = Ranges(file.name, text, protocol, file.operators, populations, ranges, fixed)
    for column, assumption in given.items():
        _check(replace(found, fixed={}), column, assumption, str(path))
    found.study({}, 0)
    return found


def _check(ranges: Ranges, column: str, assumption: AssumptionRange, where: str) -> None:
    """InputError unless each end of a range, with all else as in the files, makes a study."""
    table, _, key = column.partition(".")
    known: dict[str, Callable[[str], bool]] = {
        "assumptions": lambda name: name in Assumptions.__struct_fields__,
        "operator": lambda name: name in Person._fields,
        "operator_factor": lambda name: bool(_begin_with(name)),
        "device": lambda name: any(_number_at(tomllib.loads(d.text), name) for d in ranges.protocol.devices),
    }
    if table in known and not known[table](key):
        raise InputError(f"{where}: {column}: there is no such number of {table.replace('_', ', ')}")
    if table in ("rules", "population") and assumption.low is not None:
        raise InputError(f"{where}: {column}: must hold choices")
    for value in assumption.ends:
        for population in ranges.populations if table.startswith("operator") else (next(iter(ranges.populations)),):
            try:
                ranges.study({"population": population, column: value}, 0)
            except InputError as error:
                raise InputError(f"{where}: {column}: {value!r} cannot be: {error}") from None


def _changed_device(text: str, numbers: Mapping[str, Value]) -> str:
    """A device file with these numbers in place of its own, where it has them."""
    content = tomllib.loads(text)
    holders = {name: holder for name in numbers if (holder := _number_at(content, name))}
    for name, holder in holders.items():
        holder[name.rpartition(".")[2]] = numbers[name]
    return toml_text(content) if holders else text


def _number_at(content: dict[str, Any], name: str) -> dict[str, Any] | None:
    """The table of a file that holds this number; None: the file does not have it."""
    *tables, key = name.split(".")
    for table in tables:
        content = content.get(table, {})
        if not isinstance(content, dict):
            return None
    return content if isinstance(content.get(key), int | float) else None


def _changed_people(text: str, numbers: Mapping[str, Value], factors: Mapping[str, Value]) -> str:
    """A population file with these numbers for everyone, and these factors on others."""
    content = tomllib.loads(text)
    for key, value in numbers.items():
        content[key] = {"value": value, "source": "assumed: of a world"}
    for beginning, factor in factors.items():
        for key in (name for name in _begin_with(beginning) if name in content):
            spread = content[key]
            scaled = {key: float(factor) * number for key, number in spread.items() if key != "source"}
            content[key] = {**scaled, "source": f"assumed: {factor:g} times {spread['source']}"}
    return toml_text(content)


def _begin_with(name: str) -> list[str]:
    return [key for key in Person._fields if key == name or key.startswith(f"{name}_")]
