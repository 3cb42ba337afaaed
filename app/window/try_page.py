"""The Try page: one handle, one path, and everything that can be set acts at once; a table compares the passes."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from PySide6.QtCore import QMarginsF, QModelIndex, QPointF, QRectF, Qt, QTimer
from PySide6.QtGui import QKeyEvent, QPainter, QPainterPath, QPainterPathStroker, QPolygonF, QResizeEvent
from PySide6.QtWidgets import (
    QFileDialog,
    QFrame,
    QGridLayout,
    QHeaderView,
    QPushButton,
    QSizePolicy,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QTableWidget,
    QTableWidgetItem,
    QWidget,
)

from app.ipc import messages as m
from app.window import words
from app.window.dials import DialRow, dials_of
from app.window.page import Page
from app.window.painting import theme
from app.window.painting.force_view import FORCES, TRAIL, ForceView, Layered, Reading
from app.window.painting.layers import Instant, extent_of_paths
from app.window.painting.linkage_view import LINKAGE, LinkageView, small_view
from app.window.painting.marks import Labels, points_in
from app.window.painting.parts import (
    NO_FOCUS,
    OneLine,
    Panel,
    Segments,
    button,
    column,
    line,
    panel,
    row,
    scrolled,
    word,
)
from app.window.painting.plane import Sizes
from app.window.painting.theme import font, pen, shade, write
from app.window.words import Shown
from core import tick_log
from core.control.controllers import Preset
from core.control.rule_sets import RULE_SETS
from core.device import Device
from core.path import PathFile
from experiments.assumptions import SENSINGS
from experiments.plan import grouped

RIGHT_PX, NAME_PX = 390, 112
SEND_MS = 40  # a slider that is dragged sends its newest value so often
MARGIN_M = 0.045  # around the path, at least
GAP = "gap"
LAYERS = {
    TRAIL: ("T", "The way of the handle in this pass"),
    FORCES: ("F", "The forces of your hand and of the brakes"),
    GAP: ("G", "The band along the path in which nothing guides"),
    LINKAGE: ("L", "The whole linkage; its brakes in the colour of what they do"),
}
INSET_PX = 180  # wide, at most
HEAD_PX, FOOT_PX = 70.0, 26.0  # of the canvas, for what stands there in words
IN_CORNER = Sizes(path=2.0, ring=4.0, ring_pen=2.0, handle=4.5, pointer=0.0)
BACK = Shown("Back to the start", "The next pass begins in the green circle")
FURTHER = "Pull a little further: the brakes' own drag holds the dot"
REST_M_S = 0.002  # a handle that is slower is held
GAIN = "gain_N_s_m"
READY = Shown("Ready", "Space starts a pass")
IN_SESSION = Shown("A session is open", "Close it on the Run page, then try things out here")
SENSING = (
    "What the controller sees. Ideal: the true motion. Encoders, as on the bench: joint angles by their counts, the "
    "velocity as the slope over the last 15 ms, all of it 1 ms late."
)
REAL = "Real brakes: what you change acts in the next pass, and each pass waits for Space."


class Canvas(ForceView):
    """The path, the gap around it, the handle, the hand's spring, both forces; the whole linkage in a corner."""

    def __init__(self) -> None:
        sizes = Sizes(path=5.0, ring_pen=4.0, handle=12.0, pointer=7.0, trail=2.5)
        labels = Labels("your hand", theme.TITLE, bold=True)
        free = QMarginsF(16.0, HEAD_PX, 16.0, FOOT_PX)
        super().__init__(QRectF(-0.2, 0.3, 0.4, 0.2), free, labels, sizes, follows_mouse=True)
        self.shown = set(LAYERS)
        self.gap_m = 0.0
        self.inset: LinkageView | None = None

    def show_trial(self, device: Device, path: PathFile, tip: m.Point) -> None:
        if self.inset is not None:
            self.inset.deleteLater()
        self.inset = small_view(device, path, tip, IN_CORNER)
        self.inset.setParent(self)
        self.inset.setVisible(LINKAGE in self.shown)
        self._place_inset()
        self.set_extent(extent_of_paths([path], MARGIN_M))
        super().show_trial(device, path, tip)

    def rest(self, tip: m.Point) -> None:
        super().rest(tip)
        if self.inset is not None:
            self.inset.rest(tip)

    def show_gap(self, gap_m: float) -> None:
        """The half-width of the band without control."""
        if gap_m != self.gap_m:
            self.gap_m = gap_m
            self.repaint_still()

    def show_layer(self, layer: str, shown: bool) -> None:
        super().show_layer(layer, shown)
        if self.inset is not None:
            self.inset.setVisible(LINKAGE in self.shown)

    def add(self, rows: np.ndarray, taken: bool = False) -> None:
        super().add(rows, taken)
        if self.inset is not None and self.inset.isVisible():
            self.inset.add(rows)

    def word(self) -> None:
        super().word()
        if self.inset is not None:
            self.inset.word()

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._place_inset()
        super().resizeEvent(event)

    def _place_inset(self) -> None:
        wide = int(min(INSET_PX, 0.24 * self.width(), 0.4 * self.height()))
        if self.inset is not None:
            self.inset.setGeometry(self.width() - wide - 10, 10, wide, int(0.9 * wide))

    def solid(self, now: Instant) -> np.ndarray:
        """The linkage in its corner too."""
        corner = self._corner()
        return np.concatenate([super().solid(now), *([] if corner is None else [points_in(corner)])])

    def _corner(self) -> QRectF | None:
        """Where the linkage is seen, px."""
        return QRectF(self.inset.geometry()) if self.inset is not None and LINKAGE in self.shown else None

    @property
    def path_px(self) -> float:
        return max(super().path_px, self.gap_m * self.scale if GAP in self.shown else 0.0)

    def room(self) -> QRectF:
        return QRectF(self.rect()).adjusted(4.0, HEAD_PX, -4.0, -4.0)

    def paint_under_path(self, painter: QPainter) -> None:
        if GAP in self.shown and self.gap_m > 0.0 and len(self.outline):
            way, stroker = QPainterPath(), QPainterPathStroker()
            way.addPolygon(QPolygonF([self.to_screen(place) for place in self.outline]))
            stroker.setWidth(2.0 * self.gap_m * self.scale)
            stroker.setCapStyle(Qt.PenCapStyle.FlatCap)
            painter.setPen(pen(theme.CAUTION, 1.0, 0.5))
            painter.setBrush(shade(theme.CAUTION, 0.10))
            painter.drawPath(stroker.createStroke(way).simplified())
        right, low = self.width() - 20.0, self.height() - 14.0
        painter.setPen(pen(theme.QUIET, 1.5))
        painter.drawLine(QPointF(right - 0.02 * self.scale, low), QPointF(right, low))
        write(painter, QPointF(right - 0.01 * self.scale, low - 12.0), "2 cm", theme.NORMAL, False, theme.QUIET)
        if (corner := self._corner()) is not None:
            painter.setPen(pen(theme.LINE, 2.0))
            painter.drawRect(corner)

    def paint_under_handle(self, painter: QPainter) -> None:
        if self.tip is not None and self.instant is not None:
            self.paint_forces(painter, self.instant)

    def paint_over_handle(self, painter: QPainter) -> None:
        now = self.instant
        if now is not None and self.labelled and self.labels.cover(self.marks(now), self.solid(now), self.room()):
            self.place_labels(now)  # something has moved under one of them
        super().paint_over_handle(painter)


def feel(preset: Preset, gains: Sequence[float]) -> str:
    """What a controller feels like; gains (N s/m): of the protocol's guides."""
    gap, gain = 1e3 * preset.value("gap_m"), preset.value(GAIN)
    if preset.kind == "none":
        return "Free"
    if preset.kind == "sdof":
        return f"Rails with {gap:g} mm slack" if gap else "On rails"
    if preset.kind == "proportional":
        name = "Strong guide" if gain >= max(gains) else "Weak guide" if gain <= min(gains) else "Guide"
        return f"{name} with {gap:g} mm slack" if gap else name
    return preset.name


def brakes_of(device: str) -> str:
    """A device's name as it stands on a button."""
    return device.replace("-brake", " brakes").capitalize()


class GuideButton(QPushButton):
    """A controller: what it feels like, its name, its key."""

    def __init__(self, number: int, name: str, key: str) -> None:
        super().__init__(objectName="key", checkable=True, accessibleName=name, minimumHeight=30, focusPolicy=NO_FOCUS)
        self.key, self.feel, bar = key, word("", bold=True), QFrame()
        bar.setFixedWidth(5)
        bar.setStyleSheet(f"background: {theme.CONTROLLER.get(number, theme.QUIET)}")
        parts = (bar, self.feel, OneLine(name, "quiet", theme.NORMAL), word(key, "quiet"))
        self.setLayout(row(*parts, margins=(6, 0, 12, 0)))
        for part in self.findChildren(QWidget):
            part.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)


class Bars(QStyledItemDelegate):
    """A measure, and a bar beside it where passes compare."""

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex) -> None:
        share, colour = index.data(Qt.ItemDataRole.UserRole) or (None, "")
        box = QRectF(option.rect).adjusted(6.0, 0.0, -14.0, 0.0)
        wide = max(theme.text_px(48), theme.text_width(index.data(), theme.NORMAL))
        number = QRectF(box.left(), box.top(), wide, box.height())
        painter.setFont(font(theme.NORMAL))
        painter.setPen(shade(theme.TEXT if share is not None else theme.QUIET))
        painter.drawText(number, Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter, index.data())
        if share is not None and box.width() > 80.0:
            left, wide = number.right() + 10.0, box.width() - number.width() - 10.0
            for width, ground in ((wide, theme.LINE), (share * wide, colour)):
                painter.fillRect(QRectF(left, box.center().y() - 3.0, width, 7.0), shade(ground))


#: of a Pass: measure, head, scale, digits
MEASURES = (
    ("path_error_m", "Error\nmm", 1e3, 2),
    ("mean_tip_force_N", "Force\nN", 1.0, 1),
    ("acceleration_weighted_rms_m_s2", "Roughness\nm/s²", 1.0, 1),
    ("duration_s", "Time\ns", 1.0, 1),
)


class PassTable(QTableWidget):
    """The passes, the newest first; bars compare those of the newest one's path, device, hand and brakes alone."""

    def __init__(self) -> None:
        super().__init__(0, 3 + len(MEASURES))
        self.setHorizontalHeaderLabels(["Pass", "Guidance", "Device", *(head for _, head, _, _ in MEASURES)])
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(26)
        self.setShowGrid(False)
        self.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self.setSelectionMode(QTableWidget.SelectionMode.NoSelection)
        self.setFocusPolicy(NO_FOCUS)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        head = self.horizontalHeader()
        head.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft)
        head.setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        head.setSectionsClickable(False)
        head.setStyleSheet("QHeaderView::section { padding: 2px 0; }")  # level with the cells
        head.setMinimumSectionSize(40)
        for across in (0, 1, 2, 6):
            head.setSectionResizeMode(across, QHeaderView.ResizeMode.ResizeToContents)
        self._bars = Bars()
        for across in range(3, 3 + len(MEASURES)):
            self.setItemDelegateForColumn(across, self._bars)

    def resizeEvent(self, event: QResizeEvent) -> None:
        self.setColumnHidden(2, self.width() < theme.text_px(640))
        super().resizeEvent(event)

    def show_passes(self, passes: Sequence[m.Pass], opened: m.Opened) -> None:
        """The newest last."""
        whole = [one for one in passes if one.status == "done" and not one.changed]
        alike = [one for one in whole if one.settings.same_conditions(passes[-1].settings)]
        dials = dials_of(opened)
        self.setRowCount(len(passes))
        for at, one in enumerate(reversed(passes)):
            s, preset = one.settings, preset_of(one.settings, opened)
            colour = theme.CONTROLLER.get(s.controller, theme.TEXT)
            noted = " · changed" if one.changed else " · time-out" if one.status == "timeout" else ""
            set_to = (f"{dial.label.lower()} {grouped(dial.setting(s) * dial.scale)} {dial.unit}" for dial in dials)
            about = f"{preset.name}; path {s.path}, {s.rules} rules, {s.sensing} sensing, {', '.join(set_to)}"
            texts = [str(one.number), feel(preset, gains_of(opened)) + noted, brakes_of(s.device)]
            for across, text in enumerate(texts):
                item = QTableWidgetItem(text)
                item.setToolTip(about)
                self.setItem(at, across, item)
            self.item(at, 1).setForeground(shade(colour))
            for across, (field, _, scale, digits) in enumerate(MEASURES, start=3):
                value = one.measures[field]
                most = max((other.measures[field] or 0.0 for other in alike), default=0.0)
                item = QTableWidgetItem("–" if value is None else f"{scale * value:.{digits}f}")
                if one in alike and value is not None and most > 0.0 and field != "duration_s":
                    item.setData(Qt.ItemDataRole.UserRole, (value / most, colour))
                self.setItem(at, across, item)


def preset_of(s: m.SandboxSettings, opened: m.Opened) -> Preset:
    """The controller with its parameters as they are set."""
    return opened.protocol.controllers[s.controller].replaced(**s.values)


def gains_of(opened: m.Opened) -> list[float]:
    """Of the protocol's guides, N s/m."""
    presets = opened.protocol.controllers.values()
    return [preset.named[GAIN] for preset in presets if GAIN in preset.named]


class TryPage(Page):
    """Canvas and passes at the left, everything that can be set at the right."""

    def __init__(self, send: Callable[[object], None]) -> None:
        super().__init__(send)
        self.settings: m.SandboxSettings | None = None  # as shown; the server has them SEND_MS later
        self._theirs: m.SandboxSettings | None = None  # the server's newest
        self._front, self._cleared = False, 0  # cleared: number of the last pass that is not shown
        self._place: tuple[str, int] | None = None  # device and path on the canvas
        self._phase, self._since_s, self._reading = -1, 0.0, Reading()
        self._timer = QTimer(self, singleShot=True, interval=SEND_MS)
        self._timer.timeout.connect(lambda: self.send(m.Sandbox(self.settings)))
        self.canvas, self.table = Canvas(), PassTable()
        self.large, self.small = word("", size=30, bold=True), line("", "quiet", theme.TITLE)
        self.error, self.time = word("–", size=22, bold=True), word("–", size=22, bold=True)
        self.notice = OneLine("", "quiet", theme.NORMAL)
        self.start = button("Start a pass  Space", self._start, "main")
        self.clear = button("Clear", self._clear, "small")
        self.save = button("Save as protocol …", self._save, "small")
        self.guides: dict[int, GuideButton] = {}
        self.dials: dict[str, DialRow] = {}
        self.segments: dict[str, Segments] = {}
        self._controls, self._names = scrolled(QWidget()), []
        self._lay_out()
        self.canvas.pointer_moved.connect(self.aimed)
        self.canvas.pointer_left.connect(self.left)

    def _lay_out(self) -> None:
        over = QGridLayout(self.canvas)
        over.setContentsMargins(20, 10, INSET_PX + 30, 0)
        over.setHorizontalSpacing(26)
        figures = (self.error, word("from the line", "quiet")), (self.time, word("this pass", "quiet"))
        to_its_line = Qt.AlignmentFlag.AlignBottom, Qt.AlignmentFlag.AlignTop
        for across, labels in enumerate(((self.large, self.small), *figures)):
            for down, label in enumerate(labels):
                label.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
                over.addWidget(label, down, across, to_its_line[down])
        over.setVerticalSpacing(0)
        over.setColumnStretch(0, 1)
        over.setRowStretch(2, 1)
        self.workspace, passes = Layered(self.canvas, LAYERS), Panel()
        self.workspace.foot.addWidget(self.start)
        head = row(word("Passes", size=theme.TITLE, bold=True), self.notice, self.clear, self.save)
        passes.setLayout(column(head, self.table, margins=(14, 8, 10, 8)))
        left = column((self.workspace, 3), (passes, 2), spacing=theme.GAP)
        self.setLayout(row((left, 1), self._controls, spacing=theme.GAP))
        self.start.hide()

    def _fill(self, opened: m.Opened) -> None:
        """The controllers, devices and paths of a protocol, and the dials."""
        parts = []  # of the panel, from top to bottom
        for place, (number, preset) in enumerate(opened.protocol.controllers.items(), start=1):
            guide = self.guides[number] = GuideButton(number, preset.name, str(place) if place < 10 else "")
            guide.feel.setText(feel(preset, gains_of(opened)))
            guide.clicked.connect(lambda _=False, number=number: self._choose(number))
            parts.append(guide)
        self.warning = line("", "caution")
        self.warning.setMinimumHeight(2 * self.warning.fontMetrics().height())  # so that nothing jumps
        parts.append(self.warning)
        choices = {
            "device": {device.name: brakes_of(device.name) for device in opened.protocol.devices},
            "path": {number: f"Path {number}" for number in opened.protocol.paths},
            "rules": {name: name.capitalize() for name in RULE_SETS},
            "sensing": {name: name.capitalize() for name in SENSINGS},
        }
        for field, among in choices.items():
            segments = self.segments[field] = Segments(among)
            segments.chosen.connect(lambda value, field=field: self._set(**{field: value}))
            segments.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
            parts.append(row(name := word(field.capitalize()), segments))
            self._names.append(name)
        self.segments["sensing"].setToolTip(SENSING)
        for dial in dials_of(opened):
            made = self.dials[dial.name] = DialRow(dial)
            self._names.append(made.name)
            made.moved.connect(self._turn)
            parts.append(made)
        self.changed = OneLine("", "quiet", theme.NORMAL)
        hint = "All of these as the protocol has them, for this guidance, device and path"
        self.reset = button("Reset", lambda: self._set(**self._of_protocol()._asdict()), "small", hint)
        parts += [1, row(self.changed, self.reset)]
        self._controls.setWidget(panel("How should it guide you?", *parts, spacing=5))
        self.follow_text()

    def follow_text(self) -> None:
        """Wider for larger text; all names of settings alike."""
        self._controls.setFixedWidth(theme.text_px(RIGHT_PX))
        for name in self._names:
            name.setFixedWidth(theme.text_px(NAME_PX))

    # ------------------------------------------------------------------------------------------- what is asked for

    def begin(self, what: object = None) -> None:
        self._front = True
        self.canvas.setFocus()  # so that the digits are heard
        self._ask()

    def end(self) -> None:
        self._front = False
        self._timer.stop()
        self.send(m.EndSandbox())

    def keys(self) -> dict[str, Callable[[], object]]:
        return {"start": self._start}

    def own_keys(self) -> dict[str, str]:
        guides = {one.key: f"{one.feel.text()}: {one.accessibleName()}" for one in self.guides.values() if one.key}
        return guides | self.workspace.keys

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """A digit chooses the controller in that place."""
        guide = next((one for one in self.guides.values() if one.key and one.key == event.text()), None)
        if guide is None:
            super().keyPressEvent(event)
        else:
            guide.click()

    def _ask(self) -> None:
        """Open Try on the server, unless a session is open."""
        if self._front and self.opened is not None and not self.opened.participant:
            self.send(m.Sandbox(self.settings))

    def _start(self) -> None:
        if self.snapshot.sandbox is not None and self.snapshot.sandbox.by_start:
            self.send(m.Start())

    def _choose(self, number: int) -> None:
        """A controller, with the parameters that the protocol gives it."""
        now = self.snapshot.sandbox
        if self.opened is not None and now is not None:
            own = self.opened.protocol.controllers[number].named
            self._set(controller=number, values={**now.initial.values, **own})

    def _turn(self, name: str, value: float) -> None:
        """A dial, of a parameter or of another setting."""
        if self.settings is not None and name in self.settings.values:
            self._set(values={**self.settings.values, name: value})
        else:
            self._set(**{name: value})

    def _set(self, **what: Any) -> None:
        if self.settings is None:
            return
        self.settings = self.settings._replace(**what)
        if not self._timer.isActive():
            self._timer.start()
        self._show_settings()

    def _clear(self) -> None:
        if self.snapshot.sandbox is not None and self.snapshot.sandbox.passes:
            self._cleared = self.snapshot.sandbox.passes[-1].number
            self._show_passes()

    def _save(self) -> None:
        plain = QFileDialog.Option.DontConfirmOverwrite  # the server overwrites nothing
        path, _ = QFileDialog.getSaveFileName(self, "Save as protocol", "tried.toml", "TOML (*.toml)", options=plain)
        if path:
            self.send(m.SaveAsProtocol(path if path.endswith(".toml") else f"{path}.toml"))

    # ------------------------------------------------------------------------------------------- what the server sends

    def show_opened(self, opened: m.Opened) -> None:
        before, protocol = self.opened, opened.protocol
        super().show_opened(opened)
        had = before.protocol if before is not None else None
        if had is None or any(getattr(had, it) != getattr(protocol, it) for it in ("controllers", "paths", "obstacle")):
            self.guides.clear()
            self.dials.clear()
            self._names.clear()
            self.settings = self._theirs = self._place = None
            self._fill(opened)
            self.canvas.show_obstacles(protocol.obstacle)
            self.canvas.radii_m = (protocol.trial.start_radius_m, protocol.trial.end_radius_m)
        if before is None or before.participant:
            self._ask()

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        before = self.snapshot
        super().show_snapshot(snapshot)
        if self.opened is None:
            return
        now = snapshot.sandbox
        elsewhere = self.opened.participant or snapshot.brakes_off  # Run or the banner says it
        self.notice.setText("" if elsewhere else snapshot.notice)
        theme.name_anew(self.notice, "bad" if snapshot.notice_bad else "quiet")
        for part in (self.save, self._controls):
            part.setEnabled(now is not None)
        self.start.setVisible(now is not None and now.by_start)
        if now is None:
            self.canvas.show_handle(None)
            self._place = None
            wait = Shown("One moment", snapshot.why_not or "Everything is being prepared")
            self._say(IN_SESSION if self.opened.participant else wait)
        else:
            if self.settings is None or now.settings != self._theirs or (snapshot.notice_bad and not before.notice_bad):
                self.settings = now.settings if not self._timer.isActive() else self.settings
            self._theirs = now.settings
            self._show_place(now.settings, snapshot)
            self._show_settings()
            if snapshot.running is None:
                off = Shown("Brakes are off", "Ctrl+B lets them act again") if snapshot.brakes_off else None
                self._say(off or (READY if now.by_start else Shown("One moment", snapshot.why_not)))
                if off or now.by_start:  # else the next pass begins at once
                    self.canvas.rest(snapshot.tip)
            elif before.running != snapshot.running:
                self._phase = -1
        if before.sandbox is None or now is None or before.sandbox.passes != now.passes:
            self._show_passes()

    def show_ticks(self, rows: np.ndarray, taken: bool) -> None:
        if self.snapshot.running is None or self._place is None:
            return
        now, phase = rows[-1], int(rows[-1, tick_log.PHASE])
        held = taken or not words.hand_is_mouse(self.opened)
        if phase != self._phase:
            self._phase = phase
            self._since_s = float(rows[rows[:, tick_log.PHASE] == phase][0, tick_log.T])
            if phase == tick_log.MOVE:  # until then the way of the last pass can be looked at
                self.canvas.clear_trail()
        self.canvas.add(rows, taken)
        if self._reading.due(float(now[tick_log.T])):
            self.canvas.word()
        shown = words.moving(phase, held, words.language_of(self.opened)) or BACK
        further = phase == tick_log.APPROACH and held and self._held_by_drag(now)
        self._say(shown._replace(small=FURTHER) if further else shown)
        if phase == tick_log.MOVE:
            self.time.setText(f"{now[tick_log.T] - self._since_s:.1f} s")
            if math.isfinite(now[tick_log.PATH_DISTANCE]):
                self.error.setText(f"{1e3 * abs(now[tick_log.PATH_DISTANCE]):.1f} mm")

    def _held_by_drag(self, now: np.ndarray) -> bool:
        """Whether the handle rests outside the start though the hand pulls it there (a tick, (tick_log.WIDTH,))."""
        start, radius_m = self.canvas.outline[0], self.canvas.radii_m[0]
        tip, target = (now[at : at + 2] - start for at in (tick_log.TIP_X, tick_log.TARGET_X))
        slow = np.hypot(now[tick_log.TIP_VX], now[tick_log.TIP_VY]) < REST_M_S
        return bool(slow and np.hypot(*target) <= radius_m < np.hypot(*tip))

    def show_time(self, now_s: float) -> None:
        self.canvas.follow_pointer()

    def _say(self, shown: Shown) -> None:
        self.large.setText(shown.large)
        self.small.setText(shown.small)

    def _show_place(self, s: m.SandboxSettings, snapshot: m.Snapshot) -> None:
        if self._place != (s.device, s.path):
            assert self.opened is not None
            self._place = s.device, s.path
            self.error.setText("–")
            self.time.setText("–")
            protocol = self.opened.protocol
            self.canvas.show_trial(protocol.device(s.device), protocol.paths[s.path], snapshot.tip)

    def _show_settings(self) -> None:
        s, now, opened = self.settings, self.snapshot.sandbox, self.opened
        if s is None or now is None or opened is None:
            return
        gains = gains_of(opened)
        for number, guide in self.guides.items():
            guide.setChecked(number == s.controller)
            preset = preset_of(s, opened) if number == s.controller else opened.protocol.controllers[number]
            guide.feel.setText(feel(preset, gains))
        for field, segments in self.segments.items():
            segments.choose(getattr(s, field))
            segments.setEnabled(field not in now.fixed)
        own = preset_of(s, opened).named
        for name, dial in self.dials.items():
            dial.show_setting(dial.dial.setting(s))
            dial.setEnabled(name not in now.fixed and (name in own or name not in s.values))
        weak = own.get(GAIN, math.inf) < now.least_gain_N_s_m
        drag = f"At {grouped(own.get(GAIN, 0.0))} N s/m the brakes' own drag is larger: you will feel nothing."
        self.warning.setText(drag if weak else REAL if now.by_start else "")
        self.canvas.show_gap(own.get("gap_m", 0.0))
        protocols = self._of_protocol()
        changed = [field for field in ("rules", "sensing") if getattr(s, field) != getattr(protocols, field)]
        changed += [dial.label.lower() for dial in dials_of(opened) if dial.setting(s) != dial.setting(protocols)]
        self.changed.setText(f"Changed: {', '.join(changed)}" if changed else "")
        self.reset.setEnabled(bool(changed))

    def _of_protocol(self) -> m.SandboxSettings:
        """The settings as the protocol has them, for the guidance, device and path that are chosen."""
        s, initial = self.settings, self.snapshot.sandbox.initial
        chosen = initial._replace(device=s.device, path=s.path, controller=s.controller)
        return chosen.with_parameters(**self.opened.protocol.controllers[s.controller].named)

    def _show_passes(self) -> None:
        now = self.snapshot.sandbox
        if now is not None and self.opened is not None:
            shown = [one for one in now.passes if one.number > self._cleared]
            self.table.show_passes(shown, self.opened)
            self.clear.setEnabled(bool(shown))
