"""Both windows on a fake bench, for tests: what they are told, what they show, what is done to them."""

import numpy as np
import pytest
from fake_client import FakeClient, before, opened
from PySide6.QtCore import QEvent, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton, QApplication, QLabel, QWidget

from app.window.main_window import MainWindow
from app.window.participant.participant_window import ParticipantWindow
from app.window.run.run_page import RunPage
from app.window.widgets.page import RUN
from app.window.windows import Windows


class Screens:
    """The app without processes."""

    def __init__(self, width: int = 1280, height: int = 720) -> None:
        QApplication.setCursorFlashTime(0)  # pictures are compared, whenever they are taken
        self.client = FakeClient()
        with pytest.MonkeyPatch.context() as patch:  # the page Home is made by the tests that ask for it
            patch.setattr("app.window.main_window.HOME", RUN)
            self.windows = Windows(self.client)
        self.main: MainWindow = self.windows.main
        self.participant: ParticipantWindow = self.windows.participant
        self.main.resize(width, height)
        self.main.show()
        self.main.show_page(RUN)
        self.run: RunPage = self.main.page(RUN)  # type: ignore[assignment]

    def hear(self, *messages: object) -> MainWindow:
        """One frame in which the bench has said this."""
        self.client.inbox += messages
        self.windows.frame()
        return self.main

    def tick(self, rows: np.ndarray, taken: bool = True) -> None:
        """One frame with these ticks (n, row.WIDTH), which the panels need not wait for."""
        self.client.rows, self.client.taken = rows, taken
        self.windows.frame()
        self.run.show_panels()

    def press(self, key: Qt.Key, window: QWidget | None = None, modifier=Qt.KeyboardModifier.NoModifier) -> list:
        """Press a key; what was sent because of it."""
        before = len(self.client.sent)
        top = (window or self.main).window()
        top.activateWindow()
        QTest.qWaitForWindowActive(top)
        if key == Qt.Key.Key_Escape:  # the window hears it before what has the keyboard in it
            QTest.keyClick(top.windowHandle(), key, modifier)
        else:
            QTest.keyClick(window or self.main, key, modifier)
        return self.client.sent[before:]

    def begin_anew(self) -> None:
        """As after the start of another session server, with nothing open."""
        self.windows._timer.stop()
        self.participant.hide()
        while self.main.cards.leave() or self.run.cards.leave():
            pass
        self.client = self.windows.client = FakeClient()
        self.main.show_client(self.client, None)
        self.hear(opened(""), before())
        self.main.show_page(RUN)
        self.main.resize(1280, 720)
        self.main.setFocus()
        self.client.sent.clear()

    def close(self) -> None:
        """The end, whatever is open."""
        self.windows.close()
        for window in (self.main, self.participant):
            window.deleteLater()
        QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)


def visible_texts(window: QWidget) -> list[str]:
    """What can be read on a window's labels and buttons now."""
    widgets = [*window.findChildren(QLabel), *window.findChildren(QAbstractButton)]
    return [widget.text() for widget in widgets if widget.isVisible() and widget.text()]


def settle(window: QWidget) -> None:
    """Until everything has the place that it wants: layouts ask each other in turn."""
    for _ in range(6):
        QApplication.sendPostedEvents()
        QApplication.processEvents()
    window.grab()


def point(view: QWidget, place: QPointF) -> None:
    """The pointer is here (px) on a view, whatever lies over it."""
    none = Qt.MouseButton.NoButton
    event = QMouseEvent(
        QEvent.Type.MouseMove, place, view.mapToGlobal(place), none, none, Qt.KeyboardModifier.NoModifier
    )
    QApplication.sendEvent(view, event)
