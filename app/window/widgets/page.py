"""What a page of the main window is: the main window hands it everything that the session server sends."""

from collections.abc import Callable

import numpy as np
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from app.ipc import messages as m

HOME, TRY, RUN, ANALYSE, DEVICE = "Home", "Try", "Run", "Analyse", "Device"


class Page(QWidget):
    """A page shows `opened`, `snapshot` and ticks, and sends commands; it keeps no state of the experiment.

    To add one: a file with its class, and its line in `main_window.PAGES`.
    """

    page_asked = Signal(str, object)  # show this page (HOME ..) with this: a folder or a recording for ANALYSE ..
    folder_asked = Signal(object)  # show this folder (a Path) in the system's own file manager
    pointer_moved = Signal(float, float)  # m, over a workspace in which the pointer is the hand
    setup_asked = Signal(object, object)  # for a new session server: a Setup, None: the same; a command then, or None
    turn_asked = Signal()  # the next page of the instructions, which the participant reads
    consent_asked = Signal(object)  # a Consent that the participant is to answer on their own screen; None: no longer
    answers_changed = Signal(dict)  # of a questionnaire that is being answered here, as its `changed`
    pointer_left = Signal()  # the pointer has left that workspace: the hand lets the handle go

    def __init__(self, send: Callable[[object], None]) -> None:
        """send: brings a command (`app.ipc.messages`) to the session server; returns at once."""
        super().__init__()
        self.send = send
        self.opened: m.Opened | None = None
        self.snapshot = m.Snapshot(m.PREPARING)
        self.participant_answers = False  # the questions stand on the participant's own window
        self.participant_reads = False  # instructions, which come before the first trial

    def answer_consent(self, agrees: bool) -> None:
        """The participant has answered what `consent_asked` asked for."""

    def show_answers(self, values: dict[str, int | None]) -> None:
        """The participant has answered a question on their own screen."""

    def show_instructions(self, at: int) -> None:
        """The page of the instructions at which the participant is, from 0."""

    @property
    def says_what_is_wrong(self) -> bool:
        """Whether the page itself says what is wrong, and goes down to the edge of the window."""
        return False

    def unsaved(self) -> str:
        """What was changed on this page and not saved, in words; "": nothing."""
        return ""

    def show_setup(self, setup: m.Setup) -> None:
        """With what the session server was started."""

    def show_opened(self, opened: m.Opened) -> None:
        """A session, or the protocol before one. Extend, and call this first."""
        self.opened = opened

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        """Where the session is now. Extend, and call this first."""
        self.snapshot = snapshot

    def show_pulse(self, pulse: m.Pulse) -> None:
        """Proof of recording, about ten times a second."""

    def show_ticks(self, rows: np.ndarray, taken: bool) -> None:
        """New ticks (n, tick_log.WIDTH), n > 0, up to 60 times a second; taken: the pointer holds the handle."""

    def begin(self, what: object = None) -> None:
        """The page comes to the front, with what `page_asked` gave."""

    def end(self) -> None:
        """Another page comes to the front."""

    def to_close(self) -> Callable[[], object] | None:
        """What Esc does to close what is asked or open on this page; None: there is nothing."""
        return None

    def show_time(self, now_s: float) -> None:
        """60 times a second while the page is at the front; now_s: monotonic clock."""

    def keys(self) -> dict[str, Callable[[], object]]:
        """Actions by their names in `keys.KEYS`, valid while this page is at the front."""
        return {}

    def own_keys(self) -> dict[str, str]:
        """The keys that act on this page alone, and what each does."""
        return {}
