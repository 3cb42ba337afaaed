"""Ranges files: what each number and choice that the paper does not print may be, and the samples drawn from them.

A sample is one value of each range. A range is {low, high} (`log = true`: even in the logarithm), a list of choices, or
one value that all samples have, with its source ("assumed" where nothing stands behind it). The tables of a file, and
what their keys are:

    [rules] [population]        the range itself: rule sets; populations, shipped or files, or "mixed"
    [assumptions.KEY]           a key of the table [assumptions] of protocols
    [operator.KEY]              a number of a population file, for everyone
    [operator_factor.KEY]       a factor on it; KEY may be how several begin: `stiffness`
    [device."TABLE.KEY"]        a number of the device files that have it, as "mass.joint_C_kg"
    [device_factor."PATTERN"]   a factor on all numbers of the device files that match, as "geometry.L_*"; links then
                                count as uniform rods, whose centre and inertia follow from length and mass
    [path."NUMBER.KEY"]         x_m, y_m (the middle of a straight path), length_m or angle_deg. A path that a device
                                cannot reach moves to the middle of the workspaces, and is then shortened, until it can
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from SALib.sample import latin

from core.files import InputError, Table, parse_toml, read_text, shipped_or_file
from experiments.assumptions import Assumptions
from experiments.protocol import Protocol, load_protocol, protocol_from_json, protocol_to_json
from experiments.protocol_file import Count, Text
from experiments.sensitivity.changed_files import changed_devices, changed_paths, changed_people, names_in
from experiments.study.jobs import local_or_shipped
from experiments.trial.operator import Person
from experiments.trial.population import USUAL, Population, load_population, population_of

SHIPPED_FOLDER = Path(__file__).resolve().parent / "ranges"
DIGITS = 6  # of a number that is drawn
MIXED = "mixed"  # each person is of one of the file's populations, in turn
Value = str | float | int | bool


class AssumptionRange(Table, frozen=True):
    """The values that an assumption may take (one, {low, high} or choices), and their source."""

    source: Text
    value: Value | None = None  # the same in all samples
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

    name: Text  # in the report
    protocol: Text = "paper"  # a shipped one, or a path from this file's folder
    operators: Count = 3  # in each sample
    rules: AssumptionRange | None = None  # rule sets to choose from; none: the protocol's
    population: AssumptionRange | None = None  # populations to choose from; none: "from-device"
    assumptions: dict[str, AssumptionRange] = {}  # key of the protocol's assumptions -> range
    operator: dict[str, AssumptionRange] = {}  # key of a population -> range of the number
    operator_factor: dict[str, AssumptionRange] = {}  # key of a population -> range of a factor on it
    device: dict[str, AssumptionRange] = {}  # key of the device files, as "mass.joint_C_kg" -> range
    device_factor: dict[str, AssumptionRange] = {}  # pattern of such keys, as "geometry.L_*" -> range of a factor
    #: number of a straight path and "x_m", "y_m" (its middle), "length_m" or "angle_deg", as "1.x_m" -> range
    path: dict[str, AssumptionRange] = {}


#: The tables of a file that hold several ranges.
TABLES = ("assumptions", "operator", "operator_factor", "device", "device_factor", "path")


class SampledStudy(NamedTuple):
    """What `phd study` would run for a sample."""

    protocol: Protocol
    populations: tuple[Population, ...]  # of the people 1, 2, .., in turn


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

    def shares(self, n: int, seed: int) -> np.ndarray:
        """The shares (n, ranges) of the ranges at which n samples lie: a Latin hypercube."""
        if not self.ranges:
            return np.empty((n, 0))
        return latin.sample(problem(self.ranges), n, seed=np.random.default_rng(seed))

    @property
    def labels(self) -> list[str]:
        """The ranges in words, in their order."""
        return [self.label(column) for column in self.ranges]

    def label(self, column: str) -> str:
        """A range in words."""
        found = self.ranges.get(column) or self.fixed[column]
        return found.label or column.rpartition(".")[2].replace("_", " ")

    def values(self, shares: Sequence[float]) -> dict[str, Value]:
        """The values of a sample at these shares, by column."""
        pairs = zip(self.ranges.items(), shares, strict=True)
        return {name: assumption.at(float(share)) for (name, assumption), share in pairs}

    def study(self, values: Mapping[str, Value], seed: int) -> SampledStudy:
        """What `phd study` would run with these values; columns that are left out are as in the files.

        InputError if it cannot be run.
        """
        tables: dict[str, dict[str, Value]] = {}
        for column, value in ({name: of.at(0.0) for name, of in self.fixed.items()} | dict(values)).items():
            table, _, key = column.partition(".")
            tables.setdefault(table, {})[key] = value
        overrides = self.protocol.overrides | {"seed": seed}
        if "rules" in tables:
            overrides["rules"] = tables["rules"][""]
        if "assumptions" in tables:
            overrides["assumptions"] = {**msgspec.to_builtins(self.protocol.assumptions), **tables["assumptions"]}
        about = {**protocol_to_json(self.protocol), "overrides": overrides}
        about["devices"] = changed_devices(about["devices"], tables.get("device", {}), tables.get("device_factor", {}))
        if "path" in tables:
            about["text"] = changed_paths(about["text"], about["devices"], tables["path"])
        where = f"sample of {self.name}"
        chosen = str(tables["population"][""]) if "population" in tables else next(iter(self.populations))
        names = tuple(self.populations) if chosen == MIXED else (chosen,)
        numbers, factors = tables.get("operator", {}), tables.get("operator_factor", {})
        people = tuple(
            population_of(changed_people(self.populations[name], numbers, factors), f"{where}: population {name}")
            for name in names
        )
        return SampledStudy(protocol_from_json(about, where), people)


def problem(ranges: Mapping[str, AssumptionRange]) -> dict:
    """The ranges as SALib describes a problem: their shares, 0 to 1."""
    return {"num_vars": len(ranges), "names": list(ranges), "bounds": [[0.0, 1.0]] * len(ranges)}


def load_ranges(name_or_path: str | Path) -> Ranges:
    """Shipped ranges by name, or a file. InputError, one sentence with file and key, for what cannot be run."""
    path = shipped_or_file(name_or_path, SHIPPED_FOLDER, Path(), "unknown ranges")
    text = read_text(path)
    file = parse_toml(text, RangesFile, str(path))
    given = {table: assumption for table in ("rules", "population") if (assumption := getattr(file, table)) is not None}
    for table in TABLES:
        given |= {f"{table}.{key}": assumption for key, assumption in getattr(file, table).items()}
    if not given:
        raise InputError(f"{path}: holds no range")
    names = [str(name) for name in file.population.ends if name != MIXED] if file.population else [USUAL]
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
    known = {
        "assumptions": Assumptions.__struct_fields__,
        "operator": Person._fields,
        "operator_factor": [name[:end] for name in Person._fields for end in (*_ends_of_words(name), len(name))],
        "path": [f"{n}.{name}" for n in ranges.protocol.paths for name in ("x_m", "y_m", "length_m", "angle_deg")],
    }
    if table in known and key not in known[table]:
        raise InputError(f"{where}: {column}: there is no such number of {table.replace('_', ', ')}")
    if table.startswith("device") and not any(names_in(device.text, key) for device in ranges.protocol.devices):
        raise InputError(f"{where}: {column}: no device has such a number")
    if table in ("rules", "population") and assumption.low is not None:
        raise InputError(f"{where}: {column}: must hold choices")
    places = table in ("device", "device_factor", "path")  # what decides whether a path can be reached
    placed = {name: of.at(0.5) for name, of in ranges.ranges.items() if places and name.startswith("path.")}
    for value in assumption.ends:
        for population in ranges.populations if table.startswith("operator") else (next(iter(ranges.populations)),):
            try:
                ranges.study({**placed, "population": population, column: value}, 0)
            except InputError as error:
                raise InputError(f"{where}: {column}: {value!r} cannot be: {error}") from None


def _ends_of_words(name: str) -> list[int]:
    return [place for place, letter in enumerate(name) if letter == "_"]
