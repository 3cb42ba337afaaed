"""What the data say of the paper's statements, as a page of Analyse."""

from html import escape

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QScrollArea

from app.window.widgets.theme import COLOURS
from app.window.widgets.words import in_colour
from experiments.analysis.findings import CANNOT_TELL, DEPENDS, FAILS, HOLDS
from experiments.export.results import Conclusions

VERDICT = {HOLDS: COLOURS.good, FAILS: COLOURS.bad, CANNOT_TELL: COLOURS.caution, DEPENDS: COLOURS.caution}  # looks


class Verdicts(QScrollArea):
    """The paper's statements, each with what these data say of it; then what else the statistics say."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("panel")
        self.viewport().setObjectName("clear")
        self.shown: Conclusions | None = None
        self._text = QLabel(wordWrap=True, textFormat=Qt.TextFormat.RichText, margin=16)
        self._text.setAlignment(Qt.AlignmentFlag.AlignTop)
        self._text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.setWidgetResizable(True)
        self.setWidget(self._text)

    def show_conclusions(self, conclusions: Conclusions | None) -> None:
        """None: they are being computed."""
        self.shown = conclusions
        if conclusions is None:
            self._text.setText("The statistics are being computed …")
            return
        warned = filter(None, (*conclusions.warnings, conclusions.refusal))
        parts = [f"<p>{in_colour(text, COLOURS.caution)}</p>" for text in warned]
        if conclusions.found:
            parts.append("<h3>What these data say of the paper's statements</h3><table cellpadding=6 width=100%>")
            for finding in conclusions.found:
                verdict, why = (
                    in_colour(finding.verdict, VERDICT[finding.verdict]),
                    in_colour(finding.sentence, COLOURS.quiet),
                )
                parts.append(
                    f"<tr><td width=13%><b>{verdict}</b></td><td width=30%>{escape(finding.statement.text)}</td>"
                    f"<td>{why}</td></tr>"
                )
            parts.append("</table>")
        if conclusions.sentences:
            parts.append("<h3>What else to know</h3>")
        self._text.setText("".join(parts + [f"<p>{escape(sentence)}</p>" for sentence in conclusions.sentences]))
