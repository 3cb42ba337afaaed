"""The keys of both windows: one table, the same everywhere."""

from collections.abc import Callable, Mapping

from PySide6.QtCore import Qt
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QWidget

KEYS = {
    "start": (Qt.Key.Key_Space,),
    "escape": (Qt.Key.Key_Escape,),
    "allow brakes": (Qt.Key.Key_B,),
    "redo": (Qt.Key.Key_R,),
    "skip": (Qt.Key.Key_S,),
    "pause": (Qt.Key.Key_P,),
    "abort": (Qt.Key.Key_A,),
    "note": (Qt.Key.Key_N,),
    "results": (Qt.Key.Key_F2,),
    "device": (Qt.Key.Key_F3,),
    "participant": (Qt.Key.Key_F11,),
}


def bind(window: QWidget, commands: Mapping[str, Callable[[], None]]) -> None:
    """Let the keys of these commands act in a window; a key held down acts once, a text field keeps its letters."""
    for command, do in commands.items():
        for key in KEYS[command]:
            shortcut = QShortcut(QKeySequence(key), window)
            shortcut.setAutoRepeat(False)
            shortcut.activated.connect(do)
