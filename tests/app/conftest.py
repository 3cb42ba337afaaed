"""What tests of the windows share."""

from collections.abc import Iterator

import pytest
from PySide6.QtWidgets import QApplication
from screens import Screens


@pytest.fixture
def screens(qtbot) -> Iterator[Screens]:
    """Both windows, without processes; nothing is left of them at the end."""
    screens = Screens()
    yield screens
    screens.close()
    assert screens.client.stopped and not [top for top in QApplication.topLevelWidgets() if top.isVisible()]
