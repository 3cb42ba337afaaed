"""What stands on the screen is what a canvas that is painted anew would show, whatever has happened to it."""

import numpy as np
import pytest
from drawn_ways import way_of
from fake_client import DEVICES, PATHS, TIP, movement
from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QApplication
from screens import point

from app.window.canvas.force_view import ForceView
from app.window.canvas.linkage_view import LAYERS, LinkageView
from app.window.canvas.plane import Plane
from app.window.participant.participant_window import ParticipantView
from app.window.sandbox import pass_view
from app.window.sandbox.pass_view import PassView
from app.window.widgets import theme
from app.window.widgets.words import Shown
from core import tick_log
from core.obstacles import ObstacleFile

STEPS, OUT_OF_SIGHT = 90, (0.5, 0.1)  # m


class Anything:
    """Does to a view what the pages do to it, in any order."""

    def __init__(self, view: Plane) -> None:
        self.view, self.random = view, np.random.default_rng(1)
        self.rows, self.at = movement(1, "AEB", 1.0), 0
        own = [happens for kind, happens in OWN if isinstance(view, kind)]
        self.happen = [*EVERY, *(each for happens in own for each in 3 * happens)]
        view.show()
        if isinstance(view, LinkageView):
            view.show_places(DEVICES, PATHS)
        self.show_trial()

    def any(self, *among):
        return among[self.random.integers(len(among))]

    def show_trial(self) -> None:
        path, tip = self.any(*PATHS), self.any(TIP, (-0.05, 0.33))
        self.rows, self.at = movement(path, "AEBC", 1.0, 1.0), 0
        self.rows[:100, tick_log.PHASE] = tick_log.APPROACH
        self.rows[-100:, tick_log.PHASE] = tick_log.END
        if isinstance(self.view, ForceView):
            self.view.show_trial(self.any(*DEVICES), PATHS[path], tip)
        else:
            self.view.show_path(PATHS[path])
            self.view.show_handle(tip)

    def ticks(self) -> None:
        begin, self.at = self.at, self.at + self.any(1, 16, 90)
        if begin >= len(self.rows):
            begin, self.at = 0, 16
        rows = self.rows[begin : self.at]
        if isinstance(self.view, ForceView):
            self.view.add(rows, self.any(None, False, True), self.any(0, len(rows) - 1))
        else:
            self.view.extend_trail(way_of(rows))
            tip = tuple(rows[-1, tick_log.TIP_X : tick_log.TIP_Y + 1].tolist())
            self.view.show_handle(tip, self.any(True, False), 9.0)

    def show_layer(self) -> None:
        layer = self.any(*(LAYERS if isinstance(self.view, LinkageView) else pass_view.LAYERS))
        self.view.show_layer(layer, layer not in self.view.shown)


WALL = ObstacleFile(polygon_m=((0.0, 0.37), (0.02, 0.37), (0.01, 0.39)))
EVERY = (
    lambda a, view: view.resize(*a.any((420, 300), (500, 340), (360, 400))),
    lambda a, view: view.setVisible(view.isHidden()),
    lambda a, view: view.show(),
    lambda a, view: view.show(),
    lambda a, view: point(view, QPointF(a.random.integers(-20, 440), a.random.integers(-20, 320))),
    lambda a, view: view.set_extent(a.any(QRectF(-0.2, 0.2, 0.4, 0.3), QRectF(-0.1, 0.3, 0.25, 0.2))),
    lambda a, view: view.show_obstacles(a.any((), (WALL,))),
    lambda a, view: view.show_beside(a.any(np.empty((0, 2)), way_of(a.rows)), theme.COLOURS.caution),
    lambda a, view: view.clear_trail(),
    lambda a, view: a.show_trial(),
    lambda a, view: view.follow_pointer(),
)
#: views -> what happens to these alone, three times as often
OWN = (
    (Plane, [lambda a, view: a.ticks()]),
    (ForceView, [
        lambda a, view: view.rest(a.any(TIP, OUT_OF_SIGHT)), lambda a, view: view.begin(),
        lambda a, view: view.refresh_text(), lambda a, view: a.show_layer(),
        lambda a, view: view.set_blind(not view.blind),
    ]),
    (LinkageView, [lambda a, view: view.show_line(a.any("", "Participant reads: Go"))]),
    (PassView, [lambda a, view: view.show_gap(a.any(0.0, 0.005))]),
    (ParticipantView, [
        lambda a, view: view.write(Shown(a.any("Go", "Hold"), a.any("", "Follow the line"))),
        lambda a, view: view.show_hold(a.any(0.0, 0.4, 1.0)),
        lambda a, view: view.show_linkage(a.any(None, *DEVICES)),
    ]),
)  # fmt: skip


def pixels(image: QImage) -> np.ndarray:
    image = image.convertToFormat(QImage.Format.Format_RGB32)
    return np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.width(), 4)[..., :3].astype(int)


def on_screen(view: Plane) -> np.ndarray:
    QApplication.processEvents()
    return pixels(view.screen().grabWindow(view.winId()).toImage())


def painted_anew(view: Plane) -> np.ndarray:
    """As if all of it had just come to be: nothing that was painted before is used."""
    view.resize(view.width() + 1, view.height())
    view.resize(view.width() - 1, view.height())
    view.fit()
    view.show_handle(view.tip, view.taken, view.force_N)
    for plane in (view, *view.findChildren(Plane)):
        plane.repaint_still()
    return pixels(view.grab().toImage())


@pytest.mark.parametrize("kind", [LinkageView, PassView, ParticipantView])
def test_after_anything_the_screen_shows_what_a_whole_repaint_shows(qtbot, kind: type) -> None:
    view = kind()
    qtbot.addWidget(view)
    view.setMinimumSize(1, 1)
    view.resize(420, 300)
    happens = Anything(view)
    for step in range(STEPS):
        happens.any(*happens.happen)(happens, view)
        if view.isVisible() and happens.random.random() < 0.5:
            apart = np.abs(on_screen(view) - painted_anew(view)).max(axis=2)
            assert not apart.any(), (step, int(apart.max()), np.argwhere(apart)[[0, -1]].tolist())
