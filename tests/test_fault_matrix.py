"""Every fault in every phase of a trial: what the person is told, when the currents are zero, what is kept, and that
the device is of use again. In simulated time; two of them over a pseudo-terminal are in test_emulate.py."""

from pathlib import Path

import numpy as np
import pytest
from linked import LinkedBench
from protocols import PAPER
from simulated_bench import TIP

from core import row
from core.device import build_device, load_device
from core.path_file import Segment
from experiments.linked_trial import CONTRADICT, SILENT, LinkedTrial
from experiments.plan import PlannedTrial
from experiments.recording import RecordingWriter, convert_to_parquet, read_recording
from experiments.recording_form import Sensors
from hardware.emulated_device import HeldHand
from hardware.faults import KINDS

AWAY, START, END = (0.02, 0.36), TIP, (0.06, 0.40)
PATH = Segment(START, END)
RULES = PAPER.trial._replace(hold_s=0.15, start_radius_m=0.008, end_radius_m=0.006, end_s=0.2, time_out_s=0.6)
NO = (0.0,) * 4
BOARD_MS, APP_MS, AGAIN_S = 50, 200, 2.0

#: fault -> how the trial ends (None: it goes on), and what the person reads of it
HARD = {
    "stall+0.4": (SILENT,),
    "stall+0.07": ("the board: no command for 50 ms", SILENT),
    "delay=0.08": (SILENT, "the board: no command for 50 ms"),
    "unplug+0.5": ("serial port bench: it is gone",),
    "brown-out+0.1": (SILENT,),
    "bad-encoder=A+0.1": ("the board: an encoder's signal is bad",),
    "saturated-force+0.1": ("the board: the force sensor is at the end of its range",),
}
SOFT = ["drop=0.2", "corrupt=0.2", "duplicate=0.5", "delay=0.02", "jitter=0.01"]


class Case:
    """A trial of a hand on a spring, brought into a phase; then a fault."""

    def __init__(self, phase: str, device=None) -> None:
        self.bench = LinkedBench(hand=HeldHand(AWAY if phase == "approach" else START), device=device or "four-brake")
        self.board = self.bench.board
        planned = PlannedTrial(1, 1, self.bench.device.name, 2, 1, 1)
        self.trial = LinkedTrial(
            self.bench.device, planned, PATH, PAPER.controllers[2], PAPER.rules, RULES, self.bench.link, self.bench.now
        )
        self.rows: list[np.ndarray] = []
        if phase == "approach":
            self.go(lambda: self.trial.ticks > 40)
            self.bench.hand.obey({"target": list(START)})
            return
        self.go(lambda: self.trial.phase == phase or self.trial.phase == "move")
        if phase in ("move", "end"):
            self.bench.hand.obey({"target": [END[0] + 0.03, END[1] + 0.01]})
            self.go(lambda: any(self.board.board.currents))
        self.go(lambda: self.trial.phase == phase)
        self.go(lambda: self.trial.ticks % 10 == 5)

    def go(self, until) -> None:
        end = self.board.ticks + 10_000
        while not until():
            self.rows += self.bench.exchange(self.trial)
            assert self.board.ticks < end and not (self.trial.finished and until is not self.finished)

    def finished(self) -> bool:
        return self.trial.finished

    def fault(self, text: str) -> None:
        """From now on; how many ms later the trial was seen to end."""
        self.at = self.board.ticks
        self.board.fault(text)
        self.seen_ms = 0
        while not self.trial.finished and self.board.ticks - self.at < 5000:
            self.rows += self.bench.exchange(self.trial)
            if self.trial.phase == "end" and not self.seen_ms:
                self.seen_ms = self.board.ticks - self.at

    def kept(self, folder: Path):
        """The recording, as it can be read when the trial is over."""
        path = folder / "run-001.arrows"
        with RecordingWriter(path, self.bench.device.braked, {}, sync=False, sensors=Sensors("AB", 6)) as writer:
            writer.write(np.array(self.rows))
            writer.close(self.trial.outcome())
        return read_recording(convert_to_parquet(path, sync=False))

    def use_again(self) -> float:
        """What the app does when the fault is past; s of real time until a trial could begin."""
        while any(fault.acts(self.bench.now()) for fault in self.board.faults):
            self.bench.link.exchange(NO)
            self.bench.pass_time(1)
        seconds = self.bench.until_back()
        link = self.bench.link
        self.bench.idle(3)
        sample = next(s for _ in range(20) if (s := link.exchange(NO)) is not None)
        if sample.fault:
            self.bench.idle(20)
            link.reset()
        if not sample.homed:
            link.home(self.board.device.tip)
        self.bench.idle(120)  # what was held up on the wire is past
        sample = next(s for _ in range(20) if (s := link.exchange(NO)) is not None)
        assert sample.homed and not sample.fault and np.allclose(sample.tip, self.board.device.tip, atol=1e-3)
        return seconds

    def close(self) -> None:
        self.bench.link.close()


def check_kept(case: Case, folder: Path) -> None:
    recording = case.kept(folder)
    assert recording.whole and recording.rows == case.trial.ticks == len(case.rows) > 0
    assert np.allclose(np.diff(recording.column("t_s")), 1e-3)
    outside = ~recording.in_phase("move")
    for joint in recording.braked:
        assert not recording.column(f"current_{joint}_A")[outside].any()


@pytest.mark.parametrize("phase", row.PHASES)
@pytest.mark.parametrize("fault", HARD)
def test_a_fault_ends_the_trial_with_its_reason_and_the_currents_in_time(
    fault: str, phase: str, tmp_path: Path
) -> None:
    case = Case(phase)
    flowing = any(case.board.board.currents)
    assert flowing == (phase == "move")
    case.fault(fault)
    assert case.trial.finished and not any(case.trial.currents)
    case.bench.pass_time(BOARD_MS)
    assert not any(case.board.board.currents)
    assert case.board.last_current - case.at <= BOARD_MS
    outcome = case.trial.outcome()
    if phase == "end":
        assert outcome["status"] == "done"
        assert any(reason in outcome["reason"] for reason in HARD[fault]) or not outcome["reason"]
    else:
        assert outcome["status"] == "aborted" and outcome["reason"] in HARD[fault]
        assert 0 < case.seen_ms <= APP_MS
    check_kept(case, tmp_path)
    if fault.startswith("delay"):
        case.board.faults.clear()
    assert case.use_again() <= AGAIN_S
    case.close()


@pytest.mark.parametrize("phase", row.PHASES)
@pytest.mark.parametrize("fault", SOFT)
def test_a_bad_wire_is_survived_in_every_phase(fault: str, phase: str, tmp_path: Path) -> None:
    case = Case(phase)
    case.fault(f"{fault}+0.3")
    outcome = case.trial.outcome()
    if phase == "approach":  # the hand stands at the start and is not told to go: the movement is timed out
        assert outcome["status"] == "timeout"
    else:
        assert outcome["status"] in ("done", "timeout") and outcome["reason"] == ""
    assert (outcome["filled"] > 20) == fault.startswith(("drop", "corrupt")) or phase == "end"
    check_kept(case, tmp_path)
    case.close()


@pytest.mark.parametrize("phase", ["approach", "move"])
def test_four_encoders_give_a_stuck_one_away(phase: str, tmp_path: Path) -> None:
    shipped = load_device("four-brake")
    text = shipped.text.replace("A = 96000", "A = 96000, E = 96000, C = 96000")
    assert text != shipped.text
    case = Case(phase, build_device(text, shipped.brake_texts, "test"))
    case.fault("stuck-encoder=A")
    outcome = case.trial.outcome()
    assert outcome["reason"] == CONTRADICT and case.board.last_current - case.at <= case.seen_ms + BOARD_MS
    case.close()


def test_no_fault_is_left_out() -> None:
    asked = {fault.split("=")[0].split("+")[0] for fault in (*HARD, *SOFT)} | {"stuck-encoder"}
    assert asked == set(KINDS)
