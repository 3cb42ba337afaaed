"""Another theme acts at once, but in a trial, and nothing that was typed is lost."""

from collections.abc import Iterator

import pytest
from fake_client import opened, ready, running
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QPushButton
from screens import Screens

from app.window.sandbox.dials import DIALS, DialRow
from app.window.settings import SettingsCard
from app.window.widgets import memory, palette, theme
from app.window.widgets.parts import Segments, column, holder, toggle


def choose(name: str) -> None:
    palette.choose(name)
    theme.colour_all()


@pytest.fixture(autouse=True)
def dark_again() -> Iterator[None]:
    yield
    choose("dark")


def test_a_change_waits_for_the_end_of_a_trial_and_keeps_what_was_typed(screens: Screens, monkeypatch) -> None:
    screens.hear(opened(), running(3))
    screens.run.panel.note.setText("asked for water")
    monkeypatch.setattr(memory, "remembered", lambda key: "light" if key == memory.DARK_OR_LIGHT else "")
    screens.main.setting_changed.emit(memory.DARK_OR_LIGHT)
    assert palette.chosen is palette.DARK, "a trial does not wait"
    screens.hear(ready(4))
    assert palette.chosen is palette.LIGHT and screens.run.panel.note.text() == "asked for water"


def test_settings_show_the_theme_in_use_also_where_the_command_line_chose_it(screens: Screens) -> None:
    choose("light")
    screens.main.show_settings()
    assert screens.main.findChild(SettingsCard).theme.value() == "light" != memory.remembered(memory.DARK_OR_LIGHT)


def test_tab_comes_to_choices_chips_and_sliders_and_each_shows_that_it_has_the_keyboard(qtbot) -> None:
    dial, choice = DialRow(DIALS[0]), Segments({1: "one", 2: "two"})
    dial.show_value(0.05)
    choice.show_value(1)
    chosen = choice.findChildren(QPushButton)[0]
    window = holder(column(QPushButton("first"), chosen.parentWidget(), toggle("lit", print, on=True), dial))
    qtbot.addWidget(window)
    window.show()
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow)
    window.findChild(QPushButton).setFocus()
    for part in (chosen, *window.findChildren(QPushButton, "toggle"), dial.slider):
        before = part.grab().toImage()
        window.focusNextChild()
        assert window.focusWidget() is part and part.grab().toImage() != before
    assert not dial.slider.focusPolicy() & Qt.FocusPolicy.ClickFocus, "a click leaves the keys of the page alone"
