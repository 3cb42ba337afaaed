"""A participant's window that a window manager does not put on its own screen is moved there, then asked for."""

from PySide6.QtCore import QRect
from PySide6.QtGui import QScreen
from PySide6.QtWidgets import QWidget

from app.window.second_screen import MOST_MOVES, SecondScreen


class Elsewhere:
    """A screen beside all others, on which nothing can be shown."""

    def name(self) -> str:
        return "beamer"

    def geometry(self) -> QRect:
        return QRect(5000, 0, 800, 600)


class Moved(QWidget):
    """A participant's window that counts how often it is sent to a screen, and stays where it is."""

    def __init__(self) -> None:
        super().__init__()
        self.moves = 0

    def setScreen(self, screen: QScreen) -> None:
        self.moves += 1


def test_a_participants_window_that_is_not_where_it_should_be_is_moved_four_times_and_then_said_once(
    qtbot, monkeypatch
) -> None:
    main, participant, said = QWidget(), Moved(), []
    for window in (main, participant):
        qtbot.addWidget(window)
        window.show()
    second = SecondScreen(main, participant, lambda *words: said.append(words))
    monkeypatch.setattr(second, "other", Elsewhere)
    for _ in range(MOST_MOVES + 2):
        second.look()
    assert participant.moves == MOST_MOVES == 4
    ((_, words),) = said
    assert "should cover the screen beamer" in words and "Move it there by hand" in words
    monkeypatch.setattr(second, "other", main.screen)
    second.look()
    assert participant.moves == MOST_MOVES and len(said) == 1, "where it should be, nothing is moved or said"
