"""The states of the board and every event in each of them (docs/protocol.md, "States", holds the same table)."""

from enum import Enum

from hardware.wire.messages import State


class Event(Enum):
    """What can happen to a board: a message from the host, or something of its own."""

    HELLO = "AskHello"
    LIMITS = "SetLimits"
    ON = "Command on"
    OFF = "Command off"
    HOME = "Home"
    RESET = "ResetFault"
    HEARTBEAT = "Heartbeat"
    STOP = "Stop"
    BYE = "Bye"
    STARTED = "started"  # the self-test is over
    STARTED_LOW = "started after brown-out"
    SILENCE = "silence"  # no good frame for SILENCE_US
    WATCHDOG = "watchdog"  # no fresh command for WATCHDOG_US
    BAD = "condition"  # over-current, over-speed, encoder, force saturated
    BROWN_OUT = "brown-out"  # the supply falls: the board stops and starts anew


BOOT, IDLE, READY, ACTIVE, FAULT = State

#: (state, event) -> the state after it; a pair that is not here changes nothing, for the reason that `handling` gives.
NEXT: dict[tuple[State, Event], State] = {
    (BOOT, Event.STARTED): IDLE,
    (BOOT, Event.STARTED_LOW): FAULT,
    (IDLE, Event.LIMITS): READY,
    (IDLE, Event.STOP): FAULT,
    (READY, Event.HELLO): IDLE,
    (READY, Event.ON): ACTIVE,
    (READY, Event.STOP): FAULT,
    (READY, Event.BYE): IDLE,
    (READY, Event.SILENCE): IDLE,
    (READY, Event.BAD): FAULT,
    (ACTIVE, Event.HELLO): IDLE,
    (ACTIVE, Event.OFF): READY,
    (ACTIVE, Event.STOP): FAULT,
    (ACTIVE, Event.BYE): IDLE,
    (ACTIVE, Event.WATCHDOG): FAULT,
    (ACTIVE, Event.BAD): FAULT,
    (FAULT, Event.RESET): IDLE,
    **{(state, Event.BROWN_OUT): BOOT for state in State},
}

#: Refused with WRONG_STATE.
REFUSED = {
    (IDLE, Event.ON),
    (IDLE, Event.OFF),
    (ACTIVE, Event.LIMITS),
    (ACTIVE, Event.HOME),
}

#: What a board does not see in that state: it does not watch for it.
UNSEEN = {
    *((BOOT, event) for event in (Event.SILENCE, Event.WATCHDOG, Event.BAD)),
    *((state, event) for state in State if state != BOOT for event in (Event.STARTED, Event.STARTED_LOW)),
    *((state, Event.WATCHDOG) for state in (IDLE, READY, FAULT)),
    (IDLE, Event.BAD),
    (IDLE, Event.SILENCE),
    (ACTIVE, Event.SILENCE),  # the watchdog was there long before
}

_MESSAGES = tuple(Event)[:9]


def handling(state: State, event: Event) -> str:
    """What the table of the specification says of a pair: the next state, "refused", "-" (not seen), or "same"."""
    if (state, event) in NEXT:
        return NEXT[state, event].name
    if (state, event) in REFUSED:
        return "refused"
    if (state, event) in UNSEEN:
        return "-"
    return "ignored" if state == BOOT and event in _MESSAGES else "same"
