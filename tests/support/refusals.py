"""What the command line refuses."""

import pytest

from app.cli import main


def refusal(capsys: pytest.CaptureFixture, *arguments: object) -> str:
    """The one sentence of what cannot be: exit code 2, and nothing on the standard output."""
    capsys.readouterr()
    assert main([*map(str, arguments)]) == 2, arguments
    told = capsys.readouterr()
    assert told.out == "" and told.err.startswith("phd: ") and told.err.count("\n") == 1, told
    return told.err
