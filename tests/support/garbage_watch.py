"""A process with windows, as `phd run` makes it: when Python's garbage is collected while they are built and ended.

    python garbage_watch.py lock             a collection in `QObject::disconnect`, which holds a lock of Qt
    python garbage_watch.py pages N          each page, N times, without a window around it
    python garbage_watch.py windows N        both windows with every page, N times

The last line is JSON: how many collections ran, how many of them elsewhere than in `Collector.look`, and the longest.
"""

import contextlib
import gc
import json
import sys
import threading
import time

from fake_client import FakeClient, opened, ready
from PySide6.QtCore import QEvent, QObject, Signal
from PySide6.QtWidgets import QApplication

from app.window.main_window import PAGES
from app.window.program import make_ready
from app.window.windows import Windows

SETTLE_S = 0.1  # the event loop runs for so long after each


class CollectionLog:
    """Every collection of this process from now on."""

    def __init__(self) -> None:
        self.all, self.elsewhere, self.longest_s, self._began_s = 0, 0, 0.0, 0.0
        gc.callbacks.append(self._note)

    def _note(self, phase: str, _: dict) -> None:
        if phase == "stop":
            self.longest_s = max(self.longest_s, time.perf_counter() - self._began_s)
            return
        self._began_s, frame, places = time.perf_counter(), sys._getframe(), []
        while frame is not None:
            places.append(frame.f_code.co_name)
            frame = frame.f_back
        self.all += 1
        self.elsewhere += "look" not in places or threading.current_thread() is not threading.main_thread()


class Hearer(QObject):
    """Is connected to others."""

    def hear(self) -> None: ...


def fill_with_connected_garbage(hearer: Hearer) -> None:
    """More QObjects than Qt has locks for connections (131), each with one, and held by itself alone."""
    for _ in range(400):
        one = Hearer()
        one.myself = one
        one.destroyed.connect(hearer.hear)


def disconnect_while_garbage_is_due() -> None:
    """Disconnect a signal of a new class at the moment when Python wants to collect.

    For a new class Qt's binding makes a Python object in the middle of `QObject::disconnect`.
    """
    hearer = Hearer()
    sender = type("Sender", (QObject,), {"moved": Signal()})()
    fill_with_connected_garbage(hearer)
    sender.moved.connect(hearer.hear)
    disconnect, hear, usual = sender.moved.disconnect, hearer.hear, gc.get_threshold()
    spare = [[] for _ in range(20)]  # Python takes the next lists from these: they begin no collection
    del spare
    gc.set_threshold(1)
    disconnect(hear)
    gc.set_threshold(*usual)


def settle(seconds: float = SETTLE_S) -> None:
    """Let the event loop run."""
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        QApplication.processEvents()
        time.sleep(0.002)


def show_pages(windows: Windows) -> None:
    """Every page of a window, one after the other."""
    for name in PAGES:
        windows.main.show_page(name)
        windows.client.inbox += [opened(), ready(3)]
        windows.frame()
        QApplication.processEvents()


def build_windows(times: int) -> None:
    """Both windows, with all pages, and their end."""
    for _ in range(times):
        windows = Windows(FakeClient())
        windows.show()
        show_pages(windows)
        settle()
        windows.close()
        for window in (windows.main, windows.participant):
            window.deleteLater()
        QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)


def build_pages(times: int) -> None:
    """Each page by itself, and its end."""
    windows = Windows(FakeClient())
    for name in PAGES:
        windows.main.show_page(name)
        kind = type(windows.main.page(name))
        for _ in range(times):
            page = kind(lambda _: None)
            with contextlib.suppress(AttributeError):
                page.show_opened(opened())
                page.show_snapshot(ready(3))
            page.show()
            QApplication.processEvents()
            page.close()
            page.deleteLater()
            QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
            del page
        settle()
    windows.close()


def main() -> None:
    make_ready()
    log = CollectionLog()
    match sys.argv[1]:
        case "lock":
            disconnect_while_garbage_is_due()
        case "pages":
            build_pages(int(sys.argv[2]))
        case "windows":
            build_windows(int(sys.argv[2]))
    settle(0.3)
    gc.callbacks.clear()
    print(json.dumps({"all": log.all, "elsewhere": log.elsewhere, "longest_ms": 1e3 * log.longest_s}))


if __name__ == "__main__":
    main()
