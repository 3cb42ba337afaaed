"""The passes of Try in one table: a row a setting, the devices side by side, the newest on top."""

import math
from collections.abc import Sequence

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import QHeaderView, QTableWidget, QTableWidgetItem

from app.ipc import messages as m
from app.window.sandbox.passes import about, rows_of
from app.window.widgets import theme
from app.window.widgets.parts import NO_FOCUS
from app.window.widgets.plots import NOTHING
from app.window.widgets.theme import COLOURS
from app.window.widgets.words import STATUS_WORDS, measured
from experiments.protocol import Protocol

#: of a Pass: measure, head, unit, scale
MEASURES = (
    ("path_error_m", "Path error", "mm", 1e3),
    ("mean_tip_force_N", "Mean tip force", "N", 1.0),
    ("acceleration_dft_sum", "DFT of acceleration", "m/s²", 1.0),
)
LATE = STATUS_WORDS["timeout"]
FIXED = ("", "Controller", "Setting", "Path")
ROWS, ROW_PX, HEAD_PX = (3, 6, 10), 23, 40  # that there is room for, as they come; high
#: px wide: a dot, a path's number, a measure at most (or its head), beside a text; of the room: name at most, measures
DOT_PX, PATH_PX, MOST_PX, BESIDE_PX, NAME_SHARE, MEASURED_SHARE = 20, 42, 120, 6, 0.65, 0.6
NAMED_PX = 230  # for name and setting at least
RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
LEFT = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter


class TwoLineHead(QHeaderView):
    """A measure over its devices."""

    def __init__(self, table: QTableWidget) -> None:
        super().__init__(Qt.Orientation.Horizontal, table)
        self.devices: tuple[str, ...] = ()
        self.setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        self.setMinimumSectionSize(10)
        self.setStyleSheet("QHeaderView { padding: 0; }")  # level with the cells

    def sizeHint(self) -> QSize:
        return QSize(0, HEAD_PX)

    @property
    def needed_px(self) -> int:
        """How wide a column of a measure is with its heads."""
        names = [theme.text_width(device, theme.SMALL) for device in self.devices]
        heads = [
            theme.text_width(head, theme.SMALL, bold=True) + theme.text_width(f" {unit}", theme.SMALL)
            for _, head, unit, _ in MEASURES
        ]
        return math.ceil(max([*names, *(head / max(len(names), 1) for head in heads)])) + BESIDE_PX

    def paintEvent(self, event: QPaintEvent) -> None:
        painter, half, wide = QPainter(self.viewport()), 0.5 * HEAD_PX, len(self.devices)
        for across in filter(lambda section: not self.isSectionHidden(section), range(self.count())):
            text = FIXED[across] if across < len(FIXED) else self.devices[(across - len(FIXED)) % wide]
            box = QRectF(self.sectionViewportPosition(across) + 3, half, self.sectionSize(across) - 6, half)
            painter.setPen(theme.shade(COLOURS.quiet))
            painter.setFont(theme.font(theme.SMALL))
            shown = painter.fontMetrics().elidedText(text, Qt.TextElideMode.ElideRight, math.ceil(box.width()))
            painter.drawText(box, RIGHT if across >= len(FIXED) - 1 else LEFT, shown)
        for place, (_, head, unit, _) in enumerate(MEASURES if wide else ()):
            last = len(FIXED) + (place + 1) * wide - 1
            if self.isSectionHidden(last):
                continue
            box = QRectF(0.0, 0.0, self.sectionViewportPosition(last) + self.sectionSize(last) - 3, half)
            painter.setFont(theme.font(theme.SMALL))
            painter.setPen(theme.shade(COLOURS.quiet))
            painter.drawText(box, RIGHT, unit)
            painter.setPen(theme.shade(COLOURS.text))
            painter.setFont(theme.font(theme.SMALL, bold=True))
            painter.drawText(box.adjusted(0, 0, -theme.text_width(f"{unit} ", theme.SMALL), 0), RIGHT, head)


class PassTable(QTableWidget):
    """A row a setting: its newest pass on each device, measure by measure."""

    def __init__(self) -> None:
        super().__init__(0, len(FIXED))
        self._shown: tuple[Sequence[m.Pass], Protocol] | None = None
        self._name_px = 0.0  # wide, the longest name of a controller
        self.head = TwoLineHead(self)
        self.setHorizontalHeader(self.head)
        self.verticalHeader().hide()
        self.verticalHeader().setMinimumSectionSize(ROW_PX)
        self.verticalHeader().setDefaultSectionSize(ROW_PX)
        self.setShowGrid(False)
        self.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self.setSelectionMode(QTableWidget.SelectionMode.NoSelection)
        self.setFocusPolicy(NO_FOCUS)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setFont(theme.font(theme.NORMAL))
        theme.follow(self._colour)

    def _colour(self) -> None:
        if self._shown is not None:
            self.show_passes(*self._shown)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        """Columns of measures are as wide as their heads where there is room; name and setting share the rest."""
        room, wide = self.viewport().width() - DOT_PX - PATH_PX, len(self.head.devices)
        last = len(FIXED) + (len(MEASURES) - 1) * wide  # the last measure gives way where names have no room
        narrow = room - len(MEASURES) * wide * self.head.needed_px < NAMED_PX and wide <= 2
        for across in range(last, self.columnCount()):
            self.setColumnHidden(across, narrow)
        measured = max((last if narrow else self.columnCount()) - len(FIXED), 1)
        each = max(self.head.needed_px, min(MEASURED_SHARE * room / measured, MOST_PX))
        each = int(min(each, 0.7 * room / measured))
        left = room - each * measured
        name = int(min(self._name_px, NAME_SHARE * left))
        widths = [DOT_PX, name, left - name, PATH_PX, *measured * [each]]
        for across, width in enumerate(widths[: self.columnCount()]):
            self.setColumnWidth(across, width)

    def show_passes(self, passes: Sequence[m.Pass], protocol: Protocol) -> None:
        """Show these passes, the newest last."""
        self._shown = passes, protocol
        tried = dict.fromkeys(ended.settings.device for ended in passes)
        names = tuple(device.name for device in protocol.devices)
        devices = names if len(names) <= 2 else tuple(name for name in names if name in tried) or names[:1]
        self.head.devices = devices
        self.setColumnCount(len(FIXED) + len(MEASURES) * len(devices))
        names_px = (theme.text_width(preset.name, theme.NORMAL) for preset in protocol.controllers.values())
        self._name_px = max(names_px) + 3 * BESIDE_PX
        rows = rows_of(passes, protocol)
        self.setRowCount(len(rows))
        for down, row in enumerate(rows):
            texts = ["●", row.name, row.setting or NOTHING, str(row.path)]
            cells = [
                (shown(row.passes.get(device), row.late, *measure), row.passes.get(device))
                for measure in MEASURES
                for device in devices
            ]
            newest = max(row.passes.values(), key=lambda ended: ended.number)
            for across, (text, ended) in enumerate([*((text, newest) for text in texts), *cells]):
                item = QTableWidgetItem(text)
                item.setToolTip(about(ended, protocol) if ended is not None else "Not tried yet")
                if across >= len(FIXED) - 1:
                    item.setTextAlignment(RIGHT)
                if text == LATE:
                    item.setFont(theme.font(theme.SMALL))
                if across == 0:
                    item.setForeground(theme.shade(theme.colour_of(row.controller, protocol.controllers)))
                elif across in (2, 3) or ended is None:
                    item.setForeground(theme.shade(COLOURS.quiet))
                if down == 0:  # the newest pass
                    item.setBackground(theme.shade(COLOURS.field))
                self.setItem(down, across, item)
        self.setFixedHeight(HEAD_PX + ROW_PX * next((room for room in ROWS if room >= len(rows)), ROWS[-1]))
        self._fit()


def shown(ended: m.Pass | None, late: bool, measure: str, _head: str, _unit: str, scale: float) -> str:
    """A measure of a pass; a dash: not tried yet, or not known. late: it has none that can be compared."""
    if late:
        return LATE if ended is not None and measure == MEASURES[0][0] else NOTHING
    value = ended.measures[measure] if ended is not None else None
    return measured(None if value is None else scale * value)
