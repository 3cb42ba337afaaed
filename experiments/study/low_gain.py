"""The paper's own rule for the low gain: "no detectable vibration". The largest such gain, found on simulated trials.

Vibration is what control adds to the handle's acceleration between 20 and 100 Hz, beside the same trial without
control. It counts as detected where it exceeds 0.1 m/s2 (rms over the movement) in any trial. Both are assumed: the
paper states neither a band nor a threshold, and has the gain chosen by feel. Trials are the first of three people on
every path and device, under the assumptions of the study; the same seed finds the same gain.
"""

import math
from functools import partial

import numpy as np

from core import tick_log
from core.control.controllers import Preset, make_preset
from core.files import InputError
from experiments.assumptions import NO_VIBRATION
from experiments.plan import PlannedTrial
from experiments.protocol import Protocol, protocol_from_json, protocol_to_json
from experiments.study.unrecorded import person_of, run_trial, switched_on
from experiments.trial.normals import normals
from experiments.trial.operator import TICK_S
from experiments.trial.population import Population
from experiments.trial.trial import Trial

BAND_HZ = 20.0, 100.0  # assumed
DETECTED_M_S2 = 0.1  # rms; assumed
PEOPLE = 3
#: N s/m, from one to the other: ten a decade, two digits each.
GAINS = [float(f"{10.0 ** (k / 10.0):.2g}") for k in range(41)]


def settled(protocol: Protocol, population: Population) -> Protocol:
    """The protocol with the number for a low gain that is given by the paper's rule; else as it is."""
    if not protocol.unsettled:
        return protocol
    about = protocol_to_json(protocol)
    found = {"low_gain_found": largest_without_vibration(protocol, population)}
    return protocol_from_json({**about, "overrides": about["overrides"] | found}, protocol.name)


def largest_without_vibration(protocol: Protocol, population: Population) -> float:
    """The largest gain (N s/m) of `GAINS` at which no trial vibrates. InputError where the least one does.

    By bisection: with the gain the vibration rises.
    """
    number = protocol.low_gain_controller
    assert number is not None  # else it is not unsettled
    squares = partial(vibrations, protocol, population)
    without = squares(make_preset("without", "none", {}))

    def vibrates(gain: float) -> bool:
        added = squares(protocol.controllers[number].replaced(gain_N_s_m=gain)) - without
        return bool((added > DETECTED_M_S2**2).any())

    if vibrates(GAINS[0]):
        raise InputError(f"low gain {NO_VIBRATION!r}: vibration is detected even at {GAINS[0]:g} N s/m")
    low, high = 0, len(GAINS)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if vibrates(GAINS[middle]) else (middle, high)
    return GAINS[low]


def vibrations(protocol: Protocol, population: Population, preset: Preset) -> np.ndarray:
    """Mean square of the acceleration (m2/s4) in the band during the movement, of each trial."""
    from scipy.signal import butter, sosfiltfilt  # here: an app that starts has no time for it

    band = butter(2, BAND_HZ, "band", fs=1.0 / TICK_S, output="sos")
    found = []
    for operator in range(1, PEOPLE + 1):
        person = person_of(population, protocol.seed, operator)
        for device in protocol.devices:
            for segment, path in protocol.paths.items():
                simulated = switched_on(device, protocol.paths, protocol.assumptions)
                planned = PlannedTrial(1, 1, device.name, 1, segment, 1)
                noise = normals(protocol.seed, operator, segment, 1)
                trial = Trial(simulated, planned, path, preset, protocol.rules, protocol.trial, person, noise)
                rows = run_trial(trial)
                moving = rows[:, tick_log.PHASE] == tick_log.MOVE
                filtered = sosfiltfilt(band, rows[:, tick_log.TIP_AX : tick_log.TIP_AY + 1], axis=0)[moving]
                found.append(float(np.mean(np.sum(filtered**2, axis=1))) if moving.any() else math.nan)
    return np.array(found)
