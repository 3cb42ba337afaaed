"""The console beside the workspace: participant, start, abort, the plan, what comes next, what went wrong.

It holds what it shows and tells what is asked for; the window decides.
"""

from collections.abc import Sequence

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QComboBox,
    QFrame,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from app import theme
from app.labels import breakable, line
from app.plan_grid import PlanGrid, describe
from experiments.plan import PlannedTrial

REASONS = ("stopped by the experimenter", "the participant asked", "the participant was distracted", "a mistake")


class KeyButton(QPushButton):
    """A button that says its key; it never takes the keyboard, so a key always means the same."""

    def __init__(self, text: str, key: str, name: str) -> None:
        super().__init__(text, objectName=name)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setFont(theme.font(theme.NORMAL, bold=True))
        self.setMinimumHeight(34)
        self._key = QLabel(key, self, objectName="quiet")
        self._key.setFont(theme.font(theme.SMALL))
        self._key.setStyleSheet("background: transparent")
        self._key.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(12, 0, 12, 0)
        layout.addStretch(1)
        layout.addWidget(self._key)


class Console(QFrame):
    """The left panel."""

    participant_changed = Signal(str)
    start_asked = Signal()
    abort_asked = Signal()

    def __init__(self, participant: str, parent: QWidget | None = None) -> None:
        super().__init__(parent, objectName="panel")
        self.setFixedWidth(272)
        self.participant = QLineEdit(participant)
        self.participant.setMaxLength(20)
        self.participant.setAccessibleName("Participant")
        self.participant.textChanged.connect(self.participant_changed)
        self.participant.returnPressed.connect(self.participant.clearFocus)
        self.progress = line("", "quiet", theme.SMALL)
        self.grid = PlanGrid()
        self.coming = line("", size=theme.NORMAL, bold=True)
        self.cell = line("", "quiet")
        self.notice = line("", "caution")
        self.start = KeyButton("Start", "Space", "start")
        self.start.clicked.connect(self.start_asked)
        self.abort = KeyButton("Abort trial", "Esc", "abort")
        self.abort.clicked.connect(self.abort_asked)
        self.reason = QComboBox()
        self.reason.setEditable(True)
        self.reason.addItems(REASONS)
        self.reason.setAccessibleName("Reason for an abort")
        self.reason.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.reason.lineEdit().returnPressed.connect(self.reason.clearFocus)

        layout = QVBoxLayout(self)
        layout.setContentsMargins(14, 12, 14, 12)
        layout.setSpacing(6)
        head = QHBoxLayout()
        label = line("Participant", size=theme.TITLE, bold=True)
        label.setWordWrap(False)
        head.addWidget(label)
        head.addWidget(self.participant, 1)
        layout.addLayout(head)
        layout.addWidget(self.progress)
        layout.addSpacing(4)
        layout.addWidget(self.grid)
        layout.addSpacing(8)
        layout.addWidget(self.coming)
        layout.addWidget(self.cell)
        layout.addWidget(self.notice)
        layout.addStretch(1)
        layout.addWidget(self.start)
        layout.addWidget(self.abort)
        layout.addSpacing(2)
        layout.addWidget(line("Reason kept with an aborted trial", "quiet", theme.SMALL))
        layout.addWidget(self.reason)

    def show_plan(
        self, plan: Sequence[PlannedTrial], statuses: dict[int, str], coming: PlannedTrial | None, running: bool
    ) -> None:
        """Where the session stands."""
        self.grid.show_plan(plan, statuses, coming.run if coming else None, running)
        self.progress.setText(f"{len(statuses)} of {len(plan)} trials" if plan else "")
        if coming is None:
            self.coming.setText("The plan is done" if plan else "")
            self.cell.setText("")
            return
        self.coming.setText(f"{'Trial' if running else 'Next: trial'} {coming.run} of {len(plan)}")
        self.cell.setText(describe(coming))

    def say(self, notice: str, bad: bool = False) -> None:
        """A sentence for the experimenter; empty: nothing to say."""
        self.notice.setObjectName("bad" if bad else "caution")
        self.notice.style().unpolish(self.notice)
        self.notice.style().polish(self.notice)
        self.notice.setText(breakable(notice))

    def allow(self, start: bool, abort: bool, participant: bool) -> None:
        """What can be asked for now."""
        self.start.setEnabled(start)
        self.abort.setEnabled(abort)
        self.participant.setEnabled(participant)
