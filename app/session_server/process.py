"""The process of the session server: reads commands from standard input, writes answers to standard output."""

import contextlib
import os
import sys
import tempfile

from app.ipc.messages import Setup
from app.ipc.pipe import Pipe
from app.ipc.ring import Ring
from app.session_server.loop_process import LoopProcess


def main() -> None:
    setup, ring = Setup.from_json(sys.argv[1]), Ring(sys.argv[2])
    window = Pipe(open(os.dup(0), "rb"), open(os.dup(1), "wb"))
    early_errors = tempfile.TemporaryFile()  # unexpected errors from before the data folder is ours
    null = os.open(os.devnull, os.O_RDWR)
    for number, file in ((0, null), (1, early_errors.fileno()), (2, early_errors.fileno())):
        os.dup2(file, number)
    with contextlib.ExitStack() as cleanup:
        cleanup.callback(window.flush)
        loop = LoopProcess(ring, setup.real_time, setup.link)
        cleanup.callback(lambda: None if loop.ended else loop.kill())
        from app.session_server.server import run  # 1 s and more, while the loop starts

        run(setup, ring, loop, window, early_errors, cleanup)
