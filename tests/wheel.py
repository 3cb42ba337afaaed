"""Tests from a built wheel, outside the tree: `python tests/wheel.py [OPTIONS OF PYTEST] FILES`, absolute paths.

The wheel is built from a copy and unpacked into an empty folder, which comes before the tree wherever Python looks. The
libraries are those of the .venv.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PARTS = ("app", "core", "experiments", "hardware", "phd-stubs", "LICENSE", "README.md", "phd.py", "pyproject.toml")
PIP = "wheel --no-deps --no-build-isolation --disable-pip-version-check --no-cache-dir --quiet".split()


def main() -> int:
    """The exit code of pytest, or of the build."""
    with tempfile.TemporaryDirectory(prefix="phd-wheel-") as folder:
        copy, installed = Path(folder, "copy"), Path(folder, "installed")
        copy.mkdir()
        for part in PARTS:
            source = ROOT / part
            shutil.copytree(source, copy / part) if source.is_dir() else shutil.copy2(source, copy)
        built = subprocess.call([sys.executable, "-m", "pip", *PIP, "--wheel-dir", folder, str(copy)])
        if built != 0:
            return built
        (wheel,) = Path(folder).glob("*.whl")
        zipfile.ZipFile(wheel).extractall(installed)
        config = ["-c", str(ROOT / "pyproject.toml"), "-o", "pythonpath=tests/support"]
        command = [sys.executable, "-P", "-m", "pytest", *config, *sys.argv[1:]]
        environment = os.environ | {"PYTHONPATH": str(installed), "PHD_WHEEL": str(installed)}
        return subprocess.call(command, cwd=installed, env=environment)


if __name__ == "__main__":
    sys.exit(main())
