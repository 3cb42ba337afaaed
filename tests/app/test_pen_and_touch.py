"""A mouse, a pen or a finger is the hand: where it is, as firmly as it presses, until it leaves or is lifted."""

import numpy as np
import pytest
from fake_client import opened, running
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QInputDevice, QPointingDevice, QTabletEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication
from screens import Screens, point
from tried import tried

from app.window.canvas.plane import Plane, grip_of
from app.window.widgets.page import TRY

Kind, Has, Type = QInputDevice.DeviceType, QInputDevice.Capability, QPointingDevice.PointerType
PLACE, ON = (0.03, 0.36), QEvent.Type
PEN = QPointingDevice("pen", 1, Kind.Stylus, Type.Pen, Has.Position | Has.Pressure | Has.Hover, 1, 1)


def pen(view: Plane, kind: QEvent.Type, pressure: float) -> None:
    at = view.to_screen(PLACE)
    none, left = Qt.MouseButton.NoButton, Qt.MouseButton.LeftButton
    button, buttons = (none if kind == ON.TabletMove else left), (left if pressure else none)
    upright = 5 * (0.0,)
    event = QTabletEvent(
        kind, PEN, at, view.mapToGlobal(at), pressure, *upright, Qt.KeyboardModifier.NoModifier, button, buttons
    )
    QApplication.sendEvent(view, event)


@pytest.fixture(params=["participant", "run", "try"])
def view(request, screens: Screens) -> Plane:
    """Each of the views in which the pointer is the hand."""
    if request.param == "try":
        screens.main.show_page(TRY)
        screens.hear(opened(""), tried())
        return screens.main.pages[TRY].canvas
    screens.hear(opened(), running())
    screens.participant.show()
    return screens.participant.view if request.param == "participant" else screens.run.workspace.view


def test_the_pointer_is_the_hand_in_metres_and_lets_go_where_it_leaves(screens: Screens, view: Plane) -> None:
    aimed = screens.client.aimed
    for leaves in (lambda: QApplication.sendEvent(view, QEvent(ON.Leave)), lambda: point(view, QPointF(-20.0, 50.0))):
        point(view, view.to_screen(PLACE))
        assert aimed[-1] == pytest.approx(PLACE, abs=1e-6)
        leaves()  # or is dragged out, with a button held down
        assert np.isnan(aimed[-1]).all()
    QTest.mouseClick(view, Qt.MouseButton.LeftButton, pos=view.to_screen(PLACE).toPoint())
    assert not np.isnan(aimed[-1]).any() and screens.client.grips[-1] == 1.0  # a mouse is seen without its button, too


def test_a_pens_pressure_is_the_grip_and_in_the_air_it_holds_nothing(screens: Screens, view: Plane) -> None:
    aimed, grips = screens.client.aimed, screens.client.grips
    pen(view, ON.TabletPress, 0.3)
    assert aimed[-1] == pytest.approx(PLACE, abs=1e-3) and grips[-1] == pytest.approx(0.3)
    pen(view, ON.TabletMove, 0.8)
    assert grips[-1] == pytest.approx(0.8)
    pen(view, ON.TabletRelease, 0.0)
    assert np.isnan(aimed[-1]).all()
    held = len(grips)
    pen(view, ON.TabletMove, 0.0)
    assert len(grips) == held


def test_a_mouse_and_a_pen_side_by_side_do_not_take_the_handle_from_each_other(screens: Screens, view: Plane) -> None:
    aimed, elsewhere = screens.client.aimed, view.to_screen(PLACE) + QPointF(30.0, 20.0)
    pen(view, ON.TabletPress, 0.5)
    held = len(aimed)
    point(view, elsewhere)
    QApplication.sendEvent(view, QEvent(ON.Leave))  # the mouse's
    assert len(aimed) == held, "the pen that is down is the hand"
    pen(view, ON.TabletRelease, 0.0)
    assert np.isnan(aimed[-1]).all()
    point(view, elsewhere)
    held = len(aimed)
    pen(view, ON.TabletMove, 0.0)
    assert len(aimed) == held and not np.isnan(aimed[-1]).any(), "a pen in the air leaves the handle to the mouse"


def test_a_finger_holds_while_it_is_down(screens: Screens, view: Plane) -> None:
    aimed, grips = screens.client.aimed, screens.client.grips
    screen, at = QTest.createTouchDevice(), view.to_screen(PLACE).toPoint()
    QTest.touchEvent(view, screen).press(1, at, view)
    assert aimed[-1] == pytest.approx(PLACE, abs=1e-3) and grips[-1] == 1.0  # this one does not measure pressure
    QTest.touchEvent(view, screen).move(1, at + QPoint(5, 0), view)
    assert aimed[-1][0] > PLACE[0]
    QTest.touchEvent(view, screen).release(1, at, view)
    assert np.isnan(aimed[-1]).all()
    QTest.touchEvent(view, screen).press(1, at, view)
    QTest.touchEvent(view, screen).move(1, QPoint(-20, 10), view)  # dragged out
    assert np.isnan(aimed[-1]).all()
    QTest.touchEvent(view, screen).release(1, at, view)
    measures = QPointingDevice("screen", 2, Kind.TouchScreen, Type.Finger, Has.Position | Has.Pressure, 5, 1)
    assert grip_of(measures, 0.4) == 0.4
