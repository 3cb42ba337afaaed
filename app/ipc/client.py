"""The window's connection to the session server: start it, send commands, receive its state; no Qt.

Only `refused` and `stop` wait for another process. The pointer (`ring.aim`) and the brakes-off go straight into the
memory that the control loop reads.
"""

import time
from collections.abc import Callable
from subprocess import DEVNULL

import numpy as np

from app.ipc.messages import FAILED, CannotServe, Quit, Setup, Snapshot
from app.ipc.pipe import Child
from app.ipc.ring import Ring
from app.ipc.scheduling import leave_core
from core import tick_log
from core.files import InputError

START_S = 60.0  # longest wait for a session server to say whether it can serve
END_S = 20.0  # longest wait for it to keep what it has
LOOK_S = 0.02


class Client:
    """The connection of a window to its session server."""

    def __init__(self, setup: Setup) -> None:
        """Start it; returns at once. InputError if there is no memory for what the processes share."""
        setup = setup._replace(data_dir=setup.data_dir.absolute())
        self.setup = setup
        self._data_dir, self._refused, self._left_core = setup.data_dir, "", False
        self.wants_other_folder = False  # the server has refused to serve because of the data folder
        self._received: list = []  # by `refused`, for `receive`
        self._answered = False
        try:
            self.ring = Ring(width=tick_log.BENCH_WIDTH if setup.link else tick_log.WIDTH)
        except OSError as error:
            raise InputError(f"no memory for the ticks of the control loop ({error.strerror or error})") from None
        self._server = Child(
            "app.session_server.process", setup.to_json(), self.ring.handle, stderr=DEVNULL, start_new_session=True,
            **self.ring.inherited,
        )  # fmt: skip

    @property
    def pid(self) -> int:
        return self._server.pid

    @property
    def alive(self) -> bool:
        """Whether the session server lives and has not refused to serve."""
        return not (self._refused or self._server.closed)

    def refused(self, meanwhile: Callable[[], object] = lambda: None) -> str:
        """Wait until the session server is ready; why it cannot serve, "": it can. meanwhile: called repeatedly."""
        deadline = time.perf_counter() + START_S
        while not self._answered and self.alive and time.perf_counter() < deadline:
            self._received += self._take(LOOK_S)
            meanwhile()
        if not self._answered and not self._refused:
            problem = "ended while it started" if self._server.closed else "does not answer"
            self._refused = f"{self._data_dir}: the session server {problem}"
        return self._refused

    def send(self, command: object) -> None:
        self._server.send(command)

    def receive(self) -> list:
        """Messages of the session server since the last call: Opened, Snapshot, Pulse."""
        if not self._left_core and (core := int(self.ring.control.core)) >= 0:
            leave_core(core)
            self._left_core = True
        received, self._received = self._received + self._take(), []
        return received

    def _take(self, wait_s: float = 0.0) -> list:
        messages = self._server.receive(wait_s)
        self._answered |= bool(messages)
        for at, message in enumerate(messages):
            if isinstance(message, CannotServe):
                self._refused, self.wants_other_folder = message.why, message.folder
                messages[at] = Snapshot(FAILED, notice=message.why, notice_bad=True)
        return messages

    def ticks(self) -> np.ndarray:
        """The ticks since the last call: (n, WIDTH); `t_s` starts at 0 with each trial."""
        return self.ring.newest()[:, : tick_log.WIDTH]

    @property
    def taken(self) -> bool:
        """Whether the pointer holds the handle."""
        return bool(self.ring.control.taken)

    def brakes_off(self, cause: str) -> None:
        """Switch the brakes off from the next tick on, until AllowBrakes; works without a session server too."""
        self.ring.press_brakes_off(cause)

    def stop(self, reason: str) -> None:
        """End the session server and wait for it; the running trial is aborted for this reason and kept."""
        self.send(Quit(reason))
        self.leave()
        deadline = time.perf_counter() + END_S
        while not self._server.closed and time.perf_counter() < deadline:
            self._take(LOOK_S)
        self._server.end(deadline - time.perf_counter())

    def leave(self) -> None:
        """Disconnect: the session server ends by itself after the running trial."""
        self._server.close()
        if self._left_core:
            leave_core(-1)
            self._left_core = False
