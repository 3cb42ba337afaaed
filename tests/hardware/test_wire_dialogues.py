"""The dialogues of the specification's vectors, step by step: the board in Python and the one in C do what they say.

A firmware author tests a board with the same file: told bytes and readings in time, it must answer byte for byte.
"""

import json
from pathlib import Path

import pytest
from reference_board import TARGETS, RecordedBoard, live_alike

from hardware.emulated_board.board import FULL_BOARD, TICK_US, Board, Readings
from hardware.wire.messages import Hello

VECTORS = json.loads((Path(__file__).resolve().parents[2] / "docs" / "protocol-vectors.json").read_text())
DIALOGUES = VECTORS["dialogues"]


def hello() -> Hello:
    """Of the board that the dialogues are with."""
    fields = VECTORS["dialogues_board"]
    return FULL_BOARD._replace(**{
        name: tuple(value) if isinstance(value, list) else value.encode() if isinstance(value, str) else value
        for name, value in fields.items()
    })  # fmt: skip


def hold(dialogue: dict, kind: type[Board]) -> Board:
    """A board that goes through a dialogue and does at each step what it says."""
    board = kind(hello())
    if dialogue["after_brown_out"]:
        board.lose_power(0)
    now_us = 0
    for k, step in enumerate(dialogue["steps"]):
        assert step["at_us"] >= now_us, "time goes on"
        now_us = step["at_us"]
        if "told" in step:
            said = board.receive(bytes.fromhex(step["told"]), now_us)
        else:
            rise = step.get("counts_step", (0, 0, 0, 0))
            for n in range(step["ticks"]):
                now_us = step["at_us"] + n * TICK_US
                counts = tuple(first + n * each for first, each in zip(step["counts"], rise, strict=True))
                good = tuple(map(bool, step["encoder_good"]))
                said = board.tick(Readings(counts, tuple(step["force"]), tuple(step["measured_mA"]), good), now_us)
        did = {"answer": said.hex(), "state": board.state.name, "current_mA": list(board.currents)}
        assert did == {name: step[name] for name in did}, f"step {k}"
    return board


@pytest.mark.parametrize("dialogue", DIALOGUES, ids=[dialogue["name"].replace(" ", "-") for dialogue in DIALOGUES])
def test_the_board_says_and_does_what_the_dialogue_says(dialogue: dict) -> None:
    hold(dialogue, Board)


@pytest.mark.parametrize("target", TARGETS)
def test_the_board_in_c_does_so_too(target: str, tmp_path: Path) -> None:
    live_alike(TARGETS[target](tmp_path), [hold(dialogue, RecordedBoard) for dialogue in DIALOGUES])
