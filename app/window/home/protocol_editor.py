"""The protocol editor: an experiment as a form, its paths drawn on the workspace, its plan beside it.

What is edited is the content of the protocol's file. The reader of protocols checks it while it is typed, and its
sentence stands where the mistake is.
"""

import re
import tomllib
from collections.abc import Callable
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QFileDialog,
    QGridLayout,
    QHBoxLayout,
    QLayout,
    QLineEdit,
    QPlainTextEdit,
    QWidget,
)  # fmt: skip

from app.window.canvas.path_drawing import PathDrawing
from app.window.widgets import theme
from app.window.widgets.fields import Field, NumberField, Tick, is_number, make_field
from app.window.widgets.parts import (
    PANEL_MARGINS,
    Choice,
    Panel,
    breakable,
    button,
    clear,
    column,
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

#: key of the file -> what stands at its field
LABELS = {
    "name": "Name",
    "blocks": "Blocks",
    "repetitions": "Repetitions",
    "practice_trials": "Practice trials",
    "breaks.after_trials": "Break after trials",
    "breaks.least_s": "Shortest break (s)",
    "rules": "Rules",
    "feedback": "Feedback",
    "language": "Language",
    "blind": "Blind: codes in place of controller names",
    "show_linkage": "The participant sees the linkage",
    "questionnaire.on": "A questionnaire after each block",
    "tones": "Tones at “go” and at the end of a trial",
}
CHOICES: dict[str, tuple[str, ...]] = {
    "rules": tuple(RULE_SETS), "feedback": FEEDBACK, "language": tuple(shipped_languages())
}  # fmt: skip
DEFAULTS = Settings(name="")


class ProtocolEditor(Panel):
    """A form on the left; workspace, summary and plan on the right."""

    saved = Signal(str)  # the file
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._reader = BackgroundTask(self._show_read)
        self.content: dict[str, Any] = {}  # of the file
        self._name, self._as_read = "", dict[str, Any]()  # what was opened, and its content then
        self._file: Path | None = None  # which saving proposes; None: one named as the protocol
        self._folder = SHIPPED_FOLDER  # from which paths of devices and pictures are
        self.problem = ""  # the reader's sentence; "": the content can be run
        sections = ("", "devices", "controller", "path", "form", "instruction", *LABELS)
        self.sentences = {section_of(name): wrapped_label("", "bad") for name in sections}
        self.fields = {key: self._field(key) for key in LABELS}
        self.drawing, self.summary = PathDrawing(), wrapped_label("", bold=True)
        self.plan = printed("No plan: the sentence in red says why.")
        self.title, self.save = text_label("", size=theme.HEAD, bold=True), button("Save …", self._save, "main")
        self.form, self.instructions = QLineEdit(), QPlainTextEdit()
        self._devices, self._controllers, self._paths = row(spacing=6), column(), column()
        self._timer = QTimer(self, singleShot=True, interval=WAIT_MS)
        self._timer.timeout.connect(self._read)
        self.drawing.drawn.connect(self._drawn)
        self.drawing.moved.connect(lambda place, points: self._reshape(place, lambda: points))
        self.form.textEdited.connect(lambda text: self._put("form", form_of(text)))
        self.instructions.textChanged.connect(self._instructions_changed)
        self._lay_out()

    def _field(self, key: str) -> Field:
        choices = {choice: choice for choice in CHOICES.get(key, ())}
        field = make_field(LABELS[key], str if key == "name" else type(default_of(key)), choices)
        field.changed.connect(lambda value: self._put(key, "" if value is None and key == "name" else value))
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
        self.form.setPlaceholderText("handedness: right, left; age: number")
        self.instructions.setPlaceholderText("What the participant reads first; a line of --- begins another page.")
        self.instructions.setFixedHeight(90)
        add("Form", "form", self.form)
        add("Instructions", "instruction", self.instructions)
        self.form_area = scrolled(inside)
        self.save.setToolTip("Comments of a file are not kept")
        how = wrapped_label("Drag a ring to move a point. Every device reaches the dotted area.", "quiet")
        right = column((self.drawing, 3), how, self.summary, (self.plan, 2), spacing=16)
        both = row((self.form_area, 6), (right, 5), spacing=16)
        head = row(self.title, (self.sentences[""], 1), spacing=16)  # beside it: nothing below moves
        foot = row(1, button("Undo all changes", self.undo), button("Back  Esc", self.closed.emit), self.save)
        self.setLayout(column(head, (both, 1), foot, margins=PANEL_MARGINS))

    # ----------------------------------------------------------------------------------------- the content

    def open(self, name: str) -> None:
        """Edit a protocol: a shipped one by its name, of which a copy is saved, or a file."""
        if name == self._name and self.content != self._as_read:
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
            field.show_value(self._get(key))
        self.form.setText(form_text(self.content.get("form", {})))
        pages = [str(page.get("text", "")) for page in self.content.get("instruction", [])]
        self.instructions.setPlainText(PAGE_BREAK.join(pages))
        self._show_lists()
        self._name, self._as_read = name, deepcopy(self.content)

    def undo(self) -> None:
        self._as_read = self.content
        self.open(self._name)

    def _get(self, key: str) -> Any:
        table, _, inner = key.rpartition(".")
        return (self.content.get(table, {}) if table else self.content).get(inner, default_of(key))

    def _put(self, key: str, value: Any) -> None:
        """Another value for a key; None: the file does not have it any more."""
        table, _, inner = key.rpartition(".")
        of = self.content.setdefault(table, {}) if table else self.content
        of[inner] = value
        if value is None:
            del of[inner]
        if table and not of:
            del self.content[table]
        self._timer.start()

    def _instructions_changed(self) -> None:
        texts = filter(None, (text.strip() for text in self.instructions.toPlainText().split(PAGE_BREAK)))
        before = self.content.get("instruction", [])
        pages = [{**(before[i] if i < len(before) else {}), "text": text} for i, text in enumerate(texts)]
        if pages != before:
            self._put("instruction", pages or None)

    def _show_lists(self) -> None:
        """Devices, controllers and paths, a row each."""
        for layout in (self._devices, self._controllers, self._paths):
            clear(layout)
        devices, controllers, paths = (self.content.setdefault(key, []) for key in ("devices", "controller", "path"))
        for name in dict.fromkeys([*shipped_devices(), *devices]):
            box = QCheckBox(Path(name).name)
            box.setChecked(name in devices)
            box.toggled.connect(lambda on, name=name: self._use_device(name, on))
            self._devices.addWidget(box)
        for place, controller in enumerate(controllers):
            self._controllers.addLayout(self._controller_row(place, controller))
        for place, path in enumerate(paths):
            text = ", ".join(f"{1e3 * x:g} {1e3 * y:g}" for x, y in points_of(path)) or str(path.get("file", ""))
            points = QLineEdit(text, accessibleName=f"Path {place + 1}", readOnly=path.get("kind") == DRAWING)
            points.textEdited.connect(lambda text, place=place: self._reshape(place, lambda: typed_points(text), True))
            remove_button = button("×", partial(self.remove, "path", place), "small", "Remove this path")
            self._paths.addLayout(
                row(text_label(f"{path.get('number', place + 1)}  {path.get('kind')}"), points, remove_button)
            )
        self.drawing.show_paths(paths, self._folder)
        self._grid.activate()
        self.form_area.setMinimumWidth(self.form_area.widget().minimumSizeHint().width() + 12)
        self._timer.start()

    def _controller_row(self, place: int, controller: dict[str, Any]) -> QHBoxLayout:
        name, kind = QLineEdit(str(controller.get("name")), accessibleName=f"Controller {place + 1}"), Choice()
        name.setMinimumWidth(100)
        name.setCursorPosition(0)
        name.textEdited.connect(lambda text: self._change(controller, "name", text))
        kind.addItems(list(ALGORITHMS))
        kind.setCurrentText(str(controller.get("kind")))
        kind.textActivated.connect(lambda text: self.use_kind(controller, text))
        parts: list[QWidget] = [name, kind]
        for parameter in ALGORITHMS[kind.currentText()].parameters:
            value = scaled(controller.get(parameter.name, parameter.default), parameter.scale)
            field = NumberField(f"{parameter.word} of controller {place + 1}")
            field.show_value(f"{value:.10g}" if is_number(value) else value)
            field.setFixedWidth(64)
            field.changed.connect(
                lambda value, parameter=parameter: self._change(
                    controller, parameter.name, scaled(value, 1.0 / parameter.scale)
                )
            )
            parts += [
                text_label(f"{parameter.word}, {parameter.unit}" if parameter.unit else parameter.word, "quiet"),
                field,
            ]
        return row(*parts, button("×", lambda: self.remove("controller", place), "small", "Remove this controller"))

    def _change(self, of: dict[str, Any], key: str, value: Any) -> None:
        of[key] = value
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

    def _reshape(self, place: int, points: Callable[[], list[Pair]], typed: bool = False) -> None:
        """A path was moved, or typed, then its field keeps the cursor; points: gives them, or an InputError."""
        path = self.content["path"][place]
        try:
            path |= path_through(path["kind"], points())
        except InputError as error:
            self._timer.stop()
            self._reader.forget()
            self._show_problem(str(error))
            return
        if typed:
            self.drawing.show_paths(self.content["path"], self._folder)
            self._timer.start()
        else:
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

    def _save(self) -> None:
        """The dialog asks before a file is replaced; one that it did not ask about is never replaced."""
        name = str(self.content.get("name", "protocol")).replace("/", "-")
        proposed = self._file or Path.home() / f"{name}.toml"
        chosen, _ = QFileDialog.getSaveFileName(self, "Save the protocol", str(proposed), TOML)
        path = Path(chosen).with_suffix(".toml")
        if chosen:
            try:
                save_protocol(path, self.content, replacing=str(path) == chosen)
            except InputError as error:
                self._show_problem(str(error))
                self.save.setEnabled(True)  # elsewhere, or once the reason is gone
            else:
                self._as_read = self.content
                self.saved.emit(str(path))


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


def typed_points(text: str) -> list[Pair]:
    """Points (m) from "-100 400, 100 400", in mm. InputError where they are not pairs of numbers."""
    try:
        return [(x, y) for x, y in ([float(number) / 1e3 for number in pair.split()] for pair in text.split(","))]
    except ValueError:
        raise InputError("path: each point is two numbers, in mm: -100 400, 100 400") from None


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
