"""The middle of the console: what the participant reads, over the workspace. With the mouse as the hand and one screen
the workspace can be worked on too: its pointer is the hand as well.
"""

import numpy as np
from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtGui import QMouseEvent, QResizeEvent
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from app.ipc import messages as m
from app.window import words
from app.window.hand import hand_is_mouse
from app.window.painting import theme
from app.window.painting.labels import line, word
from app.window.painting.workspace import Workspace
from core import tick_log
from experiments.plan import PlannedTrial


class Centre(QWidget):
    """Head and workspace."""

    results_asked = Signal()
    participant_asked = Signal()
    back_asked = Signal()
    aimed = Signal(float, float)  # m

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.large = word("", size=theme.HEAD, bold=True)
        self.small = line("", "quiet")  # a line of its own: the participant reads all of it
        self.small.setIndent(2)
        policy = self.small.sizePolicy()
        policy.setHeightForWidth(False)  # `_fit` says how high it is: the window's own height must not hang on it
        self.small.setSizePolicy(policy)
        self.results, self.participant, self.back = (
            QPushButton(text, objectName="small") for text in ("Results  F2", "Participant's view  F11", "Back  Esc")
        )
        for button, asked in (
            (self.results, self.results_asked),
            (self.participant, self.participant_asked),
            (self.back, self.back_asked),
        ):
            button.setFont(theme.font(theme.SMALL))
            button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
            button.clicked.connect(asked)
        self.workspace: Workspace | None = None
        self._opened: m.Opened | None = None
        self._snapshot = m.Snapshot(m.PREPARING)
        head = QHBoxLayout()
        head.setContentsMargins(2, 0, 0, 0)
        head.setSpacing(10)
        head.addWidget(self.large)
        head.addStretch(1)
        for button in (self.results, self.participant, self.back):
            head.addWidget(button)
        self._layout = QVBoxLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._layout.setSpacing(6)
        self._layout.addLayout(head)
        self._layout.addWidget(self.small)

    def show_opened(self, opened: m.Opened) -> None:
        """Another session or protocol: its devices and paths decide the scale."""
        before, self._opened = self._opened, opened
        if self.workspace is not None:
            if before is not None and same_places(before, opened):
                return
            self._layout.removeWidget(self.workspace)
            self.workspace.deleteLater()
        self.workspace = Workspace(opened.devices, opened.paths)
        self.workspace.view.setMouseTracking(True)
        self.workspace.view.installEventFilter(self)
        self._layout.addWidget(self.workspace, 1)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        """As many lines as the text needs, at least one, so that the workspace stays where it is."""
        lines = self.small.heightForWidth(self.width())
        self.small.setFixedHeight(max(lines, self.small.fontMetrics().height()))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The pointer over the workspace is the hand."""
        if event.type() == QEvent.Type.MouseMove and isinstance(event, QMouseEvent) and self.workspace is not None:
            self.aimed.emit(*self.workspace.view.to_plane(event.position()))
        return super().eventFilter(watched, event)

    def show_session(self, opened: m.Opened, snapshot: m.Snapshot, trying: bool) -> None:
        """Between trials: what the participant reads now."""
        self._snapshot = snapshot
        self.results.setVisible(bool(opened.participant) and snapshot.stage != m.RUNNING)
        self.back.setVisible(trying and snapshot.stage == m.NO_SESSION)
        if self.workspace is not None:
            self.workspace.set_blind(snapshot.blind)
        if snapshot.running is None:
            said = words.practised(snapshot) if trying else words.between(snapshot, opened, hand_is_mouse(opened))
            self._say(said)

    def begin(self, planned: PlannedTrial, tip: m.Point) -> None:
        """A trial, running or to come."""
        if self._opened is None or self.workspace is None:
            return
        device = next(device for device in self._opened.devices if device.name == planned.configuration)
        self.workspace.show_trial(device, self._opened.paths[planned.segment], tip, self._opened.rules)
        if self._snapshot.running is not None:
            self._say(words.moving(tick_log.APPROACH, not hand_is_mouse(self._opened)) or words.Said(""))

    def rest(self, tip: m.Point) -> None:
        """Between trials: the handle stands here."""
        if self.workspace is not None:
            self.workspace.rest(tip)

    def show_ticks(self, rows: np.ndarray, taken: bool) -> None:
        """Ticks (n, tick_log.WIDTH) of the running trial; taken: the pointer has hold of the handle."""
        if self._snapshot.running is None or self.workspace is None:
            return
        self.workspace.add(rows)
        if (said := words.moving(int(rows[-1, tick_log.PHASE]), taken or not hand_is_mouse(self._opened))) is not None:
            self._say(said)

    def _say(self, said: words.Said) -> None:
        self.large.setText(said.large)
        if said.small != self.small.text():
            self.small.setText(said.small)
            self._fit()


def same_places(a: m.Opened, b: m.Opened) -> bool:
    """Whether two sessions have the same devices and paths."""
    return [device.text for device in a.devices] == [device.text for device in b.devices] and a.paths == b.paths
