"""Populations: who the simulated operators are. A file gives each of a person's numbers a spread and its source.

{value = 0.13, source = ".."}               everybody the same
{low = 150.0, high = 250.0, source = ".."}  anything in between, equally likely
{mean = 8.1, sd = 1.0, source = ".."}       normal, cut at the limits of the number (LIMITS)
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_args, get_type_hints

import msgspec
import numpy as np
import scipy  # its parts, of a second each, are loaded where they are first used

from core.files import Table, is_assumed, parse_toml, read_text, shipped_or_file
from experiments.trial.operator import Person

SHIPPED_FOLDER = Path(__file__).resolve().parent / "populations"
#: Aims well and is led off the path by the device alone: the paper's own explanation of Fig. 16.
USUAL = "from-device"

#: Least and most of each number, in its unit.
LIMITS: dict[str, tuple[float, float]] = {
    key: get_args(hint)[1] for key, hint in get_type_hints(Person, include_extras=True).items()
}


class Spread(Table, frozen=True):
    """How one number is spread over people: exactly one of the three forms, and where it comes from."""

    source: Annotated[str, msgspec.Meta(min_length=1)]
    value: float | None = None
    low: float | None = None
    high: float | None = None
    mean: float | None = None
    sd: float | None = None

    def quantile(self, share: float, limits: tuple[float, float]) -> float:
        """The number that this share (0 .. 1) of people does not exceed."""
        if self.value is not None:
            return self.value
        if self.low is not None and self.high is not None:
            return self.low + share * (self.high - self.low)
        assert self.mean is not None and self.sd is not None  # checked with the file
        if self.sd == 0.0:
            return self.mean
        least, most = (float(scipy.special.ndtr((limit - self.mean) / self.sd)) for limit in limits)
        number = self.mean + self.sd * float(scipy.special.ndtri(least + share * (most - least)))
        return min(max(number, limits[0]), limits[1])

    def check(self, limits: tuple[float, float]) -> None:
        """ValueError where the form is none of the three, upside down, or outside the limits."""
        given = [key for key in ("value", "low", "high", "mean", "sd") if getattr(self, key) is not None]
        if given not in (["value"], ["low", "high"], ["mean", "sd"]):
            raise ValueError(f"must hold value, or low and high, or mean and sd, not {', '.join(given) or 'none'}")
        for key in given:
            number = getattr(self, key)
            if key == "sd":
                if not 0.0 <= number <= limits[1] - limits[0]:
                    raise ValueError(f"sd must be between 0 and {limits[1] - limits[0]:g}, not {number:g}")
            elif not limits[0] <= number <= limits[1]:
                raise ValueError(f"{key} must be between {limits[0]:g} and {limits[1]:g}, not {number:g}")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"low ({self.low:g}) must not exceed high ({self.high:g})")


#: Numbers that files of an earlier version lack, as their operators had them.
EARLIER = {
    key: Spread(source="assumed: as every operator before this number came", value=value)
    for key, value in Person._field_defaults.items()
}


_Spreads: Any = msgspec.defstruct(
    "_Spreads", [(key, Spread, EARLIER[key]) if key in EARLIER else (key, Spread) for key in Person._fields],
    bases=(Table,), frozen=True, kw_only=True,
)  # fmt: skip


class PopulationFile(_Spreads, Table, frozen=True, kw_only=True):
    """A population file as it stands: a Spread for each field of Person, and its name."""

    name: Annotated[str, msgspec.Meta(min_length=1)]  # in reports
    changed_after_findings: tuple[str, ...] = ()  # what was set after findings were seen, a sentence each

    def __post_init__(self) -> None:
        for key, limits in LIMITS.items():
            try:
                getattr(self, key).check(limits)
            except ValueError as error:
                raise ValueError(f"{key}: {error}") from None


class Operators(NamedTuple):
    """The population of a simulated operator, as session and recordings store it."""

    population: str
    changed_after_findings: tuple[str, ...]

    @property
    def label(self) -> str:
        """The operators' name on a figure."""
        return f"simulated operators (population {self.population})"

    @property
    def note(self) -> str:
        """The operators' name in a report, with the numbers that were tuned after results were seen."""
        changed = "; ".join(self.changed_after_findings) or "nothing"
        return f"simulated operators ({self.population} population; changed after findings were looked at: {changed})"


@dataclass(frozen=True)
class Population:
    """People to draw simulated operators from."""

    name: str
    text: str  # the file in full
    spreads: dict[str, Spread]
    changed_after_findings: tuple[str, ...] = ()

    @property
    def operators(self) -> Operators:
        """The population as session and figures name it."""
        return Operators(self.name, self.changed_after_findings)

    @property
    def assumed_of(self) -> tuple[str, ...]:
        """Whether some of its numbers are assumed, as `Protocol.assumed_of`: marked wherever they are shown."""
        return ("people",) if any(is_assumed(spread.source) for spread in self.spreads.values()) else ()

    def draw(self, generator: np.random.Generator) -> Person:
        """A person at random. The same draws pick the same place in every population's spreads."""
        shares = generator.random(len(Person._fields))
        drawn = zip(Person._fields, shares.tolist(), strict=True)
        return Person(*(self.spreads[key].quantile(share, LIMITS[key]) for key, share in drawn))


def load_population(name_or_path: str | Path = USUAL) -> Population:
    """A shipped population, or one from a file. InputError names file, key and reason."""
    path = shipped_or_file(name_or_path, SHIPPED_FOLDER, Path(), "unknown population")
    return population_of(read_text(path), str(path))


def population_of(text: str, where: str) -> Population:
    """A population from the text of its file, as a study stores it; `where` names the file in refusals."""
    content = parse_toml(text, PopulationFile, where)
    spreads = {key: getattr(content, key) for key in Person._fields}
    return Population(content.name, text, spreads, content.changed_after_findings)
