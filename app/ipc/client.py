"""The window's end of a live bench: start a conductor for a data folder, or join the one that is alive; no Qt.

Nothing here waits for the other processes but `stop`. The pointer and the brakes-off go straight into the memory that
the control loop reads.
"""

import json
import subprocess
import threading
import time
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client

import numpy as np

from app.ipc.address import find, is_alive
from app.ipc.messages import FAILED, Quit, Snapshot
from app.ipc.process import start_python
from app.ipc.ring import Ring
from app.ipc.scheduling import leave_core
from app.ipc.setup import Setup
from app.ipc.socket import Mailbox
from core import tick_log

START_S = 30.0  # longest wait for a conductor to say where it is
END_S = 20.0  # longest wait for it to keep what it has
GRACE_S = 2.0  # for a conductor that another window has just started
RETRY_S = 0.02


class Bench:
    """A window's line to the conductor of a data folder."""

    def __init__(self, setup: Setup) -> None:
        """Returns at once; `receive` has something when the line stands, or says why there is none."""
        self._setup = setup._replace(data_dir=setup.data_dir.absolute())
        self._started: subprocess.Popen | None = None
        self._mailbox: Mailbox | None = None
        self._ring: Ring | None = None
        self._refused = ""
        self._told = self._left_core = False
        self.pid: int | None = None  # of the conductor
        self._joining = threading.Thread(target=self._join, name="joining", daemon=True)
        self._joining.start()

    @property
    def alive(self) -> bool:
        """Whether the line stands, or is being made; False also once another window has taken over, or if refused."""
        if self._mailbox is None:
            return not self._refused
        return not self._mailbox.closed

    def refused(self) -> str:
        """Wait until the line stands; "" or why there is none."""
        self._joining.join(2.0 * START_S)
        if self._joining.is_alive():  # a conductor that is stopped takes a line and says nothing
            self._refused = f"{self._setup.data_dir}: the bench does not answer"
        return self._refused

    def send(self, intent: object) -> None:
        """Ask for something; before the line stands: wait for it."""
        self._joining.join(START_S)
        if self._mailbox is not None:
            self._mailbox.send(intent)

    def receive(self) -> list:
        """What the conductor has said since the last time: Opened, Snapshot, Pulse."""
        if self._mailbox is None:
            news = [] if self._told or not self._refused else [Snapshot(FAILED, said=self._refused, said_bad=True)]
            self._told |= bool(news)
            return news
        if self._ring is not None and not self._left_core and (core := int(self._ring.control.core)) >= 0:
            leave_core(core)
            self._left_core = True
        return self._mailbox.receive()

    def ticks(self) -> np.ndarray:
        """The ticks since the last call: (n, WIDTH), of one trial after the other (`t_s` starts again at 0)."""
        return self._ring.newest()[:, : tick_log.WIDTH] if self._ring is not None else np.empty((0, tick_log.WIDTH))

    @property
    def taken(self) -> bool:
        """Whether the pointer has hold of the handle."""
        return self._ring is not None and bool(self._ring.control.taken)

    def aim(self, x: float, y: float) -> None:
        """The pointer is here, m."""
        if self._ring is not None and self.alive:
            self._ring.aim(x, y)

    def brakes_off(self, cause: str) -> None:
        """No currents from the next tick on: the trial ends, until AllowBrakes; also without a line any more."""
        if self._ring is not None:
            self._ring.press_off(cause)

    def stop(self, reason: str) -> None:
        """End the bench: what runs is aborted for this reason and kept. Waits until that is done.

        After another window has taken over, the bench is that window's: this one only leaves.
        """
        self._joining.join(START_S)
        if self._mailbox is not None and not self.alive:
            self.close()
            return
        self.send(Quit(reason))
        deadline = time.monotonic() + END_S
        while self.alive and time.monotonic() < deadline:
            self.receive()
            time.sleep(RETRY_S)
        self.close()
        if self._started is not None:
            try:
                self._started.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                self._started.kill()
                self._started.wait()

    def close(self) -> None:
        """Leave; what runs goes on, and another window may join."""
        self._joining.join(START_S)
        if self._mailbox is not None:
            self._mailbox.close()
        self._ring = None
        if self._left_core:
            leave_core(-1)
        if self._started is not None:
            self._started.poll()

    # ------------------------------------------------------------------------------------- joining

    def _join(self) -> None:
        if self._reach():
            return
        refused, taken = self._start()
        if refused and not taken:
            self._refused = refused
            return
        deadline = time.monotonic() + (GRACE_S if taken else START_S)  # another window may have been faster
        while not self._reach():
            if time.monotonic() > deadline:
                self._refused = refused or f"{self._setup.data_dir}: the bench does not answer"
                return
            time.sleep(RETRY_S)

    def _reach(self) -> bool:
        """Join the conductor that says it is there; whether one answered."""
        address = find(self._setup.data_dir)
        if address is None:
            return False
        if (clash := self._setup.clash(Setup.from_json(address.setup))) and is_alive(address):
            self._refused = clash
            return True
        try:
            ring = Ring(address.ring)
            connection = Client(address.socket, authkey=address.key)
        except (OSError, EOFError, AuthenticationError):  # it is dead: the file is what it left
            return False
        self._ring, self.pid = ring, address.pid
        self._mailbox = Mailbox(connection)
        return True

    def _start(self) -> tuple[str, bool]:
        """Start a conductor of our own, which lives on without us; "" or why not, and whether there is another one."""
        process = start_python(
            "app.session_server.conductor_process", self._setup.to_json(),
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        with process.stdout as answers:  # type: ignore[union-attr]
            answer = answers.readline()
        self._started = process
        if not answer:
            return f"{self._setup.data_dir}: the bench ended while it started", False
        about = json.loads(answer)
        return about.get("refused", ""), about.get("taken", False)
