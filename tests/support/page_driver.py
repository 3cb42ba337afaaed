"""A page without a main window: what it sends and asks for, what can be read on it, and what its user does to it."""

from collections.abc import Callable

from PySide6.QtCore import QEvent, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton, QApplication, QLineEdit, QWidget
from screens import settle, visible_texts
from waiting import wait_until

from app.window.widgets.page import Page

LEFT = Qt.MouseButton.LeftButton
PAGE_SIZE = (1256, 620)  # px: what a page has in the smallest usual window


def texts(page: QWidget) -> str:
    """All that can be read on it now."""
    settle(page)
    return " | ".join(visible_texts(page)).replace("\u200b", "")


class PageDriver:
    """The page that `make` makes, shown at a size until it is closed. make: takes what a page sends its commands to."""

    def __init__(self, make: Callable, size: tuple[int, int] = PAGE_SIZE) -> None:
        self.sent, self.setups, self.pages = [], [], []
        self.page = make(self.sent.append)
        self.holder = QWidget()  # so that nothing of the page is a window
        self.page.setParent(self.holder)
        if isinstance(self.page, Page):
            self.page.setup_asked.connect(lambda *asked: self.setups.append(asked))
            self.page.page_asked.connect(lambda *asked: self.pages.append(asked))
        self.resize(*size)
        self.holder.show()

    def close(self) -> None:
        self.page.close()
        self.holder.close()
        self.holder.deleteLater()
        QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)

    def resize(self, width: int, height: int) -> None:
        self.page.resize(width, height)
        self.holder.resize(width, height)

    def until(self, condition: Callable[[], bool]) -> None:
        """Wait for what is done beside the page."""
        wait_until(condition, 60.0, lambda: QTest.qWait(5))

    def texts(self) -> str:
        """All that can be read now."""
        return texts(self.page)

    def field(self, name: str) -> QLineEdit:
        """A field by its accessible name."""
        return next(field for field in self.page.findChildren(QLineEdit) if field.accessibleName() == name)

    def click(self, button: QAbstractButton) -> None:
        assert button.isEnabled(), button.text()
        QTest.mouseClick(button, LEFT)

    def type(self, field: QLineEdit | str, text: str) -> None:
        """In place of what the field holds; field: or its name."""
        field = self.field(field) if isinstance(field, str) else field
        field.selectAll()
        QTest.keyClick(field, Qt.Key.Key_Delete)
        QTest.keyClicks(field, text)
