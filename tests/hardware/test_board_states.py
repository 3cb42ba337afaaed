"""The board's state machine: every event in every state, as the specification's table says.

Each of the 75 pairs is a test of its own.
"""

import re
from pathlib import Path

import pytest
from board_table import UNSEEN, handling
from simulated_board import FULL, NO_LIMIT, SimulatedBoard

from hardware.emulated_board.board import SILENCE_US, TICK_US, Board, BoardEvent
from hardware.wire.messages import (
    AskHello,
    Bye,
    Heartbeat,
    Home,
    Refused,
    ResetFault,
    SetLimits,
    State,
    Stop,
)

SPECIFICATION = (Path(__file__).resolve().parents[2] / "docs" / "protocol.md").read_text()
PAIRS = [(state, event) for state in State for event in BoardEvent]
SEEN = [pair for pair in PAIRS if pair not in UNSEEN]


def in_state(state: State, event: BoardEvent | None = None, kind: type[Board] = Board) -> SimulatedBoard:
    """A board in a state, by the shortest way from power-up."""
    bench = SimulatedBoard(kind=kind)
    if state == State.BOOT:
        if event is BoardEvent.STARTED_LOW:
            bench.start().board.lose_power(bench.now_us)
        return bench
    bench.start()
    if state != State.IDLE:
        bench.connect()
    if state == State.ACTIVE:
        bench.command()
    if state == State.FAULT:
        bench.tell(Stop())
    assert bench.state == state
    return bench


def happen(bench: SimulatedBoard, event: BoardEvent) -> list[tuple]:
    """Make an event happen; what the board says to it."""
    told = {
        BoardEvent.HELLO: AskHello(1),
        BoardEvent.LIMITS: SetLimits(FULL, NO_LIMIT),
        BoardEvent.HOME: Home(0b0101, (5, 0, 7, 0)),
        BoardEvent.RESET: ResetFault(),
        BoardEvent.HEARTBEAT: Heartbeat(9),
        BoardEvent.STOP: Stop(),
        BoardEvent.BYE: Bye(),
    }
    if event in told:
        return bench.tell(told[event])
    if event in (BoardEvent.ON, BoardEvent.OFF):
        return bench.command(mode=int(event is BoardEvent.ON))
    if event in (BoardEvent.STARTED, BoardEvent.STARTED_LOW):
        bench.start()
    elif event is BoardEvent.SILENCE:
        bench.tick(SILENCE_US // TICK_US)
    elif event is BoardEvent.WATCHDOG:
        bench.tick(50)
    elif event is BoardEvent.BAD:
        return bench.tick(encoder_good=(False, True, True, True))
    elif event is BoardEvent.BROWN_OUT:
        bench.board.lose_power(bench.now_us)
    return []


@pytest.mark.parametrize(("state", "event"), SEEN, ids=[f"{s.name}-{e.name}" for s, e in SEEN])
def test_each_event_in_each_state_does_what_the_table_says(state: State, event: BoardEvent) -> None:
    bench = in_state(state, event)
    bench.board.seen.clear()
    answers = happen(bench, event)
    assert bench.board.seen.get((state, event)) == 1, "the pair was not visited"
    says = handling(state, event)
    assert bench.state == (State[says] if says in State.__members__ else state)
    assert (Refused in map(type, answers)) == (says == "refused")
    if says == "ignored":
        assert answers == []
    if bench.state != State.ACTIVE:
        assert bench.board.currents == (0, 0, 0, 0)


def test_the_table_covers_every_pair_and_the_specification_holds_it() -> None:
    """The page says in words what Boot does, and what leads there."""
    states = [state for state in State if state != State.BOOT]
    of_boot = {BoardEvent.STARTED, BoardEvent.STARTED_LOW, BoardEvent.BROWN_OUT}
    section = SPECIFICATION.partition("\n## States\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| ([^|]+) \| ((?:[^|]+\|){4})$", section, re.M)
    written = {event: [cell.strip() for cell in cells.split("|")[:4]] for event, cells in rows[1:]}
    assert len(SEEN) + len(UNSEEN) == len(State) * len(BoardEvent) == 75
    assert written == {
        event.value: [handling(state, event) for state in states] for event in BoardEvent if event not in of_boot
    }
