"""The bottom line: proof that what happens is being recorded, and what would make it happen again."""

from PySide6.QtWidgets import QFrame, QHBoxLayout, QWidget

from app import __version__
from app.ipc import messages as m
from app.window.painting import theme
from app.window.painting.labels import OneLine, word
from app.window.words import grouped, size

STALE_S = 1.0  # a last write longer ago than this is worth a look


class ProofLine(QFrame):
    """Name, rows, bytes and age of the recording; earlier runs verified; seed, plan and version."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent, objectName="panel")
        self.lamp, self.recording = word("●", size=theme.SMALL), OneLine("Nothing recorded yet")
        self.origin = word("", "quiet", theme.SMALL)
        self._folder = ""
        layout = QHBoxLayout(self)
        layout.setContentsMargins(12, 7, 12, 7)
        layout.setSpacing(8)
        layout.addWidget(self.lamp)
        layout.addWidget(self.recording, 1)
        layout.addWidget(self.origin)
        self._light(theme.BRAKE_OFF)

    def _light(self, colour: str) -> None:
        if (sheet := f"color: {colour}") != self.lamp.styleSheet():  # each one makes the window lay itself out anew
            self.lamp.setStyleSheet(sheet)

    def show_opened(self, opened: m.Opened) -> None:
        """Seed, plan and version: with them the same session can be laid out again."""
        parts = [f"seed {opened.seed}", f"phd {__version__}"]
        if opened.plan_sha256:
            parts.insert(1, f"plan {opened.plan_sha256[:4]}…{opened.plan_sha256[-2:]}")
        self.origin.setText(" · ".join(parts))
        self.origin.setToolTip(f"Plan {opened.plan_sha256}\n{opened.note}" if opened.plan_sha256 else opened.note)
        self._folder = opened.folder

    def show_pulse(self, pulse: m.Pulse) -> None:
        """The newest proof."""
        several = f"all {pulse.verified} earlier runs verified"
        verified = {0: "", 1: "the earlier run verified"}.get(pulse.verified, several)
        proof = pulse.proof
        if proof is None:
            self._light(theme.GOOD if pulse.verified else theme.BRAKE_OFF)
            trials = "1 run" if pulse.verified == 1 else f"{pulse.verified} runs"
            said = f"Not recording · {trials} recorded and verified in {self._folder}"
            self.recording.setText(said if pulse.verified else "Nothing recorded yet")
            return
        fresh = proof.age_s < STALE_S
        self._light(theme.BAD if fresh else theme.CAUTION)
        parts = [
            f"Recording {proof.name}",
            f"{grouped(proof.rows)} rows",
            size(proof.bytes),
            f"last write {proof.age_s:.1f} s ago",
            verified,
        ]
        self.recording.setText(" · ".join(filter(None, parts)))

    def show_dead(self, elsewhere: bool = False) -> None:
        """There is no bench any more. elsewhere: there is, but it serves another window."""
        self._light(theme.BRAKE_OFF if elsewhere else theme.BAD)
        self.recording.setText("The other window shows what is being recorded" if elsewhere else "Not recording")
