"""What comes next on Home, with one large button: try the device, resume the newest session, go to the open one."""

from collections.abc import Callable
from typing import NamedTuple

from PySide6.QtWidgets import QProgressBar

from app.window.widgets import theme
from app.window.widgets.parts import (
    Panel,
    button,
    column,
    row,
    show_wait,
    text_label,
    wrapped_label,
)
from experiments.store.overview import DataOverview

TRY_TITLE = "Try the device"
TRY_TEXT = "Pull the handle with the mouse and compare controllers. Brakes steer, they never push. Nothing is saved."
MAIN_PX = (190, 44)  # of the button: wide and high at least
TRY, RESUME, GO = "try", "resume", "go"


class Next(NamedTuple):
    """What comes next."""

    kind: str  # TRY, RESUME, GO
    participant: str = ""  # whose session
    done: int = 0  # trials of it
    planned: int = 0
    protocol: str = ""
    first: bool = False  # there are no data yet: what comes first is to try


def what_comes_next(overview: DataOverview | None, is_open: str) -> Next:
    """From the data folder (None: not looked at yet) and the participant whose session is open ("": none)."""
    sessions = overview.sessions if overview is not None else ()
    if is_open:
        found = next((session for session in sessions if session.participant == is_open), None)
        return Next(GO, is_open, found.done, found.planned, found.protocol) if found else Next(GO, is_open)
    for newest in sessions[:1]:
        if overview is not None and not (overview.operators or newest.complete or newest.problem or newest.declined):
            return Next(RESUME, newest.participant, newest.done, newest.planned, newest.protocol)
    return Next(TRY, first=overview is not None and not sessions and not overview.problem)


class NextPanel(Panel):
    """Title, how far it is, and the button."""

    def __init__(self, do: Callable[[], object]) -> None:
        super().__init__()
        self.title, self.beside = text_label(size=theme.HEAD, bold=True), text_label("", "quiet")
        self.text, self.bar = wrapped_label(), QProgressBar(textVisible=False)
        self.do = button("", do)
        self.do.setFont(theme.font(theme.TITLE, bold=True))
        self.do.setMinimumSize(*MAIN_PX)
        head = row(self.title, 1, self.beside)
        self.setLayout(column(head, self.text, self.bar, row(self.do, 1), spacing=12, margins=(16, 12, 16, 14)))

    def show_next(self, coming: Next, why_not: str, opening: str) -> None:
        """why_not: why no session can be resumed now, a sentence. opening: whose session is being opened."""
        has_session = coming.kind != TRY
        self.title.setText(f"Participant {coming.participant}" if has_session else TRY_TITLE)
        self.beside.setText(f"{coming.protocol.capitalize()} protocol" if coming.protocol else "")
        texts = {TRY: TRY_TEXT, RESUME: "", GO: "The session is open."}
        self.text.setText(texts[coming.kind])
        self.text.setVisible(bool(texts[coming.kind]))
        self.bar.setMaximum(max(coming.planned, 1))
        self.bar.setValue(coming.done)
        self.bar.setVisible(has_session and coming.planned > 0)
        words = {TRY: "Try it", RESUME: "Resume session", GO: "Go to the session"}
        self.do.setText(words[coming.kind])
        self.do.setEnabled(coming.kind != RESUME or not (why_not or opening))
        self.do.setToolTip(why_not if coming.kind == RESUME else "")
        if opening and opening == coming.participant:
            show_wait(self.do, "Opening …")
        theme.set_style(self.do, "main" if has_session or coming.first else "")
