"""The error bars of a study are computed from its own trials: same start, operator and noise, one thing changed."""

import numpy as np
import pytest
from msgspec.structs import replace

from core import tick_log
from experiments.analysis.simulation_errors import HAND, STEP, Moved
from experiments.plan import make_plan
from experiments.protocol import load_protocol
from experiments.study import unrecorded
from experiments.study.unrecorded import person_of, run_trial, simulation_errors, switched_on
from experiments.trial.normals import normals
from experiments.trial.population import load_population
from experiments.trial.trial import Conditions, SimulatedTrial

PAPER = load_protocol(sensing="ideal")
PROTOCOL = replace(PAPER, devices=PAPER.devices[:1], blocks=1)
PERSON = person_of(load_population("average"), PROTOCOL.seed, 1)
LAGLESS = unrecorded.BRAKES


@pytest.fixture(scope="module")
def found() -> dict[tuple[int, str, str], Moved]:
    """One device, five controllers, two paths: two trials a controller."""
    moved = simulation_errors(PROTOCOL, PERSON, "01")
    return {(one.controller, one.change, one.measure): one for one in moved}


def test_without_a_change_each_trial_comes_out_as_it_was_so_what_moves_is_the_change_alone(found, monkeypatch):
    monkeypatch.setattr(unrecorded, "SUBSTEPS", 1)
    monkeypatch.setattr(unrecorded, "ASIDE_M", 0.0)
    again = simulation_errors(PROTOCOL, PERSON, "01")
    assert {one.worst for one in again if one.change in (STEP, HAND)} == {0.0}
    assert [one for one in again if one.change == LAGLESS] == [one for one in found.values() if one.change == LAGLESS]


def test_the_integration_errs_little_and_most_where_brakes_switch_and_the_fidelity_counts_for_more(found):
    assert found[1, STEP, "path_error_m"].worst < 1e-10
    assert found[4, STEP, "path_error_m"].worst > 1e3 * found[1, STEP, "path_error_m"].worst
    for controller in (2, 4):
        assert found[controller, STEP, "path_error_m"].worst < 1e-5
        assert found[controller, LAGLESS, "path_error_m"].worst > 10.0 * found[controller, STEP, "path_error_m"].worst


def test_a_trial_in_finer_steps_has_the_same_ticks_decisions_and_noise():
    [planned] = [one for one in make_plan(PROTOCOL, "01", coded=False) if (one.controller, one.path) == (3, 1)]

    def rows(substeps):
        trial = SimulatedTrial(
            switched_on(PROTOCOL.devices[0], PROTOCOL),
            planned,
            Conditions(PROTOCOL.paths[1], PROTOCOL.controllers[3], PROTOCOL.rules, PROTOCOL.trial),
            PERSON,
            normals(1, 1, 1, 1),
        )
        trial.refine(substeps)
        return run_trial(trial).copy()

    once, fine, finer = rows(1), rows(10), rows(20)
    assert once.shape == fine.shape == finer.shape
    assert np.array_equal(once[:, tick_log.DECISION], finer[:, tick_log.DECISION])
    motion = slice(tick_log.TIP_X, tick_log.TIP_X + 4)
    apart = [np.max(np.abs(one[:, motion] - finer[:, motion])) for one in (once, fine)]
    assert 0.0 < apart[1] < 0.05 * apart[0] and apart[0] < 5e-5  # second order: a tenth of the step, a hundredth
