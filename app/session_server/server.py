"""The session server: owns the session, its recordings, journal and tables. Its process begins in `process`.

It is not real time and draws nothing. The window that started it is at the other end of its standard input and output.
If the window hangs, the running trial goes on. If the window dies, a trial that its pointer moves is stopped and kept,
any other goes on to its end; then the server ends. Wrong input is refused before anything is written.
"""

import contextlib
import faulthandler
import os
import signal
import time
import traceback
from pathlib import Path
from typing import BinaryIO

from filelock import BaseFileLock

from app.ipc import messages as m
from app.ipc.messages import Setup
from app.ipc.pipe import Pipe
from app.ipc.ring import Ring
from app.session_server.commands import do
from app.session_server.loop_process import LoopProcess
from app.session_server.lsl import Outlets
from app.session_server.state import ServerState
from core import tick_log
from core.files import InputError
from experiments.atomic_files import PRIVATE_FILE, make_folders, reason_of
from experiments.inputs import INPUTS, is_person
from experiments.protocol import Protocol, load_protocol
from experiments.store import files
from experiments.store.files import LOCK, InUse, hold_lock
from experiments.store.stored import read_stored

BEAT_S = 0.02  # longest time between two looks at everything, and between two beats
PULSE_S = 0.1
LOCK_S = 1.5  # longest wait for a server whose window is gone, and which is about to end
FINISHING = ".finishing"  # in the data folder: a server whose window is gone is still at its last trial
LOG = ".session_server.log"  # in the data folder; only where something failed that should not
TERMINATED = "the session server was ended by the system"
WINDOW_GONE = "the window was lost"


class SessionServer:
    """The session server of one window."""

    def __init__(
        self, setup: Setup, protocol: Protocol, ring: Ring, loop: LoopProcess, window: Pipe, lsl: Outlets | None
    ) -> None:
        self._ring, self._window = ring, window
        self._state = ServerState(setup, protocol, ring, loop, lsl)
        self._state.show = self._send_state
        self._shown: dict[type, object] = {}  # the newest Opened and Snapshot that the window has got
        self._pulse_s = 0.0
        self._alone = False  # the window is gone
        self.end = ""  # why to end

    def serve(self) -> None:
        """Serve until `end` is set; then close the trial and end the loop."""
        failed = False
        try:
            while not self.end:
                self._ring.beat()
                self._listen()
                self._state.watch()
                if self._alone:
                    self._finish()
                else:
                    self._send_state()
        except Exception as error:
            traceback.print_exc()  # into the log
            self.end, failed = f"the session server failed: {type(error).__name__}: {error}", True
        finally:
            self._state.end(self.end)
            last = self._state.snapshot()
            if failed:
                last = last._replace(stage=m.FAILED, notice=self.end, notice_bad=True)
            self._window.send(last)
            self._window.flush()
            # not closed: that our end goes with the process tells the window that everything is done

    def _listen(self) -> None:
        """Do the commands of the window."""
        for command in self._window.receive(BEAT_S):
            if isinstance(command, m.Quit):
                self.end = command.reason or "the window was closed"
            else:
                do(self._state, command)
                self._shown.pop(m.Snapshot, None)  # so that every command is answered
        if self._window.closed and not self._alone and not self.end:
            self._alone = True
            self._state.window_lost()
            if self._state.runner.run is not None:
                with contextlib.suppress(OSError):  # a full disk: the next start is refused until this has ended
                    (self._state.setup.data_dir / FINISHING).touch()

    def _finish(self) -> None:
        """End after the running trial: the window is gone."""
        run = self._state.runner.run
        if run is None:
            self.end = WINDOW_GONE
        elif is_person(self._state.setup.hand) and self._has_lost_its_hand():
            run.stop(WINDOW_GONE)

    def _has_lost_its_hand(self) -> bool:
        """Whether the running trial must be stopped, and repeated, because the window is gone.

        Our choice: the pointer goes with its window, and without a window no person can be led to the start. A trial
        that another hand moves goes on to its end.
        """
        phase = self._ring.last(tick_log.PHASE)
        return INPUTS[self._state.setup.hand].by_pointer or phase in (tick_log.APPROACH, tick_log.HOLD)

    def _send_state(self) -> None:
        if self._window.has_backlog:  # it hangs; once it reads again it gets the newest state
            return
        shown, now = (self._state.opened(), self._state.snapshot()), time.perf_counter()
        changed = [state for state in shown if state != self._shown.get(type(state))]
        if changed or now - self._pulse_s >= PULSE_S:  # first: a trial that is shown to run has its proof already
            self._window.send(self._state.pulse())
            self._pulse_s = now
        for state in changed:
            self._window.send(state)
            self._shown[type(state)] = state


def run(
    setup: Setup, ring: Ring, loop: LoopProcess, window: Pipe, early_errors: BinaryIO, cleanup: contextlib.ExitStack
) -> None:
    """Serve a window to its end. early_errors: those from before the data folder is ours; cleanup: runs at the end."""
    try:
        lsl = Outlets(ring, bool(setup.link), setup.data_dir) if setup.lsl else None
        protocol = take_folder(setup, cleanup)
        _log_into(setup.data_dir / LOG, early_errors, cleanup)
        server = SessionServer(setup, protocol, ring, loop, window, lsl)
    except (InputError, OSError) as error:
        window.send(m.CannotServe(refusal_of(error, setup.data_dir), isinstance(error, OSError | InUse)))
        return
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: setattr(server, "end", TERMINATED))
    server.serve()


def take_folder(setup: Setup, cleanup: contextlib.ExitStack) -> Protocol:
    """Lock the data folder and read the protocol of new sessions; `cleanup` unlocks it and removes what is empty.

    InputError or OSError if the folder cannot be served.
    """
    data_dir = setup.data_dir
    new = [path for path in (data_dir / LOCK, data_dir, *data_dir.parents) if not path.exists()]
    cleanup.callback(_remove_empty, data_dir, new, set(data_dir.glob("sub-*")))
    make_folders(data_dir)
    cleanup.callback(_hold_lock(data_dir).release)
    (data_dir / FINISHING).unlink(missing_ok=True)
    cleanup.callback((data_dir / FINISHING).unlink, missing_ok=True)
    return read_protocol(setup)


def _hold_lock(data_dir: Path) -> BaseFileLock:
    """Lock the folder; waits for a server whose window is gone and which finishes its trial."""
    while True:
        try:
            return hold_lock(data_dir, LOCK_S)
        except InputError:
            if not (data_dir / FINISHING).exists():
                raise


def refusal_of(error: Exception, data_dir: Path) -> str:
    """Why the session server cannot serve."""
    if isinstance(error, FileExistsError | NotADirectoryError):
        return f"{data_dir}: is a file, or lies in one, and not a folder"
    if isinstance(error, OSError):
        place = error.filename if os.path.isfile(error.filename or "") else data_dir  # a lock of another user's
        return f"{place}: cannot be written to ({reason_of(error)})"
    return str(error)


def _log_into(path: Path, early_errors: BinaryIO, cleanup: contextlib.ExitStack) -> None:
    """Write unexpected errors into the data folder from now on. OSError."""
    cleanup.callback(_close_log, path, early_errors)
    log = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, PRIVATE_FILE)
    for number in (1, 2):
        os.dup2(log, number)
    os.close(log)
    faulthandler.enable()


def read_protocol(setup: Setup) -> Protocol:
    """The protocol of new sessions. InputError if it cannot be run, or not by the named participant."""
    protocol = load_protocol(
        setup.protocol, devices=setup.devices, rules=setup.rules, low_gain=setup.low_gain, seed=setup.seed
    )
    if setup.participant:
        folder = files.session_folder(setup.data_dir, setup.participant)
        if not files.is_half_created(folder):
            read_stored(folder)  # InputError if it is damaged
        else:
            files.refuse_existing(setup.data_dir, setup.participant)
            if is_person(setup.hand):
                protocol.refuse_stranger(setup.participant)
    return protocol


def _close_log(log: Path, early_errors: BinaryIO) -> None:
    """Remove the log if it is empty."""
    early_errors.seek(0)
    with contextlib.suppress(OSError):  # the window shows already that the disk fails
        if log.exists() and (content := early_errors.read()):
            with log.open("ab") as file:
                file.write(content)
        if log.exists() and not log.stat().st_size:
            for number in (1, 2):  # Windows removes no file that is open
                os.dup2(early_errors.fileno(), number)
            log.unlink()


def _remove_empty(data_dir: Path, new: list[Path], sessions: set[Path]) -> None:
    """Remove the new lock, folder and parents that are empty, if no session was added."""
    if set(data_dir.glob("sub-*")) - sessions:
        return
    for path in new:
        with contextlib.suppress(OSError):
            if path.is_dir():
                path.rmdir()
            else:
                path.unlink()
