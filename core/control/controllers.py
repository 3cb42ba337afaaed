"""The controllers (Section IV, Table I): from tip, velocity and hand force to brake currents and a decision code.

Algorithms, one a file; a protocol's controllers are presets of them (Table I: experiments/protocols/paper.toml). All
decide in the same order: where the tip is in the velocity field, which brake, which torque, which current. They know
neither device nor screen.

To add one: a file beside sdof.py, and its line in `ALGORITHMS`. Protocols, sweeps, the printed plan, the dials of Try,
recordings and exports read the table.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from core.control import proportional, reflect, sdof
from core.control.algorithm import (
    GAP_M,
    IN_GAP,
    NONE,
    NOT_FINITE,
    OWN,
    SHARED,
    Algorithm,
    Controller,
    Parameter,
    Tick,
    limit,
    release,
)
from core.control.guard import NO_OBSTACLE, keep_out
from core.control.own_file import MOST_PARAMETERS, MOST_WORDS, address_in, algorithm_in
from core.control.rule_sets import rule_set
from core.control.velocity_field import NO_FIELD, Field, Seen, field_at, field_at_obstacle, new_memory
from core.files import InputError, did_you_mean
from core.kernels import kernel
from core.kernels.by_address import FAILED, Caller
from core.mechanism import no_brakes
from core.obstacles import nearest_obstacle
from core.own_files import OwnFile
from core.simulator.state import pack_brakes


@kernel
def no_control(controller, field, tick):
    """Control never acts."""
    return NONE


#: In the order of their numbers, by which the kernels know them.
ALGORITHMS: dict[str, Algorithm] = {
    algorithm.kind: algorithm
    for algorithm in (
        Algorithm("none", (), (), no_control),
        sdof.ALGORITHM,
        proportional.ALGORITHM,
        reflect.ALGORITHM,
    )
}

NO_CONTROL = 0

#: Every parameter that any algorithm has, each once.
PARAMETERS: dict[str, Parameter] = {
    parameter.name: parameter for algorithm in ALGORITHMS.values() for parameter in algorithm.parameters
}

#: Code -> words. Those that all algorithms share come first, then each algorithm's own.
DECISIONS: tuple[str, ...] = (
    *SHARED,
    *(words for algorithm in ALGORITHMS.values() for words in algorithm.decisions),
)

#: Words of the decisions of an algorithm in a file of its own, in a blind session, which may not tell which file it is.
CODED = tuple(f"own {place}" for place in range(1, MOST_WORDS + 1))


class Preset(NamedTuple):
    """One row of Table I, or of a protocol's own table of controllers."""

    name: str
    kind: str  # of its algorithm; of one in a file of its own, the file's name, "damper.py"
    values: tuple[float, ...] = ()  # of the algorithm's parameters, in their order
    own: OwnFile | None = None  # the file

    @property
    def algorithm(self) -> Algorithm:
        """InputError if what is stored of a file of its own is damaged."""
        return ALGORITHMS[self.kind] if self.own is None else algorithm_in(self.own)

    @property
    def decisions(self) -> tuple[str, ...]:
        """Code -> words, in a trial with this controller."""
        return DECISIONS if self.own is None else (*DECISIONS, *self.algorithm.decisions)

    def value(self, parameter: str) -> float:
        """A parameter in SI units; 0 where the algorithm has none of that name."""
        return self.named.get(parameter, 0.0)

    @property
    def named(self) -> dict[str, float]:
        """Each parameter of its algorithm, SI units."""
        names = (parameter.name for parameter in self.algorithm.parameters)
        return dict(zip(names, self.values, strict=True))

    @property
    def words(self) -> str:
        """The algorithm and its parameters in words: "proportional, gap 0 mm, gain 5 N s/m"."""
        own = zip(self.algorithm.parameters, self.values, strict=True)
        words = (f"{known.word} {known.scale * value:g} {known.unit}".rstrip() for known, value in own)
        return ", ".join([self.kind, *words])

    def replaced(self, **others: float) -> "Preset":
        """The same with other values; those of parameters that its algorithm has not are left out."""
        return self._replace(values=tuple({**self.named, **others}[name] for name in self.named))


def decision_words(presets: Iterable[Preset]) -> tuple[str, ...]:
    """Code -> words, the same for every controller of a blind session."""
    return (*DECISIONS, *CODED) if any(preset.own for preset in presets) else DECISIONS


def make_preset(name: str, kind: str, given: Mapping[str, float | None], own: OwnFile | None = None) -> Preset:
    """A preset of an algorithm with the parameters given (None: not given), the others at their defaults.

    own: the file of an algorithm that is not shipped.
    ValueError, a sentence that begins with the key: a parameter is missing, or the algorithm has no such parameter.
    """
    algorithm = ALGORITHMS[kind] if own is None else algorithm_in(own)
    known = {parameter.name: parameter for parameter in algorithm.parameters}
    values = {key: parameter.default for key, parameter in known.items()}
    for key, value in given.items():
        if value is not None and key not in known:
            listed = f" (there are: {', '.join(known)})" if known else ", which never controls"
            raise ValueError(f"{key} is not for {kind!r}{did_you_mean(key, known)}{listed}")
        values |= {key: value} if value is not None else {}
    for key, value in values.items():
        if value is None:
            raise ValueError(f"{key} is required for {kind!r}")
    return Preset(name, kind, tuple(float(value) for value in values.values() if value is not None), own)


def make_controller(
    preset: Preset,
    device_force_normalised: float,
    rules: str = "settled",
    velocity_noise: float = 0.0,
    around: np.ndarray = NO_OBSTACLE,
) -> Controller:
    """The controller of a preset for a device with this normalised force (N). InputError for impossible numbers.

    rules: "settled" or "literal"; velocity_noise (m/s, rms) of the device's sensing widens one threshold of `settled`.
    around: the obstacles of the trial (`make_around`).
    """
    if preset.own is None and preset.kind not in ALGORITHMS:
        raise InputError(f"controller {preset.name}: {preset.kind!r} is none of {', '.join(ALGORITHMS)}")
    for parameter, value in zip(preset.algorithm.parameters, preset.values, strict=True):
        if not 0.0 <= value < math.inf:
            raise InputError(f"controller {preset.name}: {parameter.word} {value!r} must be finite and not negative")
    if not 0.0 < device_force_normalised < math.inf:
        raise InputError(f"controller: normalised force {device_force_normalised!r} must be positive and finite, in N")
    controller = Controller(
        len(ALGORITHMS) if preset.own else list(ALGORITHMS).index(preset.kind),
        preset.value(GAP_M.name),
        preset.values + (0.0,) * (MOST_PARAMETERS - len(preset.values)),  # one type for the kernels
        float(device_force_normalised),
        rule_set(rules, velocity_noise),
        0,
        around,
    )
    return with_address(controller, preset)


def refuse_uncompilable(presets: Iterable[Preset]) -> None:
    """InputError, one sentence, if the file of one of these controllers does not compile."""
    for preset in presets:
        if preset.own is not None:
            address_in(preset.own, decide_at)


def with_address(controller: Controller, preset: Preset) -> Controller:
    """The controller with the address of its algorithm's file in this process. InputError if that does not compile."""
    return controller if preset.own is None else controller._replace(address=address_in(preset.own, decide_at))


def _numbered(number: int, offset: int, this: Callable[..., int], others: Callable[..., int]) -> Callable[..., int]:
    """The kernel that calls `this` where the controller's algorithm has this number, else `others`.

    offset: what the algorithm adds to its own codes, the number of those before it.
    """

    @kernel
    def decide_as(controller, field, tick):
        if controller.algorithm != number:
            return others(controller, field, tick)
        code = this(controller, field, tick)
        return code + offset if code >= OWN else code

    return decide_as


def _sample() -> tuple[Controller, Field, Tick]:
    """Arguments of an algorithm's `decide`, of the types that every device and trial passes; g and mass read-only."""
    seen, brakes = Seen(*[0.0] * 6), pack_brakes(no_brakes(), backlash=True)[0]
    g, mass = np.zeros((4, 2)), np.zeros(3)
    g.flags.writeable = mass.flags.writeable = False
    tick = Tick(seen, g, mass, brakes, new_memory(), np.zeros(4))
    return make_controller(Preset("none", "none"), 1.0), NO_FIELD, tick


decide_at = Caller(_sample)


@kernel
def decide_in_own_file(controller, field, tick):
    """Call the kernel of a file of its own, which was compiled alone.

    `FAILED`: it raised an error. `UNDECLARED`: it returned a decision that it does not declare. The brakes' limits are
    put back as they were, whatever the file has written there.
    """
    if controller.address == 0:  # it came from another process: `with_address` was forgotten
        return FAILED
    most, present = tick.brakes.current_max, tick.brakes.present
    before = most[0], most[1], most[2], most[3], present[0], present[1], present[2], present[3]
    code = decide_at(controller.address, controller, field, tick)
    for i in range(4):
        most[i], present[i] = before[i], before[4 + i]
    if code < 0:
        release(tick.current)
        return code
    return code + len(DECISIONS) - OWN if code >= OWN else code


def _any_of(algorithms: Iterable[Algorithm]) -> Callable[..., int]:
    """A kernel that calls the algorithm of the controller: a chain of comparisons, the first algorithm first."""
    known, chain = list(algorithms), decide_in_own_file
    for number in reversed(range(len(known))):
        offset = sum(len(algorithm.decisions) for algorithm in known[:number])
        chain = _numbered(number, offset, known[number].decide, chain)
    return chain


_decide_as_its_algorithm = _any_of(ALGORITHMS.values())


@kernel
def _decide_within_limits(controller, field, tick):
    """Decide by its algorithm, then limit the currents, whatever the algorithm has written."""
    code = _decide_as_its_algorithm(controller, field, tick)
    limit(tick)
    return code


@kernel
def decide(controller, path, tick):
    """One tick of control (`Tick`): writes its currents, updates its memory; returns the decision code and the field.

    Input that is not finite releases the brakes and leaves the memory alone; the field is then NaN. `FAILED` or
    `UNDECLARED`: a controller in a file of its own did not decide.
    """
    seen, memory, rules = tick.seen, tick.memory, controller.rules
    release(tick.current)
    if not math.isfinite(seen.x + seen.y + seen.vx + seen.vy + seen.fx + seen.fy):
        return NONE if controller.algorithm == NO_CONTROL else NOT_FINITE, NO_FIELD
    field = field_at(path, memory, seen, rules)
    around = controller.around[0]
    if around.count > 0:
        if around.guard != 0:
            locked = keep_out(around, tick)
            if locked != NONE:
                return locked, field
        near = nearest_obstacle(around.edges, around.count, seen.x, seen.y)
        if around.guide != 0 and near.distance < path.blend_width:
            field = field_at_obstacle(near, field.distance, memory, seen, path.blend_width, rules)
            return _decide_within_limits(controller, field, tick), field
    if field.distance < controller.gap_m:
        return IN_GAP, field
    return _decide_within_limits(controller, field, tick), field
