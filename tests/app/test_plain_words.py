"""What is said is so: statuses, checks, energies, units, names, the board that was pulled out."""

import errno
import re
from dataclasses import replace
from types import SimpleNamespace

import pytest
import serial
from fake_client import PLAN, opened, result

from app.ipc import messages as m
from app.ipc.messages import DeviceStatus
from app.ipc.scheduling import Scheduling
from app.session_server.preflight import check_real, check_sensor
from app.session_server.session_progress import SessionProgress
from app.session_server.storage import Storage
from app.session_server.trial_runner import TrialRunner
from app.verbs.common import label_of_key, summary_text
from app.window.run.energy import small_energy
from app.window.widgets import words
from experiments.analysis.report_sentences import sentences
from experiments.analysis.statistics import Result
from hardware.serial_port import _reason

DEFAULT = Scheduling(False, False, -1, "default")


def test_a_trial_is_named_by_its_path_as_the_printed_plan_names_it() -> None:
    assert words.cell(PLAN[0], opened(), blind=True) == f"path {PLAN[0].segment}"
    assert "segment" not in words.describe(PLAN[0], opened(), blind=False)


def test_a_loop_that_compiles_says_how_far_and_that_it_is_once(monkeypatch) -> None:
    loop = SimpleNamespace(closed=False, hung=False, receive=lambda wait_s: [m.Compiling(45, 252, False)])
    runner = TrialRunner(SimpleNamespace(), loop, real_time=False)
    assert runner.check.text == "preparing"
    runner.watch()
    assert (runner.check.state, runner.check.text) == (m.WAITING, "compiling, 45 of 252")
    assert "once on a computer" in runner.check.advice
    loop.receive = lambda wait_s: [m.Compiling(252, 252, True)]
    runner.watch()
    assert runner.check.text == "compiling, 252 of 252, linking"
    monkeypatch.setattr("app.session_server.trial_runner.leave_core", lambda core: None)
    loop.receive, loop.send = (lambda wait_s: [m.Prepared(DEFAULT)]), lambda job: None
    runner.watch()
    assert runner.check.text == "preparing"


def test_without_its_board_a_force_sensor_is_not_ready() -> None:
    there = DeviceStatus("four-brake", "B1", homed=True, zeroed=True, force_channels=6)
    assert check_sensor(there).state == m.GOOD == check_real(there, "").state
    gone = there._replace(problem="no sample for 200 ms")
    assert check_sensor(gone).state == m.WAITING and check_real(gone, "").state == m.BAD


DENIED, NOT_FOUND = "PermissionError(13, 'Access is denied.', None, 5)", "FileNotFoundError(2, 'No file.', None, 2)"


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (serial.SerialException("device reports readiness to read but returned no data"), "the board was unplugged"),
        (OSError(errno.EIO, "Input/output error"), "the board was unplugged"),
        (OSError(errno.ENXIO, "No such device or address"), "the board was unplugged"),
        (serial.SerialException(f"ClearCommError failed ({DENIED})"), "the board was unplugged"),
        (serial.SerialException(f"could not open port 'COM3': {DENIED}"), "another program is using it"),
        (serial.SerialException(f"could not open port 'COM3': {NOT_FOUND}"), "there is no such port"),
    ],
)
def test_what_is_wrong_with_a_port_is_said_alike_on_each_system(error: Exception, said: str) -> None:
    assert _reason(error) == said


@pytest.mark.parametrize(
    ("energy", "said"), [(-3e-9, "-3 nJ"), (2e-5, "20 µJ"), (4e-3, "4 mJ"), (1.5, "1.5 J"), (5e-7, "500 nJ")]
)
def test_small_energies_are_said_in_units_that_fit(energy: float, said: str) -> None:
    assert small_energy(energy) == said


def test_a_summary_gives_units_as_units_and_names_what_it_lists() -> None:
    faults = [{"file": "run-001", "fault": "cut off"}]
    summary = {"low_gain_N_s_m": 5.0, "wall_s": 2.0, "left_out": ["a", "b"], "rules": "settled", "faults": faults}
    lines = summary_text(summary | {"warnings": ["few people"]}).splitlines()
    names = [line.split("  ")[0] for line in lines[:5]]
    assert names == ["low gain (N s/m)", "wall (s)", "left out", "rules", "faults"]
    assert [line.split()[-1] for line in lines[2:5]] == ["2", "settled", "1"]
    assert lines[5:] == ["left out: a", "left out: b", "run-001: cut off", "warning: few people"]
    assert label_of_key("operators") == "operators"
    reached = {"controller": 2, "name": "SDOF", "share_reached": 0.9583333}
    shares = {"controllers": [reached], "already_done": 3, "low_gain_N_s_m": None}
    assert dict(re.split(r"\s{2,}", line) for line in summary_text(shares).splitlines()) == {
        "share reached, SDOF": "95.83 %", "already done": "3", "low gain (N s/m)": "none"
    }  # fmt: skip


def test_the_order_of_controllers_is_told_by_their_names() -> None:
    empty = dict.fromkeys(Result._fields)
    orders = [
        Result(**{**empty, "test": "order", "configuration": "a", "measure": measure, "first": order, "second": "x"})
        for measure, order in (("x", "2 < 1"), ("y", "1 < 2"))
    ]
    [said] = sentences(orders, {1: "free", 2: "my wall"})
    assert "least first: my wall < free. Free and my wall change places by y" in said


@pytest.mark.parametrize(
    ("status", "block", "said"),
    [
        ("aborted", 1, "Trial 3 was aborted: the participant asked."),
        ("stopped", 1, "Trial 3 stopped: the participant asked. It is repeated next."),
        (
            "stopped",
            0,
            "The practice trial stopped: the participant asked. It is repeated next.",
        ),  # practice cannot be skipped
    ],
)
def test_how_a_trial_ended_and_what_can_be_done_is_said_with_its_reason(monkeypatch, status, block, said):
    heard: list[str] = []
    row = replace(result(PLAN[2], status), block=block, run=62)  # a repetition, whose run the plan does not show
    storage = Storage(SimpleNamespace(run=None), lambda text, bad=False: heard.append(text))
    storage.progress = SessionProgress.__new__(SessionProgress)
    storage.progress.session = SimpleNamespace(
        plan=PLAN, rows=(), go_on=lambda: None, database=SimpleNamespace(commit=lambda: None)
    )
    for name in ("trial_ended", "update_next", "without_valid_trial"):
        monkeypatch.setattr(SessionProgress, name, lambda *_: "")
    trial = SimpleNamespace(outcome=lambda: {"reason": "the participant asked"})
    storage.store_trial(SimpleNamespace(planned=PLAN[2], trial=trial, finish=lambda session: row, again="never"))
    assert heard == [said]
