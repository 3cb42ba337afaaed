"""The shipped protocol `wedge`: its paths leave the range in which some brake is valid, the paper's do not."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from core.path import build_path, point_at
from experiments.paper_figures.directions import HALF_TURN, force_lines
from experiments.protocol import load_protocol
from experiments.study.unrecorded import study_trials
from experiments.trial.population import load_population


def without_valid_brake(device, path_file, side):
    """Share of a path beside which (side: +1 left, -1 right) no SDOF path lies between tangent and inward normal."""
    path = build_path(path_file, "path")
    x, y, tx, ty = np.array([point_at(path, share * path.length) for share in np.linspace(0.0, 1.0, 201)]).T
    lines = force_lines(device.mechanism, device.braked, x, y) + 0.5 * HALF_TURN  # SDOF paths, Eq. (12)
    turn = np.mod(-side * (lines - math.atan2(ty[0], tx[0])), HALF_TURN)  # from the tangent towards the path
    return float(np.mean((turn > 0.5 * HALF_TURN + 1e-9).all(axis=1)))


@pytest.mark.parametrize("device", load_protocol("wedge").devices, ids=lambda device: device.name)
def test_beside_its_paths_no_brake_is_valid_on_most_of_the_way_and_beside_the_papers_nowhere(device):
    paths = load_protocol("wedge").paths
    for number, path in paths.items():
        shares = {side: without_valid_brake(device, path, side) for side in (1, -1)}
        assert max(shares.values()) > 0.6, (number, shares)
    if device.name != "er-two-brake":  # which has too few brakes for the paper's second segment
        for path in load_protocol("paper").paths.values():
            assert without_valid_brake(device, path, 1) == without_valid_brake(device, path, -1) == 0.0


@pytest.mark.parametrize("rules", ["settled", "literal"])
def test_its_trials_have_the_locks_and_releases_of_the_rules_on_every_device(rules):
    protocol = replace(load_protocol("wedge"), rules=rules, blocks=1)
    released, locked = {}, {}
    for trial in study_trials(protocol, load_population(), 1):
        cell = trial.planned.configuration, trial.planned.controller
        for found, measure in ((released, "released_share"), (locked, "locked_share")):
            found.setdefault(cell, []).append(trial.measures[measure])
    for (device, controller), shares in released.items():
        if controller == 1:
            assert shares == [None, None]
        elif controller in (2, 5):
            assert max(shares) > 0.1, (device, controller, shares)
    devices = {device for device, _ in locked}
    assert len(devices) == 3
    assert all(any(locked[device, controller] != [0.0, 0.0] for controller in (2, 4, 5)) for device in devices)
    if rules == "literal":  # the slightest push away from the path locks
        assert all(max(locked[device, 2]) > 0.02 for device in devices)
