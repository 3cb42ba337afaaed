"""The header's pre-flight row, and the brakes-off button; what is wrong and what to do about it in a banner."""

from collections.abc import Callable

from PySide6.QtCore import QRect, QSize, Qt, Signal
from PySide6.QtGui import QMouseEvent, QResizeEvent
from PySide6.QtWidgets import QLabel, QPushButton, QWidget

from app.ipc import messages as m
from app.window.widgets import theme
from app.window.widgets.parts import (
    END,
    NO_FOCUS,
    OneLine,
    Panel,
    breakable,
    clear,
    column,
    grid,
    row,
    text_label,
    wrapped_label,
)
from app.window.widgets.words import as_sentence
from core import faults

NOW = "now"  # state of a check that is being made
#: state -> shape and look of its mark: said by shape too, not by colour alone
MARKS = {
    m.GOOD: ("●", "good"), m.CAUTION: ("▲", "caution"), m.DUE: ("▲", "caution"), m.BAD: ("✕", "bad"),
    m.WAITING: ("○", "off"), NOW: ("▶", "hint"),
}  # fmt: skip
DEVICE = "Device"  # the check that leads to the device page
GAP_PX = 4  # in a pill and between two
PADDING_PX = 14  # beside the words of the banner


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


class Banner(Panel):
    """What is wrong, in two lines at most, in the place of the footer, whose words stand under it: nothing moves when
    it comes or goes, and nothing of a page is covered. Its tooltip has all of it.
    """

    def __init__(self) -> None:
        super().__init__("banner")
        self.words = wrapped_label("", size=theme.NORMAL, bold=True)
        self.words.setAlignment(Qt.AlignmentFlag.AlignVCenter)
        self.foot = OneLine("", "", theme.SMALL)
        self.setLayout(column(self.words, self.foot, spacing=0, margins=(PADDING_PX, 1, PADDING_PX, 2)))
        self._whole = ""

    def text(self) -> str:
        """What is shown of it."""
        return self.words.text()

    def show_text(self, text: str) -> None:
        """A line for each thing; "": nothing is wrong."""
        self._whole = breakable(text)
        self.setToolTip(text)
        self.fit_words()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.fit_words()

    def fit_words(self) -> None:
        """Show as much of the text, whole words, as has room in two lines, which it has without a text, too."""
        metrics, room = self.words.fontMetrics(), QRect(0, 0, self.width() - 2 * PADDING_PX - 2, 0)
        self.words.setFixedHeight(metrics.boundingRect(room, Qt.TextFlag.TextWordWrap, "A\nA").height())

        def fits(text: str) -> bool:
            needed = metrics.boundingRect(room, Qt.TextFlag.TextWordWrap, text)
            return needed.height() < 2.5 * metrics.lineSpacing() and needed.width() <= room.width()

        shown = self._whole
        while not fits(shown) and " " in shown:
            shown = f"{shown.removesuffix(' …').rpartition(' ')[0]} …"
        self.words.setText(shown)


OFF, OFF_BY_KEY, ALLOW, ARE_OFF = TEXTS = "Brakes off", "Brakes off  Esc", "Allow brakes", "Brakes are off"


class BrakesButton(QPushButton):
    """As wide as the longest of its texts needs it, so that nothing beside it moves."""

    def __init__(self) -> None:
        super().__init__(OFF, objectName="brakes", focusPolicy=NO_FOCUS)

    def show_key(self, acts: bool) -> None:
        """Name Esc while it takes the brakes off."""
        if self.text() in (OFF, OFF_BY_KEY):
            self.setText(OFF_BY_KEY if acts else OFF)

    def sizeHint(self) -> QSize:
        width = {text: self.fontMetrics().size(Qt.TextFlag.TextShowMnemonic, text).width() for text in TEXTS}
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

    def fit_words(self) -> None:
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
        self.fit_words()

    def show_snapshot(self, snapshot: m.Snapshot) -> bool:
        """Show the checks, and what is wrong: whether anything is."""
        if snapshot.checks != self._checks:
            self._checks = snapshot.checks
            clear(self._row)
            self.pills = [Pill(check) for check in snapshot.checks]
            for pill, check in zip(self.pills, snapshot.checks, strict=True):
                self._row.addWidget(pill)
                if check.name == DEVICE:
                    pill.clicked.connect(self._show_device)
            self.fit_words()
        wrong = ([snapshot.notice] if snapshot.stage == m.FAILED else []) + advice(snapshot)
        self.banner.show_text("\n".join(wrong))
        off, failed = bool(snapshot.brakes_off), snapshot.stage == m.FAILED
        theme.set_style(self.brakes, "brakes-off" if off or failed else "brakes")
        self.brakes.setText(ARE_OFF if failed else ALLOW if off else OFF)
        self.brakes.setEnabled(not failed and (not off or snapshot.can_allow))
        self.brakes.setToolTip(
            "Let currents flow again (Ctrl+B)" if off else "Zero current at once; a running trial ends and is kept"
        )
        return bool(wrong)


def advice(snapshot: m.Snapshot) -> list[str]:
    """A line for each thing that is wrong and can be mended now, the first one first: what to do about it."""
    wrong = [check for check in snapshot.checks if check.state == m.BAD]
    lines = [" ".join(filter(None, (f"{check.name}: {sentence(check.text)}", check.advice)))
             for check in wrong if not (snapshot.brakes_off and check.text == m.BRAKES_OFF)]  # fmt: skip
    if (why := snapshot.brakes_off) and snapshot.can_allow:  # else a device that is not reached comes first
        to_do = faults.advice(why) or "Press Ctrl+B or “Allow brakes”."
        lines.insert(0, f"Brakes off. {as_sentence(why)} {to_do}")
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
        self.names: dict[str, QLabel] = {}
        self._grid = grid(6, 6, stretched=2)
        self.setLayout(self._grid)

    def show_checks(self, checks: tuple[m.Check, ...]) -> bool:
        """Whether they are others than before."""
        if checks == self.shown:
            return False
        self.shown, self.names = checks, {}
        clear(self._grid)
        for at, check in enumerate(checks):
            text = told(check) if check.text and check.state != m.GOOD else check.text
            self._grid.addWidget(text_label(*MARKS[check.state]), at, 0, Qt.AlignmentFlag.AlignTop)
            words = wrapped_label(breakable(text), "quiet")
            if check.name:
                ahead = check.state == m.WAITING and not check.text
                self.names[check.name] = name = text_label(check.name, "quiet" if ahead else "", bold=not ahead)
                self._grid.addWidget(name, at, 1, Qt.AlignmentFlag.AlignTop)
                self._grid.addWidget(words, at, 2)
            else:
                self._grid.addWidget(words, at, 1, 1, 2)
        return True
