"""The participant's window: path, start, end, the handle, one line of large text. Nothing else, unless the protocol
says so: no numbers, no controller's name, no brake's colour.
"""

import time
from collections.abc import Collection

import numpy as np
from PySide6.QtCore import QMarginsF, QPointF, QRect, QRectF, Qt, Signal
from PySide6.QtGui import QCloseEvent, QHideEvent, QPainter, QShowEvent
from PySide6.QtWidgets import QStackedLayout, QWidget

from app.ipc import messages as m
from app.window.canvas.force_view import way_of
from app.window.canvas.layers import SPACING_M, joints_at
from app.window.canvas.marks import paint_arms
from app.window.canvas.path_marks import FROM_AFAR, Sizes, paint_disc, paint_hold
from app.window.canvas.plane import Plane
from app.window.participant.consent_page import ConsentPage
from app.window.participant.questionnaire import Instructions, Questionnaire
from app.window.participant.tone import Tones
from app.window.widgets import theme, words
from app.window.widgets.parts import PART
from app.window.widgets.theme import COLOURS
from app.window.widgets.words import Shown, hand_is_mouse
from core import tick_log
from core.device import Device
from core.obstacles import ObstacleFile
from core.path import PathFile, outline
from experiments.inputs import is_person
from experiments.language import Language
from experiments.plan import PlannedTrial
from experiments.protocol_file import Consent

LARGE_SHARE, SMALL_SHARE = 0.085, 0.032  # of the height: legible from two metres
SMALL_ROOM = 0.07  # of the height: what all quiet lines have under the large one
LINE = 1.2  # of the size of its letters: how high a line is
TEXT_TOP, TEXT_ALONE = 0.81, 0.40  # of the height: where the text begins, under the path and without one
EDGE_SHARE = 0.035  # of the height, under the rings of all paths; of the paths' width, beside them, at least
TOP_SHARE = 0.10  # of the height, above the rings: a hand that strays there is still seen
PATH_SHARE = 0.5  # of the width, that a session's widest path takes where the height allows it
RIM_PX = 3.0  # around the handle
ARM_SHARE = 0.7  # of the radius of the handle: how wide an arm is
LEAST_SHARE = 0.45  # of the size of the marks, in a small window
LEFT_EARLY_S = 1.5  # the hint that the start was left too early stands at least so long


class ParticipantView(Plane):
    """Path, handle and text, as the participant sees them."""

    def __init__(self) -> None:
        super().__init__(QRectF(-0.15, 0.2, 0.3, 0.25), FROM_AFAR)
        self.shown = Shown("")
        self.held = 0.0  # share of the hold at the start that is over
        self.side = 0  # where the text stands: in the middle, or out of the handle's way, left (-1) or right (1)
        self.mouse = True
        self.show_linkage(None)

    def write(self, shown: Shown) -> None:
        """The line of large text, and the quiet one under it."""
        if shown != self.shown:
            self.shown = shown
            self.repaint_still()

    def show_hold(self, share: float) -> None:
        """How much of the hold at the start is over."""
        if share != self.held:
            self.held = share
            self.update()

    def show_handle(self, tip: m.Point | None, taken: bool | None = None, force_N: float = 0.0) -> bool:
        changed = super().show_handle(tip, taken, force_N)
        at = self.to_screen(tip) if tip is not None else QPointF()
        down, side = at.y() / max(self.height(), 1), -1 if at.x() > 0.5 * self.width() else 1
        side = side if down > TEXT_TOP - (0.01 if self.side else 0.0) else 0  # the text is never under the dot
        if side != self.side:
            self.side = side
            self.repaint_still()
        return changed

    def moving_box(self) -> QRect:
        return super().moving_box() if self._device is None else self.rect()

    def show_linkage(self, device: Device | None) -> None:
        """Draw the arms of a device, and the text above them; None: no linkage."""
        self._device = device
        marks, text = [self._paint_hold, self._paint_arms, self._paint_rim], self._paint_text
        self.under_path, self.under_handle = ([text], [*marks]) if device is None else ([], [*marks, text])
        self.repaint_still()

    def fit(self) -> None:
        height, edge = self.height(), EDGE_SHARE * self.height()
        self._keep_free = QMarginsF(0.0, TOP_SHARE * height, 0.0, (1.0 - TEXT_TOP) * height + edge)
        share = max(min(height / 900.0, self.width() / 1200.0), LEAST_SHARE)
        self.sizes = Sizes(*(share * size for size in FROM_AFAR))
        super().fit()

    def point_at(self, at: QPointF) -> None:
        if self.mouse and self.tip is not None:  # else there is nothing to take hold of
            super().point_at(at)

    def _paint_text(self, painter: QPainter) -> None:
        height = self.height()
        centre = Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignVCenter
        top = (TEXT_TOP if len(self.outline) else TEXT_ALONE) * height
        left, width = (0.5 * self.width() * (self.side > 0), 0.46 * self.width()) if self.side else (0.0, self.width())
        small = list(filter(None, self.shown.small.rpartition(PART)[::2]))  # feedback, and what comes next
        small_share = min(SMALL_SHARE, SMALL_ROOM / (LINE * max(len(small), 1)))
        quiet = ((text, small_share, False, COLOURS.quiet) for text in small)
        for text, share, bold, colour in ((self.shown.large, LARGE_SHARE, True, COLOURS.text), *quiet):
            size = round(share * height)
            line = QRectF(left, top, width, LINE * size)
            while size > 1 and theme.text_width(text, size, bold) > width - 2.0 * EDGE_SHARE * height:
                size -= 1
            painter.setFont(theme.font(size, bold))
            painter.setPen(theme.shade(colour))
            painter.drawText(line, centre, text)
            top = line.bottom()

    def _paint_hold(self, painter: QPainter) -> None:
        if self.held > 0.0 and len(self.outline):
            paint_hold(painter, self.to_screen(self.outline[0]), self.rings_px[0], self.held, 2.0 * self.sizes.ring_pen)

    def _paint_arms(self, painter: QPainter) -> None:
        if self._device is not None and self.tip is not None:
            joints = joints_at(self._device.mechanism, self.tip)
            wide = ARM_SHARE * self.sizes.handle
            paint_arms(painter, {joint: self.to_screen(place) for joint, place in joints.items()}, wide, 0.25 * wide)

    def _paint_rim(self, painter: QPainter) -> None:
        """Around the handle, so that it is found on the line, which has its colour."""
        if self.tip is not None:
            paint_disc(painter, self.to_screen(self.tip), self.handle_px + RIM_PX, COLOURS.canvas)


def extent_at_half_width(
    paths: Collection[PathFile], radii_m: tuple[float, float], obstacles: Collection[ObstacleFile]
) -> QRectF:
    """The rectangle (m) to be seen so that the widest path takes half of the width; radii_m: of the rings at its ends.

    Our choice: one scale for a session, so that the same movement of the hand is the same on the screen in every
    trial; a narrower path then takes less than half. Where the paths are too high for that above the text, the height
    decides (the paper's, 16 cm, on a screen wider than 16:9), because a path must be seen whole, and so must an
    obstacle that has an end; paths that lie side by side must all be seen where they are.
    """
    lines = [np.asarray(outline(path, SPACING_M)) for path in paths]
    start, end = radii_m
    rings = [(a - start, a + start, b - end, b + end) for a, b in ((line[0], line[-1]) for line in lines)]
    bounded = [obstacle.outline() for obstacle in obstacles if obstacle.half_plane_m is None]
    places = np.vstack([*lines, *np.vstack(rings), *bounded])
    (left, low), (width, height) = places.min(axis=0), np.ptp(places, axis=0)
    widest = max(np.ptp(line[:, 0]) for line in lines)
    beside = max(0.5 * (widest / PATH_SHARE - width), EDGE_SHARE * width)
    return QRectF(left - beside, low, width + 2.0 * beside, height)


class ParticipantWindow(QWidget):
    """The picture; before it the pages of instructions, and after a block or a controller the questions."""

    close_asked = Signal()
    changed = Signal()  # whether it is seen, so that questions are answered here; or the page of instructions

    def __init__(self) -> None:
        super().__init__()
        self.setWindowTitle("PHD: participant")
        self.setMinimumSize(480, 320)
        self.view = ParticipantView()
        self.questions, self.instructions, self.consent = Questionnaire(), Instructions(), ConsentPage()
        self._asks_consent = False
        self.tones = Tones()
        self._opened: m.Opened | None = None
        self._snapshot = m.Snapshot(m.PREPARING)
        self.own_start = False  # the person who reads this has the space bar too
        self.leaving = False
        self._rest_until_s, self._told = 0.0, (False, False, 0)
        self._phase, self._since_s, self._early_s = -1, 0.0, -LEFT_EARLY_S
        self.setObjectName("participant")
        self._stack = QStackedLayout(self)
        for widget in (self.view, self.questions, self.instructions, self.consent):
            self._stack.addWidget(widget)
        self.instructions.turned.connect(self.start)

    def show_opened(self, opened: m.Opened) -> None:
        """A session, or a protocol before one."""
        protocol = opened.protocol
        if self._opened is None or opened.folder != self._opened.folder:
            reads = opened.participant and is_person(opened.hand)
            self.instructions.show_pages(protocol.pages if reads else (), protocol.sentences)
        self._opened = opened
        self.questions.show_language(protocol.sentences)
        self.view.mouse = hand_is_mouse(opened)
        self.view.show_obstacles(protocol.obstacle)
        self.view.trail_shown = protocol.show_trace
        self.view.radii_m = (protocol.trial.start_radius_m, protocol.trial.end_radius_m)
        if not self.view.mouse:
            self.view.show_pointer(None)
        self.view.set_extent(extent_at_half_width(protocol.paths.values(), self.view.radii_m, protocol.obstacle))

    def ask_consent(self, consent: Consent | None) -> None:
        """Ask whether the participant takes part; None: not any more."""
        self._asks_consent = consent is not None
        if consent is not None:
            self.consent.show_consent(consent)
        self._choose_page()

    @property
    def asks(self) -> bool:
        """Whether the participant answers something here, perhaps with the keyboard."""
        return self._stack.currentWidget() in (self.questions, self.consent)

    def start(self) -> bool:
        """Space or a click: the next page of the instructions; whether there was one."""
        turned = self._stack.currentWidget() is self.instructions and self.instructions.turn()
        self._choose_page()
        return turned

    def _choose_page(self) -> None:
        instructs = self._snapshot.stage == m.READY and not self._snapshot.rows and not self.instructions.over
        page = self.questions if self._snapshot.stage == m.QUESTIONS else self.instructions if instructs else self.view
        self._stack.setCurrentWidget(self.consent if self._asks_consent else page)
        self._tell()

    @property
    def reads(self) -> bool:
        """Whether instructions are to be read, here or, if this is not seen, on Run."""
        return self._stack.currentWidget() is self.instructions

    def _tell(self) -> None:
        if (now := (self.isVisible(), self.reads, self.instructions.at)) != self._told:
            self._told = now
            self.changed.emit()

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._tell()

    def hideEvent(self, event: QHideEvent) -> None:  # a minimised one is still visible
        super().hideEvent(event)
        self._tell()

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        before, self._snapshot = self._snapshot, snapshot
        if snapshot.stage not in (m.QUESTIONS, m.PREPARING):  # the second: a control loop is started again meanwhile
            self.questions.clear()
        self.questions.show_feedback(words.feedback(snapshot, self._opened))
        if snapshot.running is not None:  # it is too late for the instructions
            self.instructions.leave()
        self._choose_page()
        if snapshot.running is not None:
            if snapshot.running != before.running or before.stage != m.RUNNING:
                self._show_trial(snapshot.running, snapshot.tip)
                self.view.write(words.moving(tick_log.APPROACH, False, self._language))
            return
        self.view.show_handle(snapshot.tip)
        self.view.show_hold(0.0)
        step = snapshot.card is not None and snapshot.stage != m.QUESTIONS
        if step or snapshot.stage in (m.FINISHED, m.FAILED, m.NO_SESSION, m.PREPARING):
            self.view.show_path(None)
            self.view.show_handle(None)
            self.view.show_pointer(None)
        elif snapshot.coming is not None and (not snapshot.rows or self.view.path is None):
            self._show_trial(snapshot.coming, snapshot.tip)
        if snapshot.stage == m.BREAK and before.stage != m.BREAK:
            self._rest_until_s = time.perf_counter() + (snapshot.card.wait_s if snapshot.card else 0.0)
        self._write_between()

    @property
    def _language(self) -> Language:
        return words.language_of(self._opened)

    def _write_between(self) -> None:
        shown = words.between(self._snapshot, self._opened, self.own_start)
        if self._snapshot.stage == m.BREAK and (left := self._rest_until_s - time.perf_counter()) > 0.0:
            how = self._language["break_left"].format(time=words.clock(left))
            shown = shown._replace(small=shown.small.replace(self._language["break_how"], how))
        self.view.write(words.with_keys(shown, self._snapshot, self._language) if self.own_start else shown)

    def show_time(self) -> None:
        """What only the clock changes: the rest that is left."""
        if self._snapshot.stage == m.BREAK:
            self._write_between()

    def _show_trial(self, planned: PlannedTrial, tip: m.Point) -> None:
        if self._opened is None:
            return
        self._phase, self._early_s = -1, -LEFT_EARLY_S
        protocol = self._opened.protocol
        self.view.show_path(protocol.paths[planned.path])
        self.view.show_linkage(protocol.device(planned.configuration) if protocol.show_linkage else None)
        self.view.show_handle(tip)

    def show_ticks(self, rows: np.ndarray, taken: bool) -> None:
        """The newest ticks (n, tick_log.WIDTH) of the running trial; taken: the pointer has hold of the handle."""
        if self._snapshot.running is None or not len(rows):
            return
        self.view.extend_trail(way_of(rows))
        self._follow_phase(rows)  # tones are heard where this window is not seen, too
        if not self.isVisible():
            return
        held = taken or not self.view.mouse
        now = rows[-1]
        tip = (float(now[tick_log.TIP_X]), float(now[tick_log.TIP_Y]))
        force = float(now[tick_log.HAND_FX] ** 2 + now[tick_log.HAND_FY] ** 2) ** 0.5
        self.view.show_handle(tip, taken if self.view.mouse else None, force)
        if taken and self.view.mouse and not (self.view.pointer and self.view.underMouse()):
            self.view.show_pointer((float(now[tick_log.TARGET_X]), float(now[tick_log.TARGET_Y])))
        early = float(now[tick_log.T]) < self._early_s + LEFT_EARLY_S
        since_s = float(now[tick_log.T]) - self._since_s
        self.view.write(words.moving(self._phase, held, self._language, early, self.view.handle_seen, since_s))

    def _follow_phase(self, rows: np.ndarray) -> None:
        """Tones, the sweep of the hold, and whether the start was left too early."""
        now, t = int(rows[-1, tick_log.PHASE]), float(rows[-1, tick_log.T])
        if now != self._phase:
            self._since_s = float(rows[np.argmax(rows[:, tick_log.PHASE] == now), tick_log.T])
            if self._phase == tick_log.HOLD and now == tick_log.APPROACH:
                self._early_s = t
            if self._opened is not None and self._opened.protocol.tones and now in (tick_log.MOVE, tick_log.END):
                self.tones.play("go" if now == tick_log.MOVE else "end")
            self._phase = now
        hold_s = self._opened.protocol.trial.hold_s if self._opened is not None else 0.0
        holds = now == tick_log.HOLD and hold_s > 0.0
        self.view.show_hold(min((t - self._since_s) / hold_s, 1.0) if holds else 0.0)

    def show_dead(self) -> None:
        """The session server is gone."""
        self.ask_consent(None)
        self.show_snapshot(m.Snapshot(m.FAILED))

    def closeEvent(self, event: QCloseEvent) -> None:
        """Closing is the main window's: it asks while something is recorded."""
        if not self.leaving:
            event.ignore()
            self.close_asked.emit()
