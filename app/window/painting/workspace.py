"""The console's centre: the workspace with the linkage, a line on the running trial, a button for each layer."""

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QFrame, QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from app.window.painting import theme
from app.window.painting.extent import Point
from app.window.painting.linkage_view import DIRECTIONS, FIELD, LINKAGE, REACHABLE, TRAIL, LinkageView
from app.window.painting.panel import WORDS_EVERY_S
from core import tick_log
from core.device import Device
from core.path_file import PathFile

#: layer -> its key, what it shows
LAYERS = {
    FIELD: ("F", "The desired direction of motion, everywhere"),
    DIRECTIONS: ("D", "The way that each brake alone would leave the tip; strong: nearest to the desired direction"),
    REACHABLE: ("W", "The forces that the brakes can exert against the present motion"),
    TRAIL: ("T", "The way of the handle in this trial"),
    LINKAGE: ("L", "Arms, brakes and their values"),
}
PHASE_NAMES = {tick_log.APPROACH: "Approach", tick_log.HOLD: "Hold", tick_log.MOVE: "Move", tick_log.END: "End"}


class Workspace(QFrame):
    """Linkage, forces and layers of one trial, with the buttons that show and hide them."""

    def __init__(self, devices: tuple[Device, ...], paths: dict[int, PathFile], parent: QWidget | None = None) -> None:
        super().__init__(parent, objectName="workspace")
        self.setStyleSheet(
            f"QFrame#workspace {{ background: {theme.CANVAS}; border: 1px solid {theme.LINE};"
            f" border-radius: {theme.RADIUS}px; }}"
        )
        self.view = LinkageView(devices, paths)
        self._began_s, self._phase, self._worded_s = 0.0, -1, -np.inf
        self.buttons = {layer: self._button(layer) for layer in LAYERS}
        row_of_buttons = QHBoxLayout()
        row_of_buttons.setContentsMargins(16, 0, 16, 10)
        row_of_buttons.setSpacing(8)
        for button in self.buttons.values():
            row_of_buttons.addWidget(button)
        row_of_buttons.addStretch(1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(2, 2, 2, 2)
        layout.setSpacing(4)
        layout.addWidget(self.view, 1)
        layout.addLayout(row_of_buttons)

    def _button(self, layer: str) -> QPushButton:
        key, shows = LAYERS[layer]
        button = QPushButton(f"{layer}  {key}", objectName="toggle")
        button.setMinimumHeight(26)  # half of it holds the round ends
        button.setFont(theme.font(theme.SMALL))
        button.setCheckable(True)
        button.setChecked(layer in self.view.shown)
        button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        QShortcut(QKeySequence(key), self, button.toggle).setAutoRepeat(False)
        button.setToolTip(shows)
        button.toggled.connect(lambda shown: self.view.show_layer(layer, shown))
        return button

    def show_trial(self, device: Device, path: PathFile, tip: Point, rules: str = "settled") -> None:
        """The coming or beginning trial: its device and path, the handle at rest at `tip` (m)."""
        self._phase, self._worded_s = -1, -np.inf
        self.view.show_trial(device, path, tip, rules)

    def rest(self, tip: Point) -> None:
        """Between trials: the handle stands at `tip` (m), brakes off; the trail stays to be looked at."""
        self._phase, self._worded_s = -1, -np.inf
        self.say("")
        self.view.rest(tip)

    def say(self, title: str, line: str = "") -> None:
        """What stands above the workspace while no trial runs."""
        self.view.say(title, line)

    def add(self, rows: np.ndarray) -> None:
        """Ticks (n, tick_log.WIDTH) since the last frame."""
        if not len(rows):
            return
        self.view.add(rows)
        now = rows[-1]
        if int(now[tick_log.PHASE]) != self._phase:
            self._phase = int(now[tick_log.PHASE])
            first = np.flatnonzero(rows[:, tick_log.PHASE] == self._phase)[0]
            self._began_s, self._worded_s = float(rows[first, tick_log.T]), -np.inf
        if not self._worded_s <= now[tick_log.T] < self._worded_s + WORDS_EVERY_S:
            self._worded_s = float(now[tick_log.T])
            self._word(now)

    def _word(self, now: np.ndarray) -> None:
        says = [f"{now[tick_log.T] - self._began_s:.2f} s"]
        if self.view.follower is not None and self._phase == tick_log.MOVE:
            says.append(f"error {1e3 * self.view.follower.error(now[tick_log.TIP_X], now[tick_log.TIP_Y]):.1f} mm")
        says.append(f"{np.hypot(now[tick_log.TIP_VX], now[tick_log.TIP_VY]):.2f} m/s")
        self.say(PHASE_NAMES[self._phase], " · ".join(says))
        self.view.word()

    def set_blind(self, blind: bool) -> None:
        """Hide brake colours, torques, the brakes' force and what they could exert."""
        self.view.set_blind(blind)
        self.buttons[REACHABLE].setVisible(not blind)
