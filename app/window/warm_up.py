"""What the windows make ready beside their work, so that neither the first trial nor the first look at the results
has to wait for it: the kernels that drawing calls, the results window, no more garbage to look through; then one
picture of what no one sees yet, for layouts, styles and letters take longest the first time.
"""

import gc
import threading
import time

import numpy as np
from PySide6.QtCore import QObject, QTimer

from app.ipc.messages import PREPARING, RUNNING
from app.window.console_window import ConsoleWindow
from app.window.painting.layers import compile_kernels
from app.window.painting.workspace import Workspace
from core import tick_log
from core.device import Device
from core.path_file import build_path

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
        if self.beside is not None:
            if not self.beside.is_alive():
                self._timer.stop()
                if console.snapshot.stage != RUNNING:
                    paint_once(console)
        elif console.snapshot.stage != PREPARING or time.monotonic() > self._since_s + FIRST_USE_S:
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
    import app.window.results_window  # noqa: F401  (its statistics take a second and a half)

    gc.collect()
    gc.freeze()  # else looking through all that was imported holds a frame for 50 ms now and then


def paint_once(console: ConsoleWindow) -> None:
    """A picture of the desk, and of a workspace in which a trial begins, with every layer; thrown away."""
    opened, desk = console.opened, console.desk
    assert opened is not None
    if not desk.isVisible():
        desk.resize(console.pages.size())
        desk.grab()
    workspace = Workspace(opened.devices, opened.paths)
    for button in workspace.buttons.values():
        button.setChecked(True)
    path = next(iter(opened.paths.values()))
    x0, y0, x1, y1 = build_path(path, "path")[1:5]
    tip = (0.5 * (x0 + x1), 0.5 * (y0 + y1))
    workspace.show_trial(opened.devices[0], path, tip, opened.rules)
    tick = np.zeros((1, tick_log.WIDTH))
    tick[0, [tick_log.PHASE, tick_log.TIP_X, tick_log.TIP_Y, tick_log.TIP_VX, tick_log.HAND_FX]] = (
        tick_log.MOVE,
        *tip,
        0.1,
        2.0,
    )
    workspace.add(tick)
    workspace.resize(desk.size())
    workspace.grab()
    workspace.deleteLater()
