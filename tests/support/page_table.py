"""What the session server says -> what can be read, what can be pressed, what a key sends: a row for each state."""

from collections.abc import Callable
from typing import NamedTuple

from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import QAbstractButton, QLabel, QWidget
from screens import Screens

from app.window.canvas.linkage_view import LinkageView
from app.window.participant.participant_window import ParticipantView
from app.window.widgets.parts import Figures, KeyButton

BETWEEN = " | "  # between two of the words of a row


class Row(NamedTuple):
    """A state of the app, by what has been said, and what is true of its screens then."""

    said: tuple  # messages of the session server, each in a frame of its own
    reads: str = ""  # all of these can be read
    never: str = ""  # none of these can
    offers: str | None = None  # the buttons with keys that can be pressed, by their words; None: not looked at
    sends: dict[str, list] = {}  # noqa: RUF012  (never changed) key -> what is sent because of it, in this order


def read(window: QWidget) -> str:
    """All that can be read on it, drawn texts and tips with it."""
    found: list[str] = []
    for shown in (window, *window.findChildren(QWidget)):
        if not shown.isVisible():
            continue
        if isinstance(shown, QLabel | QAbstractButton | Figures):
            found.append(shown.text())
        elif isinstance(shown, LinkageView):
            found.append(shown.line)
        elif isinstance(shown, ParticipantView):
            found += shown.shown
        found.append(shown.toolTip())
    return BETWEEN.join(filter(None, found)).replace("\u200b", "")


def offered(page: QWidget) -> set[str]:
    """The words of its buttons with keys that can be pressed, without their dots."""
    buttons = (button for button in page.findChildren(KeyButton) if button.isVisible() and button.isEnabled())
    return {button.text().rstrip(" …▾▴") for button in buttons}


def press(screens: Screens, keys: str) -> list:
    """Press a key by its name ("Alt+R"); what was sent because of it."""
    pressed = QKeySequence(keys)[0]
    return screens.press(pressed.key(), modifier=pressed.keyboardModifiers())


def check(screens: Screens, row: Row, later: Callable[[], object] = lambda: None) -> None:
    """That the row is true of both windows. later: lets time go by before anything is pressed."""
    for message in row.said:
        screens.hear(message)
    text = read(screens.main)
    for words in filter(None, row.reads.split(BETWEEN)):
        assert words in text, f"{words!r} is not in {text}"
    for words in filter(None, row.never.split(BETWEEN)):
        assert words not in text, f"{words!r} is in {text}"
    if row.offers is not None:
        assert offered(screens.run) == set(filter(None, row.offers.split(BETWEEN)))
    later()
    for key, commands in row.sends.items():
        assert press(screens, key) == commands, key
