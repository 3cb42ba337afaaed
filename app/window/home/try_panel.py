"""The first column of Home: what Try is about."""

from app.window.canvas.layers import SPACING_M
from app.window.canvas.path_marks import Sizes
from app.window.canvas.small_view import SmallView
from app.window.widgets import theme
from app.window.widgets.page import TRY, Page
from app.window.widgets.parts import (
    PANEL_MARGINS,
    PART,
    OneLine,
    Panel,
    button,
    clear,
    column,
    holder,
    row,
    text_label,
    wrapped_label,
)
from app.window.widgets.words import feel
from core.path import outline
from experiments.protocol import Protocol

PICTURE = Sizes(path=4.0, ring=13.0, handle=10.0)


class TryPanel(Panel):
    """The protocol's first device with its handle between start and end, and what guides a hand there."""

    def __init__(self, page: Page) -> None:
        super().__init__()
        about = wrapped_label("Feel what the controllers do. Nothing is saved.", "quiet")
        self._picture, self._guides = SmallView(PICTURE), column(spacing=8)
        self.try_it = button("Try it", lambda: page.page_asked.emit(TRY, None), "main")
        self.try_it.setFont(theme.font(theme.HEAD, bold=True))
        self.try_it.setMinimumHeight(72)
        title, picture = text_label("Try it", size=theme.HEAD, bold=True), holder(column(self._picture))
        self.setLayout(
            column(
                title, about, (picture, 3), (holder(self._guides), 1), self.try_it, spacing=12, margins=PANEL_MARGINS
            )
        )

    def show_protocol(self, protocol: Protocol) -> None:
        device, path = protocol.devices[0], next(iter(protocol.paths.values()))
        way = outline(path, SPACING_M).tolist()
        self._picture.show_trial(device, path, tuple(way[len(way) // 2]))
        self._picture.show()
        clear(self._guides)
        for number, preset in protocol.controllers.items():
            words = dict.fromkeys((feel(preset, protocol.controllers), preset.name))
            bar = Panel()
            bar.setFixedWidth(5)
            bar.setStyleSheet(
                f"background: {theme.colour_of(number, protocol.controllers)}; border: none; border-radius: 2px"
            )
            self._guides.addLayout(row(bar, OneLine(PART.join(words), size=theme.NORMAL)))
