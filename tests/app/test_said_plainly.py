"""What the program says where something is closed, forbidden, absurd or takes long: one sentence, never a traceback."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from protocols import PAPER, PEOPLE, changed
from refusals import refusal

from app.window.widgets.work import BackgroundTask
from core.files import InputError
from experiments.protocol import MOST_PICTURE_BYTES, load_protocol
from experiments.study.study import run_study

ROOT = Path(__file__).resolve().parents[2]
posix = pytest.mark.skipif(os.name == "nt", reason="of POSIX")
PNG = b"\x89PNG\r\n\x1a\n" + bytes(100)


def phd(*arguments: str, shell: str = "", **options) -> subprocess.CompletedProcess:
    """The command in a process of its own; shell: what a shell does with its streams, as ">&-"."""
    command = [sys.executable, "-m", "app.cli", *arguments]
    if shell:
        command = ["/bin/sh", "-c", f'exec "$@" {shell}', "sh", *command]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=200, **options)


@posix
@pytest.mark.parametrize(
    ("verb", "closed"), [("--help", ">&-"), ("study --bogus", "2>&-"), ("simulate", "<&- >&- 2>&-")]
)
def test_a_stream_that_is_closed_ends_no_verb_in_a_traceback_and_spoils_no_file_that_is_written(tmp_path, verb, closed):
    scene = (ROOT / "experiments/scenes/scooter.toml").read_text()
    (tmp_path / "scene.toml").write_text(re.sub(r"duration_s = \S+", "duration_s = 0.2", scene))
    arguments = ["simulate", "scene.toml", "--out", "ticks.csv"] if verb == "simulate" else verb.split()
    done = phd(*arguments, shell=closed, cwd=tmp_path)
    assert done.returncode == (2 if "--bogus" in verb else 0)
    assert "Traceback" not in done.stderr and "Exception" not in done.stderr
    if verb == "simulate":
        head, *rows = (tmp_path / "ticks.csv").read_text().splitlines()
        assert head.startswith("t") and {row.count(",") for row in rows} == {head.count(",")}
        assert len(rows) == 21 and all(float(row.split(",")[0]) < 0.3 for row in rows)


def test_a_study_that_the_disk_has_no_room_for_is_refused_and_nothing_is_written(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr("experiments.study.study.shutil.disk_usage", lambda path: usage._replace(free=40_000_000))
    with pytest.raises(InputError, match="records about 480 MB, and 40 MB are free there: take fewer --operators"):
        run_study(tmp_path / "not" / "yet" / "there", 10, PAPER, PEOPLE)
    assert not list(tmp_path.iterdir())


def with_picture(folder: Path, name: str) -> Path:
    text = changed(PAPER.text) + f'\n[[instruction]]\ntext = "read"\npicture = "{name}"\n'
    (folder / "mine.toml").write_text(text)
    return folder / "mine.toml"


def test_pictures_that_are_png_or_jpeg_are_taken_up_to_ten_megabytes(tmp_path):
    assert MOST_PICTURE_BYTES == 10_000_000
    for content in (PNG, b"\xff\xd8\xff\xe0" + bytes(100), PNG + bytes(MOST_PICTURE_BYTES - len(PNG))):
        (tmp_path / "a.png").write_bytes(content)
        assert load_protocol(with_picture(tmp_path, "a.png")).pages[0].picture == content
    (tmp_path / "link.png").symlink_to(tmp_path / "a.png")
    assert load_protocol(with_picture(tmp_path, "link.png")).pages[0].picture == content


@posix
@pytest.mark.parametrize(
    ("what", "why"),
    [
        ("/dev/zero", "is no regular file"), ("pipe", "is no regular file"), (".", "is no regular file"),
        ("link-to-zero", "is no regular file"), ("text.png", "is neither PNG nor JPEG"),
        ("empty.png", "is neither PNG nor JPEG"), ("sparse.png", "is larger than 10 MB"), ("none.png", "no such file"),
        ("loop", "symbolic links"), ("a\\u0000b", "the path is not valid"), ("x" * 300, "too long"),
    ],
)  # fmt: skip
def test_what_is_no_picture_is_refused_in_one_sentence_without_reading_it(tmp_path, capsys, what, why):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link-to-zero").symlink_to("/dev/zero")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "text.png").write_text("password")
    (tmp_path / "empty.png").touch()
    with (tmp_path / "sparse.png").open("wb") as sparse:
        sparse.write(PNG)
        sparse.truncate(10**12)
    said = refusal(capsys, "run", with_picture(tmp_path, what), "--print-plan")
    assert "mine.toml: instruction: picture: " in said and why.lower() in said.lower()


def test_what_a_page_may_not_read_reaches_the_page_as_a_sentence(qtbot):
    def read() -> None:
        raise PermissionError(13, "Permission denied", "theirs/sub-01")

    said: list[object] = []
    task = BackgroundTask(said.append)
    task.ask(read)
    qtbot.waitUntil(lambda: bool(said))
    assert isinstance(said[0], InputError) and str(said[0]) == "theirs/sub-01: permission denied"
