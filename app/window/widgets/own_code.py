"""The question before code out of a session's folder runs."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtWidgets import QWidget

from app.window.widgets.cards import Cards, OverlayCard
from experiments.store.own_code import allow_code, unallowed_code


def ask_own_code(cards: Cards, parent: QWidget, folder: Path, run: Callable[[], object]) -> None:
    """Do it, where the folder's code needs it: once the user has said that this code may run; at once if it may."""
    code = unallowed_code(folder)
    if not code:
        run()
        return

    def allow() -> None:
        cards.leave()
        allow_code(code.values())
        run()

    text = f"{folder} holds {', '.join(code)}. It can do all that you can do on this computer."
    buttons = [("Do not run it  Enter", cards.leave), ("Run it", allow)]
    cards.put(OverlayCard("Run code out of this folder?", text, buttons, parent))
