"""Makes the pictures of this folder again, by hand: python docs/screens/make.py (two minutes; without a screen:
QT_QPA_PLATFORM=offscreen).

The real app on a live bench: two sessions of the paper's protocol, whose pointer is led by a made-up hand, then the
results of a study by simulated operators. Nothing on the pictures is painted for them.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image
from PySide6.QtCore import QObject, QTimer
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QApplication, QWidget

from app.live import messages as m
from app.live.bench import Bench
from app.live.setup import Setup
from app.screens import theme
from app.screens.linkage_view import DIRECTIONS
from app.screens.windows import Windows
from core import row
from core.path import Path as Line
from core.path import nearest, point_at
from core.path_file import build_path

HERE = Path(__file__).resolve().parent
SMALL, LARGE = (1280, 720), (1920, 1080)
SPEED_M_S, NEAR_M = 0.07, 0.0015  # how fast it likes to move; so near to the start it holds still
LEAST_M, MOST_M, STEP_M = 0.01, 0.12, 0.0012  # the pointer's lead, which grows in each frame that is slower
SWAY_M, SWAY_HZ = 0.022, 0.45  # it is never quite on the line
LONGEST_S = 120.0
OPERATORS = 6


class MadeUpHand(QObject):
    """Leads the pointer: takes the handle, goes to the start, holds, follows the path, not very well."""

    def __init__(self, windows: Windows, bench: Bench) -> None:
        super().__init__()
        self._windows, self._bench = windows, bench
        self.now: np.ndarray | None = None  # the newest tick of the running trial
        self._path: Line | None = None
        self._lead = LEAST_M
        windows.framed.connect(self._frame)

    @property
    def progress(self) -> float:
        """Share of the path that is behind the handle, in the move; else -1."""
        if self.now is None or self._path is None or self.now[row.PHASE] != row.MOVE:
            return -1.0
        return float(nearest(self._path, self.now[row.TIP_X], self.now[row.TIP_Y])[0] / self._path.length)

    def is_in(self, phase: int) -> bool:
        """Whether the running trial is in this phase."""
        return self.now is not None and int(self.now[row.PHASE]) == phase

    def _frame(self, rows: np.ndarray) -> None:
        console = self._windows.console
        running, opened = console.snapshot.running, console.opened
        if running is None or opened is None:
            self.now = None
            return
        if len(rows):
            self.now = rows[-1]
        if self.now is None:
            return
        self._path = build_path(opened.paths[running.segment], "path")
        tip = self.now[row.TIP_X : row.TIP_Y + 1]
        slow = np.hypot(self.now[row.TIP_VX], self.now[row.TIP_VY]) < SPEED_M_S
        self._lead = min(max(self._lead + (STEP_M if slow else -2.0 * STEP_M), LEAST_M), MOST_M)
        goal = np.array([self._path.x0, self._path.y0])
        if self.is_in(row.MOVE):
            length = self._path.length
            x, y, tangent_x, tangent_y = point_at(self._path, min(self.progress * length + self._lead, 1.2 * length))
            sway = SWAY_M * np.sin(2.0 * np.pi * SWAY_HZ * self.now[row.T]) * min(1.0, 4.0 * abs(1.0 - self.progress))
            goal = np.array([x - sway * tangent_y, y + sway * tangent_x])
        reach = goal - tip
        far = float(np.hypot(*reach))
        if not self._bench.taken or far < NEAR_M or self.is_in(row.HOLD) or self.is_in(row.END):
            goal, self._lead = tip, LEAST_M
        elif not self.is_in(row.MOVE):
            goal = tip + reach / far * (self._lead + 0.5 * far)
        view = self._windows.participant.view
        view.pointer = (float(goal[0]), float(goal[1]))
        self._bench.aim(*view.pointer)


def main() -> None:
    """All pictures."""
    application = QApplication(sys.argv[:1])
    theme.dress(application)
    application.setQuitOnLastWindowClosed(False)
    with tempfile.TemporaryDirectory(prefix="phd-") as folder:
        data = Path(folder) / "data"
        bench = Bench(Setup(data))
        windows = Windows(bench)
        try:
            trials(windows, MadeUpHand(windows, bench))
            study = Path(folder) / "study"
            command = [sys.executable, "-m", "app.cli", "study", "--operators", str(OPERATORS), "--out", str(study)]
            subprocess.run(command, check=True, cwd=HERE.parents[1], stdout=subprocess.DEVNULL)
            results(windows, study)
        finally:
            windows.close()


def trials(windows: Windows, hand: MadeUpHand) -> None:
    """Participant's view in each phase, the console with three brakes and with four, a pre-flight with red."""
    console, participant, send = windows.console, windows.participant, windows.bench.send
    console.resize(*SMALL)
    windows.show()
    participant.setGeometry(0, 0, *SMALL)
    participant.show()
    until(lambda: console.snapshot.stage == m.NO_SESSION)

    send(m.Open("01"))
    until(lambda: console.snapshot.stage == m.READY)
    view = participant.view
    trial(windows, controller=2)
    until(lambda: view.taken and hand.is_in(row.APPROACH))
    until(lambda: after(0.15))
    shoot(participant, "participant-approach")
    until(lambda: hand.is_in(row.HOLD))
    until(lambda: after(0.2))
    shoot(participant, "participant-hold")
    until(lambda: hand.progress > 0.55)
    shoot(participant, "participant-move")
    until(lambda: console.snapshot.stage == m.READY)
    until(lambda: after(0.2))
    shoot(participant, "participant-end")
    trial(windows, controller=4)
    until(lambda: hand.progress > 0.5 and brakes(console) > 1.0)
    shoot(console, "console-three-brake")
    until(lambda: console.snapshot.stage == m.READY)
    windows.bench.brakes_off("Esc on the console")
    until(lambda: bool(console.snapshot.brakes_off))
    until(lambda: after(0.2))
    shoot(console, "preflight-red")
    send(m.AllowBrakes())
    send(m.Leave())
    until(lambda: console.snapshot.stage == m.NO_SESSION)

    send(m.Open("02"))  # who meets the four-brake device first
    until(lambda: console.snapshot.stage == m.READY)
    assert console.centre.workspace is not None
    console.centre.workspace.buttons[DIRECTIONS].setChecked(True)
    trial(windows, controller=2)
    until(lambda: hand.progress > 0.5 and brakes(console) > 1.0)
    shoot(console, "console-four-brake")
    until(lambda: console.snapshot.stage == m.READY)
    console.centre.workspace.buttons[DIRECTIONS].setChecked(False)
    console.resize(*LARGE)
    trial(windows, controller=4)
    until(lambda: hand.progress > 0.6 and brakes(console) > 1.0)
    shoot(console, "console-1920x1080")
    until(lambda: console.snapshot.stage == m.READY)
    send(m.Leave())
    until(lambda: console.snapshot.stage == m.NO_SESSION)
    console.resize(*SMALL)


def results(windows: Windows, study: Path) -> None:
    """The results window, on all participants of a study."""
    from app.screens.results_window import ResultsWindow

    opened = windows.console.opened
    assert opened is not None
    folder = study / "sub-01" / "ses-01"
    shown = ResultsWindow(opened._replace(participant="01", folder=str(folder)), m.Snapshot(m.FINISHED))
    shown.resize(*SMALL)
    shown.show()
    until(lambda: after(0.3))
    shoot(shown, "results")
    shown.close()


def trial(windows: Windows, controller: int) -> None:
    """Run trials until one of this controller begins."""
    console = windows.console
    while True:
        coming = console.snapshot.coming
        assert coming is not None
        windows.bench.send(m.Start())
        until(lambda: console.snapshot.stage == m.RUNNING)
        if coming.controller == controller:
            return
        until(lambda: console.snapshot.stage == m.READY)


def brakes(console) -> float:
    """The force of the brakes on the console's picture, N."""
    instant = console.centre.workspace.view.instant
    return 0.0 if instant is None else float(np.hypot(*instant.brakes))


_since: list[float] = []


def after(seconds: float) -> bool:
    """Whether so long has passed since it was first asked."""
    if not _since:
        _since.append(time.monotonic())
    if time.monotonic() - _since[0] < seconds:
        return False
    _since.clear()
    return True


def until(done: Callable[[], bool]) -> None:
    """Let the app run until then."""
    application, deadline = QApplication.instance(), time.monotonic() + LONGEST_S
    while not done():
        if time.monotonic() > deadline:
            raise TimeoutError("the app did not get so far")
        QTimer.singleShot(10, lambda: application.exit(0))
        application.exec()


def shoot(window: QWidget, name: str) -> None:
    """Keep a picture, in 256 colours: so many are enough for it."""
    picture = window.grab().toImage().convertToFormat(QImage.Format.Format_RGB888)
    pixels = np.frombuffer(picture.constBits(), np.uint8).reshape(picture.height(), picture.bytesPerLine())
    whole = Image.fromarray(pixels[:, : 3 * picture.width()].reshape(picture.height(), picture.width(), 3).copy())
    file = HERE / f"{name}.png"
    whole.quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).save(file, optimize=True)
    print(f"{file.name} {picture.width()} x {picture.height()} px, {file.stat().st_size} bytes")


if __name__ == "__main__":
    main()
