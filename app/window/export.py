"""Export of results beside the window: started, watched, cancelled."""

import os
import pickle
import shutil
import subprocess
import sys
import threading

from PySide6.QtCore import QObject, Signal

from app.ipc.process import start_python
from core.files import InputError
from experiments.export.results import Job

NICE = 10  # behind everything that keeps time
CANCELLED = "The export was cancelled, nothing was written."
DIED = "The export ended before it was complete, nothing was written."


def main() -> None:
    """A pickled Job on stdin; on stdout a line for each step ("share 0.5") and the end ("done ..", "refused ..")."""
    from experiments.export.results_files import write_results  # matplotlib takes its time

    if hasattr(os, "nice"):
        os.nice(NICE)
    job: Job = pickle.load(sys.stdin.buffer)
    try:
        count = write_results(job, lambda share: print("share", share, flush=True))
    except InputError as error:
        print("refused", str(error).replace("\n", " "))
    else:
        print("done", f"{count} file{'s' if count != 1 else ''} written to {job.folder}")


class Export(QObject):
    """One export at a time, in a process of its own with a thread that listens to it."""

    progressed = Signal(float)  # the share done
    ended = Signal(str)  # what was written, or why nothing was, in a sentence

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._thread: threading.Thread | None = None
        self._process: subprocess.Popen | None = None
        self._cancelled = False

    @property
    def busy(self) -> bool:
        """Whether one is running."""
        return self._thread is not None and self._thread.is_alive()

    def start(self, job: Job) -> None:
        """Begin to write; a signal says when it has ended."""
        self._cancelled = False
        self._process = start_python("app.window.export", stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._thread = threading.Thread(target=self._listen, args=(self._process, job), name="export")
        self._thread.start()

    def cancel(self) -> None:
        """Stop now; nothing is left behind."""
        if self._process is not None and self.busy:
            self._cancelled = True
            self._process.terminate()

    def wait(self) -> None:
        """Until what runs has ended."""
        if self._thread is not None:
            self._thread.join()

    def _listen(self, process: subprocess.Popen, job: Job) -> None:
        end = ""
        with process:  # closes its pipes, waits for its end
            try:
                pickle.dump(job, process.stdin)
                process.stdin.close()
            except OSError:
                pass  # it has ended already: the sentence below says so
            for line in process.stdout:
                kind, _, what = line.decode().strip().partition(" ")
                if kind == "share":
                    self.progressed.emit(float(what))
                else:
                    end = what
        if not end and job.folder.exists():  # killed when all was written
            end = f"The results are in {job.folder}"
        if not end:  # killed: what it had begun is removed in its place
            shutil.rmtree(job.partial, ignore_errors=True)
        self.ended.emit(end or (CANCELLED if self._cancelled else DIED))
