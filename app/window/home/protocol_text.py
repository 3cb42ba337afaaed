"""The text of a protocol: numbered lines, tables in bold, comments quiet."""

import re

from PySide6.QtCore import QRect, QSize, Qt
from PySide6.QtGui import QFont, QPainter, QPaintEvent, QResizeEvent, QSyntaxHighlighter, QTextCharFormat
from PySide6.QtWidgets import QPlainTextEdit, QWidget

from app.window.widgets import theme
from app.window.widgets.theme import COLOURS

COMMENT = re.compile(r"""^(?:[^#"']|"[^"]*"|'[^']*')*(#.*)$""")  # what stands behind a # that is in no text
MARGIN_PX = 10  # beside the numbers of lines


class ProtocolText(QPlainTextEdit):
    """Text in columns, with the number of each line before it. Tab leads on to what is beside it."""

    def __init__(self) -> None:
        super().__init__(accessibleName="Protocol")
        self.setTabChangesFocus(True)
        self.setFont(theme.mono())
        self._look, self._numbers = _Look(self.document()), _Numbers(self)
        theme.follow(self._look.rehighlight)
        self.blockCountChanged.connect(self._make_room)
        self.updateRequest.connect(self._follow)
        self._make_room()

    def numbers_px(self) -> int:
        """How wide the numbers are with their margins."""
        return self.fontMetrics().horizontalAdvance("9" * max(3, len(str(self.blockCount())))) + 2 * MARGIN_PX

    def paint_numbers(self, painter: QPainter, within: QRect) -> None:
        """The numbers of the lines that are seen whole."""
        painter.setPen(theme.shade(COLOURS.quiet))
        painter.setFont(self.font())
        block = self.firstVisibleBlock()
        place = self.blockBoundingGeometry(block).translated(self.contentOffset())
        while block.isValid() and place.top() <= within.bottom() and place.bottom() <= self._numbers.height():
            line = QRect(0, round(place.top()), self.numbers_px() - MARGIN_PX, self.fontMetrics().lineSpacing())
            if line.top() >= 0:
                painter.drawText(line, Qt.AlignmentFlag.AlignRight, str(block.blockNumber() + 1))
            block = block.next()
            place.moveTop(place.bottom())
            place.setHeight(self.blockBoundingRect(block).height())

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        inside = self.contentsRect()
        self._numbers.setGeometry(inside.left(), inside.top(), self.numbers_px(), inside.height())

    def _make_room(self) -> None:
        self.setViewportMargins(self.numbers_px(), 0, 0, 0)

    def _follow(self, changed: QRect, scrolled: int) -> None:
        """The text was scrolled by so many px, or a part of it changed."""
        if scrolled:
            self._numbers.scroll(0, scrolled)
        else:
            self._numbers.update(0, changed.top(), self._numbers.width(), changed.height())


class _Numbers(QWidget):
    """The numbers beside a text."""

    def __init__(self, text: ProtocolText) -> None:
        super().__init__(text)
        self._text = text

    def sizeHint(self) -> QSize:
        return QSize(self._text.numbers_px(), 0)

    def paintEvent(self, event: QPaintEvent) -> None:
        self._text.paint_numbers(QPainter(self), event.rect())


class _Look(QSyntaxHighlighter):
    """Comments are quiet, names of tables bold."""

    def highlightBlock(self, text: str) -> None:
        form = QTextCharFormat()
        if text.lstrip().startswith("["):
            form.setFontWeight(QFont.Weight.DemiBold)
            self.setFormat(0, len(text), form)
        if found := COMMENT.match(text):
            form = QTextCharFormat()
            form.setForeground(theme.shade(COLOURS.quiet))
            self.setFormat(found.start(1), len(text) - found.start(1), form)
