"""The hand of a recorded trial to be had again: on the recorded motion it pulls with the recorded force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from protocols import PAPER
from sessions import new_session, run_trials

from core.path import Polyline, build_path
from core.simulator.hand import hand_force
from experiments.study.replay_motion import read_recorded, target_hand, what_is_held

BENT = Polyline(((-0.1, 0.4), (0.0, 0.43), (0.1, 0.4)))


def test_on_the_recorded_motion_the_arm_pulls_with_the_recorded_force(tmp_path):
    """Also where the spring is at its cap, and with an arm whose numbers are not quite those that were used."""
    session = new_session(tmp_path)
    run_trials(session, 1)
    session.close()
    trial = read_recorded(next(tmp_path.rglob("run-001.parquet")))
    recording, first, person = trial.recording, trial.first, session.person
    paths = (trial.path, build_path(BENT, "bent"))
    for arm in (person, person._replace(force_max_N=4.0), person._replace(stiffness_across_N_m=700.0)):
        for path in paths:
            hand = target_hand(recording, first, path, arm, PAPER.mouse)
            for tick in range(0, recording.rows - first, 97):
                at = {name: float(recording.column(name)[first + tick]) for name in recording.columns}
                hand.take(first + tick)
                fx, fy = hand_force(hand.hand, 0.0, at["tip_x_m"], at["tip_y_m"], at["tip_vx_m_s"], at["tip_vy_m_s"])
                assert fx - arm.mass_kg * at["tip_ax_m_s2"] == pytest.approx(at["hand_fx_N"], abs=1e-9)
                assert fy - arm.mass_kg * at["tip_ay_m_s2"] == pytest.approx(at["hand_fy_N"], abs=1e-9)


force = st.tuples(st.floats(-60.0, 60.0), st.floats(-60.0, 60.0))


@pytest.mark.nojit
@given(spring=force, held=force)
@settings(max_examples=80)
def test_spring_and_held_force_are_told_apart_where_the_operator_made_them(spring, held):
    clip, spring, held = 40.0, np.array([spring]), np.array([held])
    size = np.hypot(*held[0])
    held = held * min(1.0, clip / size) if size > clip else held
    cap = clip - np.hypot(*held[0])
    scale = min(1.0, cap / max(np.hypot(*spring[0]), 1e-300))
    force = scale * spring + held
    found, left = what_is_held(force, spring, clip)
    pull = min(1.0, left[0] / max(np.hypot(*spring[0]), 1e-300)) * spring
    assert np.allclose(pull + found, force, rtol=0.0, atol=1e-9)
    turned = spring[0, 0] * held[0, 1] - spring[0, 1] * held[0, 0]
    if scale == 1.0 or abs(turned) > 1.0:  # else many ways lead there
        assert np.allclose(found, held, rtol=0.0, atol=1e-6) and left[0] == pytest.approx(cap, abs=1e-6)
    assert left[0] >= 0.0
