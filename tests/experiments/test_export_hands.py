"""Who or what moved which device stands in an export, for every way in which a trial can be recorded."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from protocols import short
from sessions import new_session, run

from core import tick_log
from experiments.export.export import export
from experiments.recording.schema import Sensors
from experiments.session.session import Session


def on_the_bench(session: Session, board: str) -> None:
    """One trial on a device on the bench that never got to its movement."""
    trial, writer = session.begin(session.next_planned(), Sensors("AB", 6))
    rows = np.full((300, tick_log.BENCH_WIDTH), np.nan)
    rows[:, tick_log.T] = np.arange(300) / 1000.0
    rows[:, [tick_log.PHASE, tick_log.STUCK, tick_log.DECISION, tick_log.FILLED]] = 0.0
    rows[:, tick_log.COUNT : tick_log.COUNT + 4] = 1234.0
    writer.write(rows)
    trial.connect(SimpleNamespace(end_record=lambda: {"link": {"board": board} if board else {}}))
    session.finish(trial, writer)


def record(data: Path, kind: str) -> None:
    """A session of one trial."""
    if kind == "operator":
        session = new_session(data)
    else:
        hand = "mouse" if kind.startswith("serial") else kind
        session = Session(data, "01", short(), None, sync=False, hand=hand)
    if kind.startswith("serial"):
        on_the_bench(session, kind.partition(" ")[2])
    else:
        trial, writer = session.begin(session.next_planned())
        if kind != "operator":
            run(trial, writer, 200)
            trial.abort("nobody at the handle")
        run(trial, writer)
        session.finish(trial, writer)
    session.close()


#: kind of recording -> hand, words of its level, simulated device, simulated operator, number of the board
KINDS = {
    "operator": ("operator", "simulated operator", True, True, "n/a"),
    "mouse": ("mouse", "with the mouse", True, False, "n/a"),
    "hid": ("hid", "six-axis device", True, False, "n/a"),
    "serial A17": ("force sensor", "on the bench", False, False, "A17"),
    "serial EMULATED-3": ("force sensor", "on the bench", True, True, "EMULATED-3"),
    "serial": ("force sensor", "on the bench", False, False, "unknown"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_hand_and_device_of_a_recording_stand_in_its_export(tmp_path: Path, kind: str) -> None:
    hand, words, simulated_device, simulated_operator, number = KINDS[kind]
    record(tmp_path / "data", kind)
    export(tmp_path / "data", {"bids": tmp_path / "bids", "csv": tmp_path / "csv"})
    bids = tmp_path / "bids"
    (motion,) = bids.glob("sub-01/ses-01/motion/*_motion.json")
    about = json.loads(motion.read_text())
    assert (about["SimulatedDevice"], about["SimulatedOperator"]) == (simulated_device, simulated_operator)
    assert about["DeviceSerialNumber"] == number and about["Trial"]["hand"] == hand
    header, person = [line.split("\t") for line in (bids / "participants.tsv").read_text().splitlines()]
    assert dict(zip(header, person, strict=True))["hand"] == hand
    levels = json.loads((bids / "participants.json").read_text())["hand"]["Levels"]
    assert list(levels) == [hand] and words in levels[hand]
    program = shutil.which("bids-validator-deno", path=str(Path(sys.executable).parent))
    if program:
        command = [program, str(bids), "--format", "json", "--max-rows", "-1"]
        done = subprocess.run(command, capture_output=True, text=True)
        issues = json.loads(done.stdout)["issues"]["issues"]
        assert [issue for issue in issues if issue["severity"] == "error"] == []
