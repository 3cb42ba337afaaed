"""The pipes between window and session server: neither end waits for the other, and no message is lost."""

import os
import time

import numpy as np
import pytest

from app.ipc.pipe import Pipe


def two_ends() -> tuple[Pipe, Pipe, int]:
    """Ours and theirs; and the end of theirs that hears us, which is still to be read."""
    (hear_us, to_them), (hear_them, to_us) = os.pipe(), os.pipe()
    return Pipe(open(hear_them, "rb"), open(to_them, "wb")), hear_us, to_us


def other_end(hear_us: int, to_us: int) -> Pipe:
    return Pipe(open(hear_us, "rb"), open(to_us, "wb"))


def all_of(pipe: Pipe) -> list:
    """Every message up to the end."""
    got: list = []
    while not pipe.closed:
        got += pipe.receive(1.0)
    return got


@pytest.mark.timeout(60)
def test_an_end_that_does_not_read_never_makes_the_other_wait_and_loses_nothing() -> None:
    ours, *unread = two_ends()
    for i in range(300):
        ours.send((i, bytes(1000)))  # more than the system keeps for it
    began = time.perf_counter()
    ours.flush(0.1)
    assert ours.behind and time.perf_counter() - began < 30.0
    theirs = other_end(*unread)
    ours.close()
    assert [i for i, _ in all_of(theirs)] == list(range(300))
    ours.flush(30.0)
    assert not ours.behind
    theirs.close()
    assert all_of(ours) == []


def test_what_an_end_said_right_before_it_left_is_heard_also_by_one_that_spoke_meanwhile() -> None:
    ours, *unread = two_ends()
    theirs = other_end(*unread)
    theirs.send("nobody reads this")
    ours.send("abort")
    ours.close()
    theirs.send("a snapshot")
    assert all_of(theirs) == ["abort"]
    theirs.close()


def test_messages_of_any_size_come_whole_and_in_order() -> None:
    ours, *unread = two_ends()
    theirs = other_end(*unread)
    for message in [np.arange(n) for n in (0, 1, 100_000, 3)]:
        ours.send(message)
    ours.close()
    assert [len(message) for message in all_of(theirs)] == [0, 1, 100_000, 3]
    theirs.close()


def test_an_end_that_is_killed_in_the_middle_of_a_message_is_gone() -> None:
    ours, hear_us, to_us = two_ends()
    os.write(to_us, b"\x80\x05\x95")  # the beginning of a message
    os.close(to_us)
    assert all_of(ours) == []
    os.close(hear_us)
    ours.send("nobody is there")
    ours.flush(30.0)
    assert not ours.behind
