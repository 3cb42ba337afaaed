"""The lists of a protocol in its editor: devices as ticks, controllers and paths as rows in columns.

Each changes the list of the file's content that it was given, and says so.
"""

import contextlib
import itertools
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QPushButton, QWidget

from app.window.widgets import theme
from app.window.widgets.fields import NumberField, TextField, Tick, is_number
from app.window.widgets.parts import Choice, Flow, button, clear, grid, holder, row, text_label, wrapped_label
from core.control.controllers import ALGORITHMS
from core.device import shipped_devices
from core.drawn_path import DRAWING
from core.files import InputError, Pair
from experiments.protocol_writer import POINTS, path_through, points_of

POINT_PX, PARAMETER_PX = 78, 72  # wide, at a text size of 1: -93.969 and 10000 have room
SIGN_PX, LINE_PX = 26, 30  # wide, a button of one sign; high, a field


class DeviceTicks(QWidget):
    """A tick for each shipped device, and for each other one that the protocol names."""

    changed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("clear")
        self._chosen: list[str] = []
        self._ticks = Flow(gap=18)
        self.setLayout(self._ticks)

    def show_entries(self, chosen: list[str]) -> None:
        self._chosen = chosen
        clear(self._ticks)
        for name in dict.fromkeys([*shipped_devices(), *chosen]):
            tick = Tick(Path(name).name, name in chosen)
            tick.changed.connect(partial(self._use, name))
            self._ticks.addWidget(tick)

    def add(self, file: str) -> None:
        self._use(file, True)
        self.show_entries(self._chosen)

    def _use(self, name: str, on: bool) -> None:
        self._chosen[:] = [other for other in self._chosen if other != name] + [name] * on
        self.changed.emit()


class EntryRows(QWidget):
    """Entries of the file in rows whose columns align; a button at the end of a row removes it."""

    changed = Signal()
    kind, wide = "", 0  # what an entry is; the column that takes the free width

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("clear")
        self.entries: list[dict[str, Any]] = []
        self._grid = grid(6, 6, stretched=self.wide)
        self.setLayout(self._grid)

    def show_entries(self, entries: list[dict[str, Any]]) -> None:
        had = self.window().focusWidget()
        name = had.accessibleName() if had is not None and self.isAncestorOf(had) else ""
        self.entries = entries
        clear(self._grid)
        self.fill_rows()
        for again in [part for part in self.findChildren(QWidget) if name and part.accessibleName() == name][-1:]:
            again.setFocus()  # the keyboard stays where it was

    def fill_rows(self) -> None:
        """Fill the columns but for the last, and set its buttons by `close_row`."""
        raise NotImplementedError

    def close_row(self, place: int, at: tuple[int, int], *buttons: QPushButton) -> None:
        """The buttons of a row, the last of them removes it; at: row and column of the grid."""
        remove = sign("×", partial(self.remove, place), f"Remove this {self.kind}")
        for pressed in (*buttons, remove):
            pressed.setAccessibleName(f"{pressed.toolTip()}, {place + 1}")
        self._grid.addLayout(row(1, *buttons, remove, spacing=4), *at, Qt.AlignmentFlag.AlignTop)

    def add(self, entry: dict[str, Any]) -> None:
        self.entries.append(entry)
        self._renumber()

    def remove(self, place: int) -> None:
        del self.entries[place]
        self._renumber()

    def _renumber(self) -> None:
        """Entries are numbered by their place: a number that was given might now stand there twice."""
        for number, entry in enumerate(self.entries, start=1):
            entry["number"] = number
        self.show_entries(self.entries)
        self.changed.emit()

    def put(self, entry: dict[str, Any], key: str, value: Any) -> None:
        """Another value of an entry."""
        entry[key] = value
        self.changed.emit()


class ControllerRows(EntryRows):
    """Name, algorithm, and a column for each parameter that one of the algorithms has."""

    kind = "controller"

    def fill_rows(self) -> None:
        kinds = [ALGORITHMS[kind] for entry in self.entries if (kind := str(entry.get("kind"))) in ALGORITHMS]
        shown = {parameter.name: parameter for kind in kinds for parameter in kind.parameters}
        units = ["\n".join(filter(None, (parameter.word, parameter.unit))) for parameter in shown.values()]
        for column, heading in enumerate(("Name", "Algorithm", *units)):
            label = text_label(heading, "quiet", theme.SMALL)
            self._grid.addWidget(label, 0, column, Qt.AlignmentFlag.AlignBottom)
        for place, entry in enumerate(self.entries):
            name = TextField(f"Controller {place + 1}")
            name.setMinimumWidth(100)
            name.show_value(entry.get("name"))
            name.changed.connect(lambda value, entry=entry: self.put(entry, "name", value or ""))
            self._grid.addWidget(name, place + 1, 0)
            if "algorithm" in entry:  # a file of its own: its parameters are changed there and in the protocol's text
                self._grid.addWidget(wrapped_label(str(entry["algorithm"]), "quiet"), place + 1, 1, 1, 1 + len(shown))
            else:
                self._fill_kind(place, entry, list(shown))
            self.close_row(place, (place + 1, 2 + len(shown)))

    def _fill_kind(self, place: int, entry: dict[str, Any], columns: Sequence[str]) -> None:
        kind = Choice()
        kind.setAccessibleName(f"Algorithm of controller {place + 1}")
        kind.addItems(list(ALGORITHMS))
        kind.setCurrentText(str(entry.get("kind")))
        kind.textActivated.connect(partial(self.use_kind, entry))
        self._grid.addWidget(kind, place + 1, 1)
        for parameter in ALGORITHMS[kind.currentText()].parameters:
            field, scale = NumberField(f"{parameter.word} of controller {place + 1}"), parameter.scale
            field.show_value(scaled(entry.get(parameter.name, parameter.default), scale))
            field.setFixedWidth(theme.text_px(PARAMETER_PX))
            field.changed.connect(
                lambda value, name=parameter.name, scale=scale: self.put(entry, name, scaled(value, 1.0 / scale))
            )
            self._grid.addWidget(field, place + 1, 2 + columns.index(parameter.name))

    def use_kind(self, entry: dict[str, Any], kind: str) -> None:
        """Another algorithm: the parameters of the one before are gone."""
        for key in entry.keys() - {"name", "number"}:
            del entry[key]
        entry["kind"] = kind
        self.show_entries(self.entries)
        self.changed.emit()

    def add_new(self) -> None:
        self.add({"name": f"Controller {len(self.entries) + 1}", "kind": next(iter(ALGORITHMS))})


class PathRows(EntryRows):
    """Number and kind of a path, two fields for each of its points, in mm."""

    kind, wide = "path", 1
    refused = Signal(str)  # why what was typed is no path

    def fill_rows(self) -> None:
        self.points: list[list[NumberField]] = []  # of each path: x and y of its points
        if any(entry.get("kind") != DRAWING for entry in self.entries):
            heads = point_pair(*(text_label(f"{axis} mm", "quiet", theme.SMALL) for axis in "xy"))
            heads.setFixedHeight(heads.sizeHint().height())
            self._grid.addWidget(heads, 0, 1, Qt.AlignmentFlag.AlignLeft)  # of the first point: how many fit varies
        for place, entry in enumerate(self.entries):
            name = text_label(f"{entry.get('number', place + 1)}  {entry.get('kind')}")
            name.setFixedHeight(theme.text_px(LINE_PX))
            self._grid.addWidget(name, place + 1, 0, Qt.AlignmentFlag.AlignTop)
            if entry.get("kind") == DRAWING:
                self._grid.addWidget(wrapped_label(str(entry.get("file", ""))), place + 1, 1)
            else:
                self._grid.addLayout(Flow(*self._fields(place, entry), gap=8), place + 1, 1)
            more = ("+", self._lengthen, "Another point at the end"), ("−", self._shorten, "Remove the last point")
            longer = more if entry.get("kind") == "polyline" else ()
            self.close_row(place, (place + 1, 2), *(sign(text, partial(do, place), hint) for text, do, hint in longer))

    def _fields(self, place: int, entry: dict[str, Any]) -> list[QWidget]:
        self.points.append(fields := [])
        for number, point in enumerate(points_of(entry), start=1):
            for axis, value in zip("xy", point, strict=True):
                field = NumberField(f"{axis} of point {number} of path {place + 1}")
                field.show_value(in_mm(value))
                field.setToolTip(f"Point {number}: {axis}, mm")
                field.changed.connect(lambda _: self._typed(place))
                fields.append(field)
        return [point_pair(x, y) for x, y in zip(fields[::2], fields[1::2], strict=True)]

    def draw(self, kind: str, points: Sequence[Pair]) -> None:
        """A path was drawn through these points (m)."""
        try:
            self.add(path_through(kind, points))
        except InputError as error:
            self.refused.emit(str(error))

    def add_file(self, path: Path) -> None:
        """A path drawn in a file; a picture, which has no metres, 10 cm wide in the middle of the workspace."""
        placed = {"width_m": 0.1, "centre_m": [0.0, 0.36]} if path.suffix.lower() == ".svg" else {}
        self.add({"kind": DRAWING, "file": str(path)} | placed)

    def move_points(self, place: int, points: Sequence[Pair]) -> None:
        """A point was dragged; where that makes no path, it stays as it was."""
        with contextlib.suppress(InputError):
            self._reshape(place, points)
            for field, value in zip(self.points[place], itertools.chain(*points), strict=True):
                field.show_value(in_mm(value))

    def _reshape(self, place: int, points: Sequence[Pair]) -> None:
        """A path goes through other points (m). InputError: there is no such path."""
        entry = self.entries[place]
        entry |= path_through(entry["kind"], points)
        self.changed.emit()

    def _typed(self, place: int) -> None:
        values = [field.value() for field in self.points[place]]
        try:
            if not all(map(is_number, values)):
                raise InputError("path: each point is two numbers, in mm")
            self._reshape(place, [(x / 1e3, y / 1e3) for x, y in zip(values[::2], values[1::2], strict=True)])
        except InputError as error:
            self.refused.emit(str(error))

    def _lengthen(self, place: int) -> None:
        """Another point of a polyline, as far from the last as that is from the one before."""
        *_, (x0, y0), (x1, y1) = points = points_of(self.entries[place])
        self._reshape(place, [*points, (2.0 * x1 - x0, 2.0 * y1 - y0)])
        self.show_entries(self.entries)

    def _shorten(self, place: int) -> None:
        if len(points := points_of(self.entries[place])) > POINTS["polyline"]:
            self._reshape(place, points[:-1])
            self.show_entries(self.entries)


def point_pair(x: QWidget, y: QWidget) -> QWidget:
    """What belongs to one point, as wide as its fields."""
    for part in (x, y):
        part.setFixedWidth(theme.text_px(POINT_PX))
    return holder(row(x, y, spacing=2))


def sign(text: str, do: Callable[[], object], hint: str) -> QPushButton:
    """A button of one sign, level with a field."""
    pressed = button(text, do, "small", hint)
    pressed.setStyleSheet("padding: 0")
    pressed.setFixedSize(*map(theme.text_px, (SIGN_PX, LINE_PX)))
    return pressed


def scaled(value: Any, scale: float) -> Any:
    """A number in another unit, without the last digits that this makes up; anything else as it is."""
    return float(f"{scale * value:.12g}") if is_number(value) else value


def in_mm(length_m: float) -> float:
    """A coordinate as it is shown. Our choice: to a micrometre."""
    return round(1e3 * length_m, 3)
