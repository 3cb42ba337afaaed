"""A handle on a path as its newest tick is: its trail, the forces of hand and brakes with their values; layers that
a menu and its keys show and hide."""

import math
from collections.abc import Callable, Mapping

import numpy as np
from PySide6.QtCore import QMarginsF, QPointF, QRectF
from PySide6.QtGui import QAction, QPainter, QResizeEvent
from PySide6.QtWidgets import QMenu, QPushButton

from app.window.canvas.layers import Doing, Instant, Point, doing
from app.window.canvas.marks import arrow_of, paint_arrow
from app.window.canvas.path_marks import Sizes
from app.window.canvas.plane import Painter, Plane
from app.window.canvas.small_view import SmallView
from app.window.widgets.keys import add_key
from app.window.widgets.parts import NO_FOCUS, Panel, column, row
from app.window.widgets.theme import COLOURS, pen
from core import tick_log
from core.device import Device
from core.path import PathFile

TRAIL, FORCES, LINKAGE, INSET = "trail", "forces", "linkage", "whole device, small"
HAND, BRAKES = "hand", "brakes"  # whose force
FORCE_COLOUR = {HAND: COLOURS.good, BRAKES: COLOURS.brake_slipping}
INSET_PX, INSET_SIZES = 180, Sizes(path=2.0, ring=4.0, ring_pen=2.0, handle=4.5, pointer=0.0)  # wide, at most
WORDS_EVERY_S = 0.1  # numbers that change faster cannot be read


class RefreshClock:
    """When numbers are written anew: ten times a second, in the time of the ticks."""

    def __init__(self) -> None:
        self._at_s = -math.inf

    def due(self, now_s: float) -> bool:
        """Whether it is time; then the next time is a little later."""
        if self._at_s <= now_s < self._at_s + WORDS_EVERY_S:
            return False
        self._at_s = now_s
        return True


def way_of(rows: np.ndarray) -> np.ndarray:
    """Where the handle was (n, 2), m, at every one of some ticks at which it moved along the path."""
    return rows[rows[:, tick_log.PHASE] == tick_log.MOVE][:, (tick_log.TIP_X, tick_log.TIP_Y)]


class ForceView(Plane):
    """One device on one path, and in a corner the whole linkage with all of its brakes. A subclass adds what else it
    shows of `instant`."""

    def __init__(self, extent: QRectF, keep_free: QMarginsF, sizes: Sizes, follows_mouse: bool = False) -> None:
        super().__init__(extent, sizes, keep_free, follows_mouse)
        self.instant: Instant | None = None  # of the device; none before the first trial
        self.phase, self.began_s = -1, 0.0  # of the running trial, and when it began; -1: none runs
        self.shown = {TRAIL, FORCES}
        self.blind = False
        self.doing: dict[str, Doing] = {}  # joint -> what its brake does
        self._unread = np.empty((0, tick_log.WIDTH))  # ticks since the text was made
        self.inset = SmallView(INSET_SIZES)
        self.inset.setParent(self)
        self._under_inset = QRectF()  # px, where a handle would lie under it
        self.under_path = [self._paint_frame]

    # what to show

    def show_trial(self, device: Device, path: PathFile, tip: Point) -> None:
        """Another device or path: the handle at rest at `tip`, brakes off."""
        self.show_path(path)
        self.inset.show_trial(device, path, tip)
        self._rest(device, tip)

    def rest(self, tip: Point) -> None:
        """The handle stands at `tip`, brakes off; the trail stays to be looked at."""
        if self.instant is not None:
            self._rest(self.instant.device, tip)

    def _rest(self, device: Device, tip: Point) -> None:
        self.begin()
        self._unread = self._unread[:0]
        self._show(Instant(device, tip))
        self.refresh_text()

    def begin(self) -> None:
        """Another trial: the next ticks are its first. The trail stays to be looked at until its movement begins."""
        self.phase = -1

    def add(self, rows: np.ndarray, taken: bool | None = None, read_from: int = 0) -> None:
        """The next ticks (n, WIDTH) of the running trial, n > 0: all are on its way, and the newest is drawn.

        taken: as in `show_handle`. read_from: what the brakes do is told of these rows from that one on.
        """
        if self.instant is None:
            return
        way = way_of(rows)
        if len(way) and self.phase not in (tick_log.MOVE, tick_log.END):  # the movement begins
            self.clear_trail()
        self.extend_trail(way)
        if (phase := int(rows[-1, tick_log.PHASE])) != self.phase:
            self.phase, self.began_s = phase, float(rows[rows[:, tick_log.PHASE] == phase][0, tick_log.T])
        self._unread = np.concatenate((self._unread, rows[read_from:]))
        self._show(Instant.of_tick(self.instant.device, rows[-1]), taken)

    def _show(self, now: Instant, taken: bool | None = None) -> None:
        pointer = (self._aimed or self.pointer) if self._follows_mouse else now.wanted
        changed = (now, pointer) != (self.instant, self.pointer)
        self.instant, self.pointer, self._aimed = now, pointer, None
        if not self.show_handle(now.tip, taken, math.hypot(*now.hand)) and changed:
            self.repaint_moving()

    def show_layer(self, layer: str, shown: bool) -> None:
        """Lay something over the view, or take it away."""
        (self.shown.add if shown else self.shown.discard)(layer)
        self.trail_shown = TRAIL in self.shown
        self.repaint_still()
        self._show_inset()

    @property
    def whole_in_corner(self) -> bool:
        return LINKAGE in self.shown

    def show_handle(self, tip: Point | None, taken: bool | None = None, force_N: float = 0.0) -> bool:
        changed = super().show_handle(tip, taken, force_N)
        self._show_inset()
        return changed

    def _show_inset(self) -> None:
        """The linkage in its corner; away while the handle would lie under it."""
        under = self.tip is not None and self._under_inset.contains(self.to_screen(self.tip))
        shown = self.whole_in_corner and self.instant is not None and self.tip is not None and not under
        if shown == self.inset.isHidden():
            self.inset.setVisible(shown)
            self.repaint_still()
        if shown and self.instant is not None:
            self.inset.show_instant(self.instant, None if self.blind else self.doing)

    def fit(self) -> None:
        width = int(min(INSET_PX, 0.24 * self.width(), 0.4 * self.height()))
        height = int(0.9 * width)
        self.inset.setGeometry(self.width() - width - 10, self.height() - height - 10, width, height)
        self._under_inset = QRectF(self.inset.geometry()).marginsAdded(QMarginsF(*4 * (self.sizes.handle,)))
        super().fit()

    def set_blind(self, blind: bool) -> None:
        """Hide what would tell the controllers apart: what the brakes do, and their force."""
        if blind != self.blind:
            self.blind = blind
            self._show_inset()
            self.repaint_still()

    def refresh_text(self) -> None:
        """Bring what the brakes do up to date; a few times a second, for it must be read."""
        if (now := self.instant) is None:
            return
        if not now.running:  # nobody measures
            self.doing = dict.fromkeys(now.device.braked, Doing())
        elif len(self._unread):
            self.doing, self._unread = doing(now.device, self._unread), self._unread[:0]
        self._show_inset()
        self.repaint_moving()

    def moving_places(self) -> list[QPointF]:
        places, now = super().moving_places(), self.instant
        if now is not None and self.tip is not None:
            places += [self.to_screen(now.tip) + arrow_of(force) for force in (now.hand, now.brakes)]
        return places

    # painting

    def of_instant(self, *paints: Callable[[QPainter, Instant], object]) -> list[Painter]:
        """Painters of the newest tick; they draw nothing before there is one."""

        def with_instant(paint: Callable[[QPainter, Instant], object]) -> Painter:
            return lambda painter: self.instant and self.tip and paint(painter, self.instant)

        return [with_instant(paint) for paint in paints]

    def _paint_frame(self, painter: QPainter) -> None:
        if not self.inset.isHidden():
            painter.setPen(pen(COLOURS.line, 2.0))
            painter.drawRect(self.inset.geometry())

    def paint_forces(self, painter: QPainter, now: Instant) -> None:
        """Both arrows; while the pointer holds the handle the spring between them is the hand's."""
        if FORCES not in self.shown:
            return
        handle, width = self.to_screen(now.tip), self.sizes.path
        if not self.blind:
            paint_arrow(painter, handle, arrow_of(now.brakes), FORCE_COLOUR[BRAKES], width)
        if not self.taken:
            paint_arrow(painter, handle, arrow_of(now.hand), FORCE_COLOUR[HAND], width)


class Layered(Panel):
    """A view, and the menu that shows and hides its layers."""

    def __init__(self, view: ForceView, layers: Mapping[str, tuple[str, str]], over: bool = True) -> None:
        """layers: name -> its key, what it shows. over: the menu lies over a corner of the view, else in the foot."""
        super().__init__("canvas")
        self.view, self._over = view, over
        self.keys = {key: f"show or hide {shows[0].lower()}{shows[1:]}" for key, shows in layers.values()}
        self.menu = QMenu(self)
        self.menu.setToolTipsVisible(True)
        self.layers = {layer: self._entry(layer, *about) for layer, about in layers.items()}
        self.foot = row(margins=(0, 0, 0, 0) if over else (8, 0, 8, 8))
        self.setLayout(column((view, 1), self.foot, spacing=0, margins=(2, 2, 2, 2)))
        self.show_button = QPushButton("Show  ▾", self, objectName="small", focusPolicy=NO_FOCUS)
        self.show_button.setMinimumHeight(30)
        self.show_button.setMenu(self.menu)
        if not over:
            self.foot.addWidget(self.show_button)
            self.foot.addStretch(1)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        if self._over:
            self.show_button.adjustSize()
            self.show_button.move(self.width() - self.show_button.width() - 14, 12)

    def _entry(self, layer: str, key: str, shows: str) -> QAction:
        """An entry of the menu, which its key presses too."""
        entry = QAction(f"{layer[0].upper()}{layer[1:]}\t{key}", self, checkable=True, toolTip=shows)
        entry.setChecked(layer in self.view.shown)
        entry.toggled.connect(lambda shown: self.view.show_layer(layer, shown))
        self.menu.addAction(entry)
        add_key(key, self, entry.toggle)
        return entry
