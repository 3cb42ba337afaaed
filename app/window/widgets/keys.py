"""The keys of both windows, which act on every page: two tables, from which F1 shows them beside those of its page."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QWidget


class Key(NamedTuple):
    """What a key does. Letters act with Ctrl or Alt only, so that nothing that is typed sets anything off.

    Ctrl with S, A, X, P and N keep their meaning of everywhere: save, select all, cut, print, new.
    """

    keys: tuple[str, ...]
    does: str


#: in a session
SESSION = {
    "start": Key(("Space",), "start the next trial; keep the trial on the card and go on"),
    "escape": Key(("Esc",), "turn the brakes off, in a session and in Try; and close what is open"),
    "brakes on": Key(("Ctrl+B",), "turn the brakes on again"),
    "redo": Key(("Alt+R",), "repeat the last trial, or the one on the card"),
    "exclude": Key(("Alt+X",), "exclude the trial on the card"),
    "skip": Key(("Alt+S",), "skip the next trial"),
    "pause": Key(("Alt+P",), "pause after this trial, or resume"),
    "abort": Key(("Alt+A",), "abort the running trial"),
    "note": Key(("Alt+N",), "write a note"),
}
WINDOW = {
    "home": Key(("Ctrl+1",), "Home"),
    "try": Key(("Ctrl+2",), "Try"),
    "run": Key(("Ctrl+3",), "Run"),
    "analyse": Key(("Ctrl+4", "F2"), "Analyse"),
    "device": Key(("Ctrl+5", "F3"), "Device"),
    "participant": Key(("F11",), "show or hide the participant's view"),
    "keys": Key(("F1", "?"), "show the keys"),
    "help": Key(("Shift+F1",), "the help menu"),
    "settings": Key(("Ctrl+,",), "settings"),
}
#: on one page
PAGE = {
    "export": Key(("Ctrl+E",), "Analyse: export what is shown"),
    "save": Key(("Ctrl+S",), "Editor: save the protocol"),
}
KEYS = SESSION | WINDOW | PAGE
#: keys that a page, a question or a field of text has itself
OWN = {
    "1 to 5": "Try: choose a controller",
    "B": "Try: back to the start",
    "Alt+1 to 4": "Question: answer it with this reason",
    "Ctrl+Z": "Editor: undo a change",
}


def bind(window: QWidget, commands: Mapping[str, Callable[[], object]]) -> None:
    """Let the keys of these commands act in a window; a text field keeps its letters."""
    for command, do in commands.items():
        for key in KEYS[command].keys:
            add_key(key, window, do)


def add_key(key: str, widget: QWidget, do: Callable[[], object]) -> None:
    """Let a key act where a widget is seen; held down it acts once."""
    QShortcut(QKeySequence(key), widget, do).setAutoRepeat(False)
