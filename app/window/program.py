"""The program of the window: made ready, its kernels compiled once, and run until its windows are closed."""

import os
import signal
import sys

from PySide6.QtCore import QEventLoop, Qt, QTimer
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication, QMessageBox, QProgressBar, QProgressDialog

from app.ipc.client import Client
from app.progress import ProgressBar
from app.window.widgets import memory, theme, words
from app.window.widgets.garbage import Collector
from app.window.widgets.theme import show_fitted
from app.window.widgets.work import VerbProcess
from app.window.windows import Windows
from core.files import InputError
from core.kernels.cache import is_compiled

LARGEST = (1920, 1080)  # px, as the main window opens


def make_ready() -> QApplication:
    """What need not wait for the server: the application."""
    application = QApplication.instance() or QApplication(sys.argv[:1])
    assert isinstance(application, QApplication)
    Collector(application)
    memory.begin()
    theme.apply_theme(application)
    application.setQuitOnLastWindowClosed(False)
    # Esc takes the brakes off in a dialog of files, too: the system's own would keep the key to itself
    application.setAttribute(Qt.ApplicationAttribute.AA_DontUseNativeDialogs)
    return application


def compile_kernels() -> bool:
    """On the first start on a computer: a bar in a window and one in the terminal, until the kernels are compiled.

    Whether to go on: False once that window is closed.
    """
    if is_compiled("run_trial"):
        return True
    bar = QProgressDialog("Setting up for this computer, once: a minute, or a few if it is busy.", "", 0, 100)
    bar.setBar(QProgressBar(textVisible=False))
    bar.setCancelButton(None)
    bar.setWindowTitle("PHD")
    bar.setMinimumDuration(0)
    waiting = QEventLoop()
    compiling = VerbProcess(lambda _: waiting.quit())  # failed: the session server compiles, and says why it cannot
    in_terminal = ProgressBar("setting up for this computer, once")

    def show(thousandths: int) -> None:
        if not compiling.stopped:  # else it would open again
            bar.setValue(round(0.099 * thousandths))
            in_terminal(1e-3 * thousandths)

    show(0)
    compiling.progressed.connect(show)
    for closed in (bar.canceled, bar.rejected):
        closed.connect(lambda: compiling.stop())
    compiling.begin(module="app.compile_kernels")
    waiting.exec()
    in_terminal.close()
    bar.hide()
    return not compiling.stopped


def show_refusal(refused: str) -> None:
    """In a box for those who started the program without a terminal; that of a double click on Windows closes."""
    in_terminal = sys.stderr is not None and sys.stderr.isatty() and os.name != "nt"
    if not in_terminal and QGuiApplication.platformName() != "offscreen":
        QMessageBox.critical(None, "PHD cannot start", words.as_sentence(refused))


def run(client: Client) -> int:
    """Open the app, which has been made ready, on a session server and stay until it closes; the exit code.

    InputError if the session server cannot serve; the window is then closed at once.
    """
    application = QApplication.instance()
    assert isinstance(application, QApplication)
    code = 0
    try:
        windows = Windows(client)
        windows.main.closed.connect(application.quit)

        def leave(number: int, _frame: object) -> None:
            nonlocal code
            code = 128 + number
            QTimer.singleShot(0, end)  # not here: a wait for a message that this interrupts would never end

        def end() -> None:
            windows.close("the program was interrupted")
            application.quit()

        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, leave)
        show_fitted(windows.main, *LARGEST)
        windows.show()
        refused = client.refused(meanwhile=application.processEvents)
        # another folder can be chosen in the window, where there is someone to do so
        asks = client.wants_other_folder and QGuiApplication.platformName() != "offscreen"
        if refused and not windows.over and not asks:
            windows.close()
            show_refusal(refused)
            raise InputError(refused)
        if not windows.over:  # the user may have closed them meanwhile
            application.exec()
    except BaseException:
        client.stop("the window failed")
        raise
    windows.close()
    if refused and windows.client is client:
        raise InputError(refused)
    return code
