"""What the data say of the paper's statements, as a page of Analyse."""

import re
from collections import Counter
from collections.abc import Sequence

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtWidgets import QLabel, QWidget

from app.window.canvas.path_marks import paint_disc
from app.window.widgets import theme
from app.window.widgets.parts import (
    Figures,
    Panel,
    Part,
    column,
    grid,
    holder,
    row,
    scrolled,
    text_label,
    wrapped_label,
)
from app.window.widgets.theme import COLOURS, pen, shade
from experiments.analysis.findings import CANNOT_TELL, DEPENDS, FAILS, HOLDS, SIMILAR, Evidence, Finding
from experiments.export.results import Conclusions

VERDICT = {
    HOLDS: ("✓", COLOURS.good), FAILS: ("✗", COLOURS.bad),
    CANNOT_TELL: ("?", COLOURS.caution), DEPENDS: ("◐", COLOURS.caution),
}  # fmt: skip
HEADS = "Verdict", "The paper's statement", "", "The difference that decides"
ABOUT = (
    "Dot and line: a difference and its interval, in % of the size without control. Green: where it must lie.\n"
    "An arrow: it goes on beyond the scale, to the numbers at the right."
)
DIFFERENCE_PX = 170, 18  # wide, and high, of a difference
VERDICT_PX = 132


def as_printed(text: str) -> str:
    """With the sign of a negative number, and no line that ends between a number and its unit."""
    text = re.sub(r"(?<!\w)-(?=\d)", "−", text.replace("m/s", "m/\u2060s"))
    return re.sub(r"(?<=\d) (?=[%mN])", "\u00a0", text)


class Differences(QWidget):
    """Differences, each a point and its interval over the part of the scale where it had to lie."""

    def __init__(self, evidence: Sequence[Evidence], colour: str) -> None:
        super().__init__()
        self.evidence, self._colour = evidence, colour
        wide, high = DIFFERENCE_PX
        self.setFixedSize(QSize(wide, max(len(self.evidence), 1) * high))

    def _x(self, share: float) -> float:
        """Of a difference, in units of the size without control."""
        return (0.5 + 0.46 * min(max(share, -1.0), 1.0)) * self.width()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        high = self.height() / max(len(self.evidence), 1)
        for place, piece in enumerate(self.evidence):
            assert piece.found is not None
            _, middle, low, end = piece.found
            y = (place + 0.5) * high
            least = self._x(-piece.limit) if piece.claim.kind == SIMILAR else 0.0
            painter.fillRect(
                QRectF(least, y - 0.4 * high, self._x(piece.limit) - least, 0.8 * high), shade(COLOURS.good, 0.2)
            )
            painter.setPen(pen(COLOURS.quiet, 1.0))
            painter.drawLine(QPointF(self._x(0.0), y - 0.5 * high), QPointF(self._x(0.0), y + 0.5 * high))
            painter.setPen(pen(self._colour, 2.0))
            left, right = QPointF(self._x(low), y), QPointF(self._x(end), y)
            painter.drawLine(left, right)
            for beyond, at, way in ((low < -1.0, left, 1.0), (end > 1.0, right, -1.0)):
                if beyond:
                    painter.drawPolyline([at + QPointF(4.0 * way, -4.0), at, at + QPointF(4.0 * way, 4.0)])
            if abs(middle) <= 1.0:
                paint_disc(painter, QPointF(self._x(middle), y), 4.0, self._colour)


class Verdicts(Panel):
    """The paper's statements, each with what these data say of it; then what else the statistics say."""

    def __init__(self) -> None:
        super().__init__()
        self.shown: Conclusions | None = None
        self._area = scrolled(QWidget())
        self.setLayout(column(self._area, margins=(4, 4, 4, 4)))

    def show_conclusions(self, conclusions: Conclusions | None) -> None:
        """None: they are being computed."""
        self.shown, parts = conclusions, list[Part]()
        if conclusions is None:
            parts.append(_text("The statistics are being computed …", "quiet"))
        else:
            parts += [_text(warning, "caution") for warning in (*conclusions.warnings, conclusions.refusal) if warning]
            if conclusions.found:
                parts += [_title("What these data say of the paper's statements"), *_findings(conclusions.found)]
            if conclusions.sentences:
                parts += [Panel("line"), _title("What else to know"), *map(_text, conclusions.sentences)]
        self._area.setWidget(holder(column(*parts, 1, spacing=8, margins=(12, 8, 12, 12))))


def _title(text: str) -> QLabel:
    return text_label(text, size=theme.TITLE, bold=True)


def _text(text: str, name: str = "") -> QLabel:
    """It can be copied."""
    label = wrapped_label(as_printed(text), name)
    label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    return label


def _findings(found: Sequence[Finding]) -> tuple[Part, ...]:
    """How many have each verdict; and a line for each: verdict, statement, what decides it, drawn and in words."""
    count, counts = Counter(finding.verdict for finding in found), Figures(theme.NORMAL)
    counts.show_parts(*((f"{mark} {name}: {count[name]} ", of) for name, (mark, of) in VERDICT.items() if count[name]))
    lines = grid(16, 7, stretched=3)
    lines.setColumnStretch(1, 1)
    lines.setColumnStretch(3, 2)
    for across, head in enumerate(HEADS):
        lines.addWidget(text_label(head, "quiet", theme.SMALL), 0, across)
    left, zero, right = (text_label(text, "quiet", theme.SMALL) for text in ("−100 %", "0", "+100 %"))
    lines.addLayout(row(left, 1, zero, 1, right), 0, 2)
    for finding in found:
        down, (mark, colour) = lines.rowCount(), VERDICT[finding.verdict]
        verdict = wrapped_label(f"{mark} {finding.verdict}", bold=True)
        verdict.setStyleSheet(f"color: {colour}")
        verdict.setFixedWidth(VERDICT_PX)
        decisive = [piece for piece in finding.evidence if piece.found and piece.judged in finding.sentence]
        shown = verdict, _text(finding.statement.text), Differences(decisive, colour), _text(finding.sentence, "quiet")
        lines.addWidget(Panel("line"), down, 0, 1, len(HEADS))
        for across, part in enumerate(shown):
            lines.addWidget(part, down + 1, across, Qt.AlignmentFlag.AlignTop)
    return counts, wrapped_label(ABOUT, "quiet", theme.SMALL), lines
