"""Text on a panel that is never cut: it breaks into lines, or says with dots that there is more."""

from PySide6.QtCore import Qt
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtWidgets import QLabel, QSizePolicy, QWidget

from app import theme


def breakable(text: str) -> str:
    """The text with places to break inside long paths."""
    return text.replace("/", "/\u200b").replace("\\", "\\\u200b")


def line(text: str = "", name: str = "", size: int = theme.NORMAL, bold: bool = False) -> QLabel:
    """A text that breaks into lines where it must. name: quiet, caution, bad or banner."""
    label = QLabel(text, objectName=name)
    label.setFont(theme.font(size, bold))
    label.setWordWrap(True)
    label.setTextFormat(Qt.TextFormat.PlainText)
    return label


class OneLine(QLabel):
    """A text in one line, shortened in the middle where there is no room; its tooltip has all of it."""

    def __init__(self, text: str = "", name: str = "", parent: QWidget | None = None) -> None:
        super().__init__("", parent, objectName=name)
        self.setFont(theme.font(theme.SMALL))
        self.setTextFormat(Qt.TextFormat.PlainText)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.setText(text)

    def setText(self, text: str) -> None:
        super().setText(text)
        self.setToolTip(text)

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setPen(self.palette().color(self.foregroundRole()))
        shown = self.fontMetrics().elidedText(self.text(), Qt.TextElideMode.ElideMiddle, self.width())
        painter.drawText(self.rect(), Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter, shown)
