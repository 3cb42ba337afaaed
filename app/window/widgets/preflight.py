"""The header's pre-flight row, and the brakes-off button; what is wrong and what to do about it in a banner."""

from collections.abc import Callable

from PySide6.QtCore import QEvent, QObject, QRect, QSize, Qt, Signal
from PySide6.QtGui import QMouseEvent, QResizeEvent
from PySide6.QtWidgets import QLabel, QPushButton, QWidget

from app.ipc import messages as m
from app.window.widgets import theme
from app.window.widgets.parts import END, NO_FOCUS, Panel, breakable, clear, grid, row, text_label, wrapped_label
from app.window.widgets.words import as_sentence
from core import faults

#: state -> shape and look of its mark: said by shape too, not by colour alone
MARKS = {
    m.GOOD: ("●", "good"), m.CAUTION: ("▲", "caution"), m.DUE: ("▲", "caution"), m.BAD: ("✕", "bad"),
    m.WAITING: ("○", "off"),
}  # fmt: skip
DEVICE = "Device"  # the check that leads to the device page
GAP_PX = 4  # in a pill and between two
PADDING_PX = 14  # beside the words of the banner: the sheet's padding, and a little


class Pill(Panel):
    """One check of the pre-flight row; its reason and advice are in the tooltip."""

    clicked = Signal()

    def __init__(self, check: m.Check) -> None:
        super().__init__("pill-bad" if check.state == m.BAD else "pill")
        self.mark = text_label(*MARKS[check.state], theme.SMALL)
        name = text_label(check.name, size=theme.SMALL, bold=True)
        self.words = check.text.partition(",")[0] if check.state == m.GOOD else check.text
        self.text = text_label("", "quiet", theme.SMALL)
        self.setLayout(row(self.mark, name, self.text, spacing=GAP_PX, margins=(7, 0, 7, 0)))
        self.setFixedHeight(30)
        leads = "A click (F3) shows the device page." if check.name == DEVICE else ""
        self.setCursor(Qt.CursorShape.PointingHandCursor if leads else Qt.CursorShape.ArrowCursor)
        self.setToolTip(" ".join(filter(None, (f"{check.name}: {sentence(told(check))}", leads))))

    @property
    def wanted_px(self) -> int:
        """How wide its words are, with the gap before them."""
        return self.text.fontMetrics().horizontalAdvance(self.words) + 1 + GAP_PX  # 1: it is rounded

    def shorten(self, room_px: int) -> None:
        """Show as much of its words as has room; of a few letters nothing."""
        shown = self.text.fontMetrics().elidedText(self.words, END, room_px - GAP_PX)
        self.text.setText(shown)
        self.text.setVisible(shown == self.words or len(shown) > 3)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self.rect().contains(event.position().toPoint()):
            self.clicked.emit()


class Banner(QLabel):
    """What is wrong, laid over the foot of the window: nothing moves when it comes or goes.

    Two lines at most, so that what lies above stays in sight; its tooltip has all of it.
    """

    def __init__(self) -> None:
        super().__init__(objectName="banner", wordWrap=True, textFormat=Qt.TextFormat.PlainText)
        self.setFont(theme.font(theme.NORMAL, bold=True))
        self.hide()
        self._window: QWidget = self
        self._whole = ""

    def lie_over(self, window: QWidget) -> None:
        self._window = window
        self.setParent(window)
        window.installEventFilter(self)

    def show_text(self, text: str) -> None:
        """A line for each thing; "": nothing is wrong."""
        self._whole = breakable(text)
        self.setToolTip(text)
        self.setVisible(bool(text))
        self.follow_text()

    def follow_text(self) -> None:
        """As wide as the window, as high as its text, from the foot up."""
        wide = self._window.width() - 2 * theme.GAP
        self.setText(self._fitting(wide))
        high = self.heightForWidth(wide)
        self.setGeometry(theme.GAP, self._window.height() - theme.GAP - high, wide, high)
        self.raise_()

    def _fitting(self, wide: int) -> str:
        """As much of the text, whole words, as has room in two lines of a banner so wide (px)."""
        metrics, room = self.fontMetrics(), QRect(0, 0, wide - 2 * PADDING_PX, 0)

        def fits(text: str) -> bool:
            needed = metrics.boundingRect(room, Qt.TextFlag.TextWordWrap, text)
            return needed.height() < 2.5 * metrics.lineSpacing() and needed.width() <= room.width()

        shown = self._whole
        while not fits(shown) and " " in shown:
            shown = f"{shown.removesuffix(' …').rpartition(' ')[0]} …"
        return shown

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize and watched is self._window:
            self.follow_text()
        return super().eventFilter(watched, event)


OFF, ALLOW = "Brakes off  Esc", "Allow brakes"


class BrakesButton(QPushButton):
    """As wide as the longer of its two texts needs it, so that nothing beside it moves."""

    def __init__(self) -> None:
        super().__init__(OFF, objectName="brakes", focusPolicy=NO_FOCUS)

    def sizeHint(self) -> QSize:
        width = {text: self.fontMetrics().size(Qt.TextFlag.TextShowMnemonic, text).width() for text in (OFF, ALLOW)}
        return super().sizeHint() + QSize(max(width.values()) - width[self.text()], 0)


class Preflight(QWidget):
    """Pills; `brakes` and `advice`, which says what is wrong, are placed by the window."""

    def __init__(self, show_device: Callable[[], None]) -> None:
        """show_device: shows the device page."""
        super().__init__()
        self._show_device = show_device
        self._checks: tuple[m.Check, ...] = ()  # that are shown
        self.pills: list[Pill] = []
        self.brakes = BrakesButton()
        self.brakes.setFont(theme.font(theme.NORMAL, bold=True))
        self.brakes.setFixedHeight(34)
        self.banner = Banner()
        self._row = row(spacing=GAP_PX)
        self.setLayout(row(1, self._row))

    def follow_text(self) -> None:
        """A fair share of the room to the words of each: what a short one does not need is for the longer ones."""
        for pill in self.pills:
            pill.shorten(0)
        room = self.width() + GAP_PX - sum(pill.sizeHint().width() + GAP_PX for pill in self.pills)
        for n, pill in enumerate(sorted(self.pills, key=lambda pill: pill.wanted_px)):
            share = min(pill.wanted_px, max(room, 0) // (len(self.pills) - n))
            pill.shorten(share)
            room -= share

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.follow_text()

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        """Show the checks, and what is wrong."""
        if snapshot.checks != self._checks:
            self._checks = snapshot.checks
            clear(self._row)
            self.pills = [Pill(check) for check in snapshot.checks]
            for pill, check in zip(self.pills, snapshot.checks, strict=True):
                self._row.addWidget(pill)
                if check.name == DEVICE:
                    pill.clicked.connect(self._show_device)
            self.follow_text()
        wrong = ([snapshot.notice] if snapshot.stage == m.FAILED else []) + advice(snapshot)
        self.banner.show_text("\n".join(wrong))
        off = bool(snapshot.brakes_off)
        theme.set_style(self.brakes, "brakes-off" if off else "brakes")
        self.brakes.setText(ALLOW if off else OFF)
        self.brakes.setToolTip(
            "Let currents flow again (Ctrl+B)" if off else "Zero current at once; a running trial ends and is kept"
        )


def advice(snapshot: m.Snapshot) -> list[str]:
    """A line for each thing that is wrong and keeps trials from starting: what to do about it."""
    lines = []
    if why := snapshot.brakes_off:
        to_do = faults.advice(why) or "Press Ctrl+B or “Allow brakes”."
        lines.append(f"Brakes off. {as_sentence(why)} {to_do}")
    for check in snapshot.checks:
        if check.state == m.BAD and not (snapshot.brakes_off and check.text == m.BRAKES_OFF):
            lines.append(" ".join(filter(None, (f"{check.name}: {sentence(check.text)}", check.advice))))
    return lines


def told(check: m.Check) -> str:
    """What was found, and what to do about it; an advice that begins with the same words says both."""
    if not check.advice or check.advice.lower().startswith(check.text.lower()):
        return check.advice or check.text
    return f"{sentence(check.text)} {check.advice}"


def sentence(text: str) -> str:
    """The text with a full stop, unless it ends as a sentence may."""
    return text if text.endswith((".", "!", "?", "…")) else f"{text}."


class Checklist(QWidget):
    """The pre-flight checks as a list that can be read: mark, name, what was found, what to do about it."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("clear")
        self.shown: tuple[m.Check, ...] = ()
        self._grid = grid(6, 6, stretched=2)
        self.setLayout(self._grid)

    def show_checks(self, checks: tuple[m.Check, ...]) -> None:
        if checks == self.shown:
            return
        self.shown = checks
        clear(self._grid)
        for at, check in enumerate(checks):
            text = check.text if check.state == m.GOOD else told(check)
            self._grid.addWidget(text_label(*MARKS[check.state]), at, 0, Qt.AlignmentFlag.AlignTop)
            words = wrapped_label(breakable(text), "quiet")
            if check.name:
                self._grid.addWidget(text_label(check.name, bold=True), at, 1, Qt.AlignmentFlag.AlignTop)
                self._grid.addWidget(words, at, 2)
            else:
                self._grid.addWidget(words, at, 1, 1, 2)
