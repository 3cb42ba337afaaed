"""Every decision of a recorded trial taken again, from the recording and the session's device and controller alone.

The controller is given what it was given then: tip, velocity and sensed force of each tick; or what the encoders of a
simulated device made of the tip's motion until then. Nothing is simulated.
"""

from typing import NamedTuple

import numpy as np

from core.control.controllers import DECISIONS, Preset, make_controller
from core.control.guard import NOTHING, Around, make_around
from core.control.velocity_field import new_memory
from core.device import Device
from core.device_interface import velocity_noise
from core.mechanism import JOINTS
from core.path import Path, point_at
from core.simulator.state import new_state, pack_brakes, pack_mechanism
from experiments.assumptions import DEFAULTS, Assumptions
from experiments.recording.schema import Recording
from experiments.trial.encoder_sensing import REAL_AGE, decision_noise, new_sensing, sensed_age
from experiments.trial.tick import decide_again

#: What a decision is taken from, in the order in which `decide_again` reads it.
GIVEN = ("tip_x_m", "tip_y_m", "tip_vx_m_s", "tip_vy_m_s", "sensed_fx_N", "sensed_fy_N")
WANTED = ("wanted_fx_N", "wanted_fy_N")  # n/a in the recordings of earlier versions, which had no force to show


class Checked(NamedTuple):
    """What came of it."""

    decisions: int  # that were taken again
    different: int  # of them, by the decision or by any current


def check_decisions(
    recording: Recording, path: Path, device: Device, preset: Preset, rules: str,
    assumed: Assumptions = DEFAULTS, around: Around = NOTHING,
) -> Checked | None:  # fmt: skip
    """Take each decision of the movement again; None: an earlier version recorded it, without the sensed force.

    assumed: of a simulated device; a real one is as its file has it. around: the obstacles of the trial.
    """
    if not all(name in recording.columns for name in GIVEN):
        return None
    taken = recording.in_phase("move")
    if recording.sensors:
        taken &= recording.column("decided") == 1.0
    without = np.full(recording.rows, np.nan)
    wanted = [recording.columns.get(name, without) for name in WANTED]
    given = np.column_stack((*map(recording.column, GIVEN), *wanted))
    middle = point_at(path, 0.5 * path.length)[:2]
    if recording.sensors:
        noise, sensing, age = velocity_noise(device, middle), new_sensing(device, DEFAULTS), REAL_AGE
    else:
        device = assumed.applied_to(device)
        noise, sensing = decision_noise(device, middle, assumed), new_sensing(device, assumed)
        age = sensed_age(assumed)
    controller = make_controller(
        preset, device.force_normalised_N, rules, velocity_noise=noise,
        around=make_around(around, device.brakes, age),
    )  # fmt: skip
    codes, currents = np.zeros(len(given), dtype=np.int64), np.zeros((len(given), 4))
    decide_again(
        path, controller, pack_mechanism(device.mechanism), pack_brakes(device.brakes, backlash=False),
        new_state(0.0, 0.0), sensing, new_memory(), given, taken, codes, currents,
    )  # fmt: skip
    codes, currents = codes[taken], currents[taken]
    words = np.array(DECISIONS, dtype=object)
    different = words[codes] != recording.text("decision")[taken]
    for joint in device.braked:
        different |= currents[:, JOINTS.index(joint)] != recording.column(f"current_{joint}_A")[taken]
    return Checked(len(codes), int(np.count_nonzero(different)))
