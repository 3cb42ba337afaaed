"""Makes the pictures of this folder again, and the moving one of Try, by hand: python docs/screens/make.py (four
minutes; without a screen: QT_QPA_PLATFORM=offscreen).

The real app on a live bench: two sessions of the paper's protocol, whose pointer is led by a made-up hand, the results
of a study by simulated operators, an emulated board on the bench. Nothing on the pictures is painted for them.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image
from PySide6.QtCore import QObject, Qt, QTimer
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QApplication, QWidget

from app.ipc import messages as m
from app.ipc.client import Client
from app.ipc.messages import Setup
from app.window.canvas.linkage_view import DIRECTIONS
from app.window.widgets import theme
from app.window.widgets.garbage import Collector
from app.window.widgets.page import ANALYSE, DEVICE, RUN, TRY
from app.window.windows import Windows
from core import tick_log
from core.path import Path as Line
from core.path import build_path, nearest, point_at

HERE = Path(__file__).resolve().parent
SIZE = (1280, 720)
SPEED_M_S, NEAR_M = 0.07, 0.0015  # how fast it likes to move; so near to the start it holds still
PULL_M = 0.008  # further ahead on the way to the start
LEAST_M, MOST_M, STEP_M = 0.002, 0.02, 0.0002  # the pointer's lead, which grows with each frame that is slower
SWAY_M, SWAY_HZ = 0.006, 0.45  # it is never quite on the line
LONGEST_S = 120.0
SETTLED_S = 0.12  # after which a window has laid itself out at another size
COLOURS, AS_THEY_ARE = 256, 64
FILM, FILM_S = (960, 540), 0.1  # pixels; from frame to frame
LAST_MS = 2000  # for which the last frame stays
FRAME_S = 0.016
OPERATORS = 6


class MadeUpHand(QObject):
    """Leads the pointer: takes the handle, goes to the start, holds, follows the path, not very well."""

    def __init__(self, windows: Windows, bench: Client) -> None:
        super().__init__()
        self._windows, self._bench = windows, bench
        self.now: np.ndarray | None = None  # the newest tick of the running trial
        self._path: Line | None = None
        self._lead, self._at_s = LEAST_M, 0.0
        windows.framed.connect(self._frame)

    @property
    def progress(self) -> float:
        """Share of the path that is behind the handle, in the move; else -1."""
        if self.now is None or self._path is None or self.now[tick_log.PHASE] != tick_log.MOVE:
            return -1.0
        return float(nearest(self._path, self.now[tick_log.TIP_X], self.now[tick_log.TIP_Y])[0] / self._path.length)

    def is_in(self, phase: int) -> bool:
        """Whether the running trial is in this phase."""
        return self.now is not None and int(self.now[tick_log.PHASE]) == phase

    def _frame(self, rows: np.ndarray) -> None:
        main = self._windows.main
        running, opened = main.snapshot.running, main.opened
        if running is None or opened is None:
            self.now = None
            return
        if len(rows):
            self.now = rows[-1]
        if self.now is None:
            return
        self._path = build_path(opened.protocol.paths[running.path], "path")
        tip = self.now[tick_log.TIP_X : tick_log.TIP_Y + 1]
        slow = np.hypot(self.now[tick_log.TIP_VX], self.now[tick_log.TIP_VY]) < SPEED_M_S
        frames = min(max(float(self.now[tick_log.T]) - self._at_s, 0.0) / FRAME_S, 10.0)
        self._at_s = float(self.now[tick_log.T])
        self._lead = min(max(self._lead + frames * (STEP_M if slow else -2.0 * STEP_M), LEAST_M), MOST_M)
        goal = np.array([self._path.x0, self._path.y0])
        if self.is_in(tick_log.MOVE):
            length = self._path.length
            x, y, tangent_x, tangent_y = point_at(self._path, min(self.progress * length + self._lead, 1.2 * length))
            sway = (
                SWAY_M * np.sin(2.0 * np.pi * SWAY_HZ * self.now[tick_log.T]) * min(1.0, 4.0 * abs(1.0 - self.progress))
            )
            goal = np.array([x - sway * tangent_y, y + sway * tangent_x])
        reach = goal - tip
        far = float(np.hypot(*reach))
        if not self._bench.taken or self.is_in(tick_log.END):
            goal, self._lead = tip, LEAST_M
        elif self.is_in(tick_log.HOLD) or far < NEAR_M:
            self._lead = LEAST_M
        elif not self.is_in(tick_log.MOVE):
            goal = tip + reach / far * (self._lead + min(0.5 * far, PULL_M))
        pointer = float(goal[0]), float(goal[1])
        seen = (main.pages[name].workspace.view for name in (RUN, TRY) if name in main.pages)
        for view in (self._windows.participant.view, *seen):
            if view.isVisible():
                view.point_at(view.to_screen(pointer))
        self._bench.ring.aim(*pointer)


def main() -> None:
    """All pictures."""
    application = QApplication(sys.argv[:1])
    Collector(application)
    theme.apply_theme(application)
    application.setQuitOnLastWindowClosed(False)
    with tempfile.TemporaryDirectory(prefix="phd-") as folder:
        windows = Windows(Client(Setup(Path(folder) / "data")))
        try:
            hand = MadeUpHand(windows, windows.client)
            trials(windows, hand)
            study = Path(folder) / "study"
            command = [sys.executable, "-m", "app.cli", "study", "--operators", str(OPERATORS), "--out", str(study)]
            subprocess.run(command, check=True, cwd=HERE.parents[1], stdout=subprocess.DEVNULL)
            pages(windows, hand, study)
        finally:
            windows.close()
            write_pictures()
        on_the_bench(Path(folder) / "bench")
        write_pictures()


def trials(windows: Windows, hand: MadeUpHand) -> None:
    """A movement as the participant and as the experimenter see it, and the card of a trial."""
    main, send = windows.main, windows.client.send
    begin(windows, "02")  # who meets the four-brake device first
    trial(windows, controller=2)
    until(lambda: hand.progress > 0.55)
    shoot(windows.participant, "participant")
    until(lambda: main.snapshot.stage == m.READY)
    run = main.page(RUN)
    assert run.workspace is not None
    run.workspace.layers[DIRECTIONS].setChecked(True)
    trial(windows, controller=4)
    until(lambda: hand.progress > 0.5 and brakes(windows) > 1.0)
    shoot(main, "run")
    until(lambda: main.snapshot.stage == m.READY)
    until(lambda: after(0.2))
    shoot(main, "card")
    send(m.Leave())
    until(lambda: main.snapshot.stage == m.NO_SESSION)


def begin(windows: Windows, participant: str) -> None:
    """Both windows, and a session of this participant."""
    main = windows.main
    main.resize(*SIZE)
    windows.show()
    windows.participant.setGeometry(0, 0, *SIZE)
    windows.participant.show()
    until(lambda: main.snapshot.stage == m.NO_SESSION)
    windows.client.send(m.Open(participant))
    until(lambda: main.snapshot.stage == m.READY)


def pages(windows: Windows, hand: MadeUpHand, study: Path) -> None:
    """Try, pass after pass, and Analyse on all participants of a study."""
    main = windows.main
    main.show_page(TRY)
    for controller in (1, 4, 2):
        until(lambda: main.snapshot.sandbox is not None)
        assert main.snapshot.sandbox is not None
        passes = len(main.snapshot.sandbox.passes)
        preset = main.opened.protocol.controllers[controller]
        now = main.snapshot.sandbox.settings
        windows.client.send(m.SetSandbox(now._replace(controller=controller).with_parameters(**preset.named)))
        if controller == 4:
            until(lambda: hand.is_in(tick_log.HOLD))
            film(main, "try", lambda: len(main.snapshot.sandbox.passes) > passes)  # noqa: B023
        elif controller != 2:  # a line of the table
            until(lambda: len(main.snapshot.sandbox.passes) > passes)  # noqa: B023
    main.show_page(ANALYSE, study)
    until(lambda: main.page(ANALYSE).results is not None)
    until(lambda: after(1.0))
    shoot(main, "analyse")


def on_the_bench(data: Path) -> None:
    """The device page, of an emulated board."""
    command = [sys.executable, "-m", "app.cli", "emulate", "--device", "four-brake", "--hand", "still"]
    board = subprocess.Popen(command, cwd=HERE.parents[1], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert board.stdout is not None
    windows = Windows(Client(Setup(data, devices=("four-brake",), link=board.stdout.readline().strip())))
    main = windows.main
    try:
        windows.show()
        until(lambda: main.snapshot.stage == m.NO_SESSION)
        windows.client.send(m.Open("01"))
        until(lambda: main.snapshot.stage == m.RERIG)
        main.show_page(DEVICE)
        until(lambda: after(6.0))  # the clock model has its drift
        shoot(main, "device")
    finally:
        windows.close()
        board.terminate()
        board.wait()


def trial(windows: Windows, controller: int) -> None:
    """Run trials until one of this controller begins."""
    main = windows.main
    while True:
        coming = main.snapshot.coming
        assert coming is not None
        windows.client.send(m.Start())
        until(lambda: main.snapshot.stage == m.RUNNING)
        if coming.controller == controller:
            return
        until(lambda: main.snapshot.stage == m.READY)


def brakes(windows: Windows) -> float:
    """The force of the brakes on the workspace of Run, N."""
    instant = windows.main.page(RUN).workspace.view.instant
    return 0.0 if instant is None else float(np.hypot(*instant.brakes))


_since: list[float] = []
taken: list[tuple[str, QImage]] = []  # name of the file, picture


def after(seconds: float) -> bool:
    """Whether so long has passed since it was first asked."""
    if not _since:
        _since.append(time.perf_counter())
    if time.perf_counter() - _since[0] < seconds:
        return False
    _since.clear()
    return True


def until(done: Callable[[], bool]) -> None:
    """Let the app run until then."""
    application, deadline = QApplication.instance(), time.perf_counter() + LONGEST_S
    while not done():
        if time.perf_counter() > deadline:
            raise TimeoutError("the app did not get so far")
        QTimer.singleShot(10, lambda: application.exit(0))
        application.exec()


def shoot(window: QWidget, name: str) -> None:
    """Take a picture; it is written at the end, for that takes longer than a trial."""
    window.resize(*SIZE)
    until(lambda: after(SETTLED_S))
    taken.append((f"{name}.png", window.grab().toImage()))


def film(window: QWidget, name: str, ended: Callable[[], bool]) -> None:
    """Take a moving picture until then; it is written as NAME.gif, in few colours."""
    frames = []

    def take() -> None:
        frames.append(rgb(window.grab().toImage().scaled(*FILM, mode=Qt.TransformationMode.SmoothTransformation)))

    while not ended():
        take()
        until(lambda: after(FILM_S) or ended())
    until(lambda: after(FILM_S))  # the last frame has what the end brings, and stays
    take()
    middle = Image.fromarray(frames[len(frames) // 2])
    first = middle.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE, kmeans=3)  # small areas keep their colours
    pictures = [Image.fromarray(frame).quantize(palette=first, dither=Image.Dither.NONE) for frame in frames]
    times_ms = [*(len(frames) - 1) * [round(1e3 * FILM_S)], LAST_MS]
    file = HERE / f"{name}.gif"
    pictures[0].save(file, save_all=True, append_images=pictures[1:], duration=times_ms, loop=0)
    print(f"{file.name} {len(frames)} frames, {file.stat().st_size} bytes")


def rgb(image: QImage) -> np.ndarray:
    """The pixels (height, width, 3) of a picture."""
    picture = image.convertToFormat(QImage.Format.Format_RGB888)
    lines = np.frombuffer(picture.constBits(), np.uint8).reshape(picture.height(), picture.bytesPerLine())
    return lines[:, : 3 * picture.width()].reshape(picture.height(), picture.width(), 3).copy()


def write_pictures() -> None:
    """All that were taken."""
    for name, image in taken:
        file = HERE / name
        in_few_colours(rgb(image)).save(file, optimize=True)
        print(f"{file.name} {image.width()} x {image.height()} px, {file.stat().st_size} bytes")
    taken.clear()


def in_few_colours(pixels: np.ndarray) -> Image.Image:
    """Pixels (height, width, 3) in 256 colours: the most frequent ones as they are, then always the one that is
    furthest from all so far.
    """
    found, which, often = np.unique(pixels.reshape(-1, 3), axis=0, return_inverse=True, return_counts=True)
    colours = found.astype(float)
    chosen = list(np.argsort(-often)[:AS_THEY_ARE])
    far = np.min([((colours - colours[i]) ** 2).sum(axis=1) for i in chosen], axis=0)
    while len(chosen) < min(COLOURS, len(found)):
        chosen.append(int(np.argmax(far)))
        far = np.minimum(far, ((colours - colours[chosen[-1]]) ** 2).sum(axis=1))
    nearest = np.argmin([((colours - colours[i]) ** 2).sum(axis=1) for i in chosen], axis=0).astype(np.uint8)
    picture = Image.fromarray(nearest[which.reshape(pixels.shape[:2])], "P")
    picture.putpalette(found[chosen].tobytes())
    return picture


if __name__ == "__main__":
    main()
