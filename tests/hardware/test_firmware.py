"""The firmware on its processor: the whole image in QEMU does what the Python board does, an error in the core is
found on every target, and a tick and its stack have room.
"""

import ctypes
import itertools
import math
import socket
import subprocess
import time
from pathlib import Path

import pytest
from firmware_board import Image, firmware_boards
from reference_board import DIALOGUES, FLAGS, SOURCES, compiled, found, hello, hold, made, needs_compiler
from simulated_board import SimulatedBoard
from waiting import wait_until

from core.device import load_device
from core.files import InputError
from hardware.firmware import pin_map
from hardware.serial_device import SerialDevice

PAGE = SOURCES / "README.md"
#: One instruction takes 128 ns of the emulator's time, 21.504 of the processor's clocks.
ONE_BY_ONE = ("-icount", "shift=7,sleep=off")
CLOCKS = 168 * 0.128


def test_the_whole_image_does_what_dialogues_say_in_a_twentieth_of_its_time_and_a_quarter_of_its_stack() -> None:
    """Two dialogues: every byte costs a switch between threads of the emulator."""
    run = Image(made("plant-f405.elf"), *ONE_BY_ONE)
    board = firmware_boards(lambda: run)
    try:
        for dialogue in DIALOGUES:
            if dialogue["name"] in ("watchdog", "brown-out"):
                hold(dialogue, board)
        bench = SimulatedBoard(hello(), board)
        bench.connect()
        begin = len(run.costs)
        for k in range(100):
            bench.command()
            bench.tick(counts=(5 * k, 0, -3 * k, 0))
        ticks = [cost for what, cost in run.costs[begin:] if what == b"T"]
    finally:
        run.close()
    assert 0 < max(cost.stack for cost in ticks) <= 4096 // 4
    assert 0 < max(cost.clocks for cost in ticks) / CLOCKS <= 9000, "instructions; 168,000 clocks a tick"


def test_no_compiler_of_the_smallest_processor_warns_of_the_core(tmp_path: Path) -> None:
    """What is built for this machine and the M4 is built without a warning, too."""
    found("arm-none-eabi-gcc")
    for part in SOURCES.glob("phd_*.c"):
        command = ["arm-none-eabi-gcc", "-mcpu=cortex-m0", "-mthumb", *FLAGS, "-c", part, "-o", tmp_path / "part.o"]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0 and not done.stderr, done.stderr


@pytest.mark.parametrize("name", ["nucleo-f446-usb.bin", "nucleo-f446-uart.bin", "f405-usb.elf"])
def test_every_firmware_is_built_without_a_warning(name: str) -> None:
    assert made(name).stat().st_size > 0


def test_the_firmware_of_the_board_boots_and_a_host_connects_to_it() -> None:
    """The tick is SysTick's, of a processor whose time goes on with its instructions, however busy this machine is."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        number = free.getsockname()[1]
    emulator = subprocess.Popen(
        ["qemu-system-arm", "-M", "netduinoplus2", "-icount", "shift=6", "-display", "none", "-monitor", "none",
         "-serial", "null", "-serial", f"tcp:127.0.0.1:{number},server=on,wait=on,nodelay=on", "-kernel",
         made("emulated-f405.elf")]
    )  # fmt: skip
    link = SerialDevice(load_device("four-brake"), f"socket://127.0.0.1:{number}")
    try:
        wait_until(lambda: reaches(link))
        seen: list = []
        while len(seen) < 200:
            link.exchange((0.0,) * 4)
            seen += link.samples()
        report = link.report()
        assert report["frames"]["bad"] == 0 and report["refused"] == 0 and report["firmware"] == "1.0.0"
        assert report["starts"] > 1 and not seen[-1].fault
        ticks = [(sample.sequence, sample.board_us) for sample in seen]
        assert all(a < b and 0 < later - sooner for (a, sooner), (b, later) in itertools.pairwise(ticks))
        wait_until(lambda: trips(link))
    finally:
        link.close()
        emulator.kill()
        emulator.wait()


def trips(link: SerialDevice) -> bool:
    """Whether the board's own watchdog acts when no command follows one for a current."""
    link.exchange((0.1, 0.0, 0.0, 0.0))
    time.sleep(0.3)
    link.exchange((0.0,) * 4)
    return any(sample.fault == "the board got no command for 50 ms" for sample in link.samples())


def reaches(link: SerialDevice) -> bool:
    """Whether the board behind a link answers by now."""
    try:
        link.open()
    except InputError:
        return False
    return True


@needs_compiler
def test_the_current_loop_settles_zero_is_zero_and_a_broken_wire_at_most_doubles_the_current(tmp_path: Path) -> None:
    """With a coil of 20 mH: also where resistance and supply are not the assumed ones."""
    loop = ctypes.CDLL(str(compiled(tmp_path, "loop.so", "-shared", "-fPIC", sources="current_loop.c")))
    for asked_mA, ohm, share in itertools.product((100, 1000), (6.0, 8.0, 12.0), (0.8, 1.0, 1.2)):
        integral, amperes, course = ctypes.c_int32(0), 0.0, []
        for k in range(1000):  # 100 ms
            mV = loop.current_loop_step(ctypes.byref(integral), asked_mA if k < 500 else 0, round(1000.0 * amperes))
            assert 0 <= mV <= 24_000 and (k < 500 or mV == 0)
            steady = mV / 1000.0 * share / ohm
            amperes = steady + (amperes - steady) * math.exp(-ohm / 0.020 / 10_000)
            course.append(1000.0 * amperes)
        assert max(course) <= 1.15 * asked_mA + 2.0
        assert all(abs(mA - asked_mA) <= 0.02 * asked_mA + 2.0 for mA in course[150:500]), "15 ms after the step"
        assert course[-1] < 1.0
    for asked_mA in (1, 100, 1000):  # nothing is measured
        integral = ctypes.c_int32(0)
        given = [loop.current_loop_step(ctypes.byref(integral), asked_mA, 0) for _ in range(10_000)]
        assert 8 * asked_mA <= max(given) <= 2 * 8 * asked_mA


def test_every_pin_of_the_map_is_there_once_and_the_page_has_the_table() -> None:
    rows = pin_map.rows()
    header = (SOURCES / "stm32f4" / "pins.h").read_text()
    assert len(rows) == header.count("    PIN(") >= 34
    for column in (0, 1, 2):
        assert len({row[column] for row in rows}) == len(rows), "a pin or place is wired twice"
    assert not {"PA13", "PA14", "PH0", "PH1"} & {row[1] for row in rows}, "the debugger's and the clock's"
    page = PAGE.read_text(encoding="utf-8")
    assert page.endswith("\n\n" + pin_map.table()), "write it anew: python hardware/firmware/pin_map.py"
