"""The firmware on its processor: the whole image in QEMU does what the Python board does, an error in the core is
found on every target, and it keeps within its ceilings.

As a script it prints what it takes: `python tests/hardware/test_firmware.py` (hardware/firmware/check does).
"""

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from firmware_board import Image, Pipe, firmware_boards
from reference_board import SOURCES, TARGETS, RandomHost, RecordedBoard, live_alike, made, on_a_cortex_m4, recorded
from simulated_board import SimulatedBoard
from test_wire_dialogues import DIALOGUES, hello, hold

from hardware.emulated_board.board import TICK_US
from hardware.wire.messages import Fault, State

#: Bytes of the NUCLEO-F446RE's image; of the image whose plant is the clock the deepest stack (bytes), and the
#: instructions of a tick until its sample is on its way.
CEILINGS = {"flash": 16_384, "RAM": 8192, "stack": 1024, "instructions of a tick": 9000}
#: One instruction takes 128 ns of the emulator's time, 21.504 of the processor's clocks.
ONE_BY_ONE = ("-icount", "shift=7,sleep=off")
CLOCKS = 168 * 0.128
SHORT = [dialogue for dialogue in DIALOGUES if sum(step.get("ticks", 0) for step in dialogue["steps"]) < 200]
#: What is spoilt in the core, and into what: a watchdog that trips late, a limit that is too low, a message not known
ERRORS = {
    "phd_board.c": ("> PHD_WATCHDOG_US - PHD_TICK_US", "> PHD_WATCHDOG_US + PHD_TICK_US"),
    "phd_watch.c": ("> limit + limit / 10 + PHD_OVER_CURRENT_mA", "> limit + PHD_OVER_CURRENT_mA"),
    "phd_messages.c": ("case PHD_HEARTBEAT:", "case PHD_HEARTBEAT + 100:"),
}


def image(folder: Path) -> Path:
    return made(folder, "plant-f405.elf")


@pytest.mark.parametrize("file", ERRORS)
@pytest.mark.parametrize("target", TARGETS)
def test_an_error_in_the_core_is_found(target: str, file: str, tmp_path: Path) -> None:
    sources = tmp_path / "sources"
    shutil.copytree(SOURCES, sources)
    right, wrong = ERRORS[file]
    text = (sources / file).read_text()
    assert text.count(right) == 1
    (sources / file).write_text(text.replace(right, wrong))
    program = TARGETS[target](tmp_path, sources)
    with pytest.raises(AssertionError, match="event"):
        live_alike(program, [*(hold(dialogue, RecordedBoard) for dialogue in DIALOGUES), RandomHost(1).live(600)])


@pytest.mark.parametrize("dialogue", SHORT[:4], ids=[dialogue["name"].replace(" ", "-") for dialogue in SHORT[:4]])
def test_the_whole_image_does_what_the_dialogue_says(dialogue: dict, tmp_path: Path) -> None:
    run = Image(image(tmp_path))
    try:
        hold(dialogue, firmware_boards(lambda: run))
    finally:
        run.close()


@pytest.mark.parametrize("state", [State.IDLE, State.READY, State.ACTIVE, State.FAULT])
def test_the_emergency_stop_latches_what_the_host_s_stop_does(state: State, tmp_path: Path) -> None:
    bench = SimulatedBoard(hello())
    run = Pipe(on_a_cortex_m4(tmp_path))
    try:
        bench.board = firmware_boards(lambda: run)(hello())
        bench.start()
        if state != State.IDLE:
            bench.connect()
        if state in (State.ACTIVE, State.FAULT):
            bench.command()
        if state == State.FAULT:
            bench.tick(60)
        assert bench.state == state
        did = run.tell(b"S")
        assert did.state == State.FAULT and did.currents == (0, 0, 0, 0) and not did.answer
        assert did.faults & Fault.HOST_REQUEST and did.cause == (bench.board.cause or Fault.HOST_REQUEST)
        assert bench.state == state or bench.tick() is not None
    finally:
        run.close()


def figures(folder: Path) -> dict[str, int]:
    """What the firmware takes."""
    sizes = subprocess.run(
        ["arm-none-eabi-size", "-A", made(folder, "nucleo-f446-uart.elf")], capture_output=True, text=True, check=True
    ).stdout  # fmt: skip
    of = {name: int(size) for name, size in re.findall(r"^\.(\w+)\s+(\d+)", sizes, re.M)}
    run = Image(image(folder), *ONE_BY_ONE)
    try:
        bench = recorded(hello())
        bench.board = firmware_boards(lambda: run)(hello())
        bench.connect()
        for k in range(100):
            bench.command()
            bench.tick(counts=(5 * k, 0, -3 * k, 0))
        ticks = [cost for what, cost in run.costs if what == b"T"]
    finally:
        run.close()
    return {
        "flash": of["text"] + of["data"],
        "RAM": of["data"] + of["bss"] + of["stack"],
        "stack": max(cost.stack for cost in ticks),
        "instructions of a tick": round(max(cost.clocks for cost in ticks[TICK_US // 10 :]) / CLOCKS),
    }


def test_it_keeps_within_its_ceilings(tmp_path: Path) -> None:
    taken = figures(tmp_path)
    assert not {name: of for name, of in taken.items() if not 0 < of <= CEILINGS[name]}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        for what, took in figures(Path(name)).items():
            print(f"{what:24}{took:8,}  ceiling {CEILINGS[what]:8,}", file=sys.stdout)
