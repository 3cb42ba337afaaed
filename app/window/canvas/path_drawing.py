"""Paths drawn with the mouse on the places that the devices reach."""

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import QMarginsF, QRectF, Signal
from PySide6.QtGui import QMouseEvent, QPainter

from app.window.canvas.path_marks import paint_disc, polygon
from app.window.canvas.plane import Plane
from app.window.widgets import theme
from app.window.widgets.theme import COLOURS
from core.drawn_path import read_path
from core.files import InputError, Pair, read_text
from core.path import outline
from experiments.protocol_writer import POINTS, points_of

SNAP_M = 0.005  # points lie on such a grid
NUMBER_PX = 8.0  # radius of the gap in a path for its number
GRAB_PX = 12.0  # how near the pointer must come to a point to move it
VIEW = QRectF(-0.4, 0.0, 0.8, 0.62)  # m, of the plane


class PathDrawing(Plane):
    """The paths of a protocol: their points can be moved, and new ones set for a path that is drawn."""

    drawn = Signal(str, list)  # kind of path, its points (m)
    moved = Signal(int, list)  # place of the path in the list, its points (m)

    def __init__(self) -> None:
        super().__init__(VIEW, keep_free=QMarginsF(64.0, 10.0, 10.0, 10.0), grid=True, follows_mouse=False)
        self._paths: list[tuple[str, list[Pair], np.ndarray]] = []  # number, points, outline
        self._kind, self._points = "", list[Pair]()  # what is being drawn
        self._free = np.empty((0, 2))  # m, places that every device reaches
        self._held: tuple[int, int] | None = None  # path and point that the pointer holds

    def show_paths(self, paths: list[dict[str, Any]], folder: Path) -> None:
        """The paths as they stand in the file of this folder; one that is none yet is not drawn."""
        self._paths = [("", [], np.empty((0, 2)))] * len(paths)
        for number, path in enumerate(paths, start=1):
            about = {key: value for key, value in path.items() if key != "number"}
            with contextlib.suppress(InputError):  # the reader's sentence stands in the form
                found, _ = read_path(about, lambda name: read_text(folder / name), "path")
                way = np.asarray(outline(found, SNAP_M))
                self._paths[number - 1] = str(path.get("number", number)), points_of(path), way
        self.repaint_still()

    def show_free(self, free: np.ndarray) -> None:
        """Where every device can be, (n, 2) m."""
        self._free = free
        self.repaint_still()

    def begin(self, kind: str) -> None:
        """The next clicks set the points of a path of this kind; a double click ends a polyline."""
        self._kind, self._points = kind, []
        self.repaint_still()

    def paint_under_path(self, painter: QPainter) -> None:
        painter.setClipRect(self.field)  # the names of the lines are not covered
        painter.setPen(theme.pen(COLOURS.edge, 2.0, round_cap=True))
        painter.drawPoints(polygon(self.pixels(self._free)))
        drawn = [*self._paths, ("", self._points, np.reshape(self._points, (-1, 2)))]
        for at, (number, _, way) in enumerate(drawn):
            painter.setPen(theme.pen(COLOURS.handle, 3.0))
            painter.drawPolyline(polygon(self.pixels(way)))
            if number:
                along = int(len(way) * (at + 0.35) / len(self._paths))  # where no other number is, and no point
                middle = self.to_screen(way[along])
                paint_disc(painter, middle, NUMBER_PX, COLOURS.canvas)
                theme.write(painter, middle, number, theme.NORMAL, True, COLOURS.text)
        painter.setBrush(theme.shade(COLOURS.canvas))
        for _, points, _ in drawn:
            for place, point in enumerate(points):
                inner = 0 < place < len(points) - 1
                ring = COLOURS.text if inner else COLOURS.end_ring if place else COLOURS.start_ring
                painter.setPen(theme.pen(ring, 3.0))
                painter.drawEllipse(self.to_screen(point), 7.0, 7.0)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if self._kind:
            self._points += [place] if (place := self._place(event)) not in self._points[-1:] else []
            if self._kind != "polyline" and len(self._points) == POINTS[self._kind]:
                self._end()
            self.repaint_still()
            return
        near = [
            ((self.to_screen(point) - event.position()).manhattanLength(), path, place)
            for path, (_, points, _) in enumerate(self._paths)
            for place, point in enumerate(points)
        ]
        self._held = min(near)[1:] if near and min(near)[0] <= GRAB_PX else None

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._held is not None:
            path, held = self._held
            points = self._paths[path][1]
            self.moved.emit(path, [*points[:held], self._place(event), *points[held + 1 :]])

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        self._held = None

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        if self._kind == "polyline" and len(self._points) >= POINTS[self._kind]:
            self._end()

    def _end(self) -> None:
        kind, points = self._kind, self._points
        self.begin("")
        self.drawn.emit(kind, points)

    def _place(self, event: QMouseEvent) -> Pair:
        x, y = self.to_plane(event.position())
        return round(round(x / SNAP_M) * SNAP_M, 4), round(round(y / SNAP_M) * SNAP_M, 4)
