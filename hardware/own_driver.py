"""A device of another kind, by a file of its own: `--link driver:FILE.py` (docs/write-your-own-device.md)."""

import importlib.util
from collections.abc import Callable
from pathlib import Path

from core.device import Device
from core.device_interface import RealDevice
from core.files import InputError

DRIVER = "driver:"  # begins such a link
FUNCTION = "new_device"  # of the file: takes the device of the device file, returns the real one, not opened yet


def load_driver(link: str) -> Callable[[Device], RealDevice]:
    """The function of the file that a link names. InputError: there is no such file or function, or it fails."""
    path = Path(link.removeprefix(DRIVER))
    spec = importlib.util.spec_from_file_location(path.stem, path) if path.suffix == ".py" else None
    if spec is None or spec.loader is None or not path.is_file():
        raise InputError(f"--link {link}: must name a Python file: {DRIVER}FILE.py")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"{path}: cannot be loaded: {type(error).__name__}: {error}") from error
    function = getattr(module, FUNCTION, None)
    if not callable(function):
        raise InputError(f"{path}: has no function {FUNCTION}")
    return function
