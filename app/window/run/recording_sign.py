"""The sign beside the large line: whether a trial is being recorded now, and for how long it has run."""

from PySide6.QtWidgets import QLabel

from app.ipc import messages as m
from app.window.widgets import theme

STALE_S = 1.0  # a last write longer ago than this is worth a look


class RecordingSign(QLabel):
    """It says what the newest proof says; its place stays when it is quiet."""

    def __init__(self) -> None:
        super().__init__(objectName="sign")
        self.setFont(theme.font(theme.TITLE, bold=True))
        self._proof: m.Proof | None = None
        self._running = self._practice = False
        self._time_s = 0.0
        self._refresh()

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        running = snapshot.running is not None and snapshot.sandbox is None
        if running != self._running:
            self._running, self._time_s, self._proof = running, 0.0, None
        self._practice = snapshot.practice
        self._refresh()

    def show_proof(self, proof: m.Proof | None) -> None:
        """How much of the running recording is in its file; None: nothing is being recorded."""
        self._proof = proof
        self._refresh()

    def show_time(self, trial_s: float) -> None:
        """How long the running trial has run."""
        if int(trial_s) != int(self._time_s):
            self._time_s = trial_s
            self._refresh()

    def _refresh(self) -> None:
        minutes, seconds = divmod(int(self._time_s), 60)
        if not self._running:
            text, look = "Not recording", "sign"
        elif self._proof is None:
            text, look = ("Practice" if self._practice else "Not recording"), "sign"
        elif self._proof.age_s < STALE_S:
            text, look = "● Recording", "sign-on"
        else:
            text, look = f"▲ Last write {self._proof.age_s:.0f} s ago", "sign-late"
        theme.set_style(self, look)
        self.setText(f"{text}  {minutes}:{seconds:02d}" if self._running else text)
