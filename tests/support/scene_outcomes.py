"""What the simulator makes of a random scene, beside the independent reference."""

import json
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from random_scenes import STEPS, write_scene

from experiments.simulate.scene import read_scene
from experiments.simulate.simulate import SceneRun, simulate

#: m; off by more is wrong, and off by less is right: a warning of it is a false alarm.
WRONG_M, RIGHT_M = 1e-3, 1e-4
#: Begins the warning of a tip that is right but outside its workspace: it says nothing of how right it is.
ELSEWHERE = "the tip leaves the workspace"
#: Share of the energy turned over that the ledger may leave unexplained, and J below which it is rounding.
UNEXPLAINED, UNEXPLAINED_J = 0.01, 1e-6
ENERGIES = ("work_hand_J", "heat_brakes_J", "kinetic_J", "lost_at_stops_J")
#: Of the tips every INTERVAL_S one in so many is stored and compared.
THINNED = 2
STORED, KNOWN = (Path(__file__).with_name(name) for name in ("scene_references.json", "known_scenes.json"))


@dataclass(frozen=True)
class Outcome:
    """One scene at one step."""

    scene: str
    step_s: float
    fidelity: str
    off_m: float  # largest distance from the reference at any compared time; infinite: the motion is not finite
    warnings: tuple[str, ...]
    added_by_brakes_J: float  # from a row to the next
    residual_J: float
    turnover_J: float  # heat, losses at stops, kinetic energy at the end

    @property
    def silent(self) -> bool:
        """Wrong without a word."""
        return self.off_m > WRONG_M and not self.warnings

    @property
    def false_alarm(self) -> bool:
        """Right, and warned of."""
        return self.off_m < RIGHT_M and bool(self.warnings)

    @property
    def unexplained(self) -> bool:
        """The ledger does not add up."""
        return not abs(self.residual_J) <= UNEXPLAINED * self.turnover_J + UNEXPLAINED_J

    def __str__(self) -> str:
        return (
            f"{self.scene} ({self.fidelity}) at {self.step_s:g} s: {self.off_m:.3g} m off, residual "
            f"{self.residual_J:.3g} of {self.turnover_J:.3g} J, brakes add {self.added_by_brakes_J:.3g} J, "
            f"{'; '.join(self.warnings) or 'no warning'}"
        )


def outcomes(
    name: str, device: dict, scene: dict, tips: np.ndarray, steps=STEPS, integrator="event"
) -> Iterator[Outcome]:
    """The simulator's runs of a scene, from file to file, beside the tips (n, 2) every THINNED INTERVAL_S."""
    with tempfile.TemporaryDirectory() as folder:
        for step in steps:
            out = Path(folder) / f"{step!r}.csv"
            try:
                told = simulate(read_scene(write_scene(device, scene, step, Path(folder), integrator)), out)["warnings"]
            except FloatingPointError as error:
                yield Outcome(name, step, scene["fidelity"], math.inf, (str(error),), 0.0, math.nan, math.nan)
                continue
            with out.open() as file:
                columns = next(file).strip().split(",")
                numbers = [columns.index(name) for name in ("tip_x_m", "tip_y_m", *ENERGIES)]
                rows = np.loadtxt(file, delimiter=",", usecols=numbers)
            off = float(np.hypot(*(rows[::THINNED, :2] - tips).T).max())
            work, heat, kinetic, lost = rows[:, 2:].T
            left = work - heat - kinetic - lost
            warnings = tuple(one for one in told if not one.startswith(ELSEWHERE))
            added, turnover = -float(np.diff(heat).min()), float(kinetic[-1] + heat[-1] + lost[-1])
            yield Outcome(name, step, scene["fidelity"], off, warnings, added, float(left[-1] - left[0]), turnover)


def event_reference(device: dict, scene: dict) -> tuple[np.ndarray, float]:
    """Tips (n, 2) every THINNED INTERVAL_S by `event` at 5 us, and how far off it is at 10 us (m)."""
    with tempfile.TemporaryDirectory() as folder:
        read = [read_scene(write_scene(device, scene, step, Path(folder))) for step in (1e-5, 5e-6)]
    coarse, fine = (SceneRun(replace(one, tolerance=0.01)).run_chunk(one.rows)[::THINNED, 1:3] for one in read)
    return fine, float(np.hypot(*(fine - coarse).T).max())


def stored_references() -> dict[int, np.ndarray]:
    """Tips (n, 2) of each stored seed, to 1 um, of the seeds of which the independent solver was sure to 50 um.

    That solver shared nothing with the simulator: virtual work over the bodies, the implicit midpoint rule, every case
    of stick and slip tried. It is in the history of this project: tests/support/scene_reference.py.
    """
    return {int(seed): np.array(tips) for seed, tips in json.loads(STORED.read_text(encoding="utf-8")).items()}


def known_scenes() -> dict[str, tuple[dict, dict, np.ndarray]]:
    """Device, scene and tips of each scene that a version of the simulator got wrong.

    The tips are those of an independent DOP853 solution with events, in Lagrangian form; the solver of the random
    scenes agrees with all of them to 7 um.
    """
    found = json.loads(KNOWN.read_text(encoding="utf-8"))
    return {name: (one["device"], one["scene"], np.array(one["tips"])) for name, one in found.items()}
