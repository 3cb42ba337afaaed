"""`phd bring-up` as a program of its own, on an emulated board in real time."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from emulated import ROOT, Emulated
from refusals import refusal

from app.cli import main


@pytest.fixture(scope="module")
def emulated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emulated]:
    running = Emulated(tmp_path_factory.mktemp("emulated"), "--hand", "builder", "--mistake", "dead-encoder")
    yield running
    assert running.end() == 0


@pytest.fixture(autouse=True)
def no_scheduling(monkeypatch: pytest.MonkeyPatch) -> None:
    """Verbs that run in this process do not take the scheduling of a control loop."""
    monkeypatch.setattr("app.ipc.scheduling.take_scheduling", lambda: None)


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


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"--link": "sim"}, "only a real device is brought up"),
        ({"--link": "serial:/dev/nowhere"}, "there is no such port"),
        ({"--device": "nowhere.toml"}, "nowhere.toml"),
    ],
)
def test_what_cannot_be_brought_up_is_refused(wrong: dict[str, str], words: str, capsys: pytest.CaptureFixture) -> None:
    asked = {"--link": "serial:/dev/nowhere", "--by": "A. Builder"} | wrong
    assert words in refusal(capsys, "bring-up", *(word for pair in asked.items() for word in pair))


def test_an_emulated_board_without_a_builder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    still = Emulated(tmp_path)
    assert main(arguments(still, tmp_path / "data")) == 2
    assert "phd emulate --hand builder" in capsys.readouterr().err
    assert still.end() == 0
