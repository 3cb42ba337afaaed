"""A session server for tests: its messages as they come, its processes, and the proof that nothing of it is left."""

import contextlib
import os
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from processes import children, gone
from waiting import LONG_S, wait_until

from app.ipc import messages as m
from app.ipc.client import Client
from app.ipc.messages import Setup
from experiments.recording import Recording
from experiments.store.journal import read_events
from experiments.store.recording import read_recording

#: in lines of the log that only Wine causes: Arrow asks it for processors, LSL for network interfaces
WINE_ALONE = ("cpu_info.cc", "netinterfaces.cpp", "api_config.cpp")


class Window:
    """A window without eyes: a client, what it has been told, snapshot by snapshot, and all ticks."""

    def __init__(self, setup: Setup) -> None:
        self.opened: m.Opened | None = None
        self.ticks: list[np.ndarray] = []
        self.join(setup)

    def join(self, setup: Setup, client: Callable = Client) -> None:
        """A session server of its own, in place of the one there was."""
        self.client = client(setup)
        self.snapshot: m.Snapshot | None = None
        self.pulse: m.Pulse | None = None
        self._told: deque = deque()

    @property
    def rows(self) -> np.ndarray:
        """All ticks so far."""
        return np.concatenate(self.ticks)

    def look(self) -> None:
        """Take in what has been told, up to the next snapshot: no state is passed over, however seldom we look."""
        self._told += self.client.receive()
        while self._told:
            match message := self._told.popleft():
                case m.Snapshot():
                    self.snapshot = message
                    break
                case m.Opened():
                    self.opened = message
                case m.Pulse():
                    self.pulse = message
        self.ticks.append(self.client.ticks())

    def until(self, what: Callable[[m.Snapshot], object], seconds: float = LONG_S) -> m.Snapshot:
        """Wait for a snapshot of which something is true."""

        def seen() -> object:
            self.look()
            assert self.client.alive or self.snapshot, "the bench is gone"
            return self.snapshot is not None and what(self.snapshot)

        try:
            wait_until(seen, seconds)
        except AssertionError:
            raise AssertionError(f"waited in vain; the last was {self.snapshot}") from None
        assert self.snapshot is not None
        return self.snapshot

    def within(self, seconds: float, what: Callable[[m.Snapshot], object]) -> bool:
        """Whether something comes true in this time, where it need not."""
        end = time.perf_counter() + seconds
        while time.perf_counter() < end:
            self.look()
            if self.snapshot is not None and what(self.snapshot):
                return True
            time.sleep(0.005)
        return False

    def until_stage(self, *stages: str) -> m.Snapshot:
        return self.until(lambda s: s.stage in stages)

    def open(self, participant: str = "01", **how) -> m.Snapshot:
        self.until_stage(m.NO_SESSION)
        self.client.send(m.Open(participant, **how))
        return self.until_stage(m.READY)

    def start(self) -> m.Snapshot:
        """Start a trial; returns when its first ticks are there."""
        self.until_stage(m.READY, m.NO_SESSION)
        self.ticks.clear()
        self.client.send(m.Start())
        self.until_stage(m.RUNNING)
        wait_until(lambda: self.look() or len(self.rows))
        return self.snapshot

    def touch(self) -> m.Snapshot:
        """The pointer takes hold of the handle of the running trial."""
        self.until_stage(m.RUNNING)
        self.client.ring.aim(*self.snapshot.tip)
        return self.snapshot

    def abort(self, reason: str) -> m.Snapshot:
        """End the running trial; returns when its row is there."""
        self.client.send(m.Abort(reason))
        return self.until(lambda s: s.stage != m.RUNNING)

    def until_tick(self, what: Callable[[np.ndarray], object]) -> None:
        """Wait until there are ticks (n, WIDTH) of which something is true."""
        wait_until(lambda: self.look() or what(self.rows))

    def recording(self, run: int) -> Recording:
        """The recording of a run of the open session."""
        return read_recording(Path(self.opened.folder) / "trials" / f"run-{run:03d}.parquet")

    def events(self, name: str) -> list[dict]:
        """The journal's events of this name, in the open session."""
        entries = read_events(Path(self.opened.folder))
        return [{"event": name, "time": at, **about} for event, at, about in entries if event.name == name]

    def processes(self) -> list[int]:
        """The session server and its loop."""
        return [self.client.pid, *children(self.client.pid)]

    def loop(self) -> int:
        """The control loop's process, once it is there."""
        wait_until(lambda: len(children(self.client.pid)) == 1)
        return children(self.client.pid)[0]


@contextlib.contextmanager
def live_window(setup: Setup) -> Iterator[Window]:
    """A window with a session server; at the end nothing of it is left, whatever the test did to it."""
    opened = Window(setup)
    try:
        yield opened
    finally:
        pids = opened.processes() if not gone(opened.client.pid) else []
        opened.client.stop("the test is over")
        wait_until(lambda: all(map(gone, pids)))
        log = setup.data_dir / ".session_server.log"
        lines = log.read_text().splitlines() if log.exists() else []  # empty: the server was killed
        assert not [line for line in lines if line and not any(source in line for source in WINE_ALONE)], lines


def kill(pid: int, number: int = 9) -> None:
    os.kill(pid, number)
