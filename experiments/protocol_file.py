"""The keys of a protocol file, each declared once with its type, its range and its default.

Lengths in m, forces in N, times in s, gains in N s/m. The keys of `Settings` mean the same in a file (`ProtocolFile`)
and in an experiment that was checked (`experiments.protocol.Protocol`).
"""

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import msgspec

from core.control.algorithm import GAP_M
from core.control.controllers import ALGORITHMS, PARAMETERS, Preset, make_preset
from core.control.guard import Guard
from core.control.rule_sets import RULE_SETS
from core.files import NotNegative, Positive, Table, choice, text_of_form
from core.obstacles import ObstacleFile
from core.own_files import OwnFile
from core.ranges import BodyMass, Push, Radius, SmallLength
from core.simulator.hand import Hand, spring_hand
from experiments.assumptions import Assumptions, LowGain, Sensing
from experiments.language import ENGLISH
from experiments.slave import Slave

NUMBER, TEXT = "number", "text"  # what a field of the form takes where it lists no choices
FEEDBACK = ("none", "time", "error")

Count = Annotated[int, msgspec.Meta(ge=1, le=1000)]
Seed = Annotated[int, msgspec.Meta(ge=0)]
Text = Annotated[str, msgspec.Meta(min_length=1)]
Label = Annotated[str, text_of_form("[A-Za-z0-9]{1,20}", "letters and digits only, at most 20")]
Rules = Annotated[str, choice(*RULE_SETS)]
_SOME = msgspec.Meta(min_length=1)

#: Parameter of an algorithm -> its type in a file.
PARAMETER_TYPES = {
    name: Positive if parameter.default is None else NotNegative for name, parameter in PARAMETERS.items()
} | {GAP_M.name: SmallLength}


class TrialFile(Table, frozen=True):
    """How a trial goes: approach, hold, move, end. All assumed: the paper prints none of these."""

    hold_s: NotNegative = 0.5  # rest at the start, before "go"
    start_radius_m: Radius = 0.003  # of the circle that holds the handle at the start
    end_radius_m: Radius = 0.01  # of the circle in which the movement ends
    time_out_s: Positive = 30.0  # longest movement
    approach_time_out_s: Positive = 30.0  # longest way to the start, of a simulated operator; a person has 10 minutes
    end_s: NotNegative = 0.3  # recorded after the end, without current


class Release(Table, frozen=True):
    """On a real device: a full lock opens when a hand pushes harder and longer than this (assumed)."""

    on: bool = True  # whether a real device frees a trapped hand
    force_N: Push = 30.0  # a hand is trapped if it pushes a full lock harder than this
    time_s: Positive = 1.0  # and for longer than this


class Cues(Table, frozen=True):
    """Shorter moves than one and longer ones than the other earn the participant a "slower" or a "faster"."""

    too_fast_s: Positive  # the participant reads "slower" after a shorter movement
    too_slow_s: Positive  # the participant reads "faster" after a longer movement

    def __post_init__(self) -> None:
        if not self.too_fast_s < self.too_slow_s:
            raise ValueError(f"too_fast_s ({self.too_fast_s:g}) must be shorter than too_slow_s ({self.too_slow_s:g})")


class Breaks(Table, frozen=True):
    """When breaks come within a configuration, and how long they last at least."""

    after_trials: Count  # a break comes after so many trials on a device
    least_s: NotNegative  # the shortest break


class MouseHand(Table, frozen=True):
    """The spring by which the pointer pulls the handle. Assumed: capped to what an arm does.

    Our choice: 2000 N/m, so that the drag of the off-state brakes, at most 5 N, holds the handle 2.4 mm off the pointer
    and inside the start's circle; and so much damping that a fast pull hardly carries it beyond.
    """

    stiffness_N_m: Positive = 2000.0  # of the spring from pointer to handle
    damping_N_s_m: NotNegative = 80.0
    force_max_N: Push = 40.0  # its largest force
    mass_kg: BodyMass = 0.0  # of an arm behind the pointer

    def hand(self) -> Hand:
        k, b = self.stiffness_N_m, self.damping_N_s_m
        return spring_hand((k, 0.0, k), (b, 0.0, b), self.force_max_N, self.mass_kg)


class Questionnaire(Table, frozen=True):
    """Whether and when the participant answers a short questionnaire."""

    on: bool = False  # whether participants answer the seven scales
    each: Annotated[str, choice("block", "controller")] = "block"  # or "controller": after its last trial on a device


class Consent(Table, frozen=True):
    """What each participant is asked before anything else: whether they agree to take part."""

    text: Text  # each participant is asked this first
    agree: Text = "I agree to take part"  # on the button
    decline: Text = "I do not want to take part"


class Export(Table, frozen=True):
    """What a BIDS data set says of itself and only the experimenter knows: its dataset_description.json."""

    authors: tuple[Text, ...] = ()  # for `dataset_description.json` of `phd export --bids`
    license: str = ""  # as "CC0-1.0"
    hed_version: str = ""  # of the HED schema, if you tag the phases by it


class About(Table, frozen=True):
    """What is said of an experiment where one is chosen."""

    sentence: Annotated[str, msgspec.Meta(max_length=80)] = ""  # shown where a protocol is chosen, up to 80 characters

    def __post_init__(self) -> None:
        if not self.sentence.isprintable():
            raise ValueError(f"sentence must be one line of plain text, not {self.sentence!r}")


class Instruction(Table, frozen=True):
    """A page that the participant reads before the first trial."""

    text: Text  # of a page before the first trial
    picture: str = ""  # PNG or JPEG up to 10 MB, by its path from this file's folder


class InstructionPage(NamedTuple):
    """A page of instructions with its picture."""

    text: str
    picture: bytes


class Settings(Table, frozen=True, kw_only=True):
    """The keys of an experiment, as in its file. To add one: its line here."""

    name: Text  # in tables, figures and file names
    about: About = About()
    rules: Rules = "settled"  # or "literal": the paper's rules to the letter
    seed: Seed = 1  # of the order of trials and of simulated operators, with the participant's number
    blocks: Count = 1  # on each device; every controller once on every path in each
    repetitions: Count = 1  # of each controller on each path within a block
    practice_trials: Annotated[int, msgspec.Meta(ge=0, le=1000)] = 0  # before each device; recorded, not counted
    participants: tuple[Label, ...] = ()  # their labels, as "01"; none: any
    blind: bool = False  # true: the experimenter sees codes instead of controllers
    show_linkage: bool = False  # true: the participant sees the device's links
    show_trace: bool = True  # false: the participant does not see the trace of the handle
    feedback: Annotated[str, choice(*FEEDBACK)] = "none"  # what the participant reads after a trial: or "time", "error"
    provenance: str = ""  # of the paths, if they stand for others' ("assumed" marks them)
    #: what the simulation assumes: [keys](assumptions-and-equations.md#assumptions)
    assumptions: Assumptions = Assumptions()
    trial: TrialFile = TrialFile()
    slave: Slave | None = None
    obstacle: tuple[ObstacleFile, ...] = ()
    guide: bool = True  # near an obstacle, controllers lead round it
    guard: Guard | None = None
    release: Release = Release()
    cues: Cues | None = None
    breaks: Breaks | None = None
    mouse: MouseHand = MouseHand()
    questionnaire: Questionnaire = Questionnaire()
    language: Text = ENGLISH  # the participant's: "en", "de", or a translation file by its path
    tones: bool = True  # at "go" and at the end of a trial
    instruction: tuple[Instruction, ...] = ()
    export: Export = Export()
    consent: Consent | None = None
    form: dict[str, tuple[Text, ...] | str] = {}  # questions to each participant: a list of choices, "number" or "text"
    measure: str = ""  # a Python file with measures of your own

    def __post_init__(self) -> None:
        plain_text(self.name, "name")
        if len(set(self.participants)) < len(self.participants):
            raise ValueError("participants: the same label is used twice")
        for name, kind in self.form.items():
            if not (name.isascii() and name.isidentifier()):
                raise ValueError(f"form: {name!r} must be of letters, digits and _")
            if isinstance(kind, str) and kind not in (NUMBER, TEXT):
                raise ValueError(f"form.{name} must be one of {NUMBER}, {TEXT}, or a list of choices, not {kind!r}")
            if not isinstance(kind, str) and len(set(kind)) < 2:
                raise ValueError(f"form.{name} must offer at least two different choices")


_Parameters: Any = msgspec.defstruct(
    "_Parameters", [(name, kind | None, None) for name, kind in PARAMETER_TYPES.items()], bases=(Table,), frozen=True,
    kw_only=True,
)  # fmt: skip


class ControllerFile(_Parameters, Table, frozen=True, kw_only=True):
    """A controller in a protocol file: an algorithm, shipped or in a file of its own, and its parameters."""

    name: Text  # in tables and figures
    #: "none", "proportional", "sdof" or "reflect"; this or `algorithm`
    kind: Annotated[str, choice(*ALGORITHMS)] | None = None
    algorithm: Text | None = None  # a Python file beside this one, or a shipped one
    parameters: dict[str, NotNegative] = {}  # of that file
    number: Count | None = None  # none: its place in the list

    def __post_init__(self) -> None:
        plain_text(self.name, "name")
        if (self.kind is None) == (self.algorithm is None):
            raise ValueError(f"{self.name}: needs either kind or algorithm")
        if self.kind is not None and self.parameters:
            raise ValueError(f"{self.name}: parameters are for an algorithm in a file of its own")
        if self.algorithm is None:
            self.preset({})

    def preset(self, files: Mapping[str, OwnFile]) -> Preset:
        """The controller; files: by name. ValueError if its parameters are not its algorithm's."""
        given = {name: getattr(self, name) for name in PARAMETERS}
        if self.algorithm is None:
            return make_preset(self.name, str(self.kind), given)
        return make_preset(self.name, self.algorithm, given | self.parameters, files[self.algorithm])


class ProtocolFile(Settings, frozen=True, kw_only=True):
    """The keys of a protocol file."""

    devices: Annotated[tuple[Text, ...], _SOME]  # shipped names, paths from this file's folder, names of a `[[device]]`
    device: tuple[dict[str, Any], ...] = ()  # device files inside this one
    brake: tuple[dict[str, Any], ...] = ()  # brake files inside this one
    #: of each path: `number`, `kind`, the keys of its kind, `near_m`, `blend_width_m`
    path: Annotated[tuple[dict[str, Any], ...], _SOME]
    controller: Annotated[tuple[ControllerFile, ...], _SOME]


class Overrides(Table, frozen=True):
    """Options in place of what a file holds."""

    rules: Rules | None = None
    assumptions: Assumptions | None = None
    low_gain_found: Positive | None = None  # N s/m, by the rule "no vibration"
    low_gain: LowGain | None = None  # besides, of the proportional controller of least gain
    sensing: Sensing | None = None  # besides
    seed: Seed | None = None
    devices: tuple[str, ...] | None = None  # names


def plain_text(value: str, key: str) -> None:
    """For `__post_init__`: ValueError if the text cannot stand in tables and file names."""
    if not value.isprintable() or value != value.strip() or any(letter in ';"/\\' for letter in value):
        raise ValueError(f'{key} must be plain text without ; " / or \\, not {value!r}')
