"""What the pages are made of: texts that are never cut, buttons, panels, rows and columns."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QPoint, QPointF, QRect, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QFontMetrics, QPainter, QPaintEvent, QPolygonF, QResizeEvent, QWheelEvent
from PySide6.QtWidgets import (
    QBoxLayout,
    QButtonGroup,
    QComboBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLayout,
    QLayoutItem,
    QPlainTextEdit,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QStackedWidget,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QVBoxLayout,
    QWidget,
)

from app.window.widgets import theme
from app.window.widgets.theme import COLOURS

NO_FOCUS = Qt.FocusPolicy.NoFocus  # of what never takes the keyboard
TAB_FOCUS = Qt.FocusPolicy.TabFocus  # of what a click leaves the keyboard where it is
END = Qt.TextElideMode.ElideRight  # where dots stand in place of what has no room
PART = " · "  # between two parts of a line
LIST_EDGES_PX = 24  # of a list that drops down: its frame and a scroll bar


def breakable(text: str) -> str:
    """The text with places to break inside long paths."""
    return text.replace("/", "/\u200b").replace("\\", "\\\u200b")


def wrapped_label(text: str = "", name: str = "", size: int = theme.NORMAL, bold: bool = False) -> QLabel:
    """A text that breaks into lines where it must. name: quiet, good, caution or bad."""
    label = QLabel(text, objectName=name, wordWrap=True, textFormat=Qt.TextFormat.PlainText)
    label.setFont(theme.font(size, bold))
    return label


def text_label(text: str = "", name: str = "", size: int = theme.NORMAL, bold: bool = False) -> QLabel:
    """A text in one line that takes the room that it needs."""
    label = wrapped_label(text, name, size, bold)
    label.setWordWrap(False)
    return label


def printed(hint: str = "", wrap: bool = False) -> QPlainTextEdit:
    """A text in columns, to be read. hint: what stands in its place while there is none."""
    mode = QPlainTextEdit.LineWrapMode.WidgetWidth if wrap else QPlainTextEdit.LineWrapMode.NoWrap
    text = QPlainTextEdit(readOnly=True, placeholderText=hint, lineWrapMode=mode)
    text.setFont(theme.mono())
    return text


class Panel(QFrame):
    """A frame in the look of its name (the `#name` rules of the sheet): panel, canvas, card, pill, line."""

    def __init__(self, name: str = "panel", parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName(name)


class OneLine(QLabel):
    """A text in one line, shortened where there is no room: to the first of its parts, else with dots in its middle.
    Its tooltip has all of it.
    """

    def __init__(self, text: str = "", name: str = "", size: int = theme.SMALL, bold: bool = False) -> None:
        super().__init__(objectName=name, textFormat=Qt.TextFormat.PlainText)
        self.setFont(theme.font(size, bold))
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.setText(text)

    def setText(self, text: str) -> None:
        if text != self.text():
            super().setText(text)
            self.setToolTip(text)

    def minimumSizeHint(self) -> QSize:
        return QSize(0, self.fontMetrics().height())  # without a text, too: nothing moves when one comes

    def sizeHint(self) -> QSize:
        return QSize(super().sizeHint().width(), self.minimumSizeHint().height())

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setPen(self.palette().color(self.foregroundRole()))
        text, metrics, room = self.text(), self.fontMetrics(), self.width()
        parts = text.split(PART)
        shorter = (PART.join([*parts[:n], "…"]) for n in range(len(parts) - 1, 0, -1))
        fitting = (words for words in (text, *shorter) if metrics.horizontalAdvance(words) <= room)
        shown = next(fitting, None) or metrics.elidedText(text, Qt.TextElideMode.ElideMiddle, room)
        painter.drawText(self.rect(), Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter, shown)


class FittedLabel(QLabel):
    """A text of so many lines at most, of which as many whole words are shown as have room; its tooltip has all."""

    def __init__(self, lines: int, size: int = theme.NORMAL, bold: bool = False) -> None:
        super().__init__(wordWrap=True, textFormat=Qt.TextFormat.PlainText)
        self.setFont(theme.font(size, bold))
        self.setAlignment(Qt.AlignmentFlag.AlignVCenter)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self._lines, self._whole = lines, ""

    def show_text(self, text: str) -> None:
        """Show a text, with room for all of its lines whether it needs them or not."""
        self._whole = breakable(text)
        self.setToolTip(text)
        self._fit()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        metrics, room = self.fontMetrics(), QRect(0, 0, self.width() - 2, 0)
        lines = "\n".join(self._lines * "A")
        self.setFixedHeight(metrics.boundingRect(room, Qt.TextFlag.TextWordWrap, lines).height())

        def fits(text: str) -> bool:
            needed = metrics.boundingRect(room, Qt.TextFlag.TextWordWrap, text)
            return needed.height() < (self._lines + 0.5) * metrics.lineSpacing() and needed.width() <= room.width()

        shown = self._whole
        while not fits(shown) and " " in shown:
            shown = f"{shown.removesuffix(' …').rpartition(' ')[0]} …"
        self.setText(shown)


class Figures(QWidget):
    """A line that changes often, in parts with a colour each: painted, so that the window is not laid out anew.

    Where there is no room for it, it is smaller; and if that is not enough, dots stand in place of its end, never of
    the first digits of a number.
    """

    def __init__(self, size: int = theme.SMALL, right: bool = False, bold: bool = False) -> None:
        super().__init__()
        self._size, self._right, self._bold = size, right, bold
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
        return QSize(0, QFontMetrics(theme.font(self._size)).height())

    def paintEvent(self, event: QPaintEvent) -> None:
        painter, words, room = QPainter(self), self.text(), self.width()
        least = min(theme.LEAST_PX, self._size)
        sizes = range(self._size, least - 1, -1)
        size = next((fitting for fitting in sizes if theme.text_width(words, fitting, self._bold) <= room), sizes[-1])
        painter.setFont(theme.font(size, self._bold))
        x = max(room - theme.text_width(words, size, self._bold), 0.0) if self._right else 0.0
        for text, colour in self.parts:
            shown = painter.fontMetrics().elidedText(text, END, math.ceil(room - x))
            painter.setPen(theme.shade(colour))
            painter.drawText(QRectF(x, 0.0, room - x + 2.0, self.height()), Qt.AlignmentFlag.AlignVCenter, shown)
            x += theme.text_width(f"{text} ", size, self._bold)


class SaidInList(QStyledItemDelegate):
    """An entry of a list that drops down, and behind it what its tooltip says: the closed box has no room for it."""

    def initStyleOption(self, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex) -> None:
        super().initStyleOption(option, index)
        option.text = PART.join(filter(None, (option.text, index.data(Qt.ItemDataRole.ToolTipRole))))  # type: ignore[attr-defined]  # it is there


class Choice(QComboBox):
    """One of several. Without the focus it leaves the wheel to the page that scrolls below it.

    The style's own arrow would bring a ground of its own.
    """

    _values: tuple = ()

    def __init__(self) -> None:
        super().__init__()
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)  # Qt's own choice lets the wheel give the focus

    def wheelEvent(self, event: QWheelEvent) -> None:
        super().wheelEvent(event) if self.hasFocus() else event.ignore()

    def fill(self, entries: Mapping[Any, str], value: Any) -> None:
        """Show these, value -> text, and which is chosen."""
        self._values = tuple(entries)
        self.clear()
        self.addItems(list(entries.values()))
        self.setCurrentIndex(self._values.index(value))

    def say(self, sentences: Mapping[Any, str]) -> None:
        """Say these of the values in the list that drops down, which becomes as wide as they are."""
        for place, value in enumerate(self._values):
            self.setItemData(place, sentences.get(value), Qt.ItemDataRole.ToolTipRole)
        self.view().setItemDelegate(SaidInList(self))
        self.view().setMinimumWidth(self.view().sizeHintForColumn(0) + LIST_EDGES_PX)

    def value(self) -> Any:
        return self._values[self.currentIndex()]

    def show_value(self, value: Any) -> None:
        """Choose a value; one that is not among them changes nothing."""
        if value in self._values:
            self.setCurrentIndex(self._values.index(value))

    def paintEvent(self, event: QPaintEvent) -> None:
        super().paintEvent(event)
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(theme.shade(COLOURS.quiet))
        at = QPointF(self.width() - 16.0, 0.5 * self.height() + 2.5)
        painter.drawPolygon(QPolygonF([at, at + QPointF(-4.5, -5.0), at + QPointF(4.5, -5.0)]))


class KeyButton(QPushButton):
    """A button that says its key; it never takes the keyboard, so a key always means the same."""

    def __init__(self, text: str, key: str = "", name: str = "key") -> None:
        super().__init__(text, objectName=name, focusPolicy=NO_FOCUS, minimumHeight=30)
        self.setFont(theme.font(theme.NORMAL, bold=name == "main"))
        self.setStyleSheet("text-align: left")
        self.key = text_label(key, "hint" if name == "main" else "quiet", theme.SMALL)
        self.toggled.connect(lambda on: theme.set_style(self.key, "hint" if on else "quiet"))
        self.key.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.setLayout(row(1, self.key, margins=(12, 0, 10, 0)))

    def sizeHint(self) -> QSize:
        words = self.fontMetrics().horizontalAdvance(self.text()) + self.key.sizeHint().width()
        return QSize(words + 12 + 10 + 16, max(super().sizeHint().height(), self.minimumHeight()))

    def minimumSizeHint(self) -> QSize:
        return self.sizeHint()


def button(text: str, do: Callable[[], object], name: str = "", hint: str = "") -> QPushButton:
    """A button that does something, by Enter too. name: "main" or "small"; hint: its tooltip."""
    pressed = QPushButton(text, objectName=name, toolTip=hint, autoDefault=True)
    pressed.clicked.connect(lambda: do())
    return pressed


def show_wait(pressed: QPushButton, text: str) -> None:
    """What the button asked for is being done: it says so, and cannot be pressed again."""
    pressed.setText(text)
    pressed.setEnabled(False)


def toggle(text: str, do: Callable[[bool], object], on: bool = False, hint: str = "") -> QPushButton:
    """A chip that is lit while it is on."""
    pressed = QPushButton(text, objectName="toggle", checkable=True, checked=on, toolTip=hint, focusPolicy=TAB_FOCUS)
    pressed.toggled.connect(do)
    return pressed


Margins = tuple[int, int, int, int]  # px, as Qt has them: left, top, right, bottom
PANEL_MARGINS: Margins = (16, 12, 16, 14)
Part = QWidget | QLayout | int | tuple[QWidget | QLayout, int]


def row(*parts: Part, spacing: int = 8, margins: Margins = (0, 0, 0, 0)) -> QHBoxLayout:
    """Parts side by side, as (part, share) with a share of the room; a number is a stretch."""
    return fill(QHBoxLayout(), parts, spacing, margins)


def column(*parts: Part, spacing: int = 6, margins: Margins = (0, 0, 0, 0)) -> QVBoxLayout:
    """Parts one below the other, as in a row."""
    return fill(QVBoxLayout(), parts, spacing, margins)


Box = TypeVar("Box", bound=QBoxLayout)


def fill(layout: Box, parts: Sequence[Part], spacing: int, margins: Margins) -> Box:
    """Put parts into a layout; in a row a widget that takes any width has a share."""
    layout.setSpacing(spacing)
    layout.setContentsMargins(*margins)
    for given in parts:
        part, share = given if isinstance(given, tuple) else (given, 0)
        if isinstance(part, int):
            layout.addStretch(part)
        elif isinstance(part, QLayout):
            layout.addLayout(part, share)
        else:
            across = isinstance(layout, QHBoxLayout) and part.sizePolicy().horizontalPolicy()
            layout.addWidget(part, share or int(across == QSizePolicy.Policy.Ignored))
    return layout


def grid(across: int, down: int, stretched: int, margins: Margins = (0, 0, 0, 0)) -> QGridLayout:
    """An empty grid: px between its columns and its rows; `stretched` is the column that takes the free width."""
    layout = QGridLayout()
    layout.setHorizontalSpacing(across)
    layout.setVerticalSpacing(down)
    layout.setColumnStretch(stretched, 1)
    layout.setContentsMargins(*margins)
    return layout


def holder(layout: QLayout) -> QWidget:
    """A widget for a layout, with no ground of its own."""
    widget = QWidget()
    widget.setObjectName("clear")
    widget.setLayout(layout)
    return widget


def stack(*pages: QWidget) -> QStackedWidget:
    """One page at a time, at first the first."""
    widget = QStackedWidget()
    for page in pages:
        widget.addWidget(page)
    return widget


def keep_room(widget: QWidget) -> None:
    """Its place stays while it is hidden."""
    policy = widget.sizePolicy()
    policy.setRetainSizeWhenHidden(True)
    widget.setSizePolicy(policy)


def panel(title: str, *parts: Part, spacing: int = 8, margins: Margins = PANEL_MARGINS) -> QFrame:
    """A panel with a title and, in a column below it, these parts."""
    frame, head = Panel(), text_label(title, size=theme.HEAD, bold=True)
    frame.setLayout(column(head, *parts, spacing=spacing, margins=margins))
    return frame


def scrolled(inside: QWidget) -> QScrollArea:
    """What may be higher than its place."""
    area = QScrollArea(widgetResizable=True)
    inside.setObjectName("clear")
    area.viewport().setObjectName("clear")
    area.setWidget(inside)
    return area


def clear(layout: QLayout) -> None:
    """Take everything out of a layout."""
    while (item := layout.takeAt(0)) is not None:
        if (widget := item.widget()) is not None:
            widget.hide()
            widget.deleteLater()
        elif (inner := item.layout()) is not None:
            clear(inner)


def tab_stops(inside: QWidget) -> list[QWidget]:
    """Where Tab stops in a widget, in the order in which its parts were made."""
    parts = (part for part in inside.findChildren(QWidget) if part.isVisibleTo(inside))
    return [part for part in parts if part.focusPolicy() & Qt.FocusPolicy.TabFocus]


def chain_tabs(*stops: QWidget) -> None:
    """Let Tab go from each of these to the next: what is made later would come last."""
    for before, after in itertools.pairwise(stops):
        QWidget.setTabOrder(before, after)


class Segments(QWidget):
    """One of a few, side by side; in several lines where a text would not fit."""

    changed = Signal(object)  # the value that was chosen

    def __init__(self, choices: Mapping[Any, str], label: str = "") -> None:
        """choices: value -> text; none is chosen at first."""
        super().__init__(accessibleName=label)
        self.setObjectName("clear")
        self._values, self._group = tuple(choices), QButtonGroup(self)
        for place, text in enumerate(choices.values()):
            self._group.addButton(QPushButton(text, objectName="segment", checkable=True), place)
        self._group.idClicked.connect(lambda place: self.changed.emit(self._values[place]))
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setSpacing(4)
        self._arrange(len(choices))

    def _arrange(self, columns: int) -> None:
        for place, button in enumerate(self._group.buttons()):
            self._grid.addWidget(button, *divmod(place, columns))
            self._grid.setColumnStretch(place, place < columns)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        widths, gap = [button.sizeHint().width() for button in self._group.buttons()], self._grid.spacing()

        def fit(columns: int) -> bool:
            return sum(max(widths[n::columns]) + gap for n in range(columns)) - gap <= self.width()

        self._arrange(next((columns for columns in range(len(widths), 1, -1) if fit(columns)), 1))

    def value(self) -> Any:
        """What is chosen; None: nothing."""
        place = self._group.checkedId()
        return self._values[place] if place >= 0 else None

    def show_value(self, value: Any) -> None:
        """Choose a value; one that is not among them changes nothing."""
        if value in self._values:
            self._group.button(self._values.index(value)).setChecked(True)
            for one in self._group.buttons():  # Tab stops at the one that is chosen, arrows go on from there
                one.setFocusPolicy(Qt.FocusPolicy.StrongFocus if one.isChecked() else Qt.FocusPolicy.ClickFocus)


class Flow(QLayout):
    """Widgets from left to right, line by line. gap: px between them."""

    def __init__(self, *widgets: QWidget, gap: int) -> None:
        super().__init__()
        self._items: list[QLayoutItem] = []
        self.setContentsMargins(0, 0, 0, 0)
        self.setSpacing(gap)
        for widget in widgets:
            self.addWidget(widget)

    def addItem(self, item: QLayoutItem) -> None:
        self._items.append(item)

    def count(self) -> int:
        return len(self._items)

    def itemAt(self, index: int) -> QLayoutItem | None:
        return self._items[index] if 0 <= index < len(self._items) else None

    def takeAt(self, index: int) -> Any:  # None at the end, which PySide's own type leaves out
        return self._items.pop(index) if 0 <= index < len(self._items) else None

    def expandingDirections(self) -> Qt.Orientation:
        return Qt.Orientation(0)

    def hasHeightForWidth(self) -> bool:
        return True

    def heightForWidth(self, width: int) -> int:
        return self._place(QRect(0, 0, width, 0), only_measure=True)

    def setGeometry(self, rect: QRect) -> None:
        super().setGeometry(rect)
        self._place(rect)

    def sizeHint(self) -> QSize:
        return self.minimumSize()

    def minimumSize(self) -> QSize:
        sizes = [item.minimumSize() for item in self._items if not item.isEmpty()]
        return QSize(max((s.width() for s in sizes), default=0), max((s.height() for s in sizes), default=0))

    def _place(self, rect: QRect, only_measure: bool = False) -> int:
        """Put every item into its place; the height of all lines."""
        x, y, height, gap = rect.x(), rect.y(), 0, self.spacing()  # of this line
        for item in self._items:
            if item.isEmpty():
                continue
            size = item.sizeHint()
            if x > rect.x() and x + size.width() > rect.right() + 1:
                x, y, height = rect.x(), y + height + gap, 0
            if not only_measure:
                item.setGeometry(QRect(QPoint(x, y), size))
            x, height = x + size.width() + gap, max(height, size.height())
        return y + height - rect.y()
