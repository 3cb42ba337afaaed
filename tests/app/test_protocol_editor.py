"""The protocol editor: what is typed is read as it is changed, its mistakes are marked, and it is saved to be run."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from page_driver import LEFT, PageDriver
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QFileDialog

from app.window.home.protocol_editor import HINT, ProtocolEditor
from app.window.home.protocol_parts import PARTS
from experiments.protocol import SHIPPED_FOLDER, load_protocol


class Editing(PageDriver):
    """An editor, open on the paper's protocol."""

    def __init__(self) -> None:
        super().__init__(lambda send: ProtocolEditor())
        self.editor: ProtocolEditor = self.page
        self.saved: list[str] = []
        self.asked: list[tuple] = []  # of the dialog of files
        self.editor.saved.connect(self.saved.append)

    def open(self, name: str) -> None:
        """A protocol as it is in its file, whatever was typed before."""
        self.editor.open(name)
        self.editor.undo()
        self.read()

    def read(self, says: str = "") -> None:
        """Until the reader has read what is there: its summary, or its sentence, holds this."""
        self.until(lambda: not self.editor.waiting)
        shown = self.editor.problem or self.editor.summary.text()
        assert says in shown, shown

    def put(self, before: str, after: str) -> None:
        """Other words in place of the first such ones."""
        cursor = self.editor.text.textCursor()
        at = self.editor.text.toPlainText().index(before)
        cursor.setPosition(at)
        cursor.setPosition(at + len(before), cursor.MoveMode.KeepAnchor)
        cursor.insertText(after)

    def marked(self) -> str:
        """The line that is marked."""
        return "".join(mark.cursor.block().text() for mark in self.editor.text.extraSelections())

    def save_as(self, monkeypatch, path: Path | str) -> None:
        monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *asked: self.asked.append(asked) or (str(path), ""))
        QTest.mouseClick(self.editor.save_as, LEFT)


@pytest.fixture(scope="module")
def kept() -> Iterator[Editing]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("app.window.home.protocol_editor.WAIT_MS", 0)
        made = Editing()
    yield made
    made.close()


@pytest.fixture
def editing(kept: Editing) -> Editing:
    """The same for all tests, open on the paper's protocol."""
    kept.open("paper")
    kept.saved.clear()
    kept.asked.clear()
    return kept


MISTAKES = {  # what is put in place of what, what is said then, and the line that is marked
    "no blocks": ("blocks = 3", "blocks = 0", "blocks must be at least 1, not 0", "blocks = 0"),
    "no quotation mark": ('"paper"', '"paper', "a quotation mark is missing", 'name = "paper'),
    "one number": (
        'kind = "segment"\nstart_m = [-0.10, 0.40]\nend_m = [0.10, 0.40]',
        'kind = "polyline"\npoints_m = [[0.0, 0.4], [1]]', "point 2 of points_m must hold 2 values, not 1", "points_m",
    ),
    "gain below 0": ("= 500.0 ", "= -500.0 ", "controller 5: gain_N_s_m must be greater than 0", "gain_N_s_m = -500.0"),
    "unknown table": ("[trial]", "[trail]", "did you mean trial?", "[trail]"),
    "a table twice": ("[mouse]", "[trial]", "the table trial is in the text twice", "[trial]"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_said_in_words_of_the_field_and_its_line_is_marked(editing: Editing, mistake: str) -> None:
    before, after, says, line = MISTAKES[mistake]
    editing.put(before, after)
    editing.read()
    said = editing.editor.sentence.text().replace("\u200b", "")
    marked = editing.marked()
    assert says.lower() in said.lower() and marked.startswith(line)
    assert said.startswith(f"Line {editing.editor.text.toPlainText().split(chr(10)).index(marked) + 1}: ")
    assert not editing.editor.save.isEnabled() and editing.editor.plan.toPlainText() == ""
    editing.editor.text.document().undo()
    editing.read("60 trials")
    assert editing.marked() == "" and editing.editor.sentence.text() == HINT


@pytest.mark.parametrize("typed", [0, 1], ids=["before the other", "behind it"])
def test_a_key_that_is_set_twice_is_named_with_both_lines_and_the_typed_one_is_marked(editing: Editing, typed: int):
    editor, lines = editing.editor, ["blocks = 3", "blocks = 4"]
    assert not editor.undo_button.isEnabled() and editor.save.objectName() == ""
    editing.put(lines[0], "\n".join(lines))
    cursor = editor.text.textCursor()
    cursor.setPosition(editor.text.toPlainText().index(lines[typed]))
    editor.text.setTextCursor(cursor)
    editing.read()
    at = editor.text.toPlainText().split("\n").index(lines[0]) + 1
    assert editor.sentence.text() == f"`blocks` is set twice: lines {at} and {at + 1}."
    assert editing.marked().startswith(lines[typed]) and "of the last text without a mistake" in editor.shows.text()
    assert editor.undo_button.isEnabled()
    editor.undo()
    editing.read("60 trials")
    assert editor.shows.text() == "Dots: places that all 2 devices reach" and not editor.undo_button.isEnabled()


def test_a_part_from_the_menu_is_commented_can_be_run_at_once_and_is_undone_in_one_step(editing: Editing) -> None:
    editor, before = editing.editor, editing.editor.text.toPlainText()
    for part in (part for group in PARTS for part in group):
        (action,) = [action for action in editor.add.menu().actions() if action.text() == part.title]
        action.trigger()
        editing.read()
        assert not editor.problem and editor.text.textCursor().block().text().startswith(part.head)
        after = editor.text.toPlainText()
        if part.is_once and part.head in before:
            assert after == before, "it is there already, and is shown"
            continue
        assert len(after) > len(before) and ("#" in part.text or part.head == "[[instruction]]")
        editor.text.document().undo()
        assert editor.text.toPlainText() == before


def test_a_file_of_ones_own_is_saved_with_its_comments_and_can_be_run(editing: Editing, monkeypatch, tmp_path) -> None:
    before = editing.editor.text.toPlainText()
    assert "#" in before
    editing.put("blocks = 3", "blocks = 2  # a pilot")
    editing.save_as(monkeypatch, tmp_path / "pilot.toml")
    text = (tmp_path / "pilot.toml").read_text()
    assert text == before.replace("blocks = 3", "blocks = 2  # a pilot"), "what was not touched stays to the letter"
    assert editing.saved == [str(tmp_path / "pilot.toml")] and load_protocol(tmp_path / "pilot.toml").blocks == 2
    editing.put("blocks = 2", "blocks = 4")
    editing.read("80 trials")
    editing.editor.save_now()  # Ctrl+S: into the file that was opened, without a dialog
    assert len(editing.asked) == 1 and load_protocol(tmp_path / "pilot.toml").blocks == 4


def test_no_file_is_replaced_without_asking(editing: Editing, monkeypatch, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("precious")
    editing.save_as(monkeypatch, "")  # cancelled
    assert editing.saved == []
    editing.save_as(monkeypatch, tmp_path / "mine")  # the dialog has not asked about mine.toml
    assert file.read_text() == "precious" and editing.saved == []
    assert "exists already" in editing.texts()
    editing.save_as(monkeypatch, file)
    assert editing.saved == [str(file)] and load_protocol(file).name == "paper"
    assert all(len(asked) == 4 for asked in editing.asked), "without options: the dialog asks before it gives a file"


def test_a_file_that_cannot_be_run_is_opened_with_what_is_wrong_and_can_be_mended(editing: Editing, tmp_path) -> None:
    whole = (SHIPPED_FOLDER / "paper.toml").read_text()
    for text, says in (
        ("name = ", "Invalid value"),
        ("", "the required key name is missing"),
        ("breaks = 5", "breaks"),
    ):
        (tmp_path / "mine.toml").write_text(text)
        editing.open(str(tmp_path / "mine.toml"))
        editing.read(says)
        assert editing.editor.problem and not editing.editor.save.isEnabled()
        editing.editor.text.setPlainText(whole)
        editing.read("60 trials")
        assert editing.editor.save.isEnabled()


def test_changes_stay_until_they_are_saved_or_undone(editing: Editing) -> None:
    editing.put("blocks = 3", "blocks = 2")
    editing.editor.open("paper")  # back, and edit again
    editing.read("= 40 trials")
    assert editing.editor.changed and editing.editor.title.text() == "Paper protocol, a copy, not saved"
    editing.editor.undo()
    editing.read("= 60 trials")
    assert not editing.editor.changed and editing.editor.title.text() == "Paper protocol, a copy"
