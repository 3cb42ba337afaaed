"""What the program asks of each system: one clock, a compiled loop, a screen; and what its start does not wait for."""

import time
from pathlib import Path

import pytest
from refusals import refusal
from sessions import closed_session

from app import progress
from app.loop import clock


@pytest.mark.nojit
def test_the_loops_clock_is_the_one_of_the_other_processes() -> None:
    timer = clock.new_timer()
    for _ in range(100):
        before = time.perf_counter_ns()
        now = clock.now_ns(timer)
        assert before <= now <= time.perf_counter_ns()


@pytest.fixture
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress.sys, "platform", "linux")
    for name in progress.PLACES:
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize("verb", ["run", "replay"])
def test_a_verb_that_needs_a_screen_says_so_where_there_is_none(no_screen, tmp_path: Path, capsys, verb: str) -> None:
    closed_session(tmp_path / "recorded", 1)
    before = sorted(tmp_path.rglob("*"))
    recording = next(tmp_path.glob("recorded/*/*/trials/*.parquet"))
    arguments = {"run": ["--data-dir", str(tmp_path / "data")], "replay": [str(recording)]}
    assert "there is no screen to" in refusal(capsys, verb, *arguments[verb])
    assert sorted(tmp_path.rglob("*")) == before


def test_a_library_that_the_windows_need_and_the_system_lacks_is_one_sentence(monkeypatch) -> None:
    def missing(name: str):
        raise ImportError("libEGL.so.1: cannot open shared object file")

    monkeypatch.setattr(progress, "import_module", missing)
    with pytest.raises(progress.InputError, match=r"a system library is missing: libEGL"):
        progress.import_window_module("windows")
