"""A phd that starts at once and is killed when told: everything is imported once, each job runs in a fork of that.

Run as a script it reads jobs from stdin, a JSON object a line: {"phd": [arguments], "kill_after_s": 0.3}. It runs
`phd arguments`, kill -9 after that time, and answers each with a line: {"killed": true | false, "code": exit code of
one that came to its end}.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


class KilledPhd:
    """The jobs, from a test's side."""

    def __init__(self) -> None:
        from protocols import short

        self._folder = tempfile.TemporaryDirectory()
        protocol = Path(self._folder.name) / "short.toml"
        protocol.write_text(short(paths=1).text, encoding="utf-8")
        #: arguments of a study, all but its folder
        self.study = ["study", str(protocol), "--operators", "1", "--seed", "3"]
        self._process = subprocess.Popen(
            [sys.executable, __file__], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )  # fmt: skip

    def run(self, kill_after_s: float, **job) -> dict:
        """Run a job and kill it."""
        self._process.stdin.write(json.dumps({**job, "kill_after_s": kill_after_s}) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def close(self) -> None:
        """End it."""
        self._process.stdin.close()
        self._process.wait(200)
        self._folder.cleanup()


def serve() -> None:
    """Do jobs until stdin ends."""
    from sessions import new_session, run

    import app.verbs.folders  # noqa: F401  (everything that a job needs is there before the first)
    import experiments.store.verify  # noqa: F401
    import experiments.study.study  # noqa: F401
    from app.cli import main
    from core import tick_log  # noqa: F401
    from experiments.analysis import sheet
    from experiments.study import unrecorded

    sheet.PNG_DPI, sheet.STYLE["pdf.fonttype"] = 30, 3  # figures are drawn, and the report written, in less time
    unrecorded.simulation_errors = lambda *_: []
    with tempfile.TemporaryDirectory() as folder:  # compiles, or loads, the kernels
        session = new_session(Path(folder))
        trial, writer = session.begin(session.next_planned())
        run(trial, writer, ticks=100, piece=100)
        session.close()
    for line in sys.stdin:
        job = json.loads(line)
        child = os.fork()
        if child == 0:
            null = os.open(os.devnull, os.O_RDWR)
            for handle in (0, 1, 2):
                os.dup2(null, handle)
            code = 99
            try:
                code = main(job["phd"])
            finally:
                os._exit(code)
        deadline = time.perf_counter() + job["kill_after_s"]
        status = None
        while status is None and time.perf_counter() < deadline:
            ended, code = os.waitpid(child, os.WNOHANG)
            status = code if ended else None
            time.sleep(0.0005)
        if status is None:
            os.kill(child, signal.SIGKILL)
            status = os.waitpid(child, 0)[1]
        killed = os.WIFSIGNALED(status)
        print(json.dumps({"killed": killed, "code": None if killed else os.WEXITSTATUS(status)}), flush=True)


if __name__ == "__main__":
    sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]
    serve()
