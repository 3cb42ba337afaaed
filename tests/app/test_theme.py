"""Another theme acts at once, but in a trial, and nothing that was typed is lost."""

from collections.abc import Iterator

import pytest
from fake_client import opened, ready, running
from screens import Screens

from app.window.settings import SettingsCard
from app.window.widgets import memory, palette, theme


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
