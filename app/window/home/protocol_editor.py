"""The protocol editor: an experiment as a form, its paths drawn on the workspace, its plan beside it.

What is edited is the content of the protocol's file. The reader of protocols checks it while it is typed, and its
sentence stands where the mistake is.
"""

import contextlib
import itertools
import re
import tomllib
from copy import deepcopy
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import (
    QFileDialog,
    QGridLayout,
    QHBoxLayout,
    QLayout,
    QLineEdit,
    QWidget,
)

from app.window.canvas.path_drawing import PathDrawing
from app.window.widgets import theme
from app.window.widgets.fields import Field, LongText, NumberField, TextField, Tick, is_number, make_field
from app.window.widgets.parts import (
    PANEL_MARGINS,
    Choice,
    Flow,
    Panel,
    breakable,
    button,
    clear,
    column,
    holder,
    printed,
    row,
    scrolled,
    text_label,
    wrapped_label,
)
from app.window.widgets.work import BackgroundTask
from core.control.controllers import ALGORITHMS
from core.control.rule_sets import RULE_SETS
from core.device import shipped_devices
from core.drawn_path import DRAWING
from core.files import InputError, Pair, read_text
from core.workspace import tip_is_free
from experiments.language import shipped_languages
from experiments.plan import plan_summary, print_plan
from experiments.protocol import SHIPPED_FOLDER, read_protocol, shipped_protocols
from experiments.protocol_file import FEEDBACK, Settings
from experiments.protocol_writer import POINTS, path_through, points_of, protocol_text, save_protocol

WAIT_MS = 200  # after the last change, before the content is read
TOML = "TOML files (*.toml)"
WHERE = "protocol"  # begins the reader's sentences
PAGE_BREAK = "\n---\n"  # between the pages of instructions
LONGEST = 10_000  # letters of a field: a form, or the labels of many participants
LIST_HEAD_PX = 36  # high, the name over devices, controllers and paths
NUMBER_PX = 180  # wide at most, a field for a number
POINT_PX = 78  # wide, a coordinate, at a text size of 1: -93.969 has room

#: key of the file -> what stands at its field
LABELS = {
    "name": "Name",
    "blocks": "Blocks",
    "repetitions": "Repetitions",
    "practice_trials": "Practice trials",
    "seed": "Seed",
    "participants": "Participants",
    "breaks.after_trials": "Break after trials",
    "breaks.least_s": "Shortest break (s)",
    "trial.time_out_s": "Longest move (s)",
    "trial.approach_time_out_s": "Longest approach (s)",
    "rules": "Rules",
    "feedback": "Feedback",
    "language": "Language",
    "blind": "Blind: codes in place of controller names",
    "show_linkage": "The participant sees the linkage",
    "questionnaire.on": "A questionnaire after each block",
    "tones": "Tones at “go” and at the end of a trial",
    "consent.text": "Consent",
    "form": "Form",
    "instruction": "Instructions",
}
CHOICES: dict[str, tuple[str, ...]] = {
    "rules": tuple(RULE_SETS), "feedback": FEEDBACK, "language": tuple(shipped_languages())
}  # fmt: skip
DEFAULTS = Settings(name="")
HINTS = {
    "participants": "01, 02, 03; none named: anybody",
    "trial.approach_time_out_s": "of a simulated operator; a person has 10 minutes",
    "consent.text": "What the participant agrees to before the form; empty: consent is not asked.",
    "form": "handedness: right, left; age: number",
    "instruction": "What the participant reads first; a line of --- begins another page.",
}
TEXTS, LONG_TEXTS = ("name", "participants", "form"), ("consent.text", "instruction")  # keys that are typed as text


class ProtocolEditor(Panel):
    """A form on the left; workspace, summary and plan on the right."""

    saved = Signal(str)  # the file
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._reader = BackgroundTask(self._show_read)
        self.content: dict[str, Any] = {}  # of the file
        self.name, self._as_read = "", dict[str, Any]()  # what was opened, and its content then
        self._file: Path | None = None  # which saving proposes; None: one named as the protocol
        self._folder = SHIPPED_FOLDER  # from which paths of devices and pictures are
        self.problem = ""  # the reader's sentence; "": the content can be run
        sections = ("", "devices", "controller", "path", *LABELS)
        self.sentences = {section_of(name): wrapped_label("", "bad") for name in sections}
        self.fields = {key: self._field(key) for key in LABELS}
        self.drawing, self.summary = PathDrawing(), wrapped_label("", bold=True)
        self.plan = printed("No plan yet")
        self.title, self.save = text_label("", size=theme.HEAD, bold=True), button("Save …", self._save, "main")
        self._points: list[list[NumberField]] = []  # of each path: x and y of its points, mm
        self._devices, self._controllers, self._paths = row(spacing=6), column(), column()
        self._timer = QTimer(self, singleShot=True, interval=WAIT_MS)
        self._timer.timeout.connect(self._read)
        self.drawing.drawn.connect(self._drawn)
        self.drawing.moved.connect(self._moved)
        self._lay_out()

    def _field(self, key: str) -> Field:
        choices = {choice: choice for choice in CHOICES.get(key, ())}
        field: Field
        if key in LONG_TEXTS:
            field = LongText(LABELS[key])
            field.setFixedHeight(90)
        else:
            field = make_field(LABELS[key], str if key in TEXTS else type(default_of(key)), choices)
        if isinstance(field, TextField):
            field.setMaxLength(LONGEST)
        if isinstance(field, NumberField):
            field.setMaximumWidth(NUMBER_PX)
        if isinstance(field, TextField | LongText):
            field.setPlaceholderText(HINTS.get(key, ""))
        field.changed.connect(lambda value: self._put(key, from_text(key, value, self._get(key))))
        return field

    def _lay_out(self) -> None:
        inside = QWidget()
        self._grid = grid = QGridLayout(inside)
        grid.setContentsMargins(0, 0, 8, 0)
        grid.setColumnStretch(1, 1)

        def add(name: str, key: str, *parts: QWidget | QLayout) -> None:
            """A line of the form, or several below their name; below them the sentence that is about them."""
            place = grid.rowCount()
            if name:
                grid.addWidget(text_label(name, "quiet"), place, 0)
            if isinstance(parts[0], QLayout):  # a list under its name
                grid.setRowMinimumHeight(place, LIST_HEAD_PX)
            for part in parts:
                if isinstance(part, QLayout):
                    place += 1
                    grid.addLayout(part, place, 0, 1, 2)
                else:
                    grid.addWidget(part, place, int(bool(name)), 1, 1 if name else 2)
            grid.addWidget(self.sentences[section_of(key)], place + 1, 0, 1, 2)

        small = "small"
        draw = [button(f"Draw {kind}", partial(self.drawing.begin, kind), small) for kind in POINTS]
        add("Name", "name", self.fields["name"])
        add("Devices", "devices", self._devices, row(button("Add a file …", self._add_device, small), 1))
        add("Controllers", "controller", self._controllers, row(button("Add one", self.add_controller, small), 1))
        add("Paths, in mm", "path", self._paths, row(*draw, button("Add a file …", self._add_drawing, small), 1))
        for key, field in list(self.fields.items())[1:]:
            add("" if isinstance(field, Tick) else LABELS[key], key, field)
        self.form_area = scrolled(inside)
        self.save.setToolTip("Ctrl+S. Comments of a file are not kept.")
        how = wrapped_label("Drag a ring to move a point. Every device reaches the dotted area.", "quiet")
        right = column((self.drawing, 3), how, self.summary, (self.plan, 1), spacing=16)
        both = row((self.form_area, 6), (right, 5), spacing=16)
        head = row(self.title, (self.sentences[""], 1), spacing=16)  # beside it: nothing below moves
        foot = row(1, button("Undo all changes", self.undo), button("Back  Esc", self.closed.emit), self.save)
        self.setLayout(column(head, (both, 1), foot, margins=PANEL_MARGINS))

    # ----------------------------------------------------------------------------------------- the content

    def open(self, name: str) -> None:
        """Edit a protocol: a shipped one by its name, of which a copy is saved, or a file."""
        if name == self.name and self.changed:
            return  # what was changed is still there
        shipped = name in shipped_protocols()
        path = SHIPPED_FOLDER / f"{name}.toml" if shipped else Path(name)
        self._file, self._folder = None if shipped else path, path.parent
        self.title.setText(f"{name.capitalize()} protocol, a copy" if shipped else path.name)
        try:
            self.content = tomllib.loads(read_text(path))
        except (InputError, ValueError):
            self.content = {}  # the reader names each key that is missing
        for key, field in self.fields.items():
            field.show_value(to_text(key, self._get(key)))
        self._show_lists()
        self.name, self._as_read = name, deepcopy(self.content)

    @property
    def changed(self) -> bool:
        """Whether something was changed and not saved."""
        return self.content != self._as_read

    def undo(self) -> None:
        self._as_read = self.content
        self.open(self.name)

    def _get(self, key: str) -> Any:
        table, _, inner = key.rpartition(".")
        return (self.content.get(table, {}) if table else self.content).get(inner, default_of(key))

    def _put(self, key: str, value: Any) -> None:
        """Another value for a key; None: the file does not have it any more."""
        if key == "consent.text" and value is None:
            key = "consent"  # nor the words of its answers
        table, _, inner = key.rpartition(".")
        keys = self.content.setdefault(table, {}) if table else self.content
        keys[inner] = value
        if value is None:
            del keys[inner]
        if table and not keys:
            del self.content[table]
        self._timer.start()

    def _show_lists(self) -> None:
        """Devices, controllers and paths, a row each."""
        for layout in (self._devices, self._controllers, self._paths):
            clear(layout)
        devices, controllers, paths = (self.content.setdefault(key, []) for key in ("devices", "controller", "path"))
        for name in dict.fromkeys([*shipped_devices(), *devices]):
            box = Tick(Path(name).name, name in devices)
            box.changed.connect(lambda on, name=name: self._use_device(name, on))
            self._devices.addWidget(box)
        for place, controller in enumerate(controllers):
            self._controllers.addLayout(self._controller_row(place, controller))
        self._points = []
        for place, path in enumerate(paths):
            self._paths.addLayout(self._path_row(place, path))
        self.drawing.show_paths(paths, self._folder)
        self._grid.activate()
        self.form_area.setMinimumWidth(self.form_area.widget().minimumSizeHint().width() + 12)
        self._timer.start()

    def _path_row(self, place: int, path: dict[str, Any]) -> QHBoxLayout:
        """Number and kind of a path, two fields for each of its points, and what makes it longer or takes it out."""
        fields: list[NumberField] = []
        self._points.append(fields)
        parts: list[QWidget] = []
        for number, point in enumerate(points_of(path), start=1):
            for axis, value in zip("xy", point, strict=True):
                field = NumberField(f"{axis} of point {number} of path {place + 1}")
                field.show_value(in_mm(value))
                field.setFixedWidth(theme.text_px(POINT_PX))
                field.setToolTip(f"Point {number}: {axis}, mm")
                field.changed.connect(lambda _, place=place: self._points_typed(place))
                fields.append(field)
            parts.append(holder(row(*fields[-2:], spacing=2)))
        small = "small"
        if path.get("kind") == "polyline":
            parts.append(button("+", partial(self._lengthen, place), hint="Another point at the end"))
            parts.append(button("−", partial(self._shorten, place), hint="Remove the last point"))
        if path.get("kind") == DRAWING:
            parts.append(text_label(str(path.get("file", ""))))
        name = text_label(f"{path.get('number', place + 1)}  {path.get('kind')}")
        remove_button = button("×", partial(self.remove, "path", place), small, "Remove this path")
        return row(name, (Flow(*parts, gap=10), 1), remove_button)

    def _controller_row(self, place: int, controller: dict[str, Any]) -> QHBoxLayout:
        name, kind = QLineEdit(str(controller.get("name")), accessibleName=f"Controller {place + 1}"), Choice()
        name.setMinimumWidth(100)
        name.setCursorPosition(0)
        name.textEdited.connect(lambda text: self._change(controller, "name", text))
        remove_button = button("×", partial(self.remove, "controller", place), "small", "Remove this controller")
        if "algorithm" in controller:  # a file of its own: its parameters are changed there and in the protocol's text
            return row(name, (text_label(str(controller["algorithm"])), 1), remove_button)
        kind.addItems(list(ALGORITHMS))
        kind.setCurrentText(str(controller.get("kind")))
        kind.textActivated.connect(lambda text: self.use_kind(controller, text))
        parts: list[QWidget] = [name, kind]
        for parameter in ALGORITHMS[kind.currentText()].parameters:
            value = scaled(controller.get(parameter.name, parameter.default), parameter.scale)
            field = NumberField(f"{parameter.word} of controller {place + 1}")
            field.show_value(f"{value:.10g}" if is_number(value) else value)
            field.setFixedWidth(theme.text_px(64))
            field.changed.connect(
                lambda value, parameter=parameter: self._change(
                    controller, parameter.name, scaled(value, 1.0 / parameter.scale)
                )
            )
            parts += [
                text_label(f"{parameter.word}, {parameter.unit}" if parameter.unit else parameter.word, "quiet"),
                field,
            ]
        return row(*parts, remove_button, spacing=4)

    def _change(self, entry: dict[str, Any], key: str, value: Any) -> None:
        entry[key] = value
        self._timer.start()

    def use_kind(self, controller: dict[str, Any], kind: str) -> None:
        """Another algorithm: the parameters of the one before are gone."""
        for key in controller.keys() - {"name", "number"}:
            del controller[key]
        controller["kind"] = kind
        self._show_lists()

    def _use_device(self, name: str, on: bool) -> None:
        others = [other for other in self.content["devices"] if other != name]
        self._put("devices", [*others, name] if on else others)

    def _add_device(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self, "Device", "", TOML)
        if path:
            self._use_device(path, True)
            self._show_lists()

    def _add_drawing(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self, "Drawing of a path", "", "Drawings (*.csv *.svg)")
        if path:
            self.add_drawing(Path(path))

    def add_drawing(self, path: Path) -> None:
        """A path drawn in a file; a picture, which has no metres, 10 cm wide in the middle of the workspace."""
        placed = {"width_m": 0.1, "centre_m": [0.0, 0.36]} if path.suffix.lower() == ".svg" else {}
        self.content["path"].append({"kind": DRAWING, "file": str(path)} | placed)
        self._renumber("path")

    def add_controller(self) -> None:
        controllers = self.content["controller"]
        controllers.append({"name": f"Controller {len(controllers) + 1}", "kind": next(iter(ALGORITHMS))})
        self._renumber("controller")

    def remove(self, key: str, place: int) -> None:
        del self.content[key][place]
        self._renumber(key)

    def _renumber(self, key: str) -> None:
        """Entries are numbered by their place: a number that was given might now stand there twice."""
        for number, entry in enumerate(self.content[key], start=1):
            entry["number"] = number
        self._show_lists()

    def _drawn(self, kind: str, points: list[Pair]) -> None:
        try:
            self.content["path"].append(path_through(kind, points))
        except InputError as error:
            self._show_problem(str(error))
        else:
            self._renumber("path")

    def _reshape(self, place: int, points: list[Pair]) -> None:
        """A path goes through other points (m). InputError: there is no such path."""
        path = self.content["path"][place]
        path |= path_through(path["kind"], points)
        self.drawing.show_paths(self.content["path"], self._folder)
        self._timer.start()

    def _moved(self, place: int, points: list[Pair]) -> None:
        """A point of a path was dragged; where that makes no path, it stays as it was."""
        with contextlib.suppress(InputError):
            self._reshape(place, points)
            for field, value in zip(self._points[place], itertools.chain(*points), strict=True):
                field.show_value(in_mm(value))

    def _points_typed(self, place: int) -> None:
        values = [field.value() for field in self._points[place]]
        try:
            if not all(map(is_number, values)):
                raise InputError("path: each point is two numbers, in mm")
            self._reshape(place, [(x / 1e3, y / 1e3) for x, y in zip(values[::2], values[1::2], strict=True)])
        except InputError as error:
            self._timer.stop()
            self._reader.forget()
            self._show_problem(str(error))

    def _lengthen(self, place: int) -> None:
        """Another point of a polyline, as far from the last as that is from the one before."""
        *_, (x0, y0), (x1, y1) = points = points_of(self.content["path"][place])
        self._reshape(place, [*points, (2.0 * x1 - x0, 2.0 * y1 - y0)])
        self._show_lists()

    def _shorten(self, place: int) -> None:
        if len(points := points_of(self.content["path"][place])) > POINTS["polyline"]:
            self._reshape(place, points[:-1])
            self._show_lists()

    # ----------------------------------------------------------------------------------------- reading, saving

    @property
    def waiting(self) -> bool:
        """Whether a change is still to be read."""
        return self._timer.isActive()

    def _read(self) -> None:
        """Let the reader see the content."""
        self._reader.ask(preview, protocol_text(self.content), self._folder)

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
        about = re.sub(r"\W.*", "", problem.removeprefix("the required key "), flags=re.DOTALL)
        key = "path" if "cannot follow path" in problem else about
        for name, label in self.sentences.items():
            here = bool(problem) and name == (key if key in self.sentences else "")
            label.setText(breakable(problem) if here else "")
            label.setVisible(here)
        self.problem = problem
        if problem:
            self.summary.setText("")
            self.plan.setPlainText("")
        self.save.setEnabled(not problem)

    def save_now(self) -> None:
        """Ctrl+S: into the file that was opened; a dialog asks where a copy of a shipped protocol goes."""
        if self._file is None:
            self._save()
        elif self.save.isEnabled():
            self._save_as(self._file, replacing=True)

    def _save(self) -> None:
        """The dialog asks before a file is replaced; one that it did not ask about is never replaced."""
        name = str(self.content.get("name", "protocol")).replace("/", "-")
        proposed = self._file or Path.home() / f"{name}.toml"
        if not self.save.isEnabled():
            return
        chosen, _ = QFileDialog.getSaveFileName(self, "Save the protocol", str(proposed), TOML)
        path = Path(chosen or proposed).with_suffix(".toml")
        if chosen and self._save_as(path, replacing=str(path) == chosen):
            self.closed.emit()

    def _save_as(self, path: Path, replacing: bool) -> bool:
        """Whether it was saved; what is changed next is then saved there, too."""
        try:
            save_protocol(path, self.content, replacing)
        except InputError as error:
            self._show_problem(str(error))
            self.save.setEnabled(True)  # elsewhere, or once the reason is gone
            return False
        self.name, self._file, self._folder, self._as_read = str(path), path, path.parent, deepcopy(self.content)
        self.title.setText(f"{path.name}, saved {datetime.now():%H:%M}")
        self.saved.emit(str(path))
        return True


def default_of(key: str) -> Any:
    """What holds where a file lacks the key; None: nothing does."""
    value: Any = DEFAULTS
    for part in key.split("."):
        value = getattr(value, part, None)
    return value


def section_of(key: str) -> str:
    """The first part of a key, with which the reader's sentences begin."""
    return key.partition(".")[0]


def preview(text: str, folder: Path) -> tuple[str, str, np.ndarray]:
    """Of a protocol's text: summary, plan, and places of a grid of 1 cm that every device reaches (n, 2), m.

    InputError if it cannot be run.
    """
    protocol = read_protocol(text, folder, WHERE)
    x, y = np.meshgrid(np.arange(-0.6, 0.61, 0.01), np.arange(-0.2, 0.81, 0.01))
    free = np.logical_and.reduce([tip_is_free(device.mechanism, x, y) for device in protocol.devices])
    return plan_summary(protocol), print_plan(protocol, "01"), np.column_stack((x[free], y[free]))


def to_text(key: str, value: Any) -> Any:
    """What the field of a key shows for its value."""
    if key == "form":
        return form_text(value)
    if key == "instruction":
        return PAGE_BREAK.join(str(page.get("text", "")) for page in value)
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else value


def from_text(key: str, value: Any, before: Any) -> Any:
    """The value of a key from that of its field; before: its value so far."""
    if key == "participants":
        return [label.strip() for label in str(value).split(",") if label.strip()] if value else None
    if key == "form":
        return form_of(value or "")
    if key == "instruction":  # a page keeps its picture
        texts = filter(None, map(str.strip, (value or "").split(PAGE_BREAK)))
        pages = itertools.zip_longest(before, texts)
        return [{**(page or {}), "text": text} for page, text in pages if text] or None
    return "" if value is None and key == "name" else value


def scaled(value: Any, scale: float) -> Any:
    """A number in another unit, without the last digits that this makes up; anything else as it is."""
    return float(f"{scale * value:.12g}") if is_number(value) else value


def form_of(text: str) -> dict[str, Any] | None:
    """The table of a form from "handedness: right, left; age: number"; None: there is none."""
    form: dict[str, Any] = {}
    for part in filter(None, (part.strip() for part in text.split(";"))):
        name, _, kind = part.partition(":")
        kinds = [choice.strip() for choice in kind.split(",")]
        form[name.strip()] = kinds if len(kinds) > 1 else kinds[0]
    return form or None


def form_text(form: dict[str, Any]) -> str:
    """The same as text."""
    return "; ".join(f"{name}: {kind if isinstance(kind, str) else ', '.join(kind)}" for name, kind in form.items())


def in_mm(length_m: float) -> str:
    """A coordinate as it is shown. Our choice: to a micrometre."""
    return f"{round(1e3 * length_m, 3):.10g}"
