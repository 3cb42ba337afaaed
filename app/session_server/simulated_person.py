"""A simulated operator in the participant's place: for sessions and passes without a person's hand."""

import numpy as np

from app.ipc.messages import OPERATOR, Setup
from experiments.plan import participant_index
from experiments.protocol import Protocol
from experiments.trial.operator import Person
from experiments.trial.population import load_population


def done_without(setup: Setup, protocol: Protocol) -> str:
    """What the protocol asks for and a simulated operator's sessions have not, as a sentence; "": nothing is amiss."""
    asked = {
        "no blinding": protocol.blind, "no practice": protocol.practice_trials > 0,
        "no questionnaire": protocol.questionnaire.on,
    }  # fmt: skip
    missing = [what for what, is_asked in asked.items() if is_asked]
    if setup.hand != OPERATOR or not missing:
        return ""
    return f"A simulated operator moves the handle: {' and '.join(missing)}, whatever the protocol says."


def person_at(setup: Setup, protocol: Protocol, participant: str) -> Person | None:
    """The simulated operator that has this participant's place, if one moves the handle."""
    if setup.hand != OPERATOR:
        return None
    seeds = np.random.SeedSequence([protocol.seed, participant_index(participant)])
    return load_population().draw(np.random.default_rng(seeds))
