"""Export of results beside the window: started, watched, cancelled."""

import pickle
import shutil
import subprocess
import threading

from PySide6.QtCore import QObject, Signal

from app.ipc.process import start_python
from app.window.export_process import Job, partial_of

CANCELLED = "The export was cancelled, nothing was written."
DIED = "The export ended before it was complete, nothing was written."


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
        """Begin to write; a signal tells the end."""
        self._cancelled = False
        self._process = start_python("app.window.export_process", stdin=subprocess.PIPE, stdout=subprocess.PIPE)
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
                pass  # it has ended already: said below
            for line in process.stdout:
                kind, _, what = line.decode().strip().partition(" ")
                if kind == "share":
                    self.progressed.emit(float(what))
                else:
                    end = what
        if not end and job.folder.exists():  # killed when all was written
            end = f"The results are in {job.folder}"
        if not end:  # killed: what it had begun is removed in its place
            shutil.rmtree(partial_of(job.folder), ignore_errors=True)
        self.ended.emit(end or (CANCELLED if self._cancelled else DIED))
