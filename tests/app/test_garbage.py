"""Python's garbage is collected between Qt's events alone, in the thread of the windows."""

import os
import subprocess
import sys
from pathlib import Path

import waiting

ROOT = Path(__file__).parents[2]


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
