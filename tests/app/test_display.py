"""Without a screen each verb that opens windows says so in one sentence, before anything else is started."""

from pathlib import Path

import pytest
from sessions import session_of

from app import progress
from app.cli import main


@pytest.fixture
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress.sys, "platform", "linux")
    for name in progress.PLACES:
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize("verb", ["run", "replay"])
def test_a_verb_that_needs_a_screen_says_so_where_there_is_none(no_screen, tmp_path: Path, capsys, verb: str) -> None:
    with session_of(tmp_path / "recorded", 1):
        pass
    before = sorted(tmp_path.rglob("*"))
    recording = next(tmp_path.glob("recorded/*/*/trials/*.parquet"))
    arguments = {"run": ["--data-dir", str(tmp_path / "data")], "replay": [str(recording)]}
    assert main([verb, *arguments[verb]]) == 2
    said = capsys.readouterr()
    assert "there is no screen to" in said.err and said.err.count("\n") == 1 and said.out == ""
    assert sorted(tmp_path.rglob("*")) == before


def test_a_library_that_the_windows_need_and_the_system_lacks_is_one_sentence(monkeypatch) -> None:
    def missing(name: str):
        raise ImportError("libEGL.so.1: cannot open shared object file")

    monkeypatch.setattr(progress, "import_module", missing)
    with pytest.raises(progress.InputError, match=r"a system library is missing: libEGL"):
        progress.import_screen("windows")
