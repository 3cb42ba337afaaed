"""The paper's eleven qualitative statements (Sections V-B and VI), each as the claims that it makes.

What is compared with what; how a comparison is answered stands in `findings`. Our choices: "SDOF" reducing path error
means both without and with gap; "proportional" against "SDOF" overall means the mean of the two gains against the mean
of the two gaps; what four brakes gain is judged over the four controllers that brake.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from core.control.controllers import Preset
from experiments.analysis.participants import PAPER_CONFIGURATIONS

THREE, FOUR = PAPER_CONFIGURATIONS

BELOW, SIMILAR, AT_MOST = "below", "similar", "at most"

ERROR = ("path_error_m",)
FORCE = ("mean_tip_force_N", "force_over_progress_N")
ROUGHNESS = ("acceleration_dft_sum", "acceleration_weighted_rms_m_s2")
SHORT = {
    "path_error_m": "path error",
    "mean_tip_force_N": "force over time",
    "force_over_progress_N": "force over progress",
    "acceleration_dft_sum": "acceleration DFT sum",
    "acceleration_weighted_rms_m_s2": "acceleration rms",
}
CONTROLLER = {1: "none", 2: "SDOF", 3: "SDOF with gap", 4: "proportional high gain", 5: "proportional low gain"}
GROUP = {(2, 3): "SDOF, both", (4, 5): "proportional, both", (2, 3, 4, 5): "all controllers"}


class Claim(NamedTuple):
    """One thing to compare: `first` with `second`, by measures that must agree."""

    kind: str  # BELOW, SIMILAR, AT_MOST
    measures: tuple[str, ...]
    first: tuple[int, ...]  # controllers; several: their mean
    second: tuple[int, ...]
    spread: bool = False  # compare how far trials lie from the middle of the box, not the trials
    negligible: bool = False  # the band is 0.5 mm, not 15 %
    devices: tuple[str, str] | None = None  # first and second stand for these; None: same device, each in turn


class Statement(NamedTuple):
    """One of the paper's statements."""

    number: int
    text: str
    claims: tuple[Claim, ...]


def _each(kind: str, measures: tuple[str, ...], pairs: Sequence[tuple[int, int]], **more: bool) -> tuple[Claim, ...]:
    return tuple(Claim(kind, measures, (a,), (b,), **more) for a, b in pairs)


def _devices(kind: str, measures: tuple[str, ...], controllers: tuple[int, ...], **more: bool) -> Claim:
    return Claim(kind, measures, controllers, controllers, devices=(THREE, FOUR), **more)


_CONTROLLED = (2, 3, 4, 5)
STATEMENTS = (
    Statement(1, "SDOF control (without and with gap) reduces path error", _each(BELOW, ERROR, [(2, 1), (3, 1)])),
    Statement(2, "Proportional control reduces path error at either gain", _each(BELOW, ERROR, [(4, 1), (5, 1)])),
    Statement(
        3,
        "SDOF with gap is the most consistent in accuracy",
        _each(BELOW, ERROR, [(3, 1), (3, 2), (3, 4), (3, 5)], spread=True),
    ),
    Statement(4, "The gap makes SDOF smoother", _each(BELOW, ROUGHNESS, [(3, 2)])),
    Statement(5, "The gap lowers the force of SDOF", _each(BELOW, FORCE, [(3, 2)])),
    Statement(6, "The gap costs a negligible amount of accuracy", _each(AT_MOST, ERROR, [(3, 2)], negligible=True)),
    Statement(
        7,
        "The low gain lowers force and is smoother, with little change in accuracy",
        _each(BELOW, FORCE, [(5, 4)])
        + _each(BELOW, ROUGHNESS, [(5, 4)])
        + _each(SIMILAR, ERROR, [(5, 4)], negligible=True),
    ),
    Statement(
        8,
        "Low-gain proportional control is about as light and smooth as none",
        _each(SIMILAR, FORCE, [(5, 1)]) + _each(SIMILAR, ROUGHNESS, [(5, 1)]),
    ),
    Statement(
        9,
        "Proportional control is lighter and smoother than SDOF",
        (Claim(BELOW, FORCE, (4, 5), (2, 3)), Claim(BELOW, ROUGHNESS, (4, 5), (2, 3))),
    ),
    Statement(
        10,
        "Four brakes gain nothing over three, and their uncontrolled error spreads wider",
        (
            _devices(AT_MOST, ERROR, _CONTROLLED, negligible=True),
            _devices(AT_MOST, FORCE, _CONTROLLED),
            _devices(AT_MOST, ROUGHNESS, _CONTROLLED),
            _devices(BELOW, ERROR, (1,), spread=True),
        ),
    ),
    Statement(
        11,
        "All controllers improve accuracy by a similar amount",
        _each(BELOW, ERROR, [(k, 1) for k in _CONTROLLED])
        + _each(SIMILAR, ERROR, [(j, k) for k in _CONTROLLED for j in _CONTROLLED if k < j]),
    ),
)


def name(controllers: tuple[int, ...]) -> str:
    """A controller, or several, in words."""
    return CONTROLLER[controllers[0]] if len(controllers) == 1 else GROUP[controllers]


def why_no_findings(controllers: Mapping[int, Preset], coded: bool = False) -> str:
    """Why the statements cannot be tested with these controllers, as a sentence; empty if they are those of Table I.

    Some of Table I's are enough (the rest is then not tried); their gap and gains may be other numbers, in their order.
    """
    if coded:
        return "The controllers are coded, the session is blind: nothing is compared until the key is opened."
    kinds = {1: "none", 2: "sdof", 3: "sdof", 4: "proportional", 5: "proportional"}
    gap = {number: preset.value("gap_m") for number, preset in controllers.items()}
    gain = {number: preset.value("gain_N_s_m") for number, preset in controllers.items()}
    same = (
        all(preset.kind == kinds.get(number) for number, preset in controllers.items())
        and all((gap[number] > 0.0) == (number == 3) for number in gap)
        and gain.get(5, 0.0) < gain.get(4, float("inf"))
    )
    if same:
        return ""
    return "The controllers are not those of the paper's Table I, so its statements are not tested."
