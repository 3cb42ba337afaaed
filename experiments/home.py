"""Where a device's handle is held while its encoders are homed."""

from collections.abc import Mapping

from core.device import Device
from core.path import point_at
from core.path_file import PathFile, build_path


def home_of(device: Device, paths: Mapping[int, PathFile]) -> tuple[float, float]:
    """Where the jig holds the handle, m; the middle of the first path where the device file has none."""
    if device.sensing is not None and device.sensing.home_m is not None:
        return device.sensing.home_m
    path = build_path(next(iter(paths.values())), "path")
    x, y, _, _ = point_at(path, 0.5 * path.length)
    return float(x), float(y)
