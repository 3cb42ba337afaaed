"""What comes next on Home, with one large button: on a first visit to try the device, else to resume a session."""

from collections.abc import Callable

from PySide6.QtWidgets import QProgressBar, QSizePolicy

from app.window.widgets import theme
from app.window.widgets.parts import Panel, button, column, row, show_wait, text_label, wrapped_label
from experiments.store.overview import DataOverview, SessionOverview

TRY_TITLE, TRY = "Try the device", "Try it"
TRY_TEXT = "Pull the handle and compare controllers. Brakes steer, they never push. Nothing is saved."
MAIN_PX = (190, 44)  # of the button: wide and high at least


def is_first_visit(overview: DataOverview | None) -> bool:
    """Whether there are no data, as far as is known (None: not looked at yet)."""
    return overview is None or not (overview.sessions or overview.problem)


def to_resume(overview: DataOverview | None) -> SessionOverview | None:
    """The newest session of a data folder, if it can go on."""
    if overview is None or overview.operators or not overview.sessions:
        return None
    newest = overview.sessions[0]
    return None if newest.complete or newest.problem or newest.declined else newest


class NextPanel(Panel):
    """Title, how far it is, and the button."""

    def __init__(self, do: Callable[[], object]) -> None:
        super().__init__()
        self.title, self.beside = text_label(size=theme.HEAD, bold=True), text_label("", "quiet")
        self.text, self.bar = wrapped_label(TRY_TEXT), QProgressBar(textVisible=False)
        self.do = button("", do, "main")
        self.do.setFont(theme.font(theme.TITLE, bold=True))
        self.do.setMinimumSize(*MAIN_PX)
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed)
        head = row(self.title, 1, self.beside)
        self.setLayout(column(head, self.text, self.bar, row(self.do, 1), spacing=12, margins=(16, 12, 16, 14)))

    def show_next(self, session: SessionOverview | None, why_not: str, opening: str) -> None:
        """session: to be resumed; None: Try. why_not: why none can be, a sentence. opening: whose is being opened."""
        self.title.setText(f"Participant {session.participant}" if session else TRY_TITLE)
        self.beside.setText(f"{session.protocol.capitalize()} protocol" if session and session.protocol else "")
        self.text.setVisible(session is None)
        self.bar.setVisible(session is not None)
        self.bar.setMaximum(max(session.planned, 1) if session else 1)
        self.bar.setValue(session.done if session else 0)
        self.do.setText("Resume session" if session else TRY)
        self.do.setEnabled(session is None or not (why_not or opening))
        self.do.setToolTip(why_not if session else "")
        if session and opening == session.participant:
            show_wait(self.do, "Opening …")
