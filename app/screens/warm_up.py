"""What the windows make ready beside their work, so that neither the first trial nor the first look at the results
has to wait for it: the kernels that drawing calls, the results window, and no more garbage to look through.
"""

import gc
import threading
import time

from PySide6.QtCore import QObject, QTimer

from app.live.messages import PREPARING
from app.screens.console_window import ConsoleWindow
from app.screens.layers import compile_kernels
from core.device import Device

LOOK_MS = 100
#: Where the bench takes longer than this its kernels are being compiled, and ours must be too. Our choice.
FIRST_USE_S = 3.0


class WarmUp(QObject):
    """Waits until the bench is ready (it needs the processors more), or until it is clear that this takes long."""

    def __init__(self, console: ConsoleWindow) -> None:
        super().__init__()
        self._console, self._since_s = console, time.monotonic()
        self.beside: threading.Thread | None = None
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)
        self._timer.start(LOOK_MS)

    def _look(self) -> None:
        console = self._console
        if console.opened is None:
            return
        if console.snapshot.stage != PREPARING or time.monotonic() > self._since_s + FIRST_USE_S:
            self._timer.stop()
            device = console.opened.devices[0]
            self.beside = threading.Thread(target=make_ready, args=(device,), name="warm-up")
            self.beside.start()

    def close(self) -> None:
        """Nothing is begun any more; wait for what was."""
        self._timer.stop()
        if self.beside is not None:
            self.beside.join()


def make_ready(device: Device) -> None:
    """All of it; about two seconds, on the first use some more."""
    compile_kernels(device)
    import app.screens.results_window  # noqa: F401  (its statistics take a second and a half)

    gc.collect()
    gc.freeze()  # else looking through all that was imported holds a frame for 50 ms now and then
