"""What Home shows of the device before there are data: its handle on the path."""

from app.window.canvas.layers import SPACING_M
from app.window.canvas.path_marks import Sizes
from app.window.canvas.small_view import SmallView
from app.window.widgets.parts import Panel, column, row, text_label
from core.path import outline
from experiments.protocol import Protocol

PICTURE = Sizes(path=4.0, ring=13.0, handle=10.0)


class DevicePicture(Panel):
    """The protocol's first device with its handle between start and end."""

    def __init__(self) -> None:
        super().__init__("canvas")
        self._picture, self.title = SmallView(PICTURE), text_label("", bold=True)
        head = row(self.title, 1, text_label("Letters: joints with a brake", "quiet"))
        self.setLayout(column(head, (self._picture, 1), margins=(12, 8, 12, 8)))

    def show_protocol(self, protocol: Protocol) -> None:
        device, path = protocol.devices[0], next(iter(protocol.paths.values()))
        others = f", one of {len(protocol.devices)} devices" if len(protocol.devices) > 1 else ""
        self.title.setText(f"{device.name}{others}")
        way = outline(path, SPACING_M).tolist()
        self._picture.show_trial(device, path, tuple(way[len(way) // 2]))
        self._picture.show()
