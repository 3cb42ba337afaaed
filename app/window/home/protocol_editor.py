"""The protocol editor: the file itself, read while it is typed; beside it its paths, its summary and its plan.

A mistake stands in words under the text, its line is marked. *Add* inserts commented lines.
"""

import re
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import QMarginsF, QPointF, QRectF, Qt, QTimer, Signal
from PySide6.QtGui import QPainter, QTextCursor, QTextFormat
from PySide6.QtWidgets import QFileDialog, QMenu, QPushButton, QTextEdit

from app.window.canvas.grid import beside_names, paint_grid
from app.window.canvas.path_marks import paint_path, polygon
from app.window.canvas.plane import Plane
from app.window.home.protocol_mistakes import in_words, line_of, set_twice
from app.window.home.protocol_parts import PARTS, Part, place_of
from app.window.home.protocol_text import ProtocolText
from app.window.widgets import theme
from app.window.widgets.parts import (
    PANEL_MARGINS,
    Panel,
    breakable,
    button,
    column,
    printed,
    row,
    text_label,
    wrapped_label,
)
from app.window.widgets.theme import COLOURS
from app.window.widgets.words import as_sentence
from app.window.widgets.work import BackgroundTask
from core.files import InputError, read_text
from core.path import outline
from core.workspace import tip_is_free
from experiments.plan import plan_summary, print_plan
from experiments.protocol import SHIPPED_FOLDER, read_protocol, shipped_protocols
from experiments.protocol_writer import save_protocol

SENTENCE_LINES = 3  # that there is room for under the text
WAIT_MS = 200  # after the last change, before the text is read
TOML = "TOML files (*.toml)"
HINT = "Ctrl+Z undoes a change."
WHERE = "protocol"  # begins the reader's sentences
RING_PX, BESIDE_PX = 7.0, 17.0  # radius of the rings; from the middle of the first one to the number of its path
VIEW = QRectF(-0.4, 0.0, 0.8, 0.62)  # m, of the plane
SPACING_M = 0.002  # between points of a drawn path


class Preview(NamedTuple):
    """What a protocol's text says."""

    summary: str
    plan: str
    ways: dict[int, np.ndarray]  # number of a path -> its points (n, 2), m
    free: np.ndarray  # places of a grid of 1 cm that every device reaches (n, 2), m
    devices: tuple[str, ...]  # these


def preview(text: str, folder: Path) -> Preview:
    """InputError if it cannot be run."""
    protocol = read_protocol(text, folder, WHERE)
    plan = print_plan(protocol, "01").partition("\n\n")[2]  # its first line says again what the summary says
    plan = re.sub(r"(?<=[\d)]) (?=(mm|m|s|min|N s/m)\b)", "\u00a0", plan)  # no line begins with a unit
    ways = {number: np.asarray(outline(path, SPACING_M)) for number, path in protocol.paths.items()}
    x, y = np.meshgrid(np.arange(-0.6, 0.61, 0.01), np.arange(-0.2, 0.81, 0.01))
    free = np.logical_and.reduce([tip_is_free(device.mechanism, x, y) for device in protocol.devices])
    names = tuple(device.name for device in protocol.devices)
    return Preview(plan_summary(protocol), plan, ways, np.column_stack((x[free], y[free])), names)


class PathPicture(Plane):
    """The protocol's paths by number, on the places that every device reaches."""

    def __init__(self) -> None:
        super().__init__(VIEW, keep_free=QMarginsF(64.0, 10.0, 10.0, 24.0), follows_mouse=False)
        self._ways: dict[int, np.ndarray] = {}
        self._free = np.empty((0, 2))
        self.under_path = [lambda painter: paint_grid(painter, self), self._paint_places, self._paint_ways]

    def show_paths(self, ways: dict[int, np.ndarray], free: np.ndarray) -> None:
        self._ways, self._free = ways, free
        self.repaint_still()

    def _paint_places(self, painter: QPainter) -> None:
        painter.setClipRect(beside_names(self))  # the names of the lines are not covered
        painter.setPen(theme.pen(COLOURS.edge, 2.0, round_cap=True))
        painter.drawPoints(polygon(self.pixels(self._free)))

    def _paint_ways(self, painter: QPainter) -> None:
        for number, way in self._ways.items():
            points = self.pixels(way)
            paint_path(painter, points, False, (RING_PX, RING_PX), self.sizes)
            ahead = points[1] - points[0]
            behind = points[0] - BESIDE_PX * ahead / np.hypot(*ahead)
            theme.write(painter, QPointF(*behind.tolist()), str(number), theme.NORMAL, True, COLOURS.text)


class ProtocolEditor(Panel):
    """Text on the left, the reader's sentence under it, its line marked; paths, summary and plan on the right."""

    saved = Signal(str)  # the file
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.name = ""  # what was opened: a shipped protocol by its name, or a file
        self._file: Path | None = None  # which saving proposes; None: one named as the protocol
        self._folder = SHIPPED_FOLDER  # from which paths of devices and pictures are
        self.problem = ""  # the reader's sentence; "": the text can be run
        self.text, self.picture, self.summary = ProtocolText(), PathPicture(), wrapped_label("", bold=True)
        self.plan, self.sentence = printed("No plan yet", wrap=True), wrapped_label(HINT, "quiet")
        self.what, self._when = "", ""  # what is edited; ", saved" and the time, once it was
        self.title = text_label("", size=theme.HEAD, bold=True)
        self.save, self.save_as = button("Save  Ctrl+S", self.save_now), button("Save as …", self._save)
        self.undo_button = button("Undo all changes", self.undo)
        self.shows = wrapped_label("", "quiet")  # what the picture shows
        self._reader = BackgroundTask(self._show_read)
        self._timer = QTimer(self, singleShot=True, interval=WAIT_MS)
        self._timer.timeout.connect(lambda: self._reader.ask(preview, self.text.toPlainText(), self._folder))
        self.text.textChanged.connect(self._timer.start)
        self.text.document().modificationChanged.connect(self._show_changed)
        self._show_changed(False)
        theme.follow(self._mark)
        self._lay_out()

    def _lay_out(self) -> None:
        self.add = QPushButton("Add …", autoDefault=True, toolTip="Insert lines into the text")
        self.add.setMenu(menu := QMenu(self.add))
        for group in PARTS:
            for part in group:
                menu.addAction(part.title, partial(self.insert, part))
            menu.addSeparator()
        self.sentence.setFixedHeight(SENTENCE_LINES * self.sentence.fontMetrics().lineSpacing())  # nothing moves
        self.sentence.setAlignment(Qt.AlignmentFlag.AlignTop)
        right = column((self.picture, 5), self.shows, self.summary, (self.plan, 3), spacing=8)
        buttons = (self.undo_button, self.save, self.save_as, button("Back  Esc", self.closed.emit))
        head = row(self.title, self.add, 1, *buttons, spacing=12)
        left = column((self.text, 1), self.sentence, spacing=8)
        both = row((left, 13), (right, 10), spacing=16)
        self.setLayout(column(head, (both, 1), spacing=10, margins=PANEL_MARGINS))

    def insert(self, part: Part) -> None:
        """Put a part into the text, and the cursor on it; one that may be there once, and is: the cursor alone."""
        place, cursor = place_of(part, self.text.toPlainText()), self.text.textCursor()
        cursor.setPosition(place.begin)
        cursor.setPosition(place.end, QTextCursor.MoveMode.KeepAnchor)
        if cursor.selectedText() != place.text:
            cursor.insertText(place.text)
        cursor.setPosition(place.begin + len(place.text) - len(place.text.lstrip()))
        self.text.setTextCursor(cursor)
        self.text.centerCursor()
        self.text.setFocus()

    def open(self, name: str) -> None:
        """Edit a protocol: a shipped one by its name, of which a copy is saved, or a file, whole or broken."""
        if name == self.name and self.changed:
            return  # what was changed is still there
        shipped = name in shipped_protocols()
        path = SHIPPED_FOLDER / f"{name}.toml" if shipped else Path(name)
        self.name, self._file, self._folder = name, None if shipped else path, path.parent
        self.what, self._when = f"{name.capitalize()} protocol, a copy" if shipped else path.name, ""
        try:
            self.text.setPlainText(read_text(path))
        except InputError as error:
            self.text.clear()
            self._show_problem(str(error))
        self._saved()

    @property
    def changed(self) -> bool:
        """Whether something was changed and not saved."""
        return self.text.document().isModified()

    def _show_changed(self, changed: bool) -> None:
        """There is something to save and to undo, or not."""
        self.title.setText(f"{self.what}{', not saved' if changed else self._when}")
        self.undo_button.setEnabled(changed)
        theme.set_style(self.save, "main" if changed else "")

    def _saved(self) -> None:
        """What is shown is what the file says."""
        self.text.document().setModified(False)
        self._show_changed(False)

    @property
    def waiting(self) -> bool:
        """Whether a change is still to be read."""
        return self._timer.isActive() or self._reader.busy

    def undo(self) -> None:
        self.text.document().setModified(False)
        self.open(self.name)

    def _show_read(self, found: Preview | InputError) -> None:
        if isinstance(found, InputError):
            self._show_problem(str(found).removeprefix(f"{WHERE}: "))
            return
        self._show_problem("")
        theme.set_style(self.shows, "quiet")
        every = f"all {len(found.devices)} devices reach" if len(found.devices) > 1 else f"{found.devices[0]} reaches"
        self.shows.setText(f"Dots: places that {every}")
        self.summary.setText(found.summary)
        self.plan.setPlainText(found.plan)
        self.picture.show_paths(found.ways, found.free)

    def _show_problem(self, problem: str) -> None:
        """The reader's sentence, and the line that it is about."""
        self.problem = problem
        at = self._mark()
        said = f"Line {at + 1}: {as_sentence(in_words(problem))}" if problem else HINT
        if twice := set_twice(problem, self.text.toPlainText()):
            said = f"`{twice[0]}` is set twice: lines {twice[1] + 1} and {twice[2] + 1}."
        self.sentence.setText(breakable(said))
        theme.set_style(self.sentence, "bad" if problem else "quiet")
        if problem:
            self.summary.setText("")
            self.plan.setPlainText("")
            theme.set_style(self.shows, "caution")
            self.shows.setText("The picture is of the last text without a mistake.")
            self.plan.setPlaceholderText(f"No plan while line {at + 1} is wrong")
        self._may_save(not problem)

    def _may_save(self, may: bool) -> None:
        for pressed in (self.save, self.save_as):
            pressed.setEnabled(may)

    def _mark(self) -> int:
        """Mark the line that the problem is about; its number, from 0."""
        at, mark = line_of(self.problem, self.text.toPlainText()), QTextEdit.ExtraSelection()
        if twice := set_twice(self.problem, self.text.toPlainText()):  # the one that is being typed
            typed = self.text.textCursor().blockNumber()
            at = typed if typed in twice[1:] else at
        mark.cursor = QTextCursor(self.text.document().findBlockByNumber(at))  # type: ignore[attr-defined]
        mark.format.setBackground(theme.shade(COLOURS.bad_ground))  # type: ignore[attr-defined]
        mark.format.setProperty(QTextFormat.Property.FullWidthSelection, True)  # type: ignore[attr-defined]
        self.text.setExtraSelections([mark] if self.problem else [])
        return at

    def save_now(self) -> None:
        """Ctrl+S: into the file that was opened; a dialog asks where a copy of a shipped protocol goes."""
        if self._file is None:
            self._save()
        elif self.save.isEnabled():
            self._save_as(self._file, replacing=True)

    def _save(self) -> None:
        """The dialog asks before a file is replaced; one that it did not ask about is never replaced."""
        if self.save.isEnabled():
            proposed = self._file or Path.home() / f"my-{self.name}.toml"
            chosen, _ = QFileDialog.getSaveFileName(self, "Save the protocol", str(proposed), TOML)
            path = Path(chosen or proposed).with_suffix(".toml")
            if chosen and self._save_as(path, replacing=str(path) == chosen):
                self.closed.emit()

    def _save_as(self, path: Path, replacing: bool) -> bool:
        """Whether it was saved; what is changed next is then saved there, too."""
        try:
            save_protocol(path, self.text.toPlainText(), replacing)
        except InputError as error:
            self._show_problem(str(error))
            self._may_save(True)  # elsewhere, or once the reason is gone
            return False
        self.name, self._file, self._folder = str(path), path, path.parent
        self.what, self._when = path.name, f", saved {datetime.now():%H:%M}"
        self._saved()
        self.saved.emit(str(path))
        return True
