"""The protocol editor: an experiment as a form, its paths drawn on the workspace, its plan beside it.

What is edited is the content of the protocol's file. The reader of protocols checks it while it is typed, and its
sentence stands where the mistake is.
"""

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import QMarginsF, QPointF, QRectF, QTimer, Signal
from PySide6.QtGui import QMouseEvent, QPainter, QPolygonF
from PySide6.QtWidgets import (
    QCheckBox,
    QFileDialog,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLayout,
    QLineEdit,
    QPlainTextEdit,
    QVBoxLayout,
    QWidget,
)  # fmt: skip

from app.window.background import Background
from app.window.cards import Notice
from app.window.painting import theme
from app.window.painting.labels import Choice, breakable, line, word
from app.window.painting.parts import button, clear, row, scrolled
from app.window.painting.plane import Plane
from core.control.controllers import ALGORITHMS
from core.device import shipped_devices
from core.files import InputError, Pair, read_text
from core.path import outline, path_from
from core.workspace import tip_is_free
from experiments.language import shipped_languages
from experiments.plan import plan_summary, print_plan
from experiments.protocol import SHIPPED_FOLDER, Protocol, read_protocol, shipped_protocols
from experiments.protocol_writer import POINTS, path_through, points_of, protocol_text, save_protocol

WAIT_MS = 200  # after the last change, before the content is read
SNAP_M = 0.005  # points drawn with the mouse lie on such a grid
GRAB_PX = 12.0  # how near the pointer must come to a point to move it
VIEW = QRectF(-0.4, 0.0, 0.8, 0.62)  # m, of the plane
TOML = "TOML files (*.toml)"
WHERE = "protocol"  # begins the reader's sentences
PAGE_BREAK = "\n---\n"  # between the pages of instructions

#: key of the file -> what stands before its field, and its choices (none: a number or a text)
FIELDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "name": ("Name", ()),
    "blocks": ("Blocks", ()),
    "repetitions": ("Repetitions", ()),
    "practice_trials": ("Practice trials", ()),
    "breaks.after_trials": ("Break after trials", ()),
    "breaks.least_s": ("Break, at least s", ()),
    "rules": ("Rules", ("settled", "literal")),
    "feedback": ("Feedback", ("none", "time", "error")),
    "language": ("Language", tuple(shipped_languages())),
}
FLAGS = {
    "blind": "Blind: codes in place of controller names",
    "show_linkage": "The participant sees the linkage",
    "questionnaire.on": "A questionnaire after each block",
}
DEFAULTS = {
    "blocks": 1, "repetitions": 1, "practice_trials": 0, "rules": "settled", "feedback": "none", "language": "en",
}  # fmt: skip


class Drawing(Plane):
    """The workspace with the protocol's paths: points can be moved, and new ones set for a path that is drawn."""

    drawn = Signal(str, list)  # kind of path, its points (m)
    moved = Signal(int, list)  # place of the path in the list, its points

    def __init__(self) -> None:
        super().__init__(VIEW, keep_free=QMarginsF(64.0, 10.0, 10.0, 10.0), grid=True, follows_mouse=False)
        self.paths: list[dict[str, Any]] = []
        self.kind, self.points = "", []  # what is being drawn
        self._free = np.empty((0, 2))  # places (m) that every device reaches
        self._held: tuple[int, int] | None = None  # path and point that the pointer holds

    def show_paths(self, paths: list[dict[str, Any]]) -> None:
        """The paths as they stand in the file."""
        self.paths = paths
        self.repaint_still()

    def show_free(self, free: np.ndarray) -> None:
        """Where every device can be, (n, 2) m."""
        self._free = free
        self.repaint_still()

    def begin(self, kind: str) -> None:
        """The next clicks set the points of a path of this kind; a double click ends a polyline."""
        self.kind, self.points = kind, []
        self.repaint_still()

    def paint_under_path(self, painter: QPainter) -> None:
        painter.setPen(theme.pen(theme.EDGE, 2.0, round_cap=True))
        painter.drawPoints(QPolygonF([self.to_screen(place) for place in self._free.tolist()]))
        for number, path in enumerate(self.paths, start=1):
            about = {key: value for key, value in path.items() if key != "number"}
            try:
                points = points_of(path)
                way = outline(path_from(about, "path"), 0.005)
            except (InputError, KeyError, TypeError, ValueError):
                continue  # not a path yet: the reader's sentence stands beside its field
            self._paint_points(painter, np.asarray(way).tolist(), points)
            painter.setFont(theme.font(theme.NORMAL, bold=True))
            painter.setPen(theme.pen(theme.TEXT, 1.0))
            painter.drawText(self.to_screen(points[0]) + QPointF(12.0, -12.0), str(path.get("number", number)))
        self._paint_points(painter, self.points, self.points)

    def _paint_points(self, painter: QPainter, way: list, points: list[Pair]) -> None:
        painter.setPen(theme.pen(theme.HANDLE, 3.0))
        painter.drawPolyline(QPolygonF([self.to_screen(place) for place in way]))
        painter.setBrush(theme.shade(theme.CANVAS))
        for place in points:
            ring = theme.START_RING if place == points[0] else theme.END_RING if place == points[-1] else theme.TEXT
            painter.setPen(theme.pen(ring, 3.0))
            painter.drawEllipse(self.to_screen(place), 7.0, 7.0)

    def _place(self, event: QMouseEvent) -> Pair:
        x, y = self.to_plane(event.position())
        return round(round(x / SNAP_M) * SNAP_M, 4), round(round(y / SNAP_M) * SNAP_M, 4)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if self.kind:
            if self._place(event) not in self.points:
                self.points.append(self._place(event))
            if self.kind != "polyline" and len(self.points) == POINTS[self.kind]:
                self._end()
            self.repaint_still()
            return
        near = [
            ((self.to_screen(point) - event.position()).manhattanLength(), place, at)
            for place, path in enumerate(self.paths)
            for at, point in enumerate(points_or_none(path))
        ]
        self._held = min(near)[1:] if near and min(near)[0] <= GRAB_PX else None

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._held is not None:
            place, at = self._held
            points = points_of(self.paths[place])
            points[at] = self._place(event)
            self.moved.emit(place, points)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        self._held = None

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        if self.kind == "polyline" and len(self.points) >= POINTS[self.kind]:
            self._end()

    def _end(self) -> None:
        kind, points = self.kind, self.points
        self.begin("")
        self.drawn.emit(kind, points)


class ProtocolEditor(QFrame):
    """A form on the left; workspace, summary and plan on the right."""

    saved = Signal(str)  # the file
    left = Signal()

    def __init__(self, background: Background) -> None:
        super().__init__(objectName="panel")
        self._background = background
        self.content: dict[str, Any] = {}  # of the file
        self._file: Path | None = None  # where it came from; None: it is a shipped one
        self.problem = ""  # the reader's sentence; "": it can be run
        self.card: Notice | None = None
        self.fields: dict[str, QWidget] = {}
        self.sentences = {
            key: line("", "bad")
            for key in (
                "",
                *{name.partition(".")[0] for name in FIELDS},
                "devices",
                "controller",
                "path",
                "form",
                "instruction",
            )
        }
        self.drawing, self.summary, self.plan = Drawing(), line("", bold=True), QPlainTextEdit(readOnly=True)
        self.plan.setFont(theme.mono())
        self.title = word("", size=theme.HEAD, bold=True)
        self.save, self.save_as = button("Save", self._save, "main"), button("Save as …", self._save_as)
        self._controllers, self._paths, self._devices = QVBoxLayout(), QVBoxLayout(), QHBoxLayout()
        self._timer = QTimer(self, singleShot=True, interval=WAIT_MS)
        self._timer.timeout.connect(self._read)
        self.drawing.drawn.connect(self._drawn)
        self.drawing.moved.connect(self._moved)
        self._lay_out()

    def _lay_out(self) -> None:
        grid = QGridLayout()
        grid.setContentsMargins(0, 0, 8, 0)
        grid.setColumnStretch(1, 1)

        def add(name: str, key: str, *what: QWidget | QLayout) -> None:
            """A line of the form, or several below their name; below them the sentence that is about them."""
            grid.addWidget(word(name, "quiet"), at := grid.rowCount(), 0)
            for one in what:
                column = 1 if isinstance(one, QWidget) else 0
                at += 1 - column
                (grid.addWidget if column else grid.addLayout)(one, at, column, 1, 2 - column)
            grid.addWidget(self.sentences[key.partition(".")[0]], at + 1, 0, 1, 2)

        for key, (name, choices) in FIELDS.items():
            self.fields[key] = field = Choice() if choices else QLineEdit(accessibleName=name)
            if isinstance(field, Choice):
                field.addItems(choices)
                field.textActivated.connect(lambda text, key=key: self._put(key, text))
            else:
                plain = str if key == "name" else value_of
                field.textEdited.connect(lambda text, key=key, plain=plain: self._put(key, plain(text)))
            add(name, key, field)
            if key == "name":
                draw = [button(f"Draw {kind}", lambda kind=kind: self.drawing.begin(kind), "small") for kind in POINTS]
                add("Devices", "devices", self._devices, row(button("Add a file …", self._add_device, "small"), 1))
                more = row(button("Add a controller", self._add_controller, "small"), 1)
                add("Controllers", "controller", self._controllers, more)
                add("Paths, in mm", "path", self._paths, row(*draw, 1))
        for key, name in FLAGS.items():
            self.fields[key] = flag = QCheckBox(name)
            flag.toggled.connect(lambda on, key=key: self._put(key, on))
            grid.addWidget(flag, grid.rowCount(), 0, 1, 2)
        self.form, self.instructions = QLineEdit(), QPlainTextEdit()
        self.form.setPlaceholderText("handedness: right, left; age: number")
        self.form.textEdited.connect(lambda text: self._put("form", form_of(text)))
        self.instructions.setPlaceholderText("What the participant reads first; a line of --- begins another page.")
        self.instructions.setFixedHeight(90)
        self.instructions.textChanged.connect(self._instructions_changed)
        add("Form", "form", self.form)
        add("Instructions", "instruction", self.instructions)
        inside = QWidget()
        inside.setLayout(grid)

        right = QVBoxLayout()
        right.addWidget(self.drawing, 3)
        right.addWidget(
            line("Drag a ring to move a point. Every device reaches the dotted area.", "quiet")
        )
        right.addWidget(self.summary)
        right.addWidget(self.plan, 2)
        both = QHBoxLayout()
        both.setSpacing(16)
        self._area = scrolled(inside)
        both.addWidget(self._area, 6)
        both.addLayout(right, 5)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(16, 12, 16, 14)
        layout.addWidget(self.title)
        layout.addWidget(self.sentences[""])
        layout.addLayout(both, 1)
        layout.addLayout(row(1, button("Back  Esc", self.left.emit), self.save_as, self.save))

    # ----------------------------------------------------------------------------------------- the content

    def open(self, name: str) -> None:
        """Edit a protocol: a shipped one by its name, of which a copy is saved, or a file."""
        shipped = name in shipped_protocols()
        path = SHIPPED_FOLDER / f"{name}.toml" if shipped else Path(name)
        self._file = None if shipped else path
        try:
            self.content = tomllib.loads(read_text(path))
        except (InputError, tomllib.TOMLDecodeError) as error:
            self.content, self.problem = {}, str(error)
        self.title.setText(f"{name.capitalize()} protocol, a copy" if shipped else path.name)
        self._show()

    def _show(self) -> None:
        """The content in the fields."""
        for key, field in self.fields.items():
            value = self._get(key)
            if isinstance(field, QCheckBox):
                field.setChecked(bool(value))
            elif isinstance(field, Choice):
                field.setCurrentText(str(value))
            elif isinstance(field, QLineEdit):
                field.setText("" if value is None else str(value))
        self.form.setText(form_text(self.content.get("form", {})))
        pages = [str(page.get("text", "")) for page in self.content.get("instruction", [])]
        self.instructions.setPlainText(PAGE_BREAK.join(pages))
        self._show_lists()
        self._changed()

    def _get(self, key: str) -> Any:
        table, _, inner = key.rpartition(".")
        return (self.content.get(table, {}) if table else self.content).get(inner, DEFAULTS.get(key))

    def _put(self, key: str, value: Any) -> None:
        table, _, inner = key.rpartition(".")
        of = self.content.setdefault(table, {}) if table else self.content
        if value is None:
            of.pop(inner, None)
        else:
            of[inner] = value
        if table and not of:
            del self.content[table]
        self._changed()

    def _instructions_changed(self) -> None:
        texts = [text.strip() for text in self.instructions.toPlainText().split(PAGE_BREAK)]
        before = self.content.get("instruction", [])
        pages = [{**(before[i] if i < len(before) else {}), "text": text} for i, text in enumerate(texts) if text]
        if pages != before:
            self._put("instruction", pages or None)

    def _show_lists(self) -> None:
        """Devices, controllers and paths, a row each."""
        for layout in (self._devices, self._controllers, self._paths):
            clear(layout)
        chosen = self.content.setdefault("devices", [])
        for name in dict.fromkeys([*shipped_devices(), *chosen]):
            box = QCheckBox(Path(name).name)
            box.setChecked(name in chosen)
            box.toggled.connect(lambda on, name=name: self._use_device(name, on))
            self._devices.addWidget(box)
        for place, controller in enumerate(self.content.setdefault("controller", [])):
            self._controllers.addLayout(self._controller_row(place, controller))
        for place, path in enumerate(self.content.setdefault("path", [])):
            points = QLineEdit(", ".join(f"{1e3 * x:g} {1e3 * y:g}" for x, y in points_or_none(path)))
            points.setAccessibleName(f"Path {place + 1}")
            points.textEdited.connect(lambda text, place=place: self._type_points(place, text))
            gone = button("×", lambda place=place: self._remove("path", place), "small", "Remove this path")
            self._paths.addLayout(row(word(f"{path.get('number', place + 1)}  {path.get('kind')}"), points, gone))
        self.drawing.show_paths(self.content["path"])
        self._area.widget().layout().activate()
        self._area.setMinimumWidth(self._area.widget().minimumSizeHint().width() + 12)

    def _controller_row(self, place: int, controller: dict[str, Any]) -> QHBoxLayout:
        name, kind = QLineEdit(str(controller.get("name", ""))), Choice()
        name.setAccessibleName(f"Controller {place + 1}")
        name.textEdited.connect(lambda text: self._change(controller, "name", text))
        name.setMinimumWidth(100)
        kind.addItems(list(ALGORITHMS))
        kind.setCurrentText(str(controller.get("kind")))
        kind.textActivated.connect(lambda text: self._use_kind(controller, text))
        parts: list[QWidget] = [name, kind]
        for one in ALGORITHMS[kind.currentText()].parameters:
            value = controller.get(one.name, one.default)
            field = QLineEdit("" if value is None else f"{one.scale * value:g}" if is_number(value) else str(value))
            field.setAccessibleName(f"{one.word} of controller {place + 1}")
            field.setFixedWidth(64)
            field.textEdited.connect(
                lambda text, one=one: self._change(controller, one.name, scaled(value_of(text), 1.0 / one.scale))
            )
            parts += [word(f"{one.word}, {one.unit}" if one.unit else one.word, "quiet"), field]
        return row(*parts, button("×", lambda: self._remove("controller", place), "small", "Remove this controller"))

    def _change(self, of: dict[str, Any], key: str, value: Any) -> None:
        of[key] = value
        self._changed()

    def _use_kind(self, controller: dict[str, Any], kind: str) -> None:
        """Another algorithm: the parameters of the one before are gone."""
        kept = {key: controller[key] for key in ("name", "number") if key in controller}
        controller.clear()
        controller |= {**kept, "kind": kind}
        self._show_lists()
        self._changed()

    def _use_device(self, name: str, on: bool) -> None:
        others = [other for other in self.content["devices"] if other != name]
        self._put("devices", [*others, name] if on else others)

    def _add_device(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self, "Device", "", TOML)
        if path:
            self._use_device(path, True)
            self._show_lists()

    def _add_controller(self) -> None:
        controllers = self.content["controller"]
        controllers.append({"name": f"Controller {len(controllers) + 1}", "kind": next(iter(ALGORITHMS))})
        self._renumber("controller")

    def _remove(self, key: str, place: int) -> None:
        del self.content[key][place]
        self._renumber(key)

    def _renumber(self, key: str) -> None:
        """Entries are numbered by their place: a number that was given might now stand there twice."""
        for number, entry in enumerate(self.content[key], start=1):
            entry["number"] = number
        self._show_lists()
        self._changed()

    def _drawn(self, kind: str, points: list[Pair]) -> None:
        try:
            self.content["path"].append(path_through(kind, points))
        except InputError as error:
            self._show_problem(str(error))
            return
        self._renumber("path")

    def _moved(self, place: int, points: list[Pair]) -> None:
        path = self.content["path"][place]
        try:
            path |= path_through(path["kind"], points)
        except InputError:
            return  # an arc through three points on a line: it stays as it was until the pointer is elsewhere
        self._show_lists()
        self._changed()

    def _type_points(self, place: int, text: str) -> None:
        path = self.content["path"][place]
        try:
            path |= path_through(path["kind"], typed_points(text))
        except InputError as error:
            self._timer.stop()
            self._background.forget("edited")
            self._show_problem(str(error))
            return
        self.drawing.show_paths(self.content["path"])
        self._changed()

    # ----------------------------------------------------------------------------------------- reading, saving

    def _changed(self) -> None:
        self._timer.start()

    def _read(self) -> None:
        """Let the reader see the content."""
        text, folder = protocol_text(self.content), self._file.parent if self._file else SHIPPED_FOLDER
        self._background.ask("edited", lambda: look(text, folder), self._show_read)

    def _show_read(self, found: tuple[str, str, np.ndarray] | InputError) -> None:
        if isinstance(found, InputError):
            self._show_problem(str(found).removeprefix(f"{WHERE}: "))
            return
        self._show_problem("")
        summary, plan, free = found
        self.summary.setText(summary)
        self.plan.setPlainText(plan)
        self.drawing.show_free(free)

    def _show_problem(self, problem: str) -> None:
        """The reader's sentence, at the field that it is about."""
        self.problem = problem
        key = "path" if "cannot follow path" in problem else re.match(r"\w*", problem)[0]  # type: ignore[index]
        place = key if key in self.sentences else ""
        for name, label in self.sentences.items():
            label.setText(breakable(problem) if name == place else "")
            label.setVisible(bool(problem) and name == place)
        if problem:
            self.summary.setText("")
        self.save.setEnabled(not problem)
        self.save_as.setEnabled(not problem)

    def _save(self) -> None:
        self._save_to(self._file) if self._file is not None else self._save_as()

    def _save_as(self) -> None:
        options = QFileDialog.Option.DontConfirmOverwrite  # asked for below
        at = str(self._file or Path.home() / "protocol.toml")
        path, _ = QFileDialog.getSaveFileName(self, "Save the protocol", at, TOML, options=options)
        if path:
            self._save_to(Path(path).with_suffix(".toml"))

    def _save_to(self, path: Path, replacing: bool = False) -> None:
        if path.exists() and not replacing:
            self._ask_to_replace(path)
            return
        try:
            save_protocol(path, self.content, replacing)
        except InputError as error:
            self._show_problem(str(error).removeprefix(f"{path}: "))
            return
        self._file = path
        self.saved.emit(str(path))

    def _ask_to_replace(self, path: Path) -> None:
        def replace() -> None:
            self.leave()
            self._save_to(path, replacing=True)

        text = f"{path} exists. Comments in it are lost; sessions that were run by it keep their own copy."
        self.card = Notice("Replace the file?", text, [("Replace it", replace), ("Keep it", self.leave)], self)
        self.card.appear()

    def leave(self) -> bool:
        """Take the question away; whether there was one."""
        card, self.card = self.card, None
        if card is not None:
            card.hide()
            card.deleteLater()
        return card is not None


def look(text: str, folder: Path) -> tuple[str, str, np.ndarray]:
    """Summary, plan, and places (m) that every device reaches, of a protocol's text. InputError if it cannot be run."""
    protocol = read_protocol(text, folder, WHERE)
    return plan_summary(protocol), print_plan(protocol, "01"), free_places(protocol)


def free_places(protocol: Protocol) -> np.ndarray:
    """Places of a grid of 1 cm that every device reaches, (n, 2) m."""
    x, y = np.meshgrid(np.arange(-0.6, 0.61, 0.01), np.arange(-0.2, 0.81, 0.01))
    free = np.logical_and.reduce([tip_is_free(device.mechanism, x, y) for device in protocol.devices])
    return np.column_stack((x[free], y[free]))


def points_or_none(path: dict[str, Any]) -> list[Pair]:
    """As `points_of`; none where it is not a path."""
    try:
        return points_of(path)
    except (KeyError, TypeError, ValueError):
        return []


def typed_points(text: str) -> list[Pair]:
    """Points (m) from "-100 400, 100 400", in mm. InputError where they are not pairs of numbers."""
    try:
        pairs = [[float(number) / 1e3 for number in pair.split()] for pair in text.split(",")]
        return [(x, y) for x, y in pairs]
    except ValueError:
        raise InputError("path: each point is two numbers, in mm: -100 400, 100 400") from None


def value_of(text: str) -> Any:
    """A number as it is typed; None: nothing; any other text as it is, for the reader to refuse."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text or None


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def scaled(value: Any, scale: float) -> Any:
    return float(f"{scale * value:.12g}") if is_number(value) else value


def form_of(text: str) -> Any:
    """The table of a form from "handedness: right, left; age: number"; None: there is none."""
    form: dict[str, Any] = {}
    for part in filter(None, (part.strip() for part in text.split(";"))):
        name, _, kind = part.partition(":")
        kinds = [one.strip() for one in kind.split(",")]
        form[name.strip()] = kinds if len(kinds) > 1 else kinds[0]
    return form or None


def form_text(form: dict[str, Any]) -> str:
    """The same as text."""
    return "; ".join(f"{name}: {kind if isinstance(kind, str) else ', '.join(kind)}" for name, kind in form.items())
