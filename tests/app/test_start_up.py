"""What the app does not wait for when it starts. No times: machines differ."""

import subprocess
import sys

import pytest


def run_python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=200, check=True)
    return done.stdout.strip()


@pytest.mark.parametrize("module", ["app.ipc.client", "app.session_server.loop_process"])
def test_a_process_is_started_before_the_compiler_is_imported(module: str) -> None:
    """The window starts the session server with the one, the session server starts the loop with the other."""
    assert run_python(f"import sys, {module}; print('numba' in sys.modules)") == "False"


def test_the_windows_import_no_plots_and_no_statistics() -> None:
    code = "import sys, app.window.windows; print(*{'matplotlib', 'scipy.linalg', 'pyarrow'} & set(sys.modules))"
    assert run_python(code) == ""


def test_a_first_kernel_does_not_import_scipy_which_can_be_imported_afterwards() -> None:
    code = (
        "import sys; from core.path import Segment, outline;"
        "points = outline(Segment((0.0, 0.0), (0.0, 0.1)), 0.05);"
        "before = 'scipy.linalg' in sys.modules;"
        "from scipy.linalg import norm; print(before, norm(points[-1]))"
    )
    assert run_python(code) == "False 0.1"
