"""`phd bring-up` as a program of its own, on an emulated board in real time."""

import io
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from emulated import ROOT, Emulated
from refusals import refusal

from app.cli import main
from app.verbs.bring_up import AtTheKeyboard
from core.files import InputError


@pytest.fixture(scope="module")
def emulated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emulated]:
    running = Emulated(tmp_path_factory.mktemp("emulated"), "--hand", "builder", "--mistake", "dead-encoder")
    yield running
    assert running.end() == 0


@pytest.fixture(autouse=True)
def no_scheduling(monkeypatch: pytest.MonkeyPatch) -> None:
    """Verbs that run in this process do not take the scheduling of a control loop."""
    monkeypatch.setattr("app.verbs.bring_up.take_scheduling", lambda: None)


def arguments(emulated: Emulated, data: Path) -> list[str]:
    link = emulated.port if "://" in emulated.port else f"serial:{emulated.port}"
    return ["bring-up", "--link", link, "--by", "A. Builder", "--data-dir", str(data)]


def test_an_interrupt_leaves_the_board_without_current_and_no_record(emulated: Emulated, tmp_path: Path) -> None:
    running = subprocess.Popen(
        [sys.executable, "-m", "app.cli", *arguments(emulated, tmp_path)],
        cwd=ROOT, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    for line in running.stderr:
        if "Encoder of joint A" in line:  # which waits for a minute
            running.send_signal(signal.SIGTERM if sys.platform == "win32" else signal.SIGINT)
            break
    assert "interrupted" in running.communicate(timeout=120)[1] and running.returncode != 0
    truth = emulated.order()
    assert not any(truth["currents_mA"]) and truth["state"] in ("IDLE", "FAULT")
    assert not list((tmp_path / "bring-up").glob("*"))


@pytest.mark.parametrize("stdin", [io.StringIO(), None])
def test_a_keyboard_that_has_ended_is_said_where_a_step_waits_for_it(stdin: io.StringIO | None, monkeypatch) -> None:
    monkeypatch.setattr(sys, "stdin", stdin)
    keyboard = AtTheKeyboard()
    keyboard._keyboard.join()
    with pytest.raises(InputError, match="standard input has ended"):
        keyboard.is_ready()


CARD = """
class Card(Bus):
    def exchange(self, currents_mA):
        raise RuntimeError("the card fell over")
def new_device(device):
    return OwnDevice(device, Card())
"""


def test_a_driver_that_fails_gives_one_sentence_with_its_line_and_no_record(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    driver, data = tmp_path / "my_card.py", tmp_path / "data"
    driver.write_text((ROOT / "docs" / "examples" / "own_device.py").read_text() + CARD)
    asked = ("bring-up", "--link", f"driver:{driver}", "--by", "A. Builder", "--data-dir", str(data))
    assert main(asked) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert re.search(r"my_card\.py, line \d+: RuntimeError: the card fell over; no record is written", said)
    assert not list((data / "bring-up").iterdir())
    (data / "bring-up").rmdir()
    (data / "bring-up").touch()
    assert "bring-up: cannot be used" in refusal(capsys, *asked), "before anything is asked of the builder"


def test_an_emulated_board_without_a_builder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    still = Emulated(tmp_path)
    assert main(arguments(still, tmp_path / "data")) == 2
    assert "phd emulate --hand builder" in capsys.readouterr().err
    assert still.end() == 0
