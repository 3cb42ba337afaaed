"""The look of every screen: palette, typeface, sizes (DESIGN, section 10)."""

from pathlib import Path

import matplotlib
from PySide6.QtGui import QColor, QFont, QFontDatabase
from PySide6.QtWidgets import QApplication

GROUND, PANEL, LINE, TEXT, QUIET = "#12161b", "#1a2027", "#2a323c", "#e6eaee", "#8b96a3"
CANVAS = "#0d1115"  # the workspace: darker than the panels, so that what moves stands out
GOOD, BAD, CAUTION = "#3fb68b", "#e5604d", "#e0a33e"
BRAKE_OFF, BRAKE_SLIPPING, BRAKE_STUCK = "#5b6672", "#e69f00", "#d55e00"
ARM, ARM_CORE, POINTER = "#2e363f", "#505b67", "#c6ced6"
START_RING, END_RING = GOOD, "#e69f00"
TRACE, ACCENT, ACCENT_DARK = "#58b4e8", "#4f9de0", "#1f4b7a"
CONTROLLER = {1: "#9aa5b1", 2: "#e69f00", 3: "#f0c75e", 4: "#4f9de0", 5: "#8ec7f2"}
STATUS = {"done": GOOD, "timeout": CAUTION, "aborted": BAD, "redone": QUIET, "recovered": CAUTION}

SMALL, NORMAL, TITLE, LARGE = 11, 13, 15, 34  # px; LARGE is the participant's line only
GAP, RADIUS = 12, 6  # px, between panels, of their corners

FAMILIES = ["Inter", "DejaVu Sans"]  # the second comes along: the same on every machine


def font(size: int = NORMAL, bold: bool = False) -> QFont:
    """The typeface at a size in px, in one of its two weights."""
    chosen = QFont(FAMILIES)
    chosen.setPixelSize(size)
    chosen.setWeight(QFont.Weight.DemiBold if bold else QFont.Weight.Normal)
    return chosen


def colour(name: str, alpha: float = 1.0) -> QColor:
    """A colour of the palette, more or less transparent."""
    chosen = QColor(name)
    chosen.setAlphaF(alpha)
    return chosen


def mixed(a: str, b: str, share: float) -> QColor:
    """A colour between two of the palette."""
    p, q = QColor(a), QColor(b)
    parts = ((p.redF(), q.redF()), (p.greenF(), q.greenF()), (p.blueF(), q.blueF()))
    return QColor.fromRgbF(*((1.0 - share) * x + share * y for x, y in parts))


SHEET = f"""
QWidget {{ background: {GROUND}; color: {TEXT}; }}
QToolTip {{ background: {PANEL}; color: {TEXT}; border: 1px solid {LINE}; padding: 4px; }}
QFrame#panel {{ background: {PANEL}; border: 1px solid {LINE}; border-radius: {RADIUS}px; }}
QFrame#panel QLabel, QFrame#panel QCheckBox {{ background: transparent; }}
QLabel#quiet {{ color: {QUIET}; }}
QLabel#caution {{ color: {CAUTION}; }}
QLabel#bad {{ color: {BAD}; }}
QLabel#banner {{ background: #3a1c1a; color: #ff9c8c; border: 1px solid {BAD}; border-radius: {RADIUS}px;
    padding: 8px 12px; }}
QPushButton {{ background: #242c35; border: 1px solid {LINE}; border-radius: 4px; padding: 7px 12px;
    text-align: left; }}
QPushButton:hover {{ border-color: {QUIET}; }}
QPushButton:disabled {{ color: #5b6672; background: {PANEL}; }}
QPushButton#start:enabled {{ background: {ACCENT_DARK}; border-color: {ACCENT}; }}
QPushButton#abort:enabled {{ background: #3a1c1a; border-color: {BAD}; color: #f3a598; }}
QLineEdit, QComboBox {{ background: {GROUND}; border: 1px solid {LINE}; border-radius: 4px; padding: 5px 8px;
    selection-background-color: {ACCENT_DARK}; }}
QLineEdit:focus, QComboBox:focus {{ border-color: {ACCENT}; }}
QLineEdit:disabled, QComboBox:disabled {{ color: {QUIET}; }}
QComboBox QAbstractItemView {{ background: {PANEL}; border: 1px solid {LINE};
    selection-background-color: {ACCENT_DARK}; }}
"""


def dress(application: QApplication) -> None:
    """Give the application its typeface and colours."""
    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    for name in ("DejaVuSans.ttf", "DejaVuSans-Bold.ttf"):
        QFontDatabase.addApplicationFont(str(folder / name))
    application.setStyle("Fusion")
    application.setFont(font())
    application.setStyleSheet(SHEET)
