"""The board on the bench as Home offers it: what answers at the ports, and which port is connected."""

from functools import partial
from typing import NamedTuple

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QLineEdit, QPushButton, QWidget

from app.ipc import messages as m
from app.window.widgets import theme
from app.window.widgets.page import DEVICE, Page
from app.window.widgets.parts import OneLine, button, clear, column, row, show_wait, wrapped_label
from app.window.widgets.work import Watch
from hardware.discovery import BoardFound, scan_ports

OPENING = "Opening …"


class Link(NamedTuple):
    """The port that was chosen, how its board is, and the port that comes next."""

    port: str = ""
    device: m.Check = m.Check("Device", m.WAITING, OPENING)
    opening: str = ""


class BoardPorts(QWidget):
    """The ports, looked at again and again while they are shown."""

    connect_asked = Signal(str)  # to this port

    def __init__(self, page: Page) -> None:
        """page: the one that they stand on, which leads to the device's."""
        super().__init__()
        self._page = page
        self.setObjectName("clear")
        self._found: tuple[BoardFound, ...] = ()
        self._link = Link()
        self._looking = Watch(self, lambda: (scan_ports, self._found, self._link.port), self._show_found)
        self.port = QLineEdit(placeholderText="Another port", accessibleName="Port")
        self.port.returnPressed.connect(self._connect_typed)
        self.port.textChanged.connect(lambda _: self._show_typed())
        self.again = button("Look again", self._look_anew)
        self._rows = column()
        self.connect_typed = button("Connect", self._connect_typed)
        self.setLayout(column(self._rows, row((self.port, 1), self.again, self.connect_typed)))
        self._fill()

    def show_link(self, port: str, checks: tuple[m.Check, ...] = (), opening: str = "") -> None:
        """The port that was chosen ("": none), and what the session server finds there; (): it is being opened.

        opening: the port that comes next, while the session server before it ends.
        """
        device = next((check for check in checks if check.name == "Device"), Link().device)
        if (link := Link(port, device, opening)) != self._link:
            self._link = link
            if self.port.text() == port:
                self.port.clear()
            self._fill()

    def _look_anew(self) -> None:
        """Ask every port, those that did not answer too."""
        self._found = ()
        self._looking.look()

    def _show_found(self, found: tuple[BoardFound, ...]) -> None:
        if found != self._found:
            self._found = found
            self._fill()

    def _fill(self) -> None:
        clear(self._rows)
        port, device, opening = self._link
        if port:
            own = button("Device page  F3", lambda: self._page.page_asked.emit(DEVICE, None))
            connected = device.state not in (m.BAD, m.WAITING)
            words = wrapped_label("connected" if connected else device.text, "good" if connected else "caution")
            self._rows.addLayout(row_of(port, words, own))
        for found in (board for board in self._found if board.port != port):
            connect = button("Connect", partial(self.connect_asked.emit, found.port))
            if found.port == opening:
                show_wait(connect, OPENING)
            self._rows.addLayout(row_of(found.port, wrapped_label(found.words, "quiet"), connect))
        self._show_typed()
        if not self._found and not port:
            self._rows.addWidget(wrapped_label("No board answers on USB. Plug one in, or type its port.", "quiet"))

    def _show_typed(self) -> None:
        """The button beside the port that is typed: dead while none is, or while one is being opened."""
        typed = self._link.opening not in ("", *(board.port for board in self._found))
        self.connect_typed.setText(OPENING if typed else "Connect")
        self.connect_typed.setEnabled(bool(self.port.text()) and not self._link.opening)

    def _connect_typed(self) -> None:
        if self.port.text():
            self.connect_asked.emit(self.port.text())


def row_of(port: str, words: QLabel, do: QPushButton) -> QHBoxLayout:
    """A port, which may have a long name, with how it is below; beside both what can be done."""
    return row((column(OneLine(port, size=theme.NORMAL), words, spacing=2), 1), do)
