"""Python's garbage is collected between Qt's events alone, in the thread of the windows."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import waiting

SUPPORT = Path(__file__).parents[1] / "support"


def watched(tmp_path: Path, *arguments: str) -> dict:
    """What `garbage_watch` saw."""
    environment = {
        **os.environ, "QT_QPA_PLATFORM": "offscreen", "XDG_CONFIG_HOME": str(tmp_path),
        "PYTHONPATH": os.pathsep.join((str(SUPPORT.parents[1]), str(SUPPORT))),
    }  # fmt: skip
    command = [sys.executable, str(SUPPORT / "garbage_watch.py"), *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=waiting.LONG_S)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_garbage_that_is_due_within_a_call_of_qt_waits_and_locks_nothing(tmp_path: Path) -> None:
    """`QObject::disconnect` holds a lock that the end of connected QObjects needs."""
    seen = watched(tmp_path, "lock")
    assert seen["all"] > 0 and seen["elsewhere"] == 0


@pytest.mark.parametrize(("what", "times"), [("pages", "2"), ("windows", "2")])
def test_nothing_is_collected_but_from_the_timer_while_pages_and_windows_come_and_go(tmp_path, what, times) -> None:
    seen = watched(tmp_path, what, times)
    assert seen["all"] > 0 and seen["elsewhere"] == 0


#: ends while a thread imports what other pages need, as after a start that is refused
END = """
import sys, time
from importlib import import_module
from PySide6.QtWidgets import QApplication
from app.window.widgets.work import BackgroundTask

application = QApplication([])
BackgroundTask(lambda _: None).ask(import_module, "app.window.analyse.analyse_page")
time.sleep(float(sys.argv[1]))
application.processEvents()
"""


def test_a_program_that_ends_while_its_threads_are_at_work_ends_well() -> None:
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "PYTHONPATH": str(SUPPORT.parents[1])}
    for after_s in ("0.1", "0.5"):
        command = [sys.executable, "-c", END, after_s]
        done = subprocess.run(command, env=environment, capture_output=True, timeout=waiting.LONG_S)
        assert done.returncode == 0, done.stderr
