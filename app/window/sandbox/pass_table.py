"""The passes of Try in a table: bars compare those that were run under the same conditions."""

from collections.abc import Sequence

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QRectF, Qt
from PySide6.QtGui import QPainter, QResizeEvent
from PySide6.QtWidgets import QHeaderView, QStyledItemDelegate, QStyleOptionViewItem, QTableWidget, QTableWidgetItem

from app.ipc import messages as m
from app.window.sandbox.controls import brakes_of, preset_of
from app.window.sandbox.dials import dials_of
from app.window.widgets import theme
from app.window.widgets.parts import NO_FOCUS
from app.window.widgets.theme import COLOURS, font, shade
from app.window.widgets.words import feel
from experiments.plan import grouped
from experiments.protocol import Protocol


class Bars(QStyledItemDelegate):
    """A measure below its head, and a bar before it where passes compare."""

    def __init__(self, table: QTableWidget) -> None:
        super().__init__(table)
        self._table = table

    def paint(
        self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        share, colour = index.data(Qt.ItemDataRole.UserRole) or (None, "")
        box = QRectF(self._table.visualRect(index)).adjusted(20.0, 0.0, -3.0, 0.0)
        number_px = max(48, theme.text_width(index.data(), theme.NORMAL))
        number = QRectF(box.right() - number_px, box.top(), number_px, box.height())
        painter.setFont(font(theme.NORMAL))
        painter.setPen(shade(COLOURS.text if share is not None else COLOURS.quiet))
        painter.drawText(number, Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter, index.data())
        if share is not None and box.width() > 80.0:
            longest = box.width() - number.width() - 10.0
            for width, ground in ((longest, COLOURS.line), (share * longest, colour)):
                painter.fillRect(QRectF(box.left(), box.center().y() - 3.0, width, 7.0), shade(ground))


#: of a Pass: measure, head, scale, digits
MEASURES = (
    ("path_error_m", "Error mm", 1e3, 2),
    ("mean_tip_force_N", "Force N", 1.0, 1),
    ("acceleration_weighted_rms_m_s2", "Accel. rms m/s²", 1.0, 1),
    ("duration_s", "Time s", 1.0, 1),
)


class PassTable(QTableWidget):
    """The passes, the newest first; bars compare those of the newest one's path, device, hand and brakes alone."""

    def __init__(self) -> None:
        super().__init__(0, 3 + len(MEASURES))
        self.setHorizontalHeaderLabels(["Pass", "Guidance", "Device", *(head for _, head, _, _ in MEASURES)])
        self.verticalHeader().hide()
        self.setShowGrid(False)
        self.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self.setSelectionMode(QTableWidget.SelectionMode.NoSelection)
        self.setFocusPolicy(NO_FOCUS)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        head = self.horizontalHeader()
        head.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft)
        head.setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        head.setSectionsClickable(False)
        head.setStyleSheet("QHeaderView { padding: 0; } QHeaderView::section { padding: 2px 3px; }")  # level with cells
        head.setMinimumSectionSize(40)
        head.hide()  # until there is a pass
        for across in (0, 1, 2, 6):
            head.setSectionResizeMode(across, QHeaderView.ResizeMode.ResizeToContents)
        bars = Bars(self)
        for across in range(3, 3 + len(MEASURES)):
            self.setItemDelegateForColumn(across, bars)
            right, role = Qt.AlignmentFlag.AlignRight, Qt.ItemDataRole.TextAlignmentRole
            self.model().setHeaderData(across, Qt.Orientation.Horizontal, right, role)
        self.verticalHeader().setDefaultSectionSize(22)

    def resizeEvent(self, event: QResizeEvent) -> None:
        self.setColumnHidden(2, self.width() < 640)
        super().resizeEvent(event)

    def show_passes(self, passes: Sequence[m.Pass], protocol: Protocol) -> None:
        """Show these passes, the newest last."""
        whole = [ended for ended in passes if ended.status == "done" and not ended.changed]
        alike = [ended for ended in whole if ended.settings.same_conditions(passes[-1].settings)]
        dials, controllers = dials_of(protocol), protocol.controllers
        self.setRowCount(len(passes))
        self.horizontalHeader().setVisible(bool(passes))
        for line, ended in enumerate(reversed(passes)):
            s, preset = ended.settings, preset_of(ended.settings, controllers)
            colour = theme.colour_of(s.controller, controllers)
            noted = " · changed" if ended.changed else " · time-out" if ended.status == "timeout" else ""
            set_to = (f"{dial.label.lower()} {grouped(dial.setting(s) * dial.scale)} {dial.unit}" for dial in dials)
            about = f"{preset.name}; path {s.path}, {s.rules} rules, {s.sensing} sensing, {', '.join(set_to)}"
            texts = [str(ended.number), feel(preset, controllers) + noted, brakes_of(s.device)]
            for across, text in enumerate(texts):
                item = QTableWidgetItem(text)
                item.setToolTip(about)
                if across == 1:
                    item.setData(Qt.ItemDataRole.DecorationRole, shade(colour))
                self.setItem(line, across, item)
            for across, (field, _, scale, digits) in enumerate(MEASURES, start=3):
                value = ended.measures[field]
                most = max((other.measures[field] or 0.0 for other in alike), default=0.0)
                item = QTableWidgetItem("–" if value is None else f"{scale * value:.{digits}f}")
                if ended in alike and value is not None and most > 0.0 and field != "duration_s":
                    item.setData(Qt.ItemDataRole.UserRole, (value / most, colour))
                self.setItem(line, across, item)
