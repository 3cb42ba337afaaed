"""The sign over the workspace: whether a trial is being recorded now, and for how long it has run."""

from PySide6.QtWidgets import QLabel

from app.ipc import messages as m
from app.window.widgets import theme


class RecordingSign(QLabel):
    """It says what the newest proof says, which comes before its snapshot; its place stays when it is quiet."""

    def __init__(self) -> None:
        super().__init__("Not recording", objectName="sign")
        self.setFont(theme.font(theme.TITLE, bold=True))

    def show_proof(self, snapshot: m.Snapshot, proof: m.Proof | None, trial_s: float) -> None:
        """proof: how much of the running recording is in its file; None: nothing is being recorded. trial_s: how long
        the trial has run."""
        look, text = "sign", "Practice" if snapshot.practice else "Not recording"
        if proof is not None:
            late = "sign-late", f"▲ Last write {proof.age_s:.0f} s ago"
            look, text = late if proof.late else ("sign-on", "● Recording")
        runs = snapshot.running is not None and snapshot.sandbox is None
        theme.set_style(self, look if runs else "sign")
        self.setText(f"{text}  {int(trial_s) // 60}:{int(trial_s) % 60:02d}" if runs else "Not recording")
