"""How a window opens: whole on its screen, with the frame that the window system puts round it."""

from PySide6.QtWidgets import QWidget

FRAME = (8, 44)  # px across, down. Our choice: what borders and title bar of the common desktops take at most


def show_whole(window: QWidget, width: int, height: int) -> None:
    """Show it this large (px), or over all of a screen that has no room for that and a frame."""
    room = window.screen().availableSize()
    across, down = room.width() - FRAME[0], room.height() - FRAME[1]
    window.resize(min(width, across), min(height, down))
    if width > across or height > down:
        window.showMaximized()
    else:
        window.show()
