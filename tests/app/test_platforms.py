"""What the program asks of each system: one clock for all processes, and a loop that is compiled."""

import re
import sys
import time
from pathlib import Path

import numba
import pytest

from app.loop import clock

ROOT = Path(__file__).resolve().parents[2]


def test_all_processes_read_one_clock_that_ticks_finely_on_each_system() -> None:
    """time.monotonic ticks every 15.6 ms on Windows before Python 3.13, and is not the clock of the compiled loop."""
    files = [file for folder in ("core", "hardware", "experiments", "app") for file in (ROOT / folder).rglob("*.py")]
    assert len(files) > 100
    wrong = re.compile(r"\bmonotonic(_ns)?\(|\btime\.(monotonic|time_ns|process_time_ns)\b")
    assert not [file for file in files if wrong.search(file.read_text(encoding="utf-8"))]


@pytest.mark.nojit
def test_the_loops_clock_is_the_one_of_the_other_processes() -> None:
    timer = clock.new_timer()
    for _ in range(100):
        before = time.perf_counter_ns()
        now = clock.now_ns(timer)
        assert before <= now <= time.perf_counter_ns()


def test_the_loop_is_compiled_on_every_system_that_the_program_is_for() -> None:
    assert clock.NATIVE == (not numba.config.DISABLE_JIT)
    words = clock.timer_words(clock.new_timer())
    assert words in ((clock.FINE_TIMER, clock.COARSE_TIMER) if sys.platform == "win32" else ("",))


@pytest.mark.skipif(sys.platform != "win32", reason="the older kind of timer is Windows'")
def test_without_a_fine_timer_the_loop_looks_at_the_clock_all_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    load = clock.ctypes.WinDLL

    class Older:
        """Windows before 10 1803."""

        def __init__(self, kernel32: object) -> None:
            self._kernel32 = kernel32
            create = kernel32.CreateWaitableTimerExW  # type: ignore[attr-defined]

            def make(attributes: object, name: object, flags: int, access: int) -> object:
                return None if flags else create(attributes, name, flags, access)

            self.CreateWaitableTimerExW = make

        def __getattr__(self, name: str) -> object:
            return getattr(self._kernel32, name)

    def load_older(name: str, **how: object) -> object:
        return Older(load(name, **how)) if name == "kernel32" else load(name, **how)

    monkeypatch.setattr(clock.ctypes, "WinDLL", load_older)
    timer = clock.new_timer()
    assert clock.timer_words(timer) == clock.COARSE_TIMER
    deadline = clock.now_ns(timer) + 5_000_000
    assert clock.sleep_until(deadline, timer) >= deadline
