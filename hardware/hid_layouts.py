"""Six-axis HID devices: which there are, and what the bytes of their reports mean (data in hid_layouts.toml)."""

from functools import cache
from pathlib import Path
from typing import NamedTuple

from core.files import Table, parse_toml, read_text

_FILE = Path(__file__).with_name("hid_layouts.toml")
AXES = ("x", "y", "z", "rx", "ry", "rz")


class Layout(Table, frozen=True):
    """One way of reporting six axes."""

    name: str
    devices: tuple[str, ...]  # "vendor:product", hexadecimal
    length: dict[str, int]  # report number -> bytes, its number included
    axes: dict[str, tuple[int, int]]  # axis -> report number, byte after it


class Layouts(Table, frozen=True):
    """The whole file."""

    usage_page: int
    usage: int
    full_scale_counts: int
    buttons_report: int
    layout: tuple[Layout, ...]


class Attached(NamedTuple):
    """A device that is plugged in and known here."""

    path: bytes  # where the system has it
    ids: str  # "046d:c626"
    product: str
    layout: Layout
    serial: str = ""

    @property
    def who(self) -> tuple[str, str]:
        """What stays the same when it is plugged in again; two without a number, of one kind, are not told apart."""
        return self.ids, self.serial


@cache
def layouts() -> Layouts:
    """The shipped layouts."""
    return parse_toml(read_text(_FILE), Layouts, _FILE.name)


def layout_of(vendor: int, product: int) -> Layout | None:
    """The layout of a device by its USB numbers; None: not known."""
    ids = f"{vendor:04x}:{product:04x}"
    return next((layout for layout in layouts().layout if ids in layout.devices), None)


def attached(listed: list[dict]) -> list[Attached]:
    """The known six-axis devices in what `hid.enumerate()` lists (one device may be listed once per usage)."""
    found = {}
    for entry in listed:
        layout = layout_of(entry["vendor_id"], entry["product_id"])
        usage = (entry.get("usage_page", 0), entry.get("usage", 0))
        if layout and usage in ((layouts().usage_page, layouts().usage), (0, 0)):
            ids = f"{entry['vendor_id']:04x}:{entry['product_id']:04x}"
            name = entry.get("product_string") or "six-axis device"
            found[entry["path"]] = Attached(entry["path"], ids, name, layout, entry.get("serial_number") or "")
    return list(found.values())


def decode(layout: Layout, report: bytes, counts: dict[str, int]) -> bool:
    """Put the axes that a report carries into `counts`; False if it carries none (buttons, other lengths)."""
    if not report or layout.length.get(str(report[0])) != len(report):
        return False
    for axis, (number, byte) in layout.axes.items():
        if number == report[0]:
            counts[axis] = int.from_bytes(report[1 + byte : 3 + byte], "little", signed=True)
    return True
