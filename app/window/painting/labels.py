"""Text on a panel that is never cut: it breaks into lines, or says with dots that there is more."""

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QFontMetrics, QPainter, QPaintEvent, QPolygonF
from PySide6.QtWidgets import QComboBox, QFrame, QHBoxLayout, QLabel, QPushButton, QSizePolicy, QWidget

from app.window.painting import theme


def breakable(text: str) -> str:
    """The text with places to break inside long paths."""
    return text.replace("/", "/\u200b").replace("\\", "\\\u200b")


def line(text: str = "", name: str = "", size: int = theme.NORMAL, bold: bool = False) -> QLabel:
    """A text that breaks into lines where it must. name: quiet, good, caution, bad or banner."""
    label = QLabel(text, objectName=name)
    label.setFont(theme.font(size, bold))
    label.setWordWrap(True)
    label.setTextFormat(Qt.TextFormat.PlainText)
    return label


def word(text: str = "", name: str = "", size: int = theme.NORMAL, bold: bool = False) -> QLabel:
    """A text in one line that takes the room that it needs."""
    label = line(text, name, size, bold)
    label.setWordWrap(False)
    return label


def rule() -> QFrame:
    """A thin line across a panel."""
    return QFrame(objectName="line")


class OneLine(QLabel):
    """A text in one line, shortened with dots where there is no room; its tooltip has all of it."""

    def __init__(
        self,
        text: str = "",
        name: str = "",
        size: int = theme.SMALL,
        bold: bool = False,
        dots: Qt.TextElideMode = Qt.TextElideMode.ElideMiddle,
    ) -> None:
        super().__init__("", objectName=name)
        self._dots = dots
        self.setFont(theme.font(size, bold))
        self.setTextFormat(Qt.TextFormat.PlainText)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.setText(text)

    def setText(self, text: str) -> None:
        if text != self.text():
            super().setText(text)
            self.setToolTip(text)

    def minimumSizeHint(self) -> QSize:
        return QSize(0, super().minimumSizeHint().height())

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setPen(self.palette().color(self.foregroundRole()))
        shown = self.fontMetrics().elidedText(self.text(), self._dots, self.width())
        painter.drawText(self.rect(), Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter, shown)


class Figures(QWidget):
    """A line that changes often, in parts with a colour each: painted, so that the window is not laid out anew."""

    def __init__(self, size: int = theme.SMALL, bold: bool = False, right: bool = False) -> None:
        super().__init__()
        self._size, self._bold, self._right = size, bold, right
        self.parts: tuple[tuple[str, str], ...] = ()
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)

    def show_parts(self, *parts: tuple[str, str]) -> None:
        """(text, colour) each."""
        if parts != self.parts:
            self.parts = parts
            self.update()

    def text(self) -> str:
        """All of it, without the colours."""
        return " ".join(text for text, _ in self.parts)

    def sizeHint(self) -> QSize:
        return QSize(0, QFontMetrics(theme.font(self._size, self._bold)).height())

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setFont(theme.font(self._size, self._bold))
        widths = [theme.text_width(text, self._size, self._bold) for text, _ in self.parts]
        gap = theme.text_width(" ", self._size, self._bold)
        x = self.width() - sum(widths) - gap * (len(widths) - 1) if self._right else 0.0
        for (text, colour), width in zip(self.parts, widths, strict=True):
            painter.setPen(theme.shade(colour))
            painter.drawText(QRectF(x, 0.0, width + 2.0, self.height()), Qt.AlignmentFlag.AlignVCenter, text)
            x += width + gap


class Choice(QComboBox):
    """One of several; the style's own arrow would bring a ground of its own."""

    _values: tuple = ()

    def fill(self, entries: Mapping[Any, str], value: Any) -> None:
        """Show these, value -> text, and which is chosen."""
        self._values = tuple(entries)
        self.clear()
        self.addItems(list(entries.values()))
        self.setCurrentIndex(self._values.index(value))

    def value(self) -> Any:
        """What is chosen."""
        return self._values[self.currentIndex()]

    def paintEvent(self, event: QPaintEvent) -> None:
        super().paintEvent(event)
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(theme.colour(theme.QUIET))
        at = QPointF(self.width() - 16.0, 0.5 * self.height() + 2.5)
        painter.drawPolygon(QPolygonF([at, at + QPointF(-4.5, -5.0), at + QPointF(4.5, -5.0)]))


class KeyButton(QPushButton):
    """A button that says its key; it never takes the keyboard, so a key always means the same."""

    def __init__(self, text: str, key: str, name: str = "key", parent: QWidget | None = None) -> None:
        super().__init__(text, parent, objectName=name)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setFont(theme.font(theme.NORMAL, bold=name == "main"))
        self.setMinimumHeight(30)
        self.setStyleSheet("text-align: left")
        self._key = word(key, "hint" if name == "main" else "quiet", theme.SMALL)
        self.toggled.connect(lambda on: theme.name_anew(self._key, "hint" if on else "quiet"))
        self._key.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(12, 0, 10, 0)
        layout.addStretch(1)
        layout.addWidget(self._key)

    def sizeHint(self) -> QSize:
        """Room for both words."""
        words = self.fontMetrics().horizontalAdvance(self.text()) + self._key.sizeHint().width()
        return QSize(words + 12 + 10 + 16, max(super().sizeHint().height(), self.minimumHeight()))

    def minimumSizeHint(self) -> QSize:
        return self.sizeHint()
