"""While a trial runs Esc takes the brakes off in every window, dialog, menu and field, and closes what is open."""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product

import pytest
from fake_client import opened, ready, running
from PySide6.QtCore import Qt, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QComboBox, QFileDialog, QPushButton, QWidget
from screens import Screens, settle

from app.ipc import messages as m
from app.window.widgets.page import ANALYSE, DEVICE, HOME, RUN, TRY

PAGES = HOME, TRY, RUN, ANALYSE, DEVICE
ALT = Qt.KeyboardModifier.AltModifier


def press_escape(window: QWidget) -> None:
    """As the window system brings it to the window that has the keyboard."""
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_Escape)


def running_on(screens: Screens, page: str, editing: bool = False) -> QWidget:
    """A trial runs, and this page is at the front."""
    screens.hear(opened(), running())
    screens.main.show_page(page)
    if editing:
        screens.main.pages[HOME].edit.click()
    screens.main.activateWindow()
    QTest.qWaitForWindowActive(screens.main)
    settle(screens.main)
    return screens.main.page(page)


def places(page: QWidget, main: QWidget) -> Iterator[Callable[[], object]]:
    """What is done to bring the keyboard to each field, button, list and menu that is seen."""
    for widget in (*page.findChildren(QWidget), *main.findChildren(QPushButton)):
        if not (widget.isVisible() and widget.isEnabled()):
            continue
        if widget.focusPolicy() & Qt.FocusPolicy.TabFocus:
            yield widget.setFocus
        if isinstance(widget, QPushButton) and widget.menu() is not None:
            yield partial(widget.menu().popup, main.mapToGlobal(main.rect().center()))
        if isinstance(widget, QComboBox):
            yield widget.showPopup


@pytest.mark.parametrize(("name", "editing"), [*((name, False) for name in PAGES), (HOME, True)])
def test_escape_takes_the_brakes_off_from_every_field_button_list_and_menu_of_a_page(screens, name, editing) -> None:
    page = running_on(screens, name, editing)
    for number, reach in enumerate(list(places(page, screens.main)), start=1):
        reach()
        press_escape(screens.main)
        assert len(screens.client.off_causes) == number and QApplication.activePopupWidget() is None, reach
    assert screens.client.off_causes


#: what lies over the window while a trial runs, by what opens it
ASKED: dict[str, Callable[[Screens], object]] = {
    "abort": lambda screens: screens.press(Qt.Key.Key_A, modifier=ALT), "close": lambda screens: screens.main.close(),
    "settings": lambda screens: screens.main.show_settings(), "keys": lambda screens: screens.main.show_keys(),
    "note": lambda screens: screens.press(Qt.Key.Key_N, modifier=ALT),
}  # fmt: skip


def test_escape_takes_the_brakes_off_from_every_question_and_closes_it(screens: Screens) -> None:
    running_on(screens, RUN)
    for number, (asked, ask) in enumerate(ASKED.items(), start=1):
        ask(screens)
        press_escape(screens.main)
        assert len(screens.client.off_causes) == number, asked
        assert screens.main.cards.question is None and screens.run.cards.question is None


def test_escape_takes_the_brakes_off_from_a_dialog_of_files_and_closes_it_alone(screens: Screens) -> None:
    home, seen = running_on(screens, HOME, editing=True), []

    def look() -> None:
        dialog = QApplication.activeModalWidget()
        if dialog is None or QApplication.focusWindow() is not dialog.windowHandle():
            QTimer.singleShot(50, look)
            return
        seen.append(dialog)
        QTest.keyClick(dialog.windowHandle(), Qt.Key.Key_Escape)

    QTimer.singleShot(100, look)
    plain = QFileDialog.Option.DontUseNativeDialog
    assert QFileDialog.getOpenFileName(screens.main, "Protocol", "", "", options=plain)[0] == ""
    assert len(seen) == 1 and len(screens.client.off_causes) == 1
    assert home.stack.currentWidget() is home.editor, "what is behind the dialog stays"


def test_escape_takes_the_brakes_off_in_every_stage_of_a_session_in_both_windows(screens: Screens) -> None:
    stages = running(), ready(3), ready(9, stage=m.RERIG), ready(9, stage=m.BREAK), ready(10, stage=m.QUESTIONS)
    screens.participant.show()
    for number, (said, window) in enumerate(product(stages, (screens.main, screens.participant)), start=1):
        screens.hear(opened(), said)
        screens.press(Qt.Key.Key_Escape, window)
        assert len(screens.client.off_causes) == number, said.stage


def test_another_page_closes_every_menu_and_takes_the_keyboard(screens: Screens) -> None:
    screens.hear(opened(""), ready(0, stage=m.NO_SESSION))
    screens.main.show_page(HOME)
    choice = screens.main.pages[HOME].protocol
    choice.setFocus()
    choice.showPopup()
    assert QApplication.activePopupWidget() is not None
    screens.hear(opened(), ready(0))
    assert screens.main.shown == RUN and QApplication.activePopupWidget() is None
    assert screens.main.focusWidget() is not choice
    assert screens.press(Qt.Key.Key_Space, screens.main.focusWidget()) == [m.Start()]
