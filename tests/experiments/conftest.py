"""What several files of these tests look at and none changes: it is made once."""

from pathlib import Path

import pytest
from protocols import PEOPLE, short

from experiments.protocol import Protocol, protocol_from_json, protocol_to_json
from experiments.study.study import run_study


def seeded(seed: int, protocol: Protocol) -> Protocol:
    """The protocol with a seed that is given beside its file."""
    return protocol_from_json({**protocol_to_json(protocol), "overrides": {"seed": seed}}, "test")


@pytest.fixture(scope="session")
def whole_study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One operator's study of twenty trials by the paper's controllers; seed 4."""
    out = tmp_path_factory.mktemp("whole") / "study"
    run_study(out, 1, seeded(4, short()), PEOPLE)
    return out
