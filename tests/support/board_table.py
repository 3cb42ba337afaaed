"""The table of the specification, docs/protocol.md: what a board does with each event in each state."""

from hardware.emulated_board.board import NEXT, REFUSED, BoardEvent
from hardware.wire.messages import State

BOOT, IDLE, READY, ACTIVE, FAULT = State

#: What a board does not see in that state: it does not watch for it.
UNSEEN = {
    *((BOOT, event) for event in (BoardEvent.SILENCE, BoardEvent.WATCHDOG, BoardEvent.BAD)),
    *((state, event) for state in State if state != BOOT for event in (BoardEvent.STARTED, BoardEvent.STARTED_LOW)),
    *((state, BoardEvent.WATCHDOG) for state in (IDLE, READY, FAULT)),
    (IDLE, BoardEvent.BAD),
    (IDLE, BoardEvent.SILENCE),
    (ACTIVE, BoardEvent.SILENCE),  # the watchdog was there long before
}

_MESSAGES = tuple(BoardEvent)[:9]


def handling(state: State, event: BoardEvent) -> str:
    """What the table of the specification says of a pair: the next state, "refused", "-" (not seen), or "same"."""
    if (state, event) in NEXT:
        return NEXT[state, event].name
    if (state, event) in REFUSED:
        return "refused"
    if (state, event) in UNSEEN:
        return "-"
    return "ignored" if state == BOOT and event in _MESSAGES else "same"
