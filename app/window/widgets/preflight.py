"""The header's lights and the brakes' button; what is wrong and what to do about it in a banner."""

from collections.abc import Iterable, Sequence

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QMouseEvent, QResizeEvent
from PySide6.QtWidgets import QPushButton, QWidget

from app.ipc import messages as m
from app.window.widgets import theme
from app.window.widgets.parts import (
    NO_FOCUS,
    FittedLabel,
    Panel,
    clear,
    column,
    holder,
    row,
    text_label,
)
from app.window.widgets.words import as_sentence
from core import faults

NOW = "now"  # state of a check that is being made
#: state -> shape and look of its mark: said by shape too, not by colour alone
MARKS = {
    m.GOOD: ("●", "good"), m.CAUTION: ("▲", "caution"), m.DUE: ("▲", "caution"), m.BAD: ("✕", "bad"),
    m.WAITING: ("○", "off"), NOW: ("▶", "hint"),
}  # fmt: skip
ORDER = (m.BAD, m.DUE, m.CAUTION, m.WAITING)  # of the pills
GAP_PX = 4  # half of that in a pill and between two
PADDING_PX = 14  # beside the words of the banner


class Pill(Panel):
    """One check that is not green: its mark, its name and, where there is room for all of them, its words."""

    def __init__(self, check: m.Check) -> None:
        super().__init__("pill-bad" if check.state == m.BAD else "pill")
        self.check = check
        self.mark, self.name = text_label(*MARKS[check.state], theme.SMALL), text_label(check.name)
        self.words = text_label(check.text, "quiet")
        self.setLayout(row(self.mark, self.name, self.words, spacing=2 * GAP_PX, margins=(11, 0, 11, 0)))
        self.setFixedHeight(30)
        self.setToolTip(f"{check.name}: {sentence(told(check))}")


class Banner(Panel):
    """What is wrong, in two lines at most, in a place that something else has while all is well: nothing moves when it
    comes or goes, and nothing of a page is covered. Its tooltip has all of it.
    """

    def __init__(self) -> None:
        super().__init__("banner")
        self.words = FittedLabel(2, theme.NORMAL, bold=True)
        self.setLayout(column(self.words, spacing=0, margins=(PADDING_PX, 1, PADDING_PX, 1)))

    def text(self) -> str:
        """What is shown of it."""
        return self.words.text()

    def show_text(self, text: str) -> None:
        """A line for each thing; "": nothing is wrong."""
        self.words.show_text(text)
        self.setToolTip(text)


TURN_OFF, TURN_ON, ARE_OFF = TEXTS = "Turn brakes off  Esc", "Turn brakes on  Ctrl+B", "Brakes off"


CURRENTS, ZERO = "Let currents flow again", "Zero current at once; a running trial ends and is kept"
NO_CURRENT = "No session is open, nor Try: no current can flow"


class BrakesButton(QPushButton):
    """As wide as the longest of its texts needs it, so that nothing beside it moves."""

    def __init__(self) -> None:
        super().__init__(TURN_OFF, objectName="brakes", focusPolicy=NO_FOCUS)

    def sizeHint(self) -> QSize:
        width = {text: self.fontMetrics().size(Qt.TextFlag.TextShowMnemonic, text).width() for text in TEXTS}
        return super().sizeHint() + QSize(max(width.values()) - width[self.text()], 0)


class Preflight(QWidget):
    """One mark while all is well, else a pill for each check that is not; `brakes` is placed by the window."""

    clicked = Signal()  # on the mark or a pill

    def __init__(self) -> None:
        super().__init__()
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        self.mark, self.all_well = text_label(), text_label()
        self._well = holder(row(self.mark, self.all_well, spacing=8, margins=(0, 0, 6, 0)))
        self.pills: list[Pill] = []
        self.brakes = BrakesButton()
        self.brakes.setFont(theme.font(theme.NORMAL, bold=True))
        self.brakes.setFixedHeight(34)
        self._row = row(spacing=2 * GAP_PX)
        self.setLayout(row(1, self._row, self._well))
        self.show_snapshot(m.Snapshot(m.PREPARING))

    def fit_words(self) -> None:
        """Show the words of as many pills as have room for them, the reddest first, and of no pill a part of them."""
        for pill in self.pills:
            pill.words.show()
        for pill in reversed(self.pills):
            wide = sum(shown.sizeHint().width() + self._row.spacing() for shown in self.pills)
            pill.words.setVisible(wide <= self.width())

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.fit_words()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self.rect().contains(event.position().toPoint()):
            self.clicked.emit()

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        """The checks, and whether the brakes may act."""
        off, failed = bool(snapshot.brakes_off), snapshot.stage == m.FAILED
        wrong = sorted((c for c in snapshot.checks if c.state != m.GOOD), key=lambda c: ORDER.index(c.state))
        wrong = [check for check in wrong if not (off and check.text == m.BRAKES_OFF)]  # the button says it
        self._show_pills(wrong)
        theme.set_style(self.mark, "good" if snapshot.checks else "off")
        self.mark.setText("●" if snapshot.checks else "○")
        self.all_well.setText(well(snapshot))
        self._well.setVisible(not wrong and not off and not failed)
        about = [f"{check.name}: {check.text}" for check in snapshot.checks]
        self._well.setToolTip("\n".join([*about, "A click (F3) shows the device page."]))
        self.fit_words()
        theme.set_style(self.brakes, "brakes-on" if off or failed else "brakes")
        self.brakes.setText(ARE_OFF if failed else TURN_ON if off else TURN_OFF)
        self.brakes.setEnabled(not failed and (snapshot.can_allow or snapshot.can_turn_off))
        self.brakes.setToolTip(CURRENTS if off else ZERO if snapshot.can_turn_off else NO_CURRENT)

    def _show_pills(self, checks: Sequence[m.Check]) -> None:
        """A pill each; what is said again stays as it is, under a pointer that rests on it."""
        if [pill.check for pill in self.pills] == list(checks):
            return
        clear(self._row)
        self.pills = [Pill(check) for check in checks]
        for pill in self.pills:
            self._row.addWidget(pill)
            pill.show()


def well(snapshot: m.Snapshot) -> str:
    """The one mark while no check is amber or red: "Ready" while a trial or a session can be started."""
    if not snapshot.checks:
        return "One moment …"
    return "Ready" if not snapshot.trial_blocker else "No faults"


def wrong(snapshot: m.Snapshot) -> str:
    """What the banner says, a line for each thing; "": nothing is wrong."""
    return "\n".join(([snapshot.notice] if snapshot.stage == m.FAILED else []) + advice(snapshot))


def advice(snapshot: m.Snapshot) -> list[str]:
    """A line for each thing that is wrong and can be mended now, the first one first: what to do about it."""
    wrong = [check for check in snapshot.checks if check.state == m.BAD]
    lines = [" ".join(filter(None, (f"{check.name}: {sentence(check.text)}", check.advice)))
             for check in wrong if not (snapshot.brakes_off and check.text == m.BRAKES_OFF)]  # fmt: skip
    if snapshot.can_allow and (to_do := faults.advice(snapshot.brakes_off)):  # else somebody turned them off
        lines.insert(0, f"Brakes off. {as_sentence(snapshot.brakes_off)} {to_do}")
    return lines


def listed(checks: Iterable[m.Check]) -> str:
    """A line for each check that is not green: mark, name, what was found, what to do about it."""
    return "\n".join(f"{MARKS[c.state][0]} {c.name}: {sentence(told(c))}" for c in checks if c.state != m.GOOD)


def told(check: m.Check) -> str:
    """What was found, and what to do about it; an advice that begins with the same words says both."""
    if not check.advice or check.advice.lower().startswith(check.text.lower()):
        return check.advice or check.text
    return f"{sentence(check.text)} {check.advice}"


def sentence(text: str) -> str:
    """The text with a full stop, unless it ends as a sentence may."""
    return text if text.endswith((".", "!", "?", "…")) else f"{text}."
