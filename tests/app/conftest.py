"""What tests of the windows share."""

import gc
from collections.abc import Iterator

import pytest
from PySide6.QtWidgets import QApplication
from screens import Screens

from app.window.widgets import theme


@pytest.fixture(scope="session", autouse=True)
def dressed(application: QApplication) -> None:
    """The typeface and the colours, once."""
    theme.apply_theme(application)


@pytest.fixture(scope="module", autouse=True)
def alone(dressed: None) -> Iterator[None]:
    """No window loads what later pages need, or keeps settings; tests of other folders, before or after, may."""
    QApplication.setOrganizationName("")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("app.window.windows.Windows._warm", lambda *_: None)
        patch.setattr("app.window.widgets.memory.begin", lambda: None)  # the user's own settings are left alone
        yield


@pytest.fixture(scope="module", autouse=True)
def _no_collection_beside_windows() -> Iterator[None]:
    """Garbage is collected in the thread of the windows, between tests, and never by itself: as in the app."""
    usual = gc.get_threshold()
    gc.set_threshold(0)
    yield
    gc.collect()
    gc.set_threshold(*usual)


@pytest.fixture(autouse=True)
def _collected() -> Iterator[None]:
    """Collect what a test has left."""
    yield
    gc.collect(1)


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
