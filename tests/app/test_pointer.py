"""The pointer is the hand, until it leaves; a finger is a pointer while it is down."""

import numpy as np
import pytest
from fake_client import opened, running
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication
from screens import Screens, point, settle
from tried import tried

from app.window.canvas.plane import Plane
from app.window.widgets.page import TRY

PLACE = (0.03, 0.39)


@pytest.fixture(params=["participant", "run", "try"])
def view(request, screens: Screens) -> Plane:
    """Each of the views in which the pointer is the hand."""
    if request.param == "try":
        screens.main.show_page(TRY)
        screens.hear(opened(""), tried())
        return screens.main.pages[TRY].canvas
    screens.hear(opened(), running())
    if request.param == "run":
        screens.participant.hide()  # else it lies over the same place
        return screens.run.workspace.view
    screens.participant.show()
    return screens.participant.view


def test_the_pointer_is_the_hand_in_metres_and_lets_go_where_it_leaves(screens: Screens, view: Plane) -> None:
    aimed = screens.client.aimed
    for leaves in (
        lambda: QApplication.sendEvent(view, QEvent(QEvent.Type.Leave)),
        lambda: point(view, QPointF(-20.0, 50.0)),
    ):
        point(view, view.to_screen(PLACE))
        assert aimed[-1] == pytest.approx(PLACE, abs=1e-6)
        leaves()  # or is dragged out, with a button held down
        assert np.isnan(aimed[-1]).all()
    QTest.mouseClick(view, Qt.MouseButton.LeftButton, pos=view.to_screen(PLACE).toPoint())
    assert not np.isnan(aimed[-1]).any(), "a mouse is seen without its button, too"


def test_a_finger_holds_while_it_is_down(screens: Screens, view: Plane) -> None:
    settle(view.window())
    aimed, at = screens.client.aimed, view.to_screen(PLACE).toPoint()
    finger = QTest.createTouchDevice()
    QTest.touchEvent(view, finger).press(1, at, view)
    assert aimed[-1] == pytest.approx(PLACE, abs=1e-3)
    QTest.touchEvent(view, finger).move(1, at + QPoint(5, 0), view)
    assert aimed[-1][0] > PLACE[0]
    QTest.touchEvent(view, finger).release(1, at + QPoint(5, 0), view)
    assert np.isnan(aimed[-1]).all()
