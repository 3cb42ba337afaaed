"""`phd replay RECORDING`: a recorded trial in a window of its own."""

import signal
import sys
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QCloseEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import QApplication, QWidget

from app.window.analyse.trial_view import TrialView
from app.window.widgets import memory, palette, theme
from app.window.widgets.garbage import Collector
from app.window.widgets.parts import column
from app.window.widgets.theme import show_fitted
from experiments.study.playback import read_playback

LARGEST = (1280, 720)  # px


class TrialWindow(QWidget):
    """A trial in a window of its own."""

    def __init__(self, path: Path) -> None:
        """InputError if there is nothing to play."""
        super().__init__()
        self.setWindowTitle(f"phd: {path.name}")
        self.view = TrialView(whole=True)
        self.setLayout(column(self.view, margins=(10, 10, 10, 10)))
        self.view.show_trial(read_playback(path))
        self.setFocusProxy(self.view)
        QShortcut(QKeySequence(Qt.Key.Key_Escape), self, self.close)
        self.resize(*LARGEST)

    def closeEvent(self, event: QCloseEvent) -> None:
        self.view.end()
        super().closeEvent(event)


def run(path: Path) -> int:
    """Play a recording in a window of its own until it is closed. InputError if there is nothing to play."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # nothing is written here; Python's own handler waits for an event
    application = QApplication(sys.argv[:1])
    Collector(application)
    palette.choose(memory.remembered(memory.DARK_OR_LIGHT))
    theme.apply_theme(application)
    window = TrialWindow(path)
    show_fitted(window, *LARGEST)
    return application.exec()
