"""A file that another program has open for a moment is tried again; one that stays so is refused in one sentence."""

import threading
from pathlib import Path

import pytest

from core.files import InputError
from experiments.analysis.trials_table import write_table
from experiments.recording import atomic_files
from experiments.recording.atomic_files import TRIES, patiently, remove, replace_file, set_aside


def refused(winerror: int | None) -> PermissionError:
    error = PermissionError(13, "denied", "trials.csv")
    if winerror:
        error.winerror = winerror
    return error


@pytest.fixture
def waits(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The waits, which take no time."""
    waited: list[float] = []
    monkeypatch.setattr(atomic_files.time, "sleep", waited.append)
    return waited


@pytest.mark.parametrize("winerror", [5, 32, 33])
def test_it_is_tried_again_until_it_is_free(waits: list[float], winerror: int) -> None:
    answers = [refused(winerror)] * 3 + ["done"]

    def do(word: str) -> str:
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return f"{answer} {word}"

    assert patiently(do, "well") == "done well" and len(waits) == 3


def test_the_tries_are_bounded_and_end_in_one_sentence(waits: list[float], tmp_path: Path, monkeypatch) -> None:
    tries: list[tuple] = []

    def never(*arguments: object) -> None:
        tries.append(arguments)
        raise refused(32)

    monkeypatch.setattr(atomic_files.os, "replace", never)
    with pytest.raises(InputError, match=r"^.*trials\.csv: cannot be written \(another program has it open"):
        write_table(tmp_path / "trials.csv", [], replacing=True)
    assert len(tries) == TRIES == len(waits) + 1
    assert not list(tmp_path.iterdir())


def test_a_file_that_may_not_be_touched_at_all_is_refused_at_once(waits: list[float]) -> None:
    def do() -> None:
        raise refused(None)

    with pytest.raises(PermissionError, match="denied"):
        patiently(do)
    assert not waits


def test_files_that_are_open_for_a_moment_are_replaced_set_aside_and_removed(tmp_path: Path) -> None:
    for what in (lambda path: replace_file(path, b"new"), lambda path: set_aside(path, "damaged"), remove):
        old = tmp_path / "old"
        old.write_text("old")
        file = old.open()
        threading.Timer(0.3, file.close).start()
        what(old)
        assert not old.exists() or old.read_text() == "new"
        file.close()
        for path in tmp_path.iterdir():
            path.unlink()
