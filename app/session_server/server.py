"""The conductor: a process that owns the session, its recordings, journal and tables, and outlives its window.

It is not real time and draws nothing. One window at a time is joined to it; a window that hangs or dies changes nothing
in the running trial, and another one may take over. It ends when a window says so, when it is told to end, or when no
window has come back for a while; whatever runs is then ended, brakes off, and kept.
"""

import queue
import threading
import time
from multiprocessing.connection import Connection, Listener

from app.ipc import messages as m
from app.ipc.ring import Ring
from app.ipc.setup import Setup
from app.ipc.socket import Mailbox
from app.session_server.commands import do
from app.session_server.loop_process import LoopProcess
from app.session_server.state import Desk
from experiments.protocol import Protocol

BEAT_S = 0.02  # longest time between two looks at everything, and between two beats
PULSE_S = 0.1
CLOSE_S = 1.0  # longest wait for a window to take the last messages
TAKEN_OVER = "Another window has taken over: the session goes on there. This one shows nothing new and can be closed."
LEFT_ALONE = "no window came back"


class Conductor:
    """Serves one window after another until the end."""

    def __init__(self, setup: Setup, protocol: Protocol, ring: Ring, loop: LoopProcess, listener: Listener) -> None:
        self._setup, self._ring, self._listener = setup, ring, listener
        self._desk = Desk(setup, protocol, ring, loop)
        self._window: Mailbox | None = None
        self._alone_s = time.monotonic()  # since when there has been no window
        self._arrived: queue.SimpleQueue[Connection] = queue.SimpleQueue()
        self._shown: m.Snapshot | None = None
        self._opened: m.Opened | None = None
        self._pulse_s = 0.0
        self._had_window = False
        self.end = ""  # why to end
        threading.Thread(target=self._accept, name="door", daemon=True).start()

    def serve(self) -> None:
        """Until the end; every trial is then closed, the loop gone."""
        try:
            while not self.end:
                self._ring.beat()
                self._welcome()
                self._listen()
                self._desk.watch()
                self._tell()
        except BaseException as error:
            self.end = f"the bench failed: {type(error).__name__}: {error}"
            raise
        finally:
            self._desk.end(self.end)
            if self._window is not None:
                last = self._desk.snapshot()
                if self.end.startswith("the bench failed"):
                    last = last._replace(stage=m.FAILED, said=self.end, said_bad=True)
                self._window.send(last)
                deadline = time.monotonic() + CLOSE_S
                while self._window.waiting and time.monotonic() < deadline:
                    self._window.receive(BEAT_S)
                # not closed: that our end goes with the process tells the window that everything is done

    def _accept(self) -> None:
        while True:
            try:
                self._arrived.put(self._listener.accept())
            except Exception:  # whoever does not know the key, or does not speak as we do, stays outside
                time.sleep(BEAT_S)

    def _welcome(self) -> None:
        """The newest window is the one; the one before is told."""
        while not self._arrived.empty():
            if self._window is not None:
                self._window.send(self._desk.snapshot()._replace(stage=m.ELSEWHERE, said=TAKEN_OVER, said_bad=True))
                self._window.close()
            self._window, self._had_window = Mailbox(self._arrived.get()), True
            self._shown = self._opened = None
            self._ring.let_go()

    def _listen(self) -> None:
        """Do what the window asks for; without one, wait for another."""
        if self._window is None:
            self._be_alone()
            return
        for intent in self._window.receive(BEAT_S):
            if isinstance(intent, m.Quit):
                self.end = intent.reason or "the window was closed"
            else:
                do(self._desk, intent)
        if self._window.closed:
            self._window.close()
            self._window, self._alone_s = None, time.monotonic()
            self._desk.keeping.write("window lost")

    def _be_alone(self) -> None:
        time.sleep(BEAT_S)
        nothing_to_keep = self._had_window and self._desk.session is None
        too_long = time.monotonic() - self._alone_s > self._setup.patience_s
        if self._desk.runner.run is None and (nothing_to_keep or too_long):
            self.end = LEFT_ALONE

    def _tell(self) -> None:
        if self._window is None or self._window.behind:  # one that hangs is told how things are then
            return
        opened = self._desk.opened()
        if opened != self._opened:
            self._window.send(opened)
            self._opened = opened
        shown = self._desk.snapshot()
        if shown != self._shown:
            self._window.send(shown)
            self._shown = shown
        now = time.monotonic()
        if now - self._pulse_s >= PULSE_S:
            self._window.offer(self._desk.pulse())
            self._pulse_s = now
