"""What the window remembers for its user from one start to the next: a key and a text each, in the user's phd.ini."""

from PySide6.QtCore import QCoreApplication, QSettings

from app import DATA

#: keys, and what holds before the user has chosen
DARK_OR_LIGHT, SIZE, SOUND = "theme", "size", "sound"
SCREEN, DATA_FOLDER = "participant_screen", "data_folder"
AUTHORS, LICENCE = "authors", "licence"  # of exports; authors one a line
OTHER_SCREEN, NO_SCREEN = "", "none"  # of the participant's screen; else its name
ON, OFF = "on", "off"  # of the sound
SIZES = "0.9", "1.0", "1.15", "1.3", "1.5"  # times that of the design
_DEFAULTS = {
    DARK_OR_LIGHT: "dark", SIZE: "1.0", SCREEN: OTHER_SCREEN, SOUND: ON, DATA_FOLDER: str(DATA), AUTHORS: "",
    LICENCE: "",
}  # fmt: skip


def begin() -> None:
    """Remember in the user's file from now on; before it nothing is."""
    QCoreApplication.setOrganizationName("phd")


def file() -> QSettings | None:
    """The user's file; None before `begin`."""
    name = QCoreApplication.organizationName()
    return QSettings(QSettings.Format.IniFormat, QSettings.Scope.UserScope, name) if name else None


def remembered(key: str) -> str:
    """What the user has chosen for a key, else its default."""
    kept = file()
    return str(kept.value(key, _DEFAULTS[key])) if kept else _DEFAULTS[key]


def scale() -> float:
    """How large everything is, as a multiple of the design: one of `SIZES`."""
    kept = remembered(SIZE)
    return float(kept if kept in SIZES else _DEFAULTS[SIZE])


def remember(key: str, value: str) -> None:
    """The user has chosen this for a key."""
    if (kept := file()) is not None:
        kept.setValue(key, value)


def why_forgotten() -> str:
    """Why the next start will not know what is chosen; empty where it will."""
    kept = file()
    if kept is None or kept.isWritable():
        return ""
    return f"What you choose is forgotten when you close the window: {kept.fileName()} cannot be written to."
