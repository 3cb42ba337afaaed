"""Numbers as people read them: "10" and never "1e+01", "0" and never "-0", "15 %" with its space."""

from collections.abc import Iterable, Sequence


def significant(value: float, digits: int = 3) -> str:
    """A number of so many digits; powers of ten only from a million on and below 0.0001."""
    rounded = float(f"{value:.{digits}g}") + 0.0  # -0.0 + 0.0 is 0.0
    return f"{rounded:.{max(digits, 6)}g}"


def fixed(value: float, decimals: int, sign: str = "") -> str:
    """A number with so many decimals; sign "+": also before a positive one."""
    return f"{round(value, decimals) + 0.0:{sign}.{decimals}f}"


def percent(share: float, decimals: int = 0, sign: str = "") -> str:
    """A share (0 .. 1) in percent."""
    return f"{fixed(100.0 * share, decimals, sign)} %"


def in_words(parts: Iterable[str]) -> str:
    """ "a, b and c"."""
    *first, last = [*parts] or [""]
    return f"{', '.join(first)} and {last}" if first else last


def place_cm(tip: Sequence[float], decimals: int = 0) -> str:
    """A place (m) in a figure, in cm, with the sign of mathematics."""
    x, y = (fixed(100.0 * coordinate, decimals).replace("-", "−") for coordinate in tip)
    return f"({x}, {y}) cm"
