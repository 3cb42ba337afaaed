"""Every fault in the phases of a trial and between two: what the person is told, when the currents are zero, that
nothing recorded is lost, and that the device is of use again. In simulated time, so that the limits are laws.

As a script it prints a row for the table of docs/bench.md for each fault: `python tests/app/test_fault_matrix.py`.
"""

import itertools
import pickle
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fault_cases import Case, Place
from fault_kinds import BETWEEN, HARD, PHASES, SOFT, Fault
from firmware_board import Pipe, firmware_boards
from reference_board import on_a_cortex_m4
from simulated_bench import BenchWire, TcpWire

from app.ipc.ring import CODE, Ring
from core import tick_log
from core.faults import FAULTS, advice, after, cause
from experiments.store.verify import verify
from hardware.emulated_board.board import Board
from hardware.emulated_board.line_faults import KINDS
from hardware.sensing.samples import fault_words
from hardware.wire import messages

BOARD_MS, AGAIN_S = 50, 2.0
ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/bench.md"
SOURCES = [file for part in ("hardware", "experiments", "app") for file in (ROOT / part).rglob("*.py")]
WITH_TRIAL = "with the trial"  # that long the currents flow where the program finds the fault, not the board
WIRE_MS = 3  # from the app's decision to the board
#: Each fault comes over a TCP connection, in place of the serial port, in one phase of a trial: the first in the first,
#: the next in the next, and so round. Hold and end are as the approach, without current: those alone come there, and at
#: the end what no longer changes the trial.
BY_TCP = [(fault.name, phase) for fault, phase in zip(HARD, itertools.cycle(tick_log.PHASES), strict=False)]
EVERY = [
    pytest.param(fault, phase, wire, id=f"{fault.name}-{phase}{'-tcp' if wire is TcpWire else ''}")
    for fault in HARD for phase in PHASES for wire in (BenchWire, TcpWire)
    if wire is TcpWire and (fault.name, phase) in BY_TCP
    or wire is BenchWire and phase == "move"
    or wire is BenchWire and (fault.name, phase) not in BY_TCP
    and (phase in (BETWEEN, "approach") or phase == "end" and "end" in fault.goes_on)
]  # fmt: skip
#: what comes over the board in C, too
IN_C = ("unplug", "uncounted start")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    made = Place.make(tmp_path_factory.mktemp("faults"))
    yield made
    made.session.close()


def check_kept(case: Case) -> None:
    """The recording is whole, has every tick, and says why it ended; no current is in it but in the movement."""
    if case.killed and case.ticks == 0:  # no tick was made: there is nothing to record
        assert case.row.status == "recovered" and not case.row.recording
        return
    recording = case.recording
    assert recording.rows == case.ticks > 0
    if case.killed:
        assert recording.whole and recording.outcome["status"] == case.row.status == "recovered"
    else:
        assert recording.whole
        assert recording.outcome["status"] == case.row.status
        assert recording.outcome["reason"].removeprefix("brakes off: ") in case.words  # the window says that they are
        assert bool(recording.outcome["reason"]) == bool(case.words)
    assert np.allclose(np.diff(recording.column("t_s")), 1e-3)
    outside = ~recording.in_phase("move")
    for joint in recording.braked:
        assert not recording.column(f"current_{joint}_A")[outside].any()


def check_told(case: Case) -> None:
    """The words name the cause and say what to do."""
    assert any(cause.lower() in case.words.lower() for cause in case.fault.causes), case.words
    found = [fault.advice for fault in FAULTS.values() if fault.advice in case.words]
    assert found and (not case.afterwards or any(fault.advice in case.afterwards for fault in FAULTS.values()))


@pytest.mark.parametrize(("fault", "phase", "wire"), EVERY)
def test_a_fault_is_told_makes_the_currents_zero_and_loses_nothing(fault, phase, wire, place) -> None:
    case = Case(place, fault, phase, wire)
    assert case.flowing == (phase == "move")
    if phase in fault.goes_on:
        assert phase == BETWEEN or case.row.status in ("done", "timeout")
    else:
        check_told(case)
        reading_on = case.bench.link.health.lost_links  # a thread that looks for the board makes time pass as well
        assert phase == BETWEEN and reading_on or case.seen_ms <= fault.seen_ms
        assert case.killed or phase in (BETWEEN, "end") or case.row.status == "stopped"
        if phase == "move":
            assert case.zero_ms <= (BOARD_MS if fault.board else case.seen_ms + WIRE_MS)
            assert case.zero_ms <= case.seen_ms + WIRE_MS or fault.board
            if wire is BenchWire:
                said, now = rows_of_page()[fault.name], row_of(case)
                assert said[2] == now[2] and (said[1] == WITH_TRIAL or case.zero_ms <= int(said[1]))
    if phase in ("approach", "hold") and phase not in fault.goes_on and fault.board:
        assert case.zero_ms == 0
    if phase != BETWEEN:
        check_kept(case)
    case.use_again()
    assert case.again_s <= AGAIN_S
    case.close()


@pytest.fixture(scope="module")
def cortex_m4() -> Iterator[Pipe]:
    running = Pipe(on_a_cortex_m4())
    yield running
    running.close()


@pytest.mark.parametrize("fault", [fault for fault in HARD if fault.name in IN_C], ids=lambda fault: fault.name)
def test_over_the_board_in_c_a_fault_ends_a_trial_as_over_the_python_board(fault, place, cortex_m4) -> None:
    cases = []
    for board in (Board, firmware_boards(lambda: cortex_m4)):
        case = Case(place, fault, "move", board=board)
        case.use_again()
        assert case.flowing and case.zero_ms <= BOARD_MS and case.again_s <= AGAIN_S
        check_kept(case)
        case.close()
        cases.append((case.zero_ms, case.row.status, re.sub(r"Trial \d+", "Trial", case.words)))
    assert cases[0] == cases[1]


@pytest.mark.parametrize("fault", SOFT, ids=lambda fault: fault.name)
def test_a_bad_wire_is_survived_through_all_phases(fault: Fault, place: Place) -> None:
    case = Case(place, fault, "approach")
    assert case.row.status == "done" and case.words == ""
    check_kept(case)
    assert all(case.recording.in_phase(phase).any() for phase in tick_log.PHASES)
    assert bool(case.running.outcome()["filled"]) == fault.text.startswith(("drop", "corrupt"))
    case.use_again()
    case.close()
    between = Case(place, fault, BETWEEN, TcpWire)
    assert between.words == ""
    between.close()


def test_practice_keeps_its_recording_too(place: Place) -> None:
    unplug = next(fault for fault in HARD if fault.name == "unplug")
    place.plan[unplug.device].insert(0, place.session.next_practice())
    case = Case(place, unplug, "move")
    assert case.words.startswith("The practice trial: ") and case.zero_ms <= BOARD_MS
    check_told(case)
    case.use_again()
    case.close()
    assert list((place.session.folder / "practice").glob("run-*.parquet"))


def test_every_recording_of_a_day_full_of_faults_is_whole_or_recovered(place: Place) -> None:
    Case(place, HARD[0], "move").close()
    found = verify(place.folder / "data")
    assert found["faults"] == [] and found["whole"] + found["recovered"] >= 1


def test_every_fault_has_words_and_says_what_to_do_and_is_told_somewhere() -> None:
    latched = {fault_words(bit).code for bit in messages.Fault}  # on the board
    assert len(latched) == len(messages.Fault) and "unknown" not in latched
    used = {code for file in SOURCES for code in FAULTS if f'"{code}"' in file.read_text()}
    assert used | latched == set(FAULTS), "and none is left that nothing leads to"
    for code, fault in FAULTS.items():
        assert fault.words and (fault.advice.endswith(".") or code == "brakes-off"), code
        assert len(code) <= CODE
    assert advice("participant had to sneeze") == ""


def test_a_fault_stays_what_it_is_on_its_way_to_the_experimenter() -> None:
    why = after("after its end: ", cause("watchdog"))
    assert why == "after its end: the board got no command for 50 ms" and advice(why) == FAULTS["watchdog"].advice
    there = pickle.loads(pickle.dumps(why))
    assert there == why and there.code == "watchdog"
    ring = Ring(ticks=8)
    ring.switch_off(why)
    assert Ring(ring.handle).why_off == why and advice(Ring(ring.handle).why_off) == advice(why)


def test_no_fault_is_left_out() -> None:
    asked = {fault.text.split("=")[0].split("+")[0] for fault in (*HARD, *SOFT)} - {""}
    assert asked == set(KINDS)


def row_of(case: Case) -> list[str]:
    """The row of the page for a fault in a movement: fault, ms until the currents are zero, cause."""
    said = case.words.partition(": ")[2] if case.words.startswith("Trial ") else case.words
    why = said.partition(". ")[0].rstrip(".").replace("for 0.1 s", "for 1 s")  # as a protocol has it
    return [case.fault.name, str(case.zero_ms), why[0].upper() + why[1:]]


def rows_of_page() -> dict[str, list[str]]:
    """Fault -> its row on the page, which several may share."""
    table = PAGE.read_text("utf-8").partition("| fault | currents zero within")[2].partition("\n\n")[0]
    rows = [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]
    return {name: row for row in rows for name in row[0].split(", ")}


def test_the_page_has_every_fault() -> None:
    assert rows_of_page().keys() == {fault.name for fault in HARD}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        bench = Place.make(Path(name))
        for hard in HARD:
            found = Case(bench, hard, "move")
            found.use_again()
            found.close()
            print("| " + " | ".join(row_of(found)) + " |")
        bench.session.close()
