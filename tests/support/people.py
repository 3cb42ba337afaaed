"""Simulated operators for tests."""

import numpy as np

from experiments.trial.operator import Person
from experiments.trial.population import load_population

AVERAGE = load_population("average")


def somebody(seed: int, **changes: float) -> Person:
    """A person of the average population, with some numbers changed."""
    return AVERAGE.draw(np.random.default_rng(seed))._replace(**changes)


def noiseless(person: Person) -> Person:
    """The same person without noise, tremor, or change from trial to trial."""
    return person._replace(noise_share=0.0, tremor_N=0.0, trial_bias_m=0.0, reaction_spread_s=0.0)
