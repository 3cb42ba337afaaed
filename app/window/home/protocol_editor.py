"""The protocol editor: an experiment as a form, its paths drawn on the workspace, its plan beside it.

What is edited is the content of the protocol's file. The reader of protocols checks it while it is typed, and its
sentence stands where the mistake is.
"""

import re
import tomllib
from collections.abc import Mapping
from copy import deepcopy
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtWidgets import QFileDialog, QPushButton, QWidget

from app.window.canvas.path_drawing import PathDrawing
from app.window.home.protocol_keys import default_of, form_lines, from_text, refuse_other_shapes, section_of, to_text
from app.window.home.protocol_lists import LINE_PX, ControllerRows, DeviceTicks, PathRows
from app.window.widgets import theme
from app.window.widgets.fields import Field, Tick
from app.window.widgets.parts import (
    PANEL_MARGINS,
    Panel,
    breakable,
    button,
    chain_tabs,
    column,
    grid,
    printed,
    row,
    scrolled,
    tab_stops,
    text_label,
    wrapped_label,
)
from app.window.widgets.work import BackgroundTask
from core.files import InputError, read_text
from core.workspace import tip_is_free
from experiments.plan import plan_summary, print_plan
from experiments.protocol import SHIPPED_FOLDER, read_protocol, shipped_protocols
from experiments.protocol_writer import POINTS, protocol_text, save_protocol

WAIT_MS = 200  # after the last change, before the content is read
TOML = "TOML files (*.toml)"
WHERE = "protocol"  # begins the reader's sentences
HEADING_PX = 30  # high, the name of a part of the form


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
        self._lines, self._lists = form_lines(), list[tuple[QWidget, QWidget]]()  # the last button above each list
        self.fields = {key: field for lines in self._lines.values() for line in lines for key, field in line.items()}
        sections = ("", "devices", "controller", "path", *self.fields)
        self.sentences = {section_of(name): wrapped_label("", "bad") for name in sections}
        for key, field in self.fields.items():
            field.changed.connect(lambda value, key=key: self._put(key, from_text(key, value, self._get(key))))
        self.drawing, self.summary = PathDrawing(), wrapped_label("", bold=True)
        self.plan = printed("No plan yet", wrap=True)
        self.title, self.save = text_label("", size=theme.HEAD, bold=True), button("Save as …", self._save, "main")
        self.devices, self.controllers, self.paths = DeviceTicks(), ControllerRows(), PathRows()
        self._timer = QTimer(self, singleShot=True, interval=WAIT_MS)
        self._timer.timeout.connect(self._read)
        for changed in (self.devices.changed, self.controllers.changed):
            changed.connect(self._timer.start)
        self.paths.changed.connect(self._show_paths)
        self.paths.refused.connect(self._refuse)
        self.drawing.drawn.connect(self.paths.draw)
        self.drawing.moved.connect(self.paths.move_points)
        self._lay_out()

    def _lay_out(self) -> None:
        inside, self._grid = QWidget(), grid(12, 8, stretched=1, margins=(0, 0, 8, 0))
        inside.setLayout(self._grid)
        self._grid.setColumnStretch(3, 1)
        small = "small"
        self._add_line(self._lines[""][0])
        draw = [button(f"Draw {kind}", partial(self.drawing.begin, kind), small) for kind in POINTS]
        self._add_list("Devices", "devices", self.devices, button("Add a file …", self._add_device, small))
        self._add_list("Controllers", "controller", self.controllers, button("Add", self.controllers.add_new, small))
        add_drawing = button("Add a file …", self._add_drawing, small)
        self._add_list("Paths", "path", self.paths, *draw, add_drawing)
        for title in ("Trials", "People"):
            self._add_heading(title)
            for line in self._lines[title]:
                self._add_line(line)
        self.form_area = scrolled(inside)
        how = wrapped_label("Drag a ring to move a point. Every device reaches the dotted area.", "quiet")
        right = column((self.drawing, 3), how, self.summary, (self.plan, 1), spacing=12)
        both = row((self.form_area, 13), (right, 10), spacing=16)
        head = row(self.title, (self.sentences[""], 1), spacing=16)  # beside it: nothing below moves
        kept = text_label("Ctrl+S saves a file of your own. Comments in a file are not kept.", "quiet", theme.SMALL)
        foot = row(kept, 1, button("Undo all changes", self.undo), button("Back  Esc", self.closed.emit), self.save)
        self.setLayout(column(head, (both, 1), foot, spacing=10, margins=PANEL_MARGINS))

    def _add_list(self, title: str, section: str, entries: QWidget, *buttons: QPushButton) -> None:
        """A list below its name and what adds to it; the sentence that is about it below."""
        self._add_heading(title, *buttons)
        self._lists.append((buttons[-1], entries))
        for widget in (entries, self.sentences[section]):
            self._grid.addWidget(widget, self._grid.rowCount(), 0, 1, 4)

    def _add_heading(self, title: str, *buttons: QPushButton) -> None:
        place = self._grid.rowCount()
        self._grid.addLayout(row(text_label(title, bold=True), 1, *buttons), place, 0, 1, 4)
        self._grid.setRowMinimumHeight(place, HEADING_PX)

    def _add_line(self, line: Mapping[str, Field]) -> None:
        """One or two fields, and the sentences that are about them below."""
        place = self._grid.rowCount()
        for at, field in zip((0, 2), line.values(), strict=False):
            if isinstance(field, Tick):
                self._grid.addWidget(field, place, at, 1, 2)
            else:
                label = text_label(field.accessibleName(), "quiet")
                label.setFixedHeight(theme.text_px(LINE_PX))
                self._grid.addWidget(label, place, at, Qt.AlignmentFlag.AlignTop)
                self._grid.addWidget(field, place, at + 1, 1, 1 if len(line) == 2 else 3)
        for below, section in enumerate(dict.fromkeys(map(section_of, line)), start=1):
            self._grid.addWidget(self.sentences[section], place + below, 0, 1, 4)

    # ----------------------------------------------------------------------------------------- the content

    def open(self, name: str) -> None:
        """Edit a protocol: a shipped one by its name, of which a copy is saved, or a file."""
        if name == self.name and self.changed:
            return  # what was changed is still there
        shipped = name in shipped_protocols()
        path = SHIPPED_FOLDER / f"{name}.toml" if shipped else Path(name)
        self._file, self._folder = None if shipped else path, path.parent
        self.title.setText(f"{name.capitalize()} protocol, a copy" if shipped else path.name)
        self.content, broken = {}, ""
        try:
            content = tomllib.loads(read_text(path))
            refuse_other_shapes(content)
            self.content = content
        except (InputError, ValueError) as error:  # a form cannot show it
            broken = str(error)
        for key, field in self.fields.items():
            field.show_value(to_text(key, self._get(key)))
        self._show_lists()
        self.form_area.setEnabled(not broken)
        if broken:
            self._refuse(f"{broken}. Mend it in a text editor.")
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
        for key, shown in (("devices", self.devices), ("controller", self.controllers), ("path", self.paths)):
            shown.show_entries(self.content.setdefault(key, []))
        self._fit_form()
        self._show_paths()

    def _show_paths(self) -> None:
        self.drawing.show_paths(self.paths.entries, self._folder)
        self._timer.start()

    def _fit_form(self) -> None:
        """No row of a list is wider than the form, and Tab comes to each in its place."""
        for above, entries in self._lists:
            chain_tabs(above, *tab_stops(entries))
        self._grid.activate()
        self.form_area.setMinimumWidth(self.form_area.widget().minimumSizeHint().width() + 12)

    def _add_device(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self, "Device", "", TOML)
        if path:
            self.devices.add(path)

    def _add_drawing(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self, "Drawing of a path", "", "Drawings (*.csv *.svg)")
        if path:
            self.paths.add_file(Path(path))

    def _refuse(self, sentence: str) -> None:
        """What was typed cannot be put into the content, which is as it was."""
        self._timer.stop()
        self._reader.forget()
        self._show_problem(sentence)

    # ----------------------------------------------------------------------------------------- reading, saving

    @property
    def waiting(self) -> bool:
        """Whether a change is still to be read."""
        return self._timer.isActive()

    def _read(self) -> None:
        """Let the reader see the content."""
        self._fit_form()
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
            if here:
                QTimer.singleShot(0, partial(self.form_area.ensureWidgetVisible, label, 0, HEADING_PX))
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


def preview(text: str, folder: Path) -> tuple[str, str, np.ndarray]:
    """Of a protocol's text: summary, plan, and places of a grid of 1 cm that every device reaches (n, 2), m.

    InputError if it cannot be run.
    """
    protocol = read_protocol(text, folder, WHERE)
    plan = print_plan(protocol, "01").partition("\n\n")[2]  # its first line says again what the summary says
    x, y = np.meshgrid(np.arange(-0.6, 0.61, 0.01), np.arange(-0.2, 0.81, 0.01))
    free = np.logical_and.reduce([tip_is_free(device.mechanism, x, y) for device in protocol.devices])
    return plan_summary(protocol), plan, np.column_stack((x[free], y[free]))
