"""Python's garbage is collected between Qt's events alone, in the thread of the windows."""

import gc
import os
import subprocess
import sys
import threading
from pathlib import Path

import waiting

from app.window.widgets.garbage import Collector

ROOT = Path(__file__).parents[2]


def test_what_is_due_waits_for_the_timer_of_the_windows(qapp, qtbot) -> None:
    """`QObject::disconnect`, as other calls of Qt, holds a lock that the end of connected QObjects needs."""
    seen: list[threading.Thread] = []
    note, usual = lambda phase, _: seen.append(threading.current_thread()), gc.get_threshold()
    gc.callbacks.append(note)
    collector = Collector(qapp)
    try:
        gc.set_threshold(100, 10, 10)
        kept = [[] for _ in range(10_000)]
        assert not gc.isenabled() and seen == [] and len(kept) == 10_000
        qtbot.waitUntil(lambda: bool(seen), timeout=60_000)
        assert set(seen) == {threading.main_thread()}
    finally:
        collector.stop()
        gc.callbacks.remove(note)
        gc.set_threshold(*usual)
        gc.unfreeze()
        gc.enable()


#: ends while a thread imports what other pages need, as after a start that is refused
END = """
import gc, sys, time
from importlib import import_module
from app.window.program import make_ready
from app.window.widgets.work import BackgroundTask

application = make_ready()
assert not gc.isenabled()
BackgroundTask(lambda _: None).ask(import_module, "app.window.analyse.analyse_page")
time.sleep(0.1)
application.processEvents()
"""


def test_a_program_that_ends_while_its_threads_are_at_work_ends_well(tmp_path: Path) -> None:
    environment = {
        **os.environ, "QT_QPA_PLATFORM": "offscreen", "PYTHONPATH": str(ROOT), "XDG_CONFIG_HOME": str(tmp_path),
    }  # fmt: skip
    done = subprocess.run([sys.executable, "-c", END], env=environment, capture_output=True, timeout=waiting.LONG_S)
    assert done.returncode == 0, done.stderr
