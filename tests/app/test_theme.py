"""Another theme acts at once: every page then looks as after a start in it, and nothing that was typed is lost."""

from collections.abc import Iterator

import numpy as np
import pytest
from fake_client import before, movement, opened, pulse, ready, running
from PySide6.QtGui import QImage
from screens import Screens, settle
from tried import INITIAL, ended, tried

from app.window.settings import SettingsCard
from app.window.widgets import memory, palette, theme
from app.window.widgets.page import DEVICE, HOME, RUN, TRY
from core import tick_log

TYPED, NOTE = "# mine\n[trial]\nno_such_key = 1\n", "asked for water"
LATE = movement(1, "AEB")
LATE[1000:1010, tick_log.LATENESS_US] = np.linspace(150.0, 4000.0, 10)


def choose(name: str) -> None:
    palette.choose(name)
    theme.colour_all()


@pytest.fixture(autouse=True)
def dark_again() -> Iterator[None]:
    yield
    choose("dark")


def fill(screens: Screens, qtbot) -> None:
    """A trial runs, and everywhere something is open or typed."""
    screens.hear(opened(""), tried(INITIAL, ended(1)))
    screens.main.page(TRY)
    screens.main.page(DEVICE)
    editor = screens.main.page(HOME).editor
    editor.open("paper")
    editor.text.setPlainText(TYPED)
    screens.hear(opened(), before(), ready(3), running(3), pulse())
    screens.participant.show()
    screens.run.strip.open.setChecked(True)
    screens.run.panel.note.setText(NOTE)
    screens.tick(LATE)
    qtbot.waitUntil(lambda: not editor.waiting and bool(editor.problem), timeout=10_000)


def looks(screens: Screens) -> dict[str, QImage]:
    """What every page and the participant's window look like."""
    screens.hear(pulse(""))
    main, found = screens.main, {"participant": screens.participant.grab().toImage()}
    for name in (DEVICE, TRY, HOME, RUN):
        main.show_page(name)
        if name == HOME:
            main.pages[HOME]._show_editor()
        main.setFocus()
        settle(main)
        found[name] = main.grab().toImage()
    return found


def test_after_a_change_all_looks_as_after_a_start_in_it_and_what_was_typed_is_there(qtbot, monkeypatch) -> None:
    choose("light")
    started = Screens()
    fill(started, qtbot)
    started.hear(ready(4))
    choose("light")  # an edge that is drawn anew differs in a few pixels, whatever the theme
    wanted = looks(started)
    started.close()
    choose("dark")
    screens = Screens()
    fill(screens, qtbot)
    monkeypatch.setattr(memory, "remembered", lambda key: "light" if key == memory.DARK_OR_LIGHT else "")
    screens.main.setting_changed.emit(memory.DARK_OR_LIGHT)
    assert palette.chosen is palette.DARK, "a trial does not wait"
    screens.hear(ready(4))
    assert palette.chosen is palette.LIGHT
    got = looks(screens)
    assert screens.main.pages[HOME].editor.text.toPlainText() == TYPED and screens.run.panel.note.text() == NOTE
    assert [name for name in wanted if got[name] != wanted[name]] == []
    screens.close()


def test_settings_show_the_theme_in_use_also_where_the_command_line_chose_it(qtbot) -> None:
    choose("light")
    screens = Screens()
    screens.main.show_settings()
    assert screens.main.findChild(SettingsCard).theme.value() == "light" != memory.remembered(memory.DARK_OR_LIGHT)
    screens.close()
