"""Tables with wrong values in a right structure: none is taken wrongly without a word."""

import warnings

import numpy as np
from mutations import SPOILT, TABLES, spoilt_table

from core.drawn_path import read_path
from core.files import InputError, StrangeInput, read_text
from experiments.identify.step_response import read_steps
from experiments.simulate.scene import read_scene

SCENE = 'device = "four-brake"\nduration_s = 1.0\nstep_s = 1e-3\ninitial_tip_m = [0.0, 0.4]\n'
WHERE = {"force": '[force]\nfile = "it.csv"\n', "schedule": '[brakes]\nschedule = "it.csv"\n'}
REFUSED, WARNED, RIGHT, WRONG = "refused", "warned of", "taken rightly", "taken wrongly"


def numbers(kind, text, folder):
    """What the program takes a table for, as arrays."""
    (folder / "it.csv").write_text(text, encoding="utf-8")
    if kind == "points":
        path, _ = read_path({"kind": "drawing", "file": "it.csv"}, lambda name: read_text(folder / name), "")
        return [np.array(path.points_m)]
    if kind == "steps":
        return [np.array([step.key + (step.t[-1],) for step in read_steps(folder / "it.csv")])]
    scene = read_scene(folder / "scene.toml", SCENE + WHERE[kind])
    return [scene.force_t, scene.force] if kind == "force" else [scene.schedule_t, scene.schedule]


def fate_of_table(seed, folder):
    """What was done to a table, to which kind, and what became of it."""
    rng = np.random.default_rng(seed)
    cases = [(kind, what) for what, (_, kinds) in SPOILT.items() for kind in TABLES if not kinds or kind in kinds]
    kind, what = cases[seed % len(cases)]
    right, spoilt = spoilt_table(kind, what, rng)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", StrangeInput)
        try:
            found, expected = numbers(kind, spoilt, folder), numbers(kind, right, folder)
        except InputError:
            return what, REFUSED, spoilt
    if said:
        return what, WARNED, spoilt
    same = all(np.array_equal(one, other) for one, other in zip(found, expected, strict=True))
    return what, RIGHT if same else WRONG, spoilt


def test_a_spoilt_table_is_refused_warned_of_or_taken_rightly(tmp_path):
    fates = [fate_of_table(seed, tmp_path) for seed in range(0, 300, 3)]
    assert [fate for fate in fates if fate[1] == WRONG] == []
    assert {fate for _, fate, _ in fates} == {REFUSED, WARNED, RIGHT}
