"""What tests of the windows share."""

from collections.abc import Iterator

import pytest
from PySide6.QtWidgets import QApplication
from screens import Screens

from app.window.widgets import theme


@pytest.fixture(scope="session", autouse=True)
def dressed(application: QApplication) -> Iterator[None]:
    """The typeface and the colours, once; and no window loads what later pages need, or keeps settings."""
    theme.apply_theme(application)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("app.window.windows.load_statistics", lambda: None)
        patch.setattr("app.window.widgets.memory.begin", lambda: None)  # the user's own settings are left alone
        yield


@pytest.fixture(scope="module")
def kept() -> Iterator[list[Screens]]:
    """The windows of a file's tests; nothing is left of them at the end."""
    windows: list[Screens] = []
    yield windows
    while windows:
        windows.pop().close()
    assert not [top for top in QApplication.topLevelWidgets() if top.isVisible()]


@pytest.fixture
def screens(qtbot, kept: list[Screens]) -> Screens:
    """Both windows, without processes: the same for all tests of a file until one closes them."""
    if kept and kept[0].windows.over:
        kept.pop().close()
    if kept:
        kept[0].begin_anew()
    else:
        kept.append(Screens())
    return kept[0]
