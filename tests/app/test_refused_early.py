"""What cannot be is refused before anything opens: strangers, endless plans; what an operator goes without is said."""

import time
from pathlib import Path

import numpy as np
import pytest
from protocols import PAPER, changed, protocol_of, short

from app.cli import main
from app.ipc.messages import Setup
from app.session_server.preflight import done_without
from app.session_server.server import read_protocol
from app.session_server.session_progress import SessionProgress
from core.files import InputError
from experiments.inputs import OPERATOR
from experiments.protocol import MOST_TRIALS
from experiments.session.journal import unmeasured_row
from experiments.session.session import Session
from experiments.trial.population import load_population

NAMED = changed(PAPER.text, participants='["07", "08"]', devices='["four-brake"]')


@pytest.fixture
def named(tmp_path) -> Path:
    path = tmp_path / "named.toml"
    path.write_text(NAMED)
    return path


def test_a_participant_whom_the_protocol_does_not_name_is_refused_at_once(named, tmp_path, capsys):
    assert main(["run", str(named), "--participant", "09", "--print-plan"]) == 2
    told = capsys.readouterr()
    assert told.out == "" and told.err.count("\n") == 1 and "07, 08" in told.err and "09" in told.err
    setup = Setup(tmp_path / "data", str(named), participant="09")
    with pytest.raises(InputError, match="07, 08"):
        read_protocol(setup)
    assert main(["run", str(named), "--participant", "08", "--print-plan"]) == 0
    assert read_protocol(setup._replace(participant="08")).participants == ("07", "08")
    assert read_protocol(setup._replace(hand=OPERATOR)).name == PAPER.name  # a simulated one takes any place
    assert main(["run", str(named), "--participant", "09", "--print-plan", "--input", "operator"]) == 0


def test_a_session_that_is_there_is_taken_up_whoever_the_protocol_names_now(named, tmp_path):
    data = tmp_path / "data"
    Session(data, "09", PAPER, sync=False).close()
    assert read_protocol(Setup(data, str(named), participant="09")).participants == ("07", "08")


def test_a_plan_without_end_is_refused_in_one_sentence(tmp_path, capsys):
    path = tmp_path / "endless.toml"
    path.write_text(changed(PAPER.text, blocks="1000", repetitions="1000"))
    began = time.perf_counter()
    assert main(["run", str(path), "--print-plan"]) == 2
    told = capsys.readouterr()
    assert told.err.count("\n") == 1 and f"{MOST_TRIALS}" in told.err and "20000000" in told.err
    assert time.perf_counter() - began < 60.0  # it would take hours
    cells = len(PAPER.devices) * len(PAPER.paths) * len(PAPER.controllers)
    most = MOST_TRIALS // cells
    assert protocol_of(changed(PAPER.text, blocks=f"{most}", repetitions="1")).blocks == most
    with pytest.raises(InputError, match="at most"):
        protocol_of(changed(PAPER.text, blocks=f"{most + 1}", repetitions="1"))


def test_what_an_operators_sessions_go_without_is_said_in_one_sentence(tmp_path):
    full = protocol_of(changed(PAPER.text, blind="true", practice_trials="2", on="true"))
    setup = Setup(tmp_path, hand=OPERATOR)
    said = done_without(setup, full)
    assert all(word in said for word in ("blinding", "practice", "questionnaire")) and said.count(". ") == 0
    assert done_without(setup, protocol_of(changed(PAPER.text, practice_trials="0"))) == ""
    assert done_without(setup._replace(hand="mouse"), full) == ""


def test_no_questionnaire_is_put_to_a_simulated_operator(tmp_path):
    asking = short(1, 1, on="true")
    person = load_population().draw(np.random.default_rng(1))
    asked = {}
    for name, who in (("01", person), ("02", None)):
        session = Session(tmp_path, name, asking, who, sync=False)
        for _ in range(len(session.plan) // len(asking.devices)):
            trial = session.plan[len(session.rows)]
            session.rows.append(unmeasured_row(session.folder, trial._asdict(), "done"))
        asked[name] = SessionProgress(session).asked
        session.close()
    assert asked["01"] is None and asked["02"] is not None
