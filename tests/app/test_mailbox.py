"""The line between window and conductor: nobody waits for the other end, and no message is lost."""

import socket
from multiprocessing.connection import Connection

import numpy as np
import pytest

from app.ipc.socket import Mailbox


def two_ends() -> tuple[Mailbox, Mailbox]:
    ours, theirs = socket.socketpair()
    return Mailbox(Connection(ours.detach())), Mailbox(Connection(theirs.detach()))


@pytest.mark.timeout(60)
def test_an_end_that_does_not_read_never_makes_the_other_wait_and_loses_no_event() -> None:
    ours, theirs = two_ends()
    offered = [ours.offer(bytes(4000)) for _ in range(500)]
    for i in range(300):
        ours.send((i, bytes(1000)))  # one that waits would wait for ever
    assert offered[0] and not offered[-1] and ours.waiting
    events: list[int] = []
    while len(events) < 300:
        events += [message[0] for message in theirs.receive(1.0) if isinstance(message, tuple)]
        ours.flush()
    assert events == list(range(300)) and not ours.waiting
    theirs.close()
    assert ours.receive(1.0) == [] and ours.closed
    ours.close()


def test_what_an_end_said_right_before_it_left_is_heard_also_by_one_that_spoke_meanwhile() -> None:
    ours, theirs = two_ends()
    theirs.send("nobody reads this")
    ours.send("abort")
    ours.close()
    theirs.send("a snapshot")
    assert theirs.receive(1.0) == ["abort"] and not theirs.waiting
    assert theirs.receive(1.0) == [] and theirs.closed
    theirs.close()


def test_messages_of_any_size_come_whole_and_in_order_also_the_last_ones_before_the_end() -> None:
    ours, theirs = two_ends()
    sent = [np.arange(n) for n in (0, 1, 100_000, 3)]
    got: list[np.ndarray] = []
    for message in sent:
        ours.send(message)
        got += theirs.receive()
    while ours.waiting:
        ours.flush()
        got += theirs.receive()
    ours.close()
    got += theirs.receive(1.0)
    assert [len(message) for message in got] == [0, 1, 100_000, 3] and theirs.closed
    theirs.close()


def test_an_end_that_does_not_read_is_known_to_be_behind_until_it_does() -> None:
    ours, theirs = two_ends()
    while not theirs.behind:
        theirs.send(b"x" * 4096)
    assert theirs.waiting and not theirs.offer("a pulse")
    while theirs.behind:
        ours.receive()
    assert theirs.offer("a pulse")
    ours.close()
    theirs.close()
