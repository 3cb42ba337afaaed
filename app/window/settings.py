"""The settings, which are remembered, and the help: cards over the page at the front."""

from collections.abc import Callable, Mapping
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication, QScreen
from PySide6.QtWidgets import QGridLayout, QLabel, QWidget

from app import __version__
from app.window.participant.tone import NO_SOUND, player
from app.window.widgets import memory, theme
from app.window.widgets.cards import OverlayCard
from app.window.widgets.parts import (
    Choice,
    OneLine,
    Segments,
    breakable,
    button,
    column,
    grid,
    holder,
    row,
    scrolled,
    text_label,
    wrapped_label,
)
from app.window.widgets.words import GAIN, from_home
from experiments.plan import grouped
from experiments.protocol import Protocol

NAME_PX = 240  # wide, at most, of a name in one line
WIDE_PX = 640  # wide, a card
CITATION = (
    "M. R. Reed and W. J. Book, “Modeling and control of an improved dissipative passive haptic display”, Proc. IEEE "
    "Int. Conf. on Robotics and Automation (ICRA), 2004, vol. 1, pp. 311-318 (as far as known)."
)
#: algorithm -> what a hand feels of it
FELT = {
    "none": "All brakes are off: the hand feels only friction and mass.",
    "sdof": "Single degree of freedom: one brake at a time is locked, so that the handle can move along one line only. "
    "It is the brake whose line leads best to the path and along it.",
    "proportional": "One brake at a time resists motion away from the path, in proportion to its speed: the larger the "
    "gain, the stiffer.",
    "reflect": "The brakes show a force from elsewhere, such as that of a wall, as far as brakes can.",
}
KEYS_PX = 960  # wide, groups side by side
BESIDE_PX, FOOT_PX = 44, 200  # what else a card needs: wide, high


class SettingsCard(OverlayCard):
    """What the user chooses for this computer; each takes effect at once, but for the size."""

    wide_px = WIDE_PX

    def __init__(
        self, parent: QWidget, leave: Callable[[], object], changed: Callable[[str], object], data_folder: Path
    ) -> None:
        """changed: does what a key of `memory` asks for, once its new value is remembered."""
        super().__init__("Settings", memory.why_forgotten(), [("Close  Enter", leave)], parent)
        self._changed = changed
        self.theme = Segments({"dark": "Dark", "light": "Light"}, "Theme")
        self.scale = Segments({size: f"{100 * float(size):.0f} %" for size in memory.SIZES}, "Size")
        self.sound = Segments({memory.ON: "On", memory.OFF: "Off"}, "Sound")
        self.participant_screen = Choice()
        screens = {screen.name(): screen_words(screen) for screen in QGuiApplication.screens()}
        chosen = memory.remembered(memory.SCREEN)
        choices = {memory.OTHER_SCREEN: "The other screen", memory.NO_SCREEN: "None: F11 shows it here"}
        self.participant_screen.fill({chosen: f"{chosen} (not attached)", **choices, **screens}, chosen)
        self.theme.show_value("dark" if theme.is_dark() else "light")  # --theme is remembered nowhere
        self.scale.show_value(memory.remembered(memory.SIZE))
        self.sound.show_value(memory.remembered(memory.SOUND) if player() is not None else memory.OFF)
        self.sound.setEnabled(player() is not None)
        kept_in = OneLine(from_home(data_folder), "", theme.NORMAL)
        folder = holder(row(kept_in, button("Change …", lambda: changed(memory.DATA_FOLDER), "small")))
        lines = grid_of({
            "Theme": (self.theme, "A change takes effect at once; during a trial, when it has ended."),
            "Size": (self.scale, "Of text and controls. A change takes effect at the next start."),
            "Participant's screen": (self.participant_screen, ""),
            "Sound": (self.sound, NO_SOUND if player() is None else "A tone at “go” and one at the end of a trial."),
            "Data folder": (folder, "Sessions are kept here."),
        })  # fmt: skip
        self.inside.addLayout(lines)
        self.participant_screen.activated.connect(lambda: self._choose(memory.SCREEN, self.participant_screen.value()))
        for key, field in ((memory.DARK_OR_LIGHT, self.theme), (memory.SOUND, self.sound), (memory.SIZE, self.scale)):
            field.changed.connect(lambda value, key=key: self._choose(key, value))

    def _choose(self, key: str, value: str) -> None:
        memory.remember(key, value)
        self._changed(key)


def screen_words(screen: QScreen) -> str:
    """Name and size, by which a screen is recognised."""
    primary = ", the main one" if screen == QGuiApplication.primaryScreen() else ""
    return f"{screen.name() or 'Screen'}: {screen.size().width()} × {screen.size().height()}{primary}"


def grid_of(lines: Mapping[str, tuple[QWidget, str]]) -> QGridLayout:
    """Name -> what stands beside it, and a quiet line below that."""
    beside = grid(14, 8, stretched=1)
    for down, (name, (part, hint)) in enumerate(lines.items()):
        told = text_label(name, bold=True)
        if told.sizeHint().width() > NAME_PX:
            told = wrapped_label(name, bold=True)
            told.setFixedWidth(NAME_PX)
        told.setMinimumHeight(0 if isinstance(part, QLabel) else part.sizeHint().height())  # level with a field
        beside.addWidget(told, down, 0, Qt.AlignmentFlag.AlignTop)
        hints = [wrapped_label(hint, "caution" if hint == NO_SOUND else "quiet", theme.SMALL)] if hint else []
        beside.addLayout(column(part, *hints, spacing=4), down, 1)
    return beside


class HelpCard(OverlayCard):
    """Groups of names and what is to be known of each, side by side: title of a group -> name -> text."""

    def __init__(
        self,
        title: str,
        text: str,
        groups: Mapping[str, Mapping[str, str]],
        parent: QWidget,
        leave: Callable[[], object],
    ) -> None:
        super().__init__(title, text, [("Close  Enter", leave)], parent)
        self.wide_px = WIDE_PX if len(groups) == 1 else KEYS_PX
        columns = row(spacing=24)
        for heading, lines in groups.items():
            parts = [text_label(heading, size=theme.TITLE)] if heading else []
            told = grid_of({name: (selectable(text), "") for name, text in lines.items()})
            columns.addLayout(column(*parts, told, 1, spacing=8), 1)
        area = scrolled(holder(columns))
        needed = columns.heightForWidth(self.wide_px - BESIDE_PX)
        area.setFixedHeight(min(needed, parent.height() - FOOT_PX))
        self.inside.addWidget(area)


def selectable(text: str) -> QLabel:
    """A text that can be copied."""
    label = wrapped_label(breakable(text), "quiet")
    label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    return label


def controllers_help(protocol: Protocol) -> dict[str, str]:
    """Controller of the protocol -> what it does."""
    found = {}
    for number, preset in protocol.controllers.items():
        gain, gap_m = preset.value(GAIN), preset.value("gap_m")
        text = FELT.get(preset.kind, preset.words)
        text += f" Here it is {grouped(gain)} N s/m." if gain and preset.kind in FELT else ""
        text += f" Within {1e3 * gap_m:g} mm of the path nothing acts." if gap_m else ""
        found[f"{number}  {preset.name}"] = text
    return found


def files_help(data_folder: str) -> dict[str, str]:
    """What is where on this computer."""
    kept = memory.file()
    return {
        "Sessions": data_folder,
        "Each session": "sub-01/ses-01: session.db (plan, protocol, journal, rows), trials.csv, trials/ with one "
        "recording for each trial.",
        "Settings": kept.fileName() if kept else "not kept",
        "Program": str(Path(__file__).resolve().parents[2]),
        "Export": "Home, Data, Export: BIDS-Motion or CSV, into a new folder.",
    }


def about_help() -> dict[str, str]:
    """Version, and how to cite."""
    return {
        "Version": f"phd {__version__}",
        "Cite the paper": CITATION,
        "Cite the program": "CITATION.cff in the program's folder.",
    }
