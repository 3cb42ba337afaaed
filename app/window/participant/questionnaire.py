"""A short questionnaire: the six raw NASA-TLX scales (Hart and Staveland 1988) and one on smoothness; instructions.

Each scale has 21 marks, 0 to 100; none is set before it is touched, and all are to be answered.
"""

from collections.abc import Mapping

from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QPixmap, QResizeEvent, QShowEvent
from PySide6.QtWidgets import QGridLayout, QLabel, QPushButton, QSizePolicy, QWidget

from app.window.widgets import theme
from app.window.widgets.parts import PART, Panel, column, row, text_label, wrapped_label
from app.window.widgets.theme import COLOURS, pen
from experiments.language import ENGLISH_WORDS, Language
from experiments.protocol_file import InstructionPage

#: item, whose question is the language's sentence of that name, and the keys of what stands at both ends
ITEMS = (
    ("mental_demand", "very_little", "very_much"),
    ("physical_demand", "very_little", "very_much"),
    ("temporal_demand", "not_at_all", "very"),
    ("performance", "perfectly", "not_at_all"),
    ("effort", "very_little", "very_hard"),
    ("frustration", "not_at_all", "very"),
    ("smoothness", "smooth", "jerky"),
)
STEPS = 20
LARGEST = 1.8  # times the size in a small window
ROOM_PX = (760, 430)  # what the card takes, at the size in a small window and a text size of 1
QUESTION_PX = 330  # wide, at least, at the same: the longest of the shipped languages
TEXT_SHARE, PLACE_SHARE = 0.05, 0.032  # of the height: instructions, legible from two metres
LEAST_SHARE = 0.02  # of long instructions


class Scale(QWidget):
    """Marks from 0 to 100 in steps of 5; a click, a drag or the arrows set it."""

    changed = Signal()

    def __init__(self, name: str) -> None:
        super().__init__()
        self.value: int | None = None
        self.setAccessibleName(name)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def sizeHint(self) -> QSize:
        return QSize(320, 28)

    def set(self, value: int | None) -> None:
        """0 to 100; None: not answered."""
        if value != self.value:
            self.value = value
            self.update()
            self.changed.emit()

    def _x(self, value: float) -> float:
        return 10.0 + (self.width() - 20.0) * value / 100.0

    def mousePressEvent(self, event: QMouseEvent) -> None:
        share = (event.position().x() - 10.0) / max(self.width() - 20.0, 1.0)
        self.set(round(min(max(share, 0.0), 1.0) * STEPS) * (100 // STEPS))
        self.setFocus()

    mouseMoveEvent = mousePressEvent

    def keyPressEvent(self, event: QKeyEvent) -> None:
        step = {Qt.Key.Key_Left: -1, Qt.Key.Key_Right: 1}.get(Qt.Key(event.key()))
        if step is None:
            super().keyPressEvent(event)
        elif self.value is None:
            self.set(50)
        else:
            self.set(min(max(self.value + step * (100 // STEPS), 0), 100))

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        middle = 0.5 * self.height()
        if self.hasFocus():
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(theme.shade(COLOURS.accent_ground))
            painter.drawRoundedRect(QRectF(self.rect()), 5.0, 5.0)
        painter.setPen(pen(COLOURS.text if self.hasFocus() else COLOURS.brake_off, 1.5))
        painter.drawLine(QPointF(self._x(0), middle), QPointF(self._x(100), middle))
        for i in range(STEPS + 1):
            half = 7.0 if i % (STEPS // 2) == 0 else 4.0
            x = self._x(100.0 * i / STEPS)
            painter.drawLine(QPointF(x, middle - half), QPointF(x, middle + half))
        if self.value is not None:
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(theme.shade(COLOURS.accent))
            painter.drawRoundedRect(QRectF(self._x(self.value) - 5.0, middle - 11.0, 10.0, 22.0), 4.0, 4.0)


class Done(QPushButton):
    """With the keyboard on it Enter and the space bar press it, whatever the space bar means to the window."""

    def __init__(self) -> None:
        super().__init__("Done", objectName="main")
        self.setAutoDefault(True)

    def event(self, event: QEvent) -> bool:
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.ShortcutOverride:
            if event.key() == Qt.Key.Key_Space:
                event.accept()
                return True
        return super().event(event)


class Questionnaire(QWidget):
    """The scales and a button that waits until all are answered."""

    answered = Signal(dict)  # item -> 0 .. 100
    changed = Signal(dict)  # the same, or None where it is not answered yet

    def __init__(self) -> None:
        super().__init__()
        self._language = ENGLISH_WORDS
        self.scales = {item: Scale(item) for item, *_ in ITEMS}
        self.done, self.lacking = Done(), text_label("", "quiet")
        self.done.clicked.connect(self._answer)
        self._card = card = Panel()
        self._grid = grid = QGridLayout(card)
        title = text_label()
        self._feedback = wrapped_label("", "quiet")  # of the trial before, which nothing else shows now
        self._feedback.hide()
        grid.addLayout(column(title, self._feedback), 0, 0, 1, 4)
        #: What is read, its size (px, in a small window) and whether it is bold; of a sentence its key in the language.
        self._texts: list[tuple[QLabel | QPushButton, int, bool, str]] = [
            (title, theme.HEAD, True, "questions_controller"), (self._feedback, theme.NORMAL, False, ""),
            (self.lacking, theme.NORMAL, False, ""), (self.done, theme.TITLE, True, "questions_done"),
        ]  # fmt: skip
        for at, (item, low, high) in enumerate(ITEMS, start=1):
            asked, left, right = wrapped_label(), text_label("", "quiet"), text_label("", "quiet")
            self._texts += [(asked, theme.TITLE, False, item)]
            self._texts += [(end, theme.NORMAL, False, key) for end, key in ((left, low), (right, high))]
            grid.addWidget(asked, at, 0)
            grid.addWidget(left, at, 1, Qt.AlignmentFlag.AlignRight)
            grid.addWidget(self.scales[item], at, 2)
            grid.addWidget(right, at, 3)
            self.scales[item].changed.connect(self._changed)
        grid.setColumnStretch(2, 1)
        grid.addWidget(self.lacking, len(ITEMS) + 1, 0, 1, 3)
        grid.addWidget(self.done, len(ITEMS) + 1, 2, 1, 2, Qt.AlignmentFlag.AlignRight)
        self.setLayout(row(1, (column(1, card, 1), 100), 1, margins=(theme.GAP, theme.GAP, theme.GAP, theme.GAP)))
        self.show_language(ENGLISH_WORDS)

    def show_language(self, language: Language) -> None:
        self._language = language
        for text, _, _, key in self._texts:
            if key:
                text.setText(language[key])
        for item, scale in self.scales.items():
            scale.setAccessibleName(language[item])
        self._allow()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Larger where there is room: the participant sits further away."""
        super().resizeEvent(event)
        by = min(max(min(self.width() / 1000.0, self.height() / 560.0), 1.0), LARGEST)
        by = min(by, self.width() / ROOM_PX[0], self.height() / ROOM_PX[1])
        for text, size, bold, _ in self._texts:
            text.setFont(theme.font(round(by * size), bold))
        self._grid.setColumnMinimumWidth(0, round(by * QUESTION_PX))
        self.done.setMinimumSize(round(by * 160), round(by * 42))
        across, down = round(by * 28), round(by * 20)
        self._grid.setContentsMargins(across, down, across, down)
        self._grid.setHorizontalSpacing(round(by * 16))
        self._grid.setVerticalSpacing(round(by * 12))
        self._card.setMaximumWidth(round(by * 900))

    def show_feedback(self, feedback: str) -> None:
        """What the protocol gives back of the trial before; "": nothing."""
        self._feedback.setText(feedback)
        self._feedback.setVisible(bool(feedback))

    @property
    def values(self) -> dict[str, int | None]:
        return {item: scale.value for item, scale in self.scales.items()}

    def show_values(self, values: Mapping[str, int | None]) -> None:
        """What was answered, here or on another screen."""
        for item, value in values.items():
            self.scales[item].set(value)

    def clear(self) -> None:
        self.show_values(dict.fromkeys(self.scales))

    def showEvent(self, event: QShowEvent) -> None:
        """The first question has the keyboard."""
        super().showEvent(event)
        next(iter(self.scales.values())).setFocus()

    def _changed(self) -> None:
        self._allow()
        self.changed.emit(self.values)

    def _allow(self) -> None:
        left = list(self.values.values()).count(None)
        self.done.setEnabled(not left)
        self.lacking.setText(self._language["questions_left"].format(count=left) if left else "")

    def _answer(self) -> None:
        self.answered.emit({item: float(value) for item, value in self.values.items() if value is not None})


class Instructions(QWidget):
    """What the participant reads before the first trial: page by page, a text and perhaps a picture."""

    turned = Signal()  # a click, for a participant without a keyboard

    def __init__(self) -> None:
        super().__init__()
        self._pages: tuple[InstructionPage, ...] = ()
        self._language = ENGLISH_WORDS
        self.at = 0
        self.text, self.picture = wrapped_label(), QLabel()
        self.place = text_label("", "quiet")
        middle = Qt.AlignmentFlag.AlignHCenter
        self.setLayout(column(1, self.picture, self.text, 1, self.place))
        for part in (self.picture, self.text, self.place):
            part.setAlignment(middle)

    @property
    def over(self) -> bool:
        return self.at >= len(self._pages)

    def show_pages(self, pages: tuple[InstructionPage, ...], language: Language) -> None:
        """From the first page on."""
        self._pages, self._language, self.at = pages, language, 0
        self._show()

    def show_page(self, at: int) -> None:
        """This page, from 0."""
        self.at = at
        self._show()

    def turn(self) -> bool:
        """To the next page; whether there was one to turn."""
        if self.over:
            return False
        self.show_page(self.at + 1)
        return True

    def leave(self) -> None:
        self.at = len(self._pages)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self.turned.emit()

    def _show(self) -> None:
        if self.over:
            return
        page, pages, height = self._pages[self.at], len(self._pages), self.height()
        count = self._language["page"].format(page=self.at + 1, pages=pages) + PART if pages > 1 else ""
        self.place.setText(f"{count}{self._language['page_space']}")
        self.place.setFont(theme.font(round(PLACE_SHARE * height)))
        pixmap = QPixmap()
        pixmap.loadFromData(page.picture)
        room = QSize(round(0.8 * self.width()), round(0.55 * height))
        larger = pixmap.width() > room.width() or pixmap.height() > room.height()
        how = Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
        self.picture.setPixmap(pixmap.scaled(room, *how) if larger else pixmap)
        self.picture.setVisible(not pixmap.isNull())
        self.text.setText(page.text)
        left = 0.75 * height - self.picture.isVisibleTo(self) * self.picture.pixmap().height()
        for size in range(round(TEXT_SHARE * height), round(LEAST_SHARE * height), -1):
            self.text.setFont(theme.font(size))
            if self.text.heightForWidth(room.width()) <= left:
                break

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        across, down = round(0.1 * self.width()), round(0.05 * self.height())
        self.setContentsMargins(across, down, across, down)
        self._show()
