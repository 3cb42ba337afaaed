"""A controller in a file of one's own is tried before anything is made for it: it compiles, and a tick of it ends."""

import functools
from collections.abc import Iterable

import numpy as np

from core.control.algorithm import Tick
from core.control.controllers import Preset, decide_in_own_file, make_controller, refuse_uncompilable
from core.control.velocity_field import NO_FIELD, Seen, new_memory
from core.files import InputError
from core.mechanism import no_brakes
from core.own_consent import refuse_unallowed
from core.own_process import OwnCodeFailed, call_apart
from core.simulator.state import pack_brakes


def refuse_unusable(presets: Iterable[Preset]) -> None:
    """InputError, one sentence, if the file of one of these controllers does not compile, or its first tick not end."""
    own = [preset for preset in presets if preset.own is not None]
    for preset in own:
        _refuse_endless(preset)
    refuse_uncompilable(own)


@functools.cache
def _refuse_endless(preset: Preset) -> None:
    """In a process beside this one, which can be ended."""
    assert preset.own is not None
    refuse_unallowed(f"{preset.own.name}.py", preset.own.text)
    try:
        call_apart(f"{preset.own.name}.py: its first tick", first_tick, preset)
    except OwnCodeFailed as error:
        raise InputError(str(error)) from None


def first_tick(preset: Preset) -> None:
    """A tick of a device without brakes, at rest."""
    g, mass = np.zeros((4, 2)), np.zeros(3)
    g.flags.writeable = mass.flags.writeable = False
    brakes = pack_brakes(no_brakes(), backlash=True)[0]
    tick = Tick(Seen(*[0.0] * 6), g, mass, brakes, new_memory(), np.zeros(4))
    decide_in_own_file(make_controller(preset, 1.0), NO_FIELD, tick)
