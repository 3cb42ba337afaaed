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
    early = tempfile.TemporaryFile()  # takes what should not happen, before the data folder is ours
    null = os.open(os.devnull, os.O_RDWR)
    for number, file in ((0, null), (1, early.fileno()), (2, early.fileno())):
        os.dup2(file, number)
    with contextlib.ExitStack() as left:
        left.callback(window.flush)
        loop = LoopProcess(ring, setup.real_time, setup.link)
        left.callback(lambda: None if loop.ended else loop.kill())
        from app.session_server.server import run  # 1 s and more, while the loop starts

        run(setup, ring, loop, window, early, left)
