"""The format of protocol files: what a file may say, and the rules that one table of it can break by itself.

Lengths in m, forces in N, times in s, gains in N s/m. What a file leaves out has the default that stands here.
"""

from typing import Annotated, Any, NamedTuple

import msgspec

from core.control.controllers import KINDS
from core.control.rule_sets import RULE_SETS
from core.files import NotNegative, Positive, Table, one_of
from core.simulator.hand import Hand, spring_hand

FEEDBACKS = ("none", "time", "error")  # what the participant is told after a trial

Count = Annotated[int, msgspec.Meta(ge=1, le=1000)]
Text = Annotated[str, msgspec.Meta(min_length=1)]


class ControllerFile(Table, frozen=True):
    """One controller: an algorithm of the paper and its parameters."""

    name: Text
    kind: str  # "none", "sdof", "proportional"
    number: Count | None = None  # its place in the list where it is left out
    gap_m: NotNegative = 0.0  # half-width of the band around the path without control
    gain_N_s_m: Positive | None = None  # K_y, of "proportional" alone

    def __post_init__(self) -> None:
        one_of(self.kind, tuple(KINDS), "kind")
        plain_text(self.name, "name")
        if (self.kind == "proportional") != (self.gain_N_s_m is not None):
            raise ValueError(f"gain_N_s_m is {'required for' if self.gain_N_s_m is None else 'not for'} {self.kind!r}")
        if self.kind == "none" and self.gap_m:
            raise ValueError("gap_m is not for 'none', which never controls")


class TrialFile(Table, frozen=True):
    """How a trial goes: approach, hold, move, end. The end radius is assumed; the paper prints none of these."""

    hold_s: NotNegative = 0.5  # at the start, before "go"
    start_radius_m: Positive = 0.003  # within which the start is held
    end_radius_m: Positive = 0.01  # within which the end is reached
    time_out_s: Positive = 30.0  # longest move
    approach_time_out_s: Positive = 30.0  # longest approach of a simulated operator; a person has 10 minutes
    end_s: NotNegative = 0.3  # recorded after the end, brakes off


class Release(Table, frozen=True):
    """Release of a trapped hand, on a real device alone: a full lock pushed so hard for so long lets go (assumed)."""

    on: bool = True
    force_N: Positive = 30.0
    time_s: Positive = 1.0


class TrialRules(NamedTuple):
    """How a trial goes, as a trial reads it: the fields of `TrialFile`, and the release (None: off)."""

    hold_s: float = 0.5
    start_radius_m: float = 0.003
    end_radius_m: float = 0.01
    time_out_s: float = 30.0
    approach_time_out_s: float = 30.0
    end_s: float = 0.3
    release: Release | None = Release()


class Cues(Table, frozen=True):
    """Durations of the move that earn the participant a "slower" (shorter ones) or a "faster" (longer ones)."""

    too_fast_s: Positive
    too_slow_s: Positive

    def __post_init__(self) -> None:
        if not self.too_fast_s < self.too_slow_s:
            raise ValueError(f"too_fast_s ({self.too_fast_s:g}) must be shorter than too_slow_s ({self.too_slow_s:g})")


class Breaks(Table, frozen=True):
    """A break comes after so many trials of a configuration, and lasts at least so long."""

    after_trials: Count
    least_s: NotNegative


class MouseHand(Table, frozen=True):
    """The spring by which the pointer pulls the handle. Assumed: soft enough to feel, capped to what an arm does."""

    stiffness_N_m: Positive = 200.0
    damping_N_s_m: NotNegative = 8.0
    force_max_N: Positive = 40.0
    mass_kg: NotNegative = 0.0  # a pointer has no arm behind it

    def hand(self) -> Hand:
        """The spring-damper for the simulator."""
        k, b = self.stiffness_N_m, self.damping_N_s_m
        return spring_hand((k, 0.0, k), (b, 0.0, b), self.force_max_N, self.mass_kg)


class Questionnaire(Table, frozen=True):
    """Whether the participant answers a short questionnaire after each block."""

    on: bool = False


class ProtocolFile(Table, frozen=True):
    """One protocol as its file says it."""

    name: Text
    devices: Annotated[tuple[Text, ...], msgspec.Meta(min_length=1)]  # shipped names, or paths from the file's folder
    path: Annotated[tuple[dict[str, Any], ...], msgspec.Meta(min_length=1)]  # each a path of core.path_file
    controller: Annotated[tuple[ControllerFile, ...], msgspec.Meta(min_length=1)]
    rules: str = "settled"
    seed: Annotated[int, msgspec.Meta(ge=0)] = 1
    blocks: Count = 1  # of each configuration; every controller x path once in each
    repetitions: Count = 1  # of a cell within a block
    practice_trials: Annotated[int, msgspec.Meta(ge=0, le=1000)] = 0  # before each configuration, not counted
    participants: tuple[str, ...] = ()  # none named: anybody
    blind: bool = False  # the console sees codes in place of controllers
    show_linkage: bool = False  # to the participant
    feedback: str = "none"
    provenance: str = ""  # "assumed": the paths are nobody's, and every figure says so
    trial: TrialFile = TrialFile()
    cues: Cues | None = None
    breaks: Breaks | None = None
    mouse: MouseHand = MouseHand()
    release: Release = Release()
    questionnaire: Questionnaire = Questionnaire()

    def __post_init__(self) -> None:
        plain_text(self.name, "name")
        one_of(self.rules, tuple(RULE_SETS), "rules")
        one_of(self.feedback, FEEDBACKS, "feedback")
        one_of(self.provenance, ("", "assumed"), "provenance")
        for label in self.participants:
            if not (label.isascii() and label.isalnum()):
                raise ValueError(f"participants: {label!r} must be letters and digits only")
        if len(set(self.participants)) < len(self.participants):
            raise ValueError("participants: the same label stands there twice")

    def trial_rules(self) -> TrialRules:
        """The tables `trial` and `release` together."""
        return TrialRules(*msgspec.structs.astuple(self.trial), release=self.release if self.release.on else None)


def plain_text(value: str, key: str) -> None:
    """For `__post_init__`: a ValueError unless the text can stand in tables and file names."""
    if not value.isprintable() or value != value.strip() or any(letter in ';"/\\' for letter in value):
        raise ValueError(f'{key} must be plain text without ; " / or \\, not {value!r}')
