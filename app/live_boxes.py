"""Box plots on the screen, growing trial by trial; the numbers are those of the figures for print."""

from collections.abc import Sequence

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QWidget

from app import theme
from app.traces import range_for
from experiments.boxplots import Box, Measure, boxes
from experiments.trials_table import TrialRow

LABELS = {1: "None", 2: "SDOF", 3: "SDOF gap", 4: "Prop. high", 5: "Prop. low"}
TITLES = {"acceleration_dft_sum": "Acceleration DFT sum"}  # shorter than in print
TOP_PX, BOTTOM_PX, LEFT_PX = 26, 18, 34


class LiveBoxes(QWidget):
    """One measure: five controllers, a box for each configuration (the first filled, the second open)."""

    def __init__(self, measure: Measure, configurations: Sequence[str], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._measure, self._configurations = measure, tuple(configurations)
        self.found: dict[tuple[int, str], Box] = {}
        self._end = 1.0
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumHeight(84)

    def sizeHint(self) -> QSize:
        return QSize(320, 130)

    def show_rows(self, rows: Sequence[TrialRow]) -> None:
        """The boxes of these trials."""
        self.found = boxes(rows, self._measure.column, self._configurations, self._measure.scale)
        highest = max((max(box.high, *box.outliers, box.q3) for box in self.found.values()), default=0.0)
        self._end = range_for(1.02 * highest, 1.0)
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.fillRect(self.rect(), theme.colour(theme.PANEL))
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self._paint_frame(painter)
        width = min(0.30 * self._step(), 15.0)
        for (controller, configuration), box in self.found.items():
            j = self._configurations.index(configuration)
            middle = self._x(controller) + (j - 0.5 * (len(self._configurations) - 1)) * (width + 4.0)
            self._paint_box(painter, box, middle, width, theme.CONTROLLER[controller], filled=j == 0)

    def _step(self) -> float:
        return (self.width() - LEFT_PX) / len(LABELS)

    def _x(self, controller: int) -> float:
        return LEFT_PX + (list(LABELS).index(controller) + 0.5) * self._step()

    def _y(self, value: float) -> float:
        room = self.height() - TOP_PX - BOTTOM_PX
        return TOP_PX + room * (1.0 - value / self._end)

    def _paint_frame(self, painter: QPainter) -> None:
        """Title, unit, three lines, the controllers' names."""
        left = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        painter.setFont(theme.font(theme.NORMAL, bold=True))
        painter.setPen(theme.colour(theme.TEXT))
        title = TITLES.get(self._measure.column, self._measure.title)
        painter.drawText(QRectF(0.0, 0.0, self.width(), 18.0), left, title)
        painter.setFont(theme.font(theme.SMALL))
        painter.setPen(theme.colour(theme.QUIET))
        painter.drawText(QRectF(0.0, 0.0, self.width(), 18.0), right, self._measure.unit)
        for share in (0.0, 0.5, 1.0):
            y = self._y(share * self._end)
            painter.setPen(QPen(theme.colour(theme.LINE), 1.0))
            painter.drawLine(QPointF(LEFT_PX, y), QPointF(self.width(), y))
            painter.setPen(theme.colour(theme.QUIET))
            painter.drawText(QRectF(0.0, y - 8.0, LEFT_PX - 6.0, 16.0), right, f"{share * self._end:g}")
        for controller, label in LABELS.items():
            box = QRectF(self._x(controller) - 0.5 * self._step(), self.height() - 15.0, self._step(), 15.0)
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, label)

    def _paint_box(self, painter: QPainter, box: Box, x: float, width: float, colour: str, filled: bool) -> None:
        half = 0.5 * width
        pen = QPen(theme.colour(colour), 1.4)
        painter.setPen(pen)
        for inner, outer in ((box.q1, box.low), (box.q3, box.high)):
            painter.drawLine(QPointF(x, self._y(inner)), QPointF(x, self._y(outer)))
            painter.drawLine(QPointF(x - 0.5 * half, self._y(outer)), QPointF(x + 0.5 * half, self._y(outer)))
        painter.setBrush(theme.colour(colour, 0.75 if filled else 0.12))
        top = self._y(box.q3)
        painter.drawRoundedRect(QRectF(x - half, top, width, max(self._y(box.q1) - top, 1.0)), 1.5, 1.5)
        flat = self._y(box.q1) - top < 4.0  # one trial: a line in the controller's colour
        painter.setPen(QPen(theme.colour("#ffffff" if filled and not flat else colour), 2.0))
        painter.drawLine(QPointF(x - half, self._y(box.median)), QPointF(x + half, self._y(box.median)))
        painter.setPen(pen)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for value in box.outliers:
            painter.drawEllipse(QPointF(x, self._y(value)), 2.5, 2.5)
