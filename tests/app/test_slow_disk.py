"""A disk that is slow, or does not answer: the Disk check measures it as a session does; every wait is announced."""

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from waiting import wait_until

from app import doctor
from app.ipc.messages import BAD, CAUTION, GOOD, WAITING
from app.session_server import preflight
from app.session_server.preflight import DiskWatch, check_disk


class Clock:
    """Time in which nothing passes but what a disk takes to bring a write to itself."""

    def __init__(self, patch: pytest.MonkeyPatch, sync_s: float) -> None:
        self.now, self.sync_s = 100.0, sync_s
        patch.setattr(preflight.time, "perf_counter", lambda: self.now)
        patch.setattr(os, "fsync", self.fsync)

    def fsync(self, _handle: int) -> None:
        self.now += self.sync_s


@pytest.mark.parametrize(
    ("sync_s", "state", "says"),
    [
        (0.003, GOOD, ""), (0.3, CAUTION, "waits about 0.3 s for its start and 1.8 s after its end"),
        (1.0, CAUTION, "waits about 1.0 s for its start and 6.0 s after its end"),
        (5.0, BAD, "waits about 5.0 s for its start and 30 s after its end"),
    ],
)  # fmt: skip
def test_the_disk_is_measured_as_a_session_waits_for_it_and_what_that_means_is_said(tmp_path, sync_s, state, says):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(preflight, "LOW", 0)
        patch.setattr(preflight, "TOO_LOW", 0)
        Clock(patch, sync_s)
        found = check_disk(tmp_path)
    assert found.state == state and says in found.advice and ("local disk" in found.advice) == (state != GOOD)
    assert doctor.check_disk is check_disk  # one rule
    assert not any(tmp_path.iterdir())


@pytest.fixture
def held() -> Iterator[threading.Event]:
    """Until it is set no write reaches the disk."""
    free, sync = threading.Event(), os.fsync
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(preflight.os, "fsync", lambda handle: (free.wait(60.0), sync(handle)))
        yield free
        free.set()


def test_a_disk_that_does_not_answer_holds_up_nothing_but_the_start_and_says_how_long(tmp_path, held, monkeypatch):
    now = [time.perf_counter()]
    monkeypatch.setattr(preflight.time, "perf_counter", lambda: now[0])
    disk = DiskWatch(tmp_path)
    assert disk.check.state == WAITING and not disk.known
    now[0] += 3.0
    assert disk.check.state == WAITING and "have taken 3 s so far" in disk.check.advice and disk.known and disk.slow
    now[0] += 30.0
    assert disk.check.state == BAD and "Waiting for the disk" in disk.check.advice
    held.set()
    wait_until(lambda: disk.watch() or "free" in disk.check.text)


def test_a_data_folder_that_is_gone_is_red_and_not_the_room_of_what_is_above_it(tmp_path: Path) -> None:
    disk = DiskWatch(tmp_path / "data")
    wait_until(lambda: disk.known)
    assert disk.check.state == BAD and "is gone" in disk.check.advice
