"""The protocol editor: what is typed and drawn is read as it is changed, and saved as a file that can be run."""

from pathlib import Path

import pytest
from msgspec.structs import replace
from page_driver import LEFT, PageDriver
from protocols import CURVES
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QCheckBox, QFileDialog, QPushButton, QWidget
from screens import settle

from app.window.home.protocol_editor import ProtocolEditor
from app.window.home.protocol_keys import form_of, form_text
from app.window.widgets.fields import NumberField
from app.window.widgets.parts import Choice
from core.path import Arc, Polyline, Segment
from experiments.protocol import load_protocol

NONE = Qt.KeyboardModifier.NoModifier


class Editing(PageDriver):
    """An editor, open on the paper's protocol."""

    def __init__(self, qtbot) -> None:
        super().__init__(qtbot, lambda send: ProtocolEditor())
        self.editor: ProtocolEditor = self.page
        self.saved: list[str] = []
        self.asked: list[tuple] = []  # of the dialog of files
        self.editor.saved.connect(self.saved.append)
        self.open("paper")

    def open(self, name: str) -> None:
        """A shipped protocol of 60 trials, as it is in its file, whatever was typed before."""
        self.editor.open(name)
        self.editor.undo()
        self.read("60 trials")

    def read(self, says: str = "") -> None:
        """Until the reader has read what is there: its summary, or its sentence, holds this."""
        editor = self.editor
        self.until(lambda: not editor.waiting)
        self.until(lambda: says in (editor.problem or editor.summary.text()))

    def mouse(self, do, x: float, y: float) -> None:
        """Click, press, move .. at a place of the plane, m."""
        drawing = self.editor.drawing
        at = drawing.to_screen((x, y)).toPoint()
        if do is QTest.mouseMove:
            QTest.mouseMove(drawing, at)
            QApplication.processEvents()
        else:
            do(drawing, LEFT, NONE, QPoint(at))

    def save_as(self, monkeypatch, path: Path | str) -> None:
        monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *asked: self.asked.append(asked) or (str(path), ""))
        QTest.mouseClick(self.editor.save, LEFT)


@pytest.fixture
def editing(qtbot, monkeypatch):
    monkeypatch.setattr("app.window.home.protocol_editor.WAIT_MS", 0)
    return Editing(qtbot)


def test_what_is_typed_is_read_at_once_and_the_plan_follows(editing: Editing) -> None:
    assert editing.field("gain of controller 4").cursorPosition() == 0, "the first digits of a number are seen"
    editing.type("Blocks", "2")
    editing.read("= 40 trials")
    assert editing.editor.plan.toPlainText().startswith("participants"), "what the summary says is not said again"
    four = next(box for box in editing.editor.findChildren(QCheckBox) if box.text() == "four-brake")
    four.click()
    editing.read("1 device × 5 controllers × 2 paths × 2 = 20 trials")


def test_the_wheel_scrolls_the_form_and_turns_only_a_drop_down_that_has_the_focus(editing: Editing) -> None:
    editor = editing.editor
    editing.holder.activateWindow()
    QTest.qWaitForWindowActive(editing.holder)
    settle(editing.holder)
    bar = editor.form_area.verticalScrollBar()
    editor.fields["name"].setFocus()
    bar.setValue(0)
    choices = [one for one in editor.findChildren(Choice) if one.isVisible()]
    before = [one.currentText() for one in choices]
    for one in choices:
        wheel_down(one)
    assert len(choices) == 5 and [one.currentText() for one in choices] == before and bar.value() > 0
    bar.setValue(0)
    choices[1].setFocus()
    wheel_down(choices[1])
    assert editor.content["controller"][1]["kind"] != before[1]


def wheel_down(widget: QWidget) -> None:
    """A notch of the wheel over the middle of a widget, as the window system brings it."""
    window, place = widget.window().windowHandle(), widget.mapTo(widget.window(), widget.rect().center())
    QTest.wheelEvent(window, QPointF(place), QPoint(0, -120))
    QApplication.processEvents()


def test_the_readers_sentence_stands_where_the_mistake_is(editing: Editing) -> None:
    for field, text, section, says in (
        ("Blocks", "0", "blocks", "blocks must be at least 1"), ("Blocks", "two", "blocks", "must be a whole number"),
        ("Name", "", "name", "name"), ("Controller 2", "None", "controller", "two controllers have the same name"),
        ("gain of controller 4", "", "controller", "gain_N_s_m is required"),
        ("x of point 2 of path 1", "900", "path", "cannot follow path 1"),
        ("x of point 2 of path 1", "x", "path", "in mm"), ("Longest move (s)", "0", "trial", "time_out_s"),
        ("Break after trials", "0", "breaks", "breaks"), ("Break after trials", "5", "breaks", "least_s is missing"),
    ):  # fmt: skip
        editing.open("paper")
        editing.type(field, text)
        editing.read(says)
        shown = [name for name, label in editing.editor.sentences.items() if not label.isHidden()]
        assert shown == [section] and says in editing.editor.sentences[section].text().replace("\u200b", "")
        assert not editing.editor.save.isEnabled() and editing.editor.plan.toPlainText() == ""


def test_every_coordinate_of_a_path_is_seen_whole(editing: Editing) -> None:
    editing.editor.open(str(CURVES))
    fields = [field for path in editing.editor.paths.points for field in path]
    assert "-93.969" in [field.text() for field in fields]
    for field in fields:
        edges = field.width() - field.contentsRect().width() + 16  # with the padding of the sheet
        assert field.fontMetrics().horizontalAdvance(field.text()) + edges <= field.width(), field.text()


def test_the_editor_can_be_used_by_keys_alone(editing: Editing) -> None:
    editor, press = editing.editor, lambda key: QTest.keyClick(editing.holder.focusWidget(), key)
    editing.editor.open(str(CURVES))
    editing.holder.activateWindow()
    QTest.qWaitForWindowActive(editing.holder)
    editing.read("24 trials")
    editor.fields["name"].setFocus()
    passed = []
    while not passed or passed[-1] not in ("Blocks", ""):
        press(Qt.Key.Key_Tab)
        passed.append((one := editing.holder.focusWidget()).accessibleName() or one.text())
        if passed[-1] == "Algorithm of controller 2":
            press(Qt.Key.Key_Down)
            settle(editing.holder)
            assert editing.holder.focusWidget().accessibleName() == passed[-1], "its row was made anew"
        if passed[-1] == "Another point at the end, 1":
            for _ in range(2):
                press(Qt.Key.Key_Space)
                settle(editing.holder)
    lists = ("four-brake", "Controller 1", "Algorithm of controller 2", "x of point 1 of path 1", "Blocks")
    assert [name for name in passed if name in lists] == list(lists), "each in its place"
    assert editor.content["controller"][1]["kind"] == "proportional" and len(editor.content["path"][0]["points_m"]) == 5


def test_rows_of_controllers_and_paths_align(editing: Editing) -> None:
    editing.editor.open(str(CURVES))
    editing.holder.resize(1256, 620)
    settle(editing.holder)
    places = {one: one.mapTo(editing.editor, QPoint()) for one in editing.editor.findChildren(QWidget)}
    for shown in (Choice, NumberField):
        seen = [one for one in editing.editor.controllers.findChildren(shown) if "gain" not in one.accessibleName()]
        assert len(seen) > 1 and len({places[one].x() for one in seen}) == 1, shown
    signs = [one for one in editing.editor.paths.findChildren(QPushButton) if one.toolTip() != "Remove this path"]
    first = editing.field("x of point 1 of path 1")
    assert [places[one].y() for one in signs] == [places[first].y()] * 2, "in the polyline's own line"


def test_paths_are_drawn_and_moved_with_the_mouse_on_a_grid_of_5_mm(editing: Editing, monkeypatch, tmp_path) -> None:
    editor = editing.editor
    settle(editing.holder)
    for kind, places in (
        ("polyline", [(-0.1, 0.35), (0.0, 0.45), (0.1, 0.35)]), ("arc", [(-0.1, 0.4), (0.0, 0.45), (0.1, 0.4)]),
        ("segment", [(0.0, 0.3), (0.0, 0.45)]),
    ):  # fmt: skip
        editor.drawing.begin(kind)
        for place in places:
            editing.mouse(QTest.mouseClick, *place)
        if kind == "polyline":
            editing.mouse(QTest.mouseDClick, *places[-1])
    editing.mouse(QTest.mousePress, 0.0, 0.3)
    editing.mouse(QTest.mouseMove, 0.0205, 0.3095)
    editing.mouse(QTest.mouseRelease, 0.0205, 0.3095)
    assert [editing.field(f"{axis} of point 1 of path 5").text() for axis in "xy"] == ["20", "310"]
    QTest.mouseClick(next(b for b in editor.findChildren(QPushButton) if b.text() == "+"), LEFT)
    editing.type("x of point 4 of path 3", "120")
    editing.read("5 paths")
    editing.save_as(monkeypatch, tmp_path / "drawn.toml")
    paths = load_protocol(tmp_path / "drawn.toml").paths
    assert isinstance(paths[3], Polyline) and paths[3].points_m == (
        (-0.1, 0.35),
        (0.0, 0.45),
        (0.1, 0.35),
        (0.12, 0.25),
    )
    assert isinstance(paths[4], Arc) and paths[4].from_deg > paths[4].to_deg, "over the top: clockwise"
    assert paths[5] == Segment((0.02, 0.31), (0.0, 0.45))


def test_a_protocol_of_ones_own_is_saved_and_can_be_run(editing: Editing, monkeypatch, tmp_path: Path) -> None:
    editing.type("Name", "pilot")
    editing.editor.fields["tones"].click()
    editing.type("gap of controller 3", "7.5")
    editing.type("Break after trials", "10")
    editing.type("Shortest break (s)", "30")
    editing.type("Form", "handedness: right, left; age: number")
    editing.editor.fields["instruction"].setPlainText("Follow the line.\n---\nRest when you like.")
    editing.editor.fields["consent.text"].setPlainText("You may stop at any time.")
    editing.type("Seed", "7")
    editing.type("Participants", "P1, P2")
    editing.type("Longest move (s)", "12,5")
    editing.read("60 trials")
    editing.save_as(monkeypatch, tmp_path / "pilot.toml")
    saved = load_protocol(tmp_path / "pilot.toml")
    assert editing.saved == [str(tmp_path / "pilot.toml")] and saved.name == "pilot"
    assert saved.controllers[3].value("gap_m") == 0.0075
    assert saved.breaks is not None and (saved.breaks.after_trials, saved.breaks.least_s) == (10, 30)
    assert not saved.tones and saved.form == {"handedness": ("right", "left"), "age": "number"}
    assert [page.text for page in saved.pages] == ["Follow the line.", "Rest when you like."]
    assert saved.consent is not None and saved.consent.text == "You may stop at any time."
    assert (saved.seed, saved.participants, saved.trial.time_out_s) == (7, ("P1", "P2"), 12.5)
    assert replace(saved.trial, time_out_s=30.0) == load_protocol().trial, "what the editor does not show stays"
    editing.editor.open(str(tmp_path / "pilot.toml"))
    editing.type("Seed", "8")
    many = [f"{number:03d}" for number in range(1, 61)]
    editing.field("Participants").selectAll()
    editing.field("Participants").insert(", ".join(many))
    editing.read("60 trials")
    editing.editor.save_now()  # Ctrl+S: into the file that was opened, without a dialog
    again = load_protocol(tmp_path / "pilot.toml")
    assert len(editing.asked) == 1 and (again.seed, list(again.participants)) == (8, many)


def test_no_file_is_replaced_without_asking(editing: Editing, monkeypatch, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("precious")
    editing.save_as(monkeypatch, "")  # cancelled
    assert editing.saved == []
    editing.save_as(monkeypatch, tmp_path / "mine")  # the dialog has not asked about mine.toml
    assert file.read_text() == "precious" and editing.saved == []
    assert "exists already" in editing.editor.sentences[""].text()
    editing.save_as(monkeypatch, file)
    assert editing.saved == [str(file)] and load_protocol(file).name == "paper"
    assert all(len(asked) == 4 for asked in editing.asked), "without options: the dialog asks before it gives a file"


def test_a_file_that_cannot_be_run_is_opened_with_what_is_wrong(editing: Editing, tmp_path: Path) -> None:
    none = "devices must hold 1 value, not 0"
    for text, says in (
        ("name = ", "Invalid value"), ("", none), ('name = "x"\n[[path]]\nkind = "spiral"\n', none),
        ("breaks = 5", "breaks must be a table"), ("controller = 3", "controller must be a list"),
        ('form = {age = 7}\n[[controller]]\nkind = []\n[[path]]\nkind = 5\n', none),
    ):  # fmt: skip
        editing.open("paper")
        (tmp_path / "mine.toml").write_text(text)
        editing.editor.open(str(tmp_path / "mine.toml"))
        editing.read(says)
        assert not editing.editor.save.isEnabled() and editing.editor.plan.toPlainText() == ""


def test_changes_stay_until_they_are_saved_or_undone(editing: Editing) -> None:
    editing.type("Blocks", "2")
    editing.read("= 40 trials")
    editing.editor.open("paper")  # back, and edit again
    editing.read("= 40 trials")
    assert editing.field("Blocks").text() == "2"
    editing.editor.undo()
    editing.read("= 60 trials")
    assert editing.field("Blocks").text() == "3"


def test_another_kind_of_controller_has_other_parameters(editing: Editing) -> None:
    editing.editor.controllers.use_kind(editing.editor.content["controller"][0], "proportional")
    editing.read("gain_N_s_m is required")
    editing.type("gain of controller 1", "300")
    editing.read("60 trials")
    editing.editor.controllers.remove(1)
    editing.editor.controllers.add_new()
    editing.read("= 60 trials")
    assert [one["number"] for one in editing.editor.content["controller"]] == [1, 2, 3, 4, 5]


def test_a_form_reads_back_as_it_was_written() -> None:
    form = {"handedness": ["right", "left"], "age": "number"}
    assert form_of(form_text(form)) == form and form_of(" ; ") is None
