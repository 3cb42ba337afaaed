"""A Python process of this program: it finds the program wherever it was started from, and starts fast."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from app.ipc.scheduling import program_cores

_ROOT = str(Path(__file__).resolve().parent.parent.parent)


def start_python(
    module: str, *arguments: str, environment: dict[str, str] | None = None, **options: Any
) -> subprocess.Popen:
    """Run `main` of a module in a new process; `environment` is added to ours, options as for Popen.

    Not `-m`: what it pickles is of that module.
    """
    program_cores()  # handed down
    path = os.environ.get("PYTHONPATH", "")
    found = {"PYTHONPATH": f"{_ROOT}{os.pathsep}{path}" if path else _ROOT}
    command = [sys.executable, "-c", f"from {module} import main; main()", *arguments]
    if sys.platform == "win32":  # neither a console window of its own nor the Ctrl-C of ours
        options["creationflags"] = subprocess.CREATE_NO_WINDOW
    return subprocess.Popen(command, env=os.environ | found | (environment or {}), **options)
