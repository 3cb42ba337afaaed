"""The participant's window: path, start, end, the handle, one line of large text. Nothing else, unless the protocol
says so: no numbers, no controller's name, no brake's colour.
"""

import numpy as np
from PySide6.QtCore import QMarginsF, QRectF, Qt, Signal
from PySide6.QtGui import QCloseEvent, QMouseEvent, QPainter, QRegion, QResizeEvent
from PySide6.QtWidgets import QStackedLayout, QWidget

from app.ipc import messages as m
from app.window import words
from app.window.painting import theme
from app.window.painting.layers import extent_of_linkages, extent_of_paths, joints_at
from app.window.painting.plane import FROM_AFAR, Plane, Sizes
from app.window.painting.theme import pen
from app.window.questionnaire import Questionnaire
from app.window.words import Said, hand_is_mouse
from core import tick_log
from core.device import Device
from experiments.plan import PlannedTrial

LARGE_SHARE, SMALL_SHARE = 0.085, 0.032  # of the height: legible from two metres
TEXT_SHARE = 0.30  # of the height, at the bottom: for the text
TEXT_TOP, TEXT_ALONE = 0.735, 0.40  # of the height: where the text begins, under the path and without one
EDGE_SHARE = 0.06
MARGIN_M = 0.045  # around the paths


class ParticipantView(Plane):
    """The picture."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(QRectF(-0.15, 0.2, 0.3, 0.25), FROM_AFAR, parent=parent)
        self.said = Said("")
        self.mouse = True
        self._device: Device | None = None  # whose linkage is shown

    def say(self, said: Said) -> None:
        """The line of large text, and the quiet one under it."""
        if said != self.said:
            self.said = said
            self.repaint_still()

    def show_linkage(self, device: Device | None) -> None:
        """Draw the arms of a device; None: no linkage."""
        self._device = device
        self.update()

    def resizeEvent(self, event: QResizeEvent) -> None:
        height, edge = self.height(), EDGE_SHARE * self.height()
        self._keep_free = QMarginsF(edge, edge, edge, TEXT_SHARE * height)
        self.sizes = scaled(FROM_AFAR, min(height / 900.0, self.width() / 1200.0))
        super().resizeEvent(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self.mouse and self.tip is not None:  # else there is nothing to take hold of
            super().mouseMoveEvent(event)

    def moving(self) -> QRegion:
        return super().moving() if self._device is None else QRegion(self.rect())

    def paint_under_path(self, painter: QPainter) -> None:
        height = float(self.height())
        centre = Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignVCenter
        top = TEXT_TOP if len(self.outline) else TEXT_ALONE
        for text, share, down, bold, colour in (
            (self.said.large, LARGE_SHARE, 0.0, True, theme.TEXT),
            (self.said.small, SMALL_SHARE, 1.3 * LARGE_SHARE, False, theme.QUIET),
        ):
            size = round(share * height)
            chosen = theme.font(size, bold)
            painter.setFont(chosen)
            while painter.fontMetrics().horizontalAdvance(text) > self.width() - 16 and size > theme.SMALL:
                size -= 1
                chosen.setPixelSize(size)
                painter.setFont(chosen)
            painter.setPen(theme.colour(colour))
            painter.drawText(QRectF(0.0, (top + down) * height, self.width(), 1.4 * share * height), centre, text)

    def paint_under_handle(self, painter: QPainter) -> None:
        if self._device is None or self.tip is None:
            return
        at = {joint: self.to_screen(place) for joint, place in joints_at(self._device.mechanism, self.tip).items()}
        for width, shade in ((12.0, theme.ARM), (3.0, theme.ARM_CORE)):
            painter.setPen(pen(shade, width))
            for one, other in ("AE", "ED", "BC", "CD"):
                if one in at and other in at:
                    painter.drawLine(at[one], at[other])


def scaled(sizes: Sizes, share: float) -> Sizes:
    """The same marks, larger or smaller."""
    return Sizes(*(max(share, 0.45) * size for size in sizes))


class ParticipantWindow(QWidget):
    """The picture and, after a block that asks for it, the questions."""

    aimed = Signal(float, float)  # m
    left = Signal()  # the pointer has left the picture: the hand lets the handle go
    answered = Signal(dict)
    close_asked = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("phd: participant")
        self.setMinimumSize(480, 320)
        self.view = ParticipantView()
        self.questions = Questionnaire()
        self._opened: m.Opened | None = None
        self._snapshot = m.Snapshot(m.PREPARING)
        self.own_start = False  # the person who reads this has the space bar too
        self.leaving = False
        self._tried = False  # a practice trial without a session was the last thing that happened
        self._stack = QStackedLayout(self)
        self._stack.addWidget(self.view)
        self._stack.addWidget(self.questions)
        self.view.pointer_moved.connect(self.aimed)
        self.view.pointer_left.connect(self.left)
        self.questions.answered.connect(self.answered)

    def show_opened(self, opened: m.Opened) -> None:
        """A session, or a protocol before one."""
        self._opened = opened
        self.view.mouse = hand_is_mouse(opened)
        if not self.view.mouse:
            self.view.show_pointer(None)
        paths = opened.paths.values()
        self.view.set_extent(
            extent_of_linkages(opened.devices, paths) if opened.show_linkage else extent_of_paths(paths, MARGIN_M)
        )

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        """Where the session is."""
        before, self._snapshot = self._snapshot, snapshot
        if (snapshot.stage == m.QUESTIONS) != (before.stage == m.QUESTIONS):
            self.questions.clear()
        self.questions.show_feedback(words.feedback(snapshot, self._opened))
        self._stack.setCurrentWidget(self.questions if snapshot.stage == m.QUESTIONS else self.view)
        if snapshot.running is not None:
            if snapshot.running != before.running or before.stage != m.RUNNING:
                self._show_trial(snapshot.running, snapshot.tip)
                self.view.say(words.moving(tick_log.APPROACH, False) or Said(""))
            return
        self.view.show_handle(snapshot.tip)
        if snapshot.stage in (m.RERIG, m.BREAK, m.FINISHED, m.FAILED, m.NO_SESSION, m.PREPARING):
            self.view.show_path(None)
            self.view.show_handle(None)
            self.view.show_pointer(None)
        elif snapshot.coming is not None and (not snapshot.rows or self.view.path is None):
            self._show_trial(snapshot.coming, snapshot.tip)
        if snapshot.stage != m.NO_SESSION:
            self._tried = False
        elif before.stage == m.RUNNING:
            self._tried = before.practice
        self._say(words.practised(snapshot, self.own_start) if self._tried else self._between())

    def leave_practice(self) -> None:
        """Back from practice: the page before a session stands on the console."""
        self._tried = False
        self._say(self._between())

    def _between(self) -> Said:
        return words.between(self._snapshot, self._opened, self.own_start)

    def _say(self, said: Said) -> None:
        """Between trials."""
        self.view.say(words.with_keys(said, self._snapshot) if self.own_start else said)

    def _show_trial(self, planned: PlannedTrial, tip: m.Point) -> None:
        if self._opened is None:
            return
        self.view.show_path(self._opened.paths[planned.segment])
        device = next((one for one in self._opened.devices if one.name == planned.configuration), None)
        self.view.show_linkage(device if self._opened.show_linkage else None)
        self.view.show_handle(tip)

    def show_ticks(self, rows: np.ndarray, taken: bool) -> None:
        """The newest ticks (n, tick_log.WIDTH) of the running trial; taken: the pointer has hold of the handle."""
        if self._snapshot.running is None or not len(rows):
            return
        held = taken or not self.view.mouse
        now = rows[-1]
        tip = (float(now[tick_log.TIP_X]), float(now[tick_log.TIP_Y]))
        force = float(now[tick_log.HAND_FX] ** 2 + now[tick_log.HAND_FY] ** 2) ** 0.5
        self.view.show_handle(tip, taken and self.view.mouse, force)
        if taken and self.view.mouse and not (self.view.pointer and self.view.underMouse()):
            self.view.show_pointer((float(now[tick_log.TARGET_X]), float(now[tick_log.TARGET_Y])))
        if now[tick_log.PHASE] == tick_log.MOVE:
            self.view.extend_trail(tip)
        said = words.moving(int(now[tick_log.PHASE]), held)
        if said is not None:
            self.view.say(said)

    def show_dead(self) -> None:
        """The session server has ended."""
        self._snapshot = m.Snapshot(m.FAILED)
        self.view.show_handle(None)
        self.view.show_path(None)
        self._stack.setCurrentWidget(self.view)
        self.view.say(words.between(self._snapshot, self._opened))

    def closeEvent(self, event: QCloseEvent) -> None:
        """Closing is the console's: it asks while something is recorded."""
        if not self.leaving:
            event.ignore()
            self.close_asked.emit()
