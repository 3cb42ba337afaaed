"""The board in C is the same board on every processor: an int of 16 bits, a compiler for C++, warnings as errors.

What a machine has no compiler for is skipped; the width of an int is looked at with the C compiler of any machine.
"""

import re
import subprocess
from pathlib import Path

import pytest
from reference_board import COMPILER, FLAGS, SOURCES, found, needs_compiler

HEADERS = sorted(SOURCES.glob("phd_*.h"))
PARTS = sorted(SOURCES.glob("phd_*.c"))  # try_board.c is for this host alone
#: compiler and what it is told of its processor
PROCESSORS = {
    "this machine": ("cc",),
    "Cortex-M0": ("arm-none-eabi-gcc", "-mcpu=cortex-m0", "-mthumb"),
    "Cortex-M4": ("arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb"),
}
CPP = {
    "this machine": ("g++",),
    "Cortex-M4": ("arm-none-eabi-g++", "-mcpu=cortex-m4", "-mthumb"),
}
#: every function of the board, from C++
CALLER = """
#include "phd_board.h"
static phd_board board;
void phd_set_currents(const uint16_t *) {}
void phd_send(const uint8_t *, size_t) {}
int main()
{
    phd_capability made_of = phd_capability();
    phd_readings readings = phd_readings();
    uint8_t byte = 0;
    phd_board_power_up(&board, &made_of, 1, false, 0);
    phd_board_receive(&board, &byte, 1, 1);
    phd_board_tick(&board, &readings, PHD_TICK_US);
    return board.state + (int)phd_crc32(&byte, 0) + phd_states[PHD_ON_HELLO][PHD_BOOT] - PHD_IGNORED;
}
"""


def numbers() -> list[str]:
    """The names of all numbers in the headers."""
    text = "\n".join(re.sub(r"/\*.*?\*/", "", header.read_text(), flags=re.S) for header in HEADERS)
    in_enums = ",".join(re.findall(r"\benum\s*\w*\s*\{(.*?)\}", text, re.S))
    return re.findall(r"PHD_\w+(?=\s*(?:=|,|$))", in_enums) + re.findall(r"^#define (PHD_\w+) +\S", text, re.M)


@needs_compiler
def test_no_number_of_the_board_needs_an_int_of_more_than_16_bits(tmp_path: Path) -> None:
    lines = [f'printf("{name} %lld %d\\n", (long long)({name}), _Generic(({name}), int: 1, default: 0));'
             for name in numbers()]  # fmt: skip
    source = ['#include "phd_board.h"', "#include <stdio.h>", "int main(void) {", *lines, "}"]
    (tmp_path / "say.c").write_text("\n".join(source))
    subprocess.run([COMPILER, "-std=c11", f"-I{SOURCES}", tmp_path / "say.c", "-o", tmp_path / "say"], check=True)
    said = subprocess.run([tmp_path / "say"], capture_output=True, text=True, check=True).stdout.split()
    known = {
        name: (int(value), kind == "1") for name, value, kind in zip(said[::3], said[1::3], said[2::3], strict=True)
    }
    assert {"PHD_WATCHDOG_US", "PHD_LATE_US", "PHD_MAX_PAYLOAD", "PHD_BYE"} <= set(known) and len(known) > 60
    assert known["PHD_WATCHDOG_US"][0] == 50_000 and known["PHD_SILENCE_US"][0] == 1_000_000
    assert not [name for name, (value, is_int) in known.items() if is_int and not -(2**15) <= value < 2**15]


@pytest.mark.parametrize("processor", PROCESSORS)
def test_no_compiler_warns(processor: str, tmp_path: Path) -> None:
    compiler = PROCESSORS[processor]
    found(compiler[0])
    for part in PARTS:
        done = subprocess.run(
            [*compiler, *FLAGS, "-c", part, "-o", tmp_path / f"{part.stem}.o"], capture_output=True, text=True
        )
        assert done.returncode == 0 and not done.stderr, done.stderr


@pytest.mark.parametrize("processor", CPP)
def test_a_program_in_cpp_is_linked_with_the_board_in_c(processor: str, tmp_path: Path) -> None:
    compiler, *options = CPP[processor]
    found(compiler, compiler.replace("++", "cc"))
    (tmp_path / "caller.cpp").write_text(CALLER)
    files = []
    for file in (*PARTS, tmp_path / "caller.cpp"):
        files.append(tmp_path / f"{file.stem}.o")
        language = (compiler, "-std=c++11") if file.suffix == ".cpp" else (compiler.replace("++", "cc"), "-std=c99")
        flags = [flag for flag in FLAGS if not flag.startswith("-std")]
        subprocess.run([*language, *options, *flags, f"-I{SOURCES}", "-c", file, "-o", files[-1]], check=True)
    if processor != "Cortex-M4":  # which needs a start-up of its own
        subprocess.run([compiler, *options, *files, "-o", tmp_path / "caller"], check=True)
    if processor == "this machine":
        assert subprocess.run([tmp_path / "caller"]).returncode == 0
