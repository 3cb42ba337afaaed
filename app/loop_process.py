"""The window's end of the control loop: start it, talk to it, see whether it lives, end it."""

import multiprocessing
from collections.abc import Sequence
from pathlib import Path

from app.loop import run_loop
from app.mailbox import Mailbox
from app.messages import Quit
from core.device import Device
from experiments.session import Choices

END_S = 15.0  # longest wait for the loop to keep what it has


class LoopProcess:
    """A control loop in a process of its own."""

    def __init__(self, devices: Sequence[Device], data_dir: Path, choices: Choices, sync: bool = True) -> None:
        context = multiprocessing.get_context("spawn")  # a fork would carry the window's threads along
        ours, theirs = context.Pipe()
        self._process = context.Process(
            target=run_loop, args=(theirs, devices, data_dir, choices, sync), name="control loop", daemon=True
        )
        self._process.start()
        theirs.close()  # else the loop's death would not be seen
        self._mailbox = Mailbox(ours)

    @property
    def pid(self) -> int | None:
        """Its process number."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it is there."""
        return self._process.is_alive()

    def send(self, message: object) -> None:
        """Tell it something."""
        self._mailbox.send(message)

    def receive(self) -> list:
        """What it has said since the last time."""
        return self._mailbox.receive()

    def stop(self, reason: str) -> None:
        """End it: what runs is aborted for this reason and kept. Waits until that is done."""
        self._mailbox.send(Quit(reason))
        self._process.join(0.5)
        self._mailbox.close()  # the loop takes an end of file for the end, whatever it was doing
        self._process.join(END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
