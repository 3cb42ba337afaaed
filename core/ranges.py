"""Plausible ranges of the quantities in input files, each declared here and nowhere else.

A number beyond `least` .. `most` is refused: nothing can come of it but overflow, or a run without end. One beyond
`usual` is only strange: it is taken, and a warning says which unit was probably meant. Our choice throughout: `usual`
holds every planar device that stands on a table, `most` whatever the integrators still carry.
"""

import functools
import math
import types
import typing
from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple, Union

import msgspec


class Range(NamedTuple):
    """The plausible range of a quantity, in its unit; with a negative `least` both bounds are of the size."""

    unit: str
    least: float
    most: float
    usual: tuple[float, float]  # sizes; 0 is never strange
    meant: tuple[tuple[str, float], ...]  # other units, as multiples of this one: what may have been meant

    def refusal(self, value: float) -> str:
        """What the number must be; empty where it is within the range."""
        if self.least <= value <= self.most:
            return ""
        bound, limit = ("at least", self.least) if not value >= self.least else ("at most", self.most)
        return f"must be {bound} {limit:g} {self.unit}, not {value:g}"

    def doubt(self, value: float) -> str:
        """What is strange about the number, and what was probably meant; empty where nothing is."""
        low, high = self.usual
        if value == 0.0 or low <= abs(value) <= high:
            return ""
        for unit, factor in self.meant:
            if low <= abs(value) * factor <= high:
                return f"{value:g} {self.unit} is strange; if {value:g} {unit} is meant, write {value * factor:g}"
        return f"{value:g} {self.unit} is strange: usual is from {low:g} to {high:g} {self.unit}"


_SMALLER_LENGTHS = (("mm", 1e-3), ("cm", 1e-2), ("um", 1e-6))
_DEGREES = (("degrees", math.pi / 180.0),)

LENGTH = Range("m", 1e-3, 1e3, (0.01, 3.0), _SMALLER_LENGTHS)  # of a link
PLACE = Range("m", -1e3, 1e3, (0.0, 5.0), _SMALLER_LENGTHS)  # a coordinate
SMALL_LENGTH = Range("m", 0.0, 1e3, (0.0, 0.3), _SMALLER_LENGTHS)  # a radius around a place, a gap
MASS = Range("kg", 0.0, 1e4, (1e-6, 10.0), (("g", 1e-3),))
MASS_OF_A_COBOT = Range("kg", 1e-3, 1e5, (0.1, 500.0), (("g", 1e-3),))
INERTIA = Range("kg m2", 0.0, 1e4, (0.0, 1.0), (("kg cm2", 1e-4), ("kg mm2", 1e-6), ("g cm2", 1e-7)))
INERTIA_OF_A_COBOT = Range("kg m2", 1e-6, 1e5, (1e-3, 500.0), (("kg cm2", 1e-4), ("kg mm2", 1e-6), ("g cm2", 1e-7)))
FORCE = Range("N", -1e5, 1e5, (0.0, 1e3), (("mN", 1e-3),))
TORQUE = Range("N m", -1e5, 1e5, (0.0, 100.0), (("N mm", 1e-3),))
YIELD = TORQUE._replace(usual=(0.0, 1e3))  # of an ideal brake, which a large one locks
SPEED = Range("m/s", -100.0, 100.0, (0.0, 10.0), (("mm/s", 1e-3), ("cm/s", 1e-2)))
CURRENT = Range("A", 1e-6, 1e4, (1e-3, 50.0), (("mA", 1e-3),))
TIME_CONSTANT = Range("s", 1e-6, 1e6, (1e-5, 1.0), (("ms", 1e-3),))
STEP = Range("s", 1e-9, 1.0, (0.0, 0.05), (("ms", 1e-3), ("us", 1e-6)))
ANGLE = Range("rad", -1e3, 1e3, (0.0, 2.0 * math.pi), _DEGREES)
RATE = Range("rad/s", 1e-3, 1e4, (0.05, 200.0), (("degrees/s", math.pi / 180.0),))  # of a servo


def _within(allowed: Range, least: float | None = None) -> msgspec.Meta:
    """For `Annotated[float, ..]`: numbers of a range. least: its lower bound, if it is another one here."""
    return msgspec.Meta(ge=allowed.least if least is None else least, le=allowed.most, extra={"range": allowed})


# the types of the keys of files
Length = Annotated[float, _within(LENGTH)]
Coordinate = Annotated[float, _within(PLACE)]
Place = tuple[Coordinate, Coordinate]
SmallLength = Annotated[float, _within(SMALL_LENGTH)]
Radius = Annotated[float, _within(SMALL_LENGTH, 1e-6)]
BodyMass = Annotated[float, _within(MASS)]
Inertia = Annotated[float, _within(INERTIA)]
Force = Annotated[float, _within(FORCE)]
Push = Annotated[float, _within(FORCE, 1e-6)]  # a force without a direction
Torque = Annotated[float, _within(TORQUE)]
Held = Annotated[float, _within(YIELD, 0.0)]  # a torque that a brake can hold
Speed = Annotated[float, _within(SPEED)]
Current = Annotated[float, _within(CURRENT)]
TableCurrent = Annotated[float, _within(CURRENT, 0.0)]  # of a point of a torque table
LagTime = Annotated[float, _within(TIME_CONSTANT)]
Step = Annotated[float, _within(STEP)]
Angle = Annotated[float, _within(ANGLE)]
Rate = Annotated[float, _within(RATE)]
CobotMass = Annotated[float, _within(MASS_OF_A_COBOT)]
CobotInertia = Annotated[float, _within(INERTIA_OF_A_COBOT)]


_fields_of = functools.cache(msgspec.structs.fields)


def strange(value: Any, kind: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """The strange numbers of a value: the key of each, and what was probably meant.

    kind: the type of the value, as its field declares it; a table has its own. key: of the value, in the file.
    """
    if isinstance(value, msgspec.Struct):
        for field in _fields_of(type(value)):
            inner = field.encode_name
            yield from strange(getattr(value, field.name), field.type, f"{key}.{inner}" if key else inner)
        return
    origin, inside = typing.get_origin(kind), typing.get_args(kind)
    if origin is Annotated:
        ranges = [meta.extra["range"] for meta in inside[1:] if isinstance(meta, msgspec.Meta) and meta.extra]
        if ranges and isinstance(value, float | int) and (doubt := ranges[0].doubt(value)):
            yield key, doubt
        elif not ranges:
            yield from strange(value, inside[0], key)
    elif origin in (Union, types.UnionType):
        for member in inside:
            yield from strange(value, member, key)
    elif isinstance(value, tuple | list) and inside:
        several = inside[:1] * len(value) if len(inside) == 1 or inside[-1] is Ellipsis else inside
        for i, (entry, its_kind) in enumerate(zip(value, several, strict=True)):
            yield from strange(entry, its_kind, f"{key}[{i}]")
