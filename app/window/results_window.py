"""The page Analyse in a window of its own, beside the console."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.ipc import messages as m
from app.window.analyse_page import AnalysePage

LARGEST = (1280, 720)  # px, as it opens


class ResultsWindow(QWidget):
    """Everything that was recorded in the data folder of a session."""

    escaped = Signal()  # Esc, with nothing to close in the window: whether it stops a trial is not known here

    def __init__(self, opened: m.Opened, snapshot: m.Snapshot) -> None:
        super().__init__()
        self.setWindowTitle("phd: results")
        self.page = AnalysePage(lambda command: None)
        self.page.show_opened(opened)
        self.page.show_snapshot(snapshot)
        layout = QVBoxLayout(self)
        layout.addWidget(self.page)
        QShortcut(QKeySequence("Ctrl+E"), self, self.page.export)
        QShortcut(QKeySequence(Qt.Key.Key_Escape), self, lambda: self.page.cancel() or self.escaped.emit())
        self.resize(*LARGEST)
        self.page.begin()

    def show_snapshot(self, snapshot: m.Snapshot) -> None:
        """The session went on."""
        self.page.show_snapshot(snapshot)

    def closeEvent(self, event) -> None:
        self.page.close()
        super().closeEvent(event)
