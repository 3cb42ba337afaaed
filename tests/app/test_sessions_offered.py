"""What the start page is told of the sessions that are there, and of the next one."""

from pathlib import Path

import pytest
from protocols import PAPER, changed, protocol_of, short
from sessions import new_session
from simulated_loop import local_window

from app.ipc.messages import OPERATOR, Setup
from experiments.session.files import protocols_otherwise


def test_a_session_is_of_another_protocol_when_anything_in_it_differs(tmp_path: Path) -> None:
    for participant, protocol in (("01", PAPER), ("02", short()), ("03", protocol_of(changed(PAPER.text, seed="2")))):
        new_session(tmp_path, participant, protocol).close()
    there = ("01", "02", "03", "04")  # the last is gone by now
    assert protocols_otherwise(tmp_path, there, PAPER) == {"02": PAPER.name, "03": PAPER.name}
    assert protocols_otherwise(tmp_path, there, short()) == {"01": PAPER.name, "03": PAPER.name}


@pytest.mark.parametrize("hand", ["mouse", OPERATOR])
def test_before_a_session_it_is_known_whose_runs_otherwise_and_whether_the_next_is_blind(tmp_path, hand: str) -> None:
    data, file = tmp_path / "data", tmp_path / "pilot.toml"
    file.write_text(changed(PAPER.text, blind="true"), encoding="utf-8")
    new_session(data, "01").close()
    with local_window(Setup(data, str(file), hand=hand, real_time=False)) as bench:
        snapshot = bench.until(lambda s: s.resumable)
        assert snapshot.resumable == ("01",) and snapshot.otherwise == (("01", PAPER.name),)
        assert bench.opened is not None and bench.opened.blind == (hand != OPERATOR)
        bench.until_stage("no session")
        assert bench.open("02").blind == bench.opened.blind
