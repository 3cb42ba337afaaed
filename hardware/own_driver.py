"""A device of another kind, by a file of its own: `--link driver:FILE.py` (docs/bench.md)."""

import importlib.util
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

from core.device import Device
from core.device_interface import AnyDevice, DeviceError, DeviceSample, RealDevice
from core.files import InputError

DRIVER = "driver:"  # begins such a link
FUNCTION = "new_device"  # of the file: takes the device of the device file, returns the real one, not opened yet
#: What each method of a driver that has failed returns; the other methods raise a DeviceError.
FAILED: dict[str, Any] = {
    "exchange": None,
    "samples": [],
    "begin": None,
    "stop": None,
    "report": {},
    "end_record": {},
    "close": None,
}
PAUSE_S = 0.004  # of an exchange with a driver that has failed


def load_driver(link: str) -> Callable[[Device], RealDevice]:
    """The function of the file that a link names. InputError: there is no such file or function, or it fails."""
    path = Path(link.removeprefix(DRIVER))
    spec = importlib.util.spec_from_file_location(path.stem, path) if path.suffix == ".py" else None
    if spec is None or spec.loader is None:
        raise InputError(f"--link {link}: must name a Python file: {DRIVER}FILE.py")
    if not path.is_file():
        raise InputError(f"--link {link}: there is no such file")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise InputError(f"{path}: cannot be loaded: {type(error).__name__}: {error}") from error
    function = getattr(module, FUNCTION, None)
    if not callable(function):
        raise InputError(f"{path}: has no function {FUNCTION}")
    return function


def own_device(device: Device, link: str) -> RealDevice:
    """The device of the file that a link names. InputError: it makes none, or one without a member of `RealDevice`."""
    path, function = Path(link.removeprefix(DRIVER)), load_driver(link)
    try:
        made = function(device)
    except Exception as error:
        raise InputError(error_of(path, error)) from error
    members = {name for kind in (AnyDevice, RealDevice) for name, value in vars(kind).items() if callable(value)}
    missing = sorted(name for name in members if name[0] != "_" and not callable(getattr(made, name, None)))
    if missing:
        raise InputError(f"{path}: what {FUNCTION} returns has no {', '.join(missing)}")
    return cast(RealDevice, OwnDevice(made, path))


def error_of(path: Path, error: Exception) -> str:
    """An error of a driver in one sentence, with the line of its file."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    where = f"{path}, line {lines[-1]}" if lines else str(path)
    return f"{where}: {type(error).__name__}: {error}"


class OwnDevice:
    """A driver, whose first error ends it: nobody knows what it left half done.

    Its hardware takes the currents off by itself when no `exchange` comes.
    """

    def __init__(self, driver: Any, path: Path) -> None:
        self._driver, self._path = driver, path
        self.failed = ""  # its error, one sentence

    @property
    def problem(self) -> str:
        return self.failed or self._driver.problem

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._driver, name)
        return partial(self._call, name, value) if callable(value) and name != "clock" else value

    def _call(self, name: str, method: Callable[..., Any], *args: object) -> Any:
        if self.failed and name != "close":
            if name not in FAILED:
                raise DeviceError(self.failed)
            time.sleep(PAUSE_S if name == "exchange" else 0.0)
            return FAILED[name]
        try:
            return self._checked(name, method(*args))
        except (InputError, DeviceError):
            raise
        except Exception as error:
            self.failed = error_of(self._path, error)
            if name == "open":
                raise InputError(self.failed) from error
            if name not in FAILED:
                raise DeviceError(self.failed) from error
            return FAILED[name]

    def _checked(self, name: str, result: Any) -> Any:
        """The result of a method. TypeError: it is of the wrong type."""
        if name == "open":
            missing = [member for member in ("device", "port", "encoders", "force_channels", "problem", "zeroed")
                       if not hasattr(self._driver, member)]  # fmt: skip
            if missing:
                raise TypeError(f"once open it has no {', '.join(missing)}")
        if name == "samples" and not all(isinstance(sample, DeviceSample) for sample in result):
            raise TypeError("samples() must give a list of DeviceSample")
        if name in ("report", "end_record") and not isinstance(result, dict):
            raise TypeError(f"{name}() must give a dict, not {type(result).__name__}")
        return result
