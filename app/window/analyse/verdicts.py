"""What the data say of the paper's statements, as a page of Analyse."""

import re
from collections import Counter
from collections.abc import Sequence

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtWidgets import QGridLayout, QLabel, QWidget

from app.window.canvas.path_marks import paint_disc
from app.window.widgets import theme
from app.window.widgets.parts import Panel, Part, column, grid, holder, rule, scrolled, text_label, wrapped_label
from app.window.widgets.theme import COLOURS, pen, shade
from app.window.widgets.words import in_colour
from experiments.analysis.findings import CANNOT_TELL, DEPENDS, FAILS, HOLDS, SIMILAR, Evidence
from experiments.export.results import Conclusions

VERDICT = {
    HOLDS: ("✓", COLOURS.good), FAILS: ("✗", COLOURS.bad),
    CANNOT_TELL: ("?", COLOURS.caution), DEPENDS: ("◐", COLOURS.caution),
}  # fmt: skip
HEADS = "Verdict", "The paper's statement", "−100 to +100 %", "The difference that decides"
ABOUT = (
    "Dot and line: a difference and its interval, in % of the size without control. Green ground: where it must lie."
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
        self.follow_text()

    def follow_text(self) -> None:
        wide, high = map(theme.text_px, DIFFERENCE_PX)
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
        self.shown = conclusions
        parts: list[Part] = [text_label("The statistics are being computed …", "quiet")]
        if conclusions is not None:
            warned = " ".join(filter(None, (*conclusions.warnings, conclusions.refusal)))
            parts = [_text(warned, "caution")] if warned else []
            if conclusions.found:
                parts += [_title("What these data say of the paper's statements"), _counts(conclusions)]
                parts += [wrapped_label(ABOUT, "quiet", theme.SMALL), _table(conclusions)]
            if conclusions.sentences:
                parts += [rule(), _title("What else to know")]
                parts += [_text(sentence) for sentence in conclusions.sentences]
        self._area.setWidget(holder(column(*parts, 1, spacing=8, margins=(12, 8, 12, 12))))


def _text(text: str, name: str = "") -> QLabel:
    """It can be copied."""
    label = wrapped_label(as_printed(text), name)
    label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    return label


def _title(text: str) -> QLabel:
    return text_label(text, size=theme.TITLE, bold=True)


def _counts(conclusions: Conclusions) -> QLabel:
    """How many statements have each verdict."""
    count, label = Counter(finding.verdict for finding in conclusions.found), wrapped_label()
    label.setTextFormat(Qt.TextFormat.RichText)
    parts = (
        in_colour(f"{mark} {verdict}: {count[verdict]}".replace(" ", "\u00a0"), colour)
        for verdict, (mark, colour) in VERDICT.items() if count[verdict]
    )  # fmt: skip
    label.setText(" &nbsp; ".join(parts))
    return label


def _table(conclusions: Conclusions) -> QGridLayout:
    """A line for each statement: verdict, statement, what decides it as a picture and in words."""
    lines = grid(16, 7, stretched=3)
    lines.setColumnStretch(1, 1)
    lines.setColumnStretch(3, 2)
    top = Qt.AlignmentFlag.AlignTop
    for across, head in enumerate(HEADS):
        lines.addWidget(text_label(head, "quiet", theme.SMALL), 0, across)
    for finding in conclusions.found:
        down, (mark, colour) = lines.rowCount(), VERDICT[finding.verdict]
        verdict = wrapped_label(f"{mark} {finding.verdict}", bold=True)
        verdict.setStyleSheet(f"color: {colour}")
        verdict.setFixedWidth(theme.text_px(VERDICT_PX))
        decisive = [piece for piece in finding.evidence if piece.found and piece.judged in finding.sentence]
        lines.addWidget(rule(), down, 0, 1, len(HEADS))
        lines.addWidget(verdict, down + 1, 0, top)
        lines.addWidget(_text(finding.statement.text), down + 1, 1, top)
        lines.addWidget(Differences(decisive, colour), down + 1, 2, top)
        lines.addWidget(_text(finding.sentence, "quiet"), down + 1, 3, top)
    return lines
