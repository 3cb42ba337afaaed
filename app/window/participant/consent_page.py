"""What a participant is asked before anything else: whether they take part. No answer is easier to give."""

from PySide6.QtCore import Signal
from PySide6.QtGui import QResizeEvent, QShowEvent
from PySide6.QtWidgets import QWidget

from app.window.widgets import theme
from app.window.widgets.parts import Panel, button, column, row, scrolled, wrapped_label
from experiments.protocol_file import Consent

WIDE_SHARE = 0.8  # of the width, at most
TEXT_SHARE, BUTTON_SHARE = 0.042, 0.03  # of the height: the letters of the text and of the answers
AROUND_SHARE = 0.4  # of the height: what is above and below the text


class ConsentPage(QWidget):
    """The text, to be scrolled where it is long, and a button for each answer, of which no key presses the first."""

    answered = Signal(bool)  # whether they take part

    def __init__(self) -> None:
        super().__init__()
        self.title = wrapped_label("", size=theme.HEAD, bold=True)
        self.text = wrapped_label("")
        self.decline = button("", lambda: self.answered.emit(False))
        self.agree = button("", lambda: self.answered.emit(True))
        for answer in (self.decline, self.agree):
            answer.setMinimumHeight(48)
        self.area = scrolled(self.text)
        answers = row((self.decline, 1), (self.agree, 1), spacing=theme.GAP)
        self.sheet = sheet = Panel()
        sheet.setLayout(column(self.area, answers, spacing=32, margins=(40, 32, 40, 32)))
        self._page = row(1, (column(1, self.title, sheet, 1, spacing=12), 100), 1, margins=(40, 32, 40, 32))
        self.setLayout(self._page)

    def show_consent(self, consent: Consent, title: str = "") -> None:
        """title: the experimenter's, above what the participant reads."""
        self.title.setText(title)
        self.title.setVisible(bool(title))
        self.text.setText(consent.text.strip())
        self.decline.setText(consent.decline)
        self.agree.setText(consent.agree)
        self._fit()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        """The answers stand right under the text; one that is too long for the page is scrolled."""
        height = self.height()
        self.sheet.setFixedWidth(round(WIDE_SHARE * self.width()))
        self.text.setFont(theme.font(round(TEXT_SHARE * height)))
        for answer in (self.decline, self.agree):
            answer.setFont(theme.font(round(BUTTON_SHARE * height), bold=True))
        self._page.activate()
        needed = self.text.heightForWidth(self.area.viewport().width())
        self.area.setFixedHeight(max(min(needed, round((1.0 - AROUND_SHARE) * height)), 1))

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self.area.verticalScrollBar().setValue(0)
        self.setFocus()
