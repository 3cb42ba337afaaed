"""The participant's window on a screen of its own: whether it has landed there, and what is said if it has not.

A window manager may put a window elsewhere than it was asked to, and the main window is given its place only after it
is shown. So both are looked at once they are seen, and again after each move.
"""

from collections.abc import Callable

from PySide6.QtCore import QObject, QTimer
from PySide6.QtGui import QGuiApplication, QScreen
from PySide6.QtWidgets import QWidget

from app.window.widgets import memory

LOOK_MS = 400  # after a window was shown or moved, until it is looked at. Our choice: window managers take a tenth
MOST_MOVES = 4  # of the participant's window, before the experimenter is asked to move it
NOT_THERE = (
    "The participant's window should cover the screen {}, but {}. Move it there by hand, or choose another screen in "
    "the settings (Ctrl+,); F11 hides and shows it."
)


class SecondScreen(QObject):
    """Brings the participant's window to the screen on which the main window is not."""

    def __init__(self, main: QWidget, participant: QWidget, say: Callable[[str, str], object]) -> None:
        """say: shows the experimenter a message, by its title and text."""
        super().__init__(main)
        self._main, self._participant, self._say = main, participant, say
        self._moves, self._said = 0, False
        self._timer = QTimer(self, singleShot=True, interval=LOOK_MS)
        self._timer.timeout.connect(self.look)

    def other(self) -> QScreen | None:
        """The participant's screen, by the settings; None: they have none of their own."""
        chosen, mine = memory.remembered(memory.SCREEN), self._main.screen()
        others = [screen for screen in QGuiApplication.screens() if screen != mine]
        if chosen == memory.NO_SCREEN or not others:
            return None
        return next((screen for screen in others if screen.name() == chosen), others[0])

    def show(self) -> None:
        """Bring the participant's window to its screen, or over the main window; look where it lands."""
        self._moves, self._said = 0, False
        self._place(self.other() or self._main.screen())
        self._watch_main()

    def _place(self, screen: QScreen) -> None:
        window = self._participant
        if window.isFullScreen():
            window.showNormal()  # a full screen is not moved
        window.setScreen(screen)
        window.setGeometry(screen.geometry())
        window.showFullScreen()
        window.raise_()
        self._timer.start()

    def _watch_main(self) -> None:
        """Look again when the main window comes to another screen."""
        if (handle := self._main.windowHandle()) is not None and handle.property("watched") is None:
            handle.setProperty("watched", True)
            handle.screenChanged.connect(lambda _: self._timer.start())

    def look(self) -> None:
        """Move the participant's window if it is not where it belongs; in the end, tell the experimenter."""
        screen, window = self.other(), self._participant
        if screen is None or not window.isVisible() or not (wrong := self._wrong(screen)):
            self._moves = 0
            return
        if self._moves < MOST_MOVES:
            self._moves += 1
            self._place(screen)
        elif not self._said:
            self._said = True
            self._say("The participant's window is not seen", NOT_THERE.format(screen.name(), wrong))

    def _wrong(self, screen: QScreen) -> str:
        """What is wrong with where the participant's window is; "": nothing."""
        handle = self._participant.windowHandle()
        if handle is None or not handle.isExposed():
            return "it is not seen at all"
        if handle.screen() != screen:  # as the window system says: Wayland tells no program where its windows are
            return f"it is on {handle.screen().name()}"
        return ""
