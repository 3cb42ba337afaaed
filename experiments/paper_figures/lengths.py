"""The base distance and link lengths with which the brakes of a display can show most across the motion.

Three scales are sought, of the base distance, both proximal and both distal links, each within bounds, for which the
least force across the motion (`maps.worst_across`), averaged over a grid of tips about the paper's paths, is largest;
tips that the linkage does not reach count against it. By differential evolution (scipy), with a seed of its own: the
same device gives the same lengths. Our choice: masses stay as in the file, whatever the lengths.
"""

import tomllib
from dataclasses import replace

import numpy as np
from scipy.optimize import differential_evolution

from core.device import Device, build_device
from core.files import InputError, toml_text
from core.mechanism import Mechanism
from core.workspace import tip_is_free
from experiments.paper_figures.maps import pushes_of, worst_across

#: m. The paper's two paths, as assumed, and two centimetres about them.
TIPS = np.meshgrid(np.linspace(-0.12, 0.12, 13), np.linspace(0.24, 0.44, 11))
OUT_OF_REACH_N = 10.0  # what the mean loses if no tip is reached: a few times what there is to gain
LENGTHS = (("L_AE_m", "L_BC_m"), ("L_ED_m", "L_CD_m"))


def mean_least_force(device: Device, scales: np.ndarray) -> float:
    """The number, N, that is maximised, for scales (3,) of base distance, proximal and distal links."""
    scaled = replace(device, mechanism=_scaled(device.mechanism, scales))
    free = tip_is_free(scaled.mechanism, *TIPS)
    worst = np.where(free, worst_across(pushes_of(scaled, *TIPS)), 0.0)
    return float(worst.mean() - OUT_OF_REACH_N * (1.0 - free.mean()))


def _scaled(mechanism: Mechanism, scales: np.ndarray) -> Mechanism:
    base, proximal, distal = scales
    middle = 0.5 * (mechanism.arm_1.base_x + mechanism.arm_2.base_x)
    arms = [
        arm._replace(
            base_x=middle + base * (arm.base_x - middle),
            length_1=proximal * arm.length_1,
            length_2=distal * arm.length_2,
        )
        for arm in (mechanism.arm_1, mechanism.arm_2)
    ]
    return mechanism._replace(arm_1=arms[0], arm_2=arms[1])


def with_better_lengths(device: Device, share: float) -> Device:
    """The device with the best lengths that differ from its own by at most a share, in whole tenths of a millimetre.

    InputError where it does not reach all tips as it is, or no lengths are better.
    """
    if not tip_is_free(device.mechanism, *TIPS).all():
        raise InputError(f"--lengths-within: {device.name} does not reach all places about the paper's paths")
    bounds = [(1.0 - share, 1.0 + share)] * 3
    best = differential_evolution(lambda scales: -mean_least_force(device, scales), bounds, seed=1)
    if -best.fun <= mean_least_force(device, np.ones(3)):
        raise InputError(f"--lengths-within: no lengths so near let the brakes of {device.name} show more than its own")
    content = tomllib.loads(device.text)
    content["name"], geometry = f"{device.name}-lengths", content["geometry"]
    scaled = _scaled(device.mechanism, best.x)
    for key, arm in (("base_A_m", scaled.arm_1), ("base_B_m", scaled.arm_2)):
        geometry[key] = [round(float(arm.base_x), 4), float(arm.base_y)]
    for keys, scale in zip(LENGTHS, best.x[1:], strict=True):
        geometry |= {key: round(float(scale) * geometry[key], 4) for key in keys}
    found = toml_text(content)
    return build_device(found, device.brake_texts, content["name"], device.calibration_text)
