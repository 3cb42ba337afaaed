"""The rules of every widget's look, as Qt's style sheets; $names are those of `palette.Palette`."""

from string import Template

SHEET = Template("""
QWidget { background: $ground; color: $text; }
QToolTip { background: $panel; color: $text; border: 1px solid $line; padding: 4px; }
QFrame#panel { background: $panel; border: 1px solid $line; border-radius: ${radius}px; }
QFrame#canvas { background: $canvas; border: 1px solid $line; border-radius: ${radius}px; }
QFrame#card { background: $panel; border: 1px solid $edge; border-radius: ${radius}px; }
QWidget#clear { background: transparent; }
QWidget#participant, QWidget#participant > QWidget { background: $canvas; }
QStackedWidget { background: transparent; }
QFrame#line { background: $line; border: none; max-height: 1px; min-height: 1px; }
QFrame#pill { background: $panel; border: 1px solid $line; border-radius: 15px; }
QFrame#pill-bad { background: $bad_ground; border: 1px solid $bad; border-radius: 15px; }
QLabel, QCheckBox, QRadioButton { background: transparent; }
QLabel#quiet { color: $quiet; }
QLabel#hint { color: $text; }
QLabel:disabled, QLabel#quiet:disabled, QLabel#hint:disabled { color: $brake_off; }
QLabel#good { color: $good; }
QLabel#caution { color: $caution; }
QLabel#bad { color: $bad; }
QLabel#off { color: $brake_off; }
QFrame#banner { background: $bad_ground; border: 1px solid $bad; border-radius: ${radius}px; }
QFrame#banner QLabel { color: $bad_text; }
QLabel#sign, QLabel#sign-on, QLabel#sign-late { border-radius: ${radius}px; padding: 3px 16px; color: $quiet; }
QLabel#sign { border: 1px solid $line; }
QLabel#sign-on { border: 1px solid $bad; color: $bad; }
QLabel#sign-late { background: $caution; color: $on_bad; }
QPushButton { background: $field; border: 1px solid $line; border-radius: 5px; padding: 6px 12px; }
QPushButton:hover { border-color: $quiet; }
QPushButton:focus { border-color: $accent; outline: none; }
QPushButton:disabled { color: $brake_off; background: $panel; }
QPushButton#main:enabled { background: $accent_ground; border-color: $accent; }
QPushButton#main:focus, QPushButton#segment:checked:focus { border-color: $text; }
QPushButton#brakes { background: $bad; border-color: $bad; color: $on_bad; padding: 6px 10px; }
QPushButton#brakes-on { background: $panel; border-color: $caution; color: $caution; padding: 6px 10px; }
QPushButton#brakes:disabled, QPushButton#brakes-on:disabled { background: $panel; border-color: $line;
    color: $brake_off; }
QPushButton#key { text-align: left; }
QPushButton#key:checked, QPushButton#segment:checked { background: $accent_ground;
    border-color: $accent; }
QPushButton#segment { padding: 6px 8px; }
QPushButton#segment:checked:disabled { background: $panel; color: $quiet; border-color: $edge; }
QPushButton#toggle { background: transparent; color: $quiet; border-radius: 12px; padding: 3px 8px; }
QPushButton#toggle:checked { background: $field; color: $text; border-color: $edge; }
QPushButton#toggle:focus { border-color: $text; }
QPushButton#toggle:disabled { background: transparent; color: $brake_off; border-color: $line; }
QPushButton#tab { background: transparent; border: none; border-bottom: 3px solid transparent; border-radius: 0;
    padding: 8px 7px; color: $quiet; }
QPushButton#tab:checked { color: $text; border-bottom-color: $accent; }
QPushButton#tab:focus { border-bottom-color: $text; }
QPushButton::menu-indicator { image: none; width: 0; }
QProgressBar { background: $field; border: none; border-radius: 3px; min-height: 6px; max-height: 6px; }
QProgressBar::chunk { background: $accent; border-radius: 3px; }
QProgressBar#done::chunk { background: $good; }
QMenu { background: $panel; border: 1px solid $edge; padding: 4px; }
QMenu::item { padding: 6px 18px; }
QMenu::item:selected { background: $accent_ground; }
QMenu::item:disabled { color: $brake_off; }
QPushButton#small { padding: 3px 10px; }
QPushButton#link { background: transparent; border: 1px solid transparent; color: $accent; padding: 4px 6px; }
QPushButton#link:hover, QPushButton#link:focus { border-color: $accent; }
QPushButton#link:disabled { color: $brake_off; }
QLineEdit, QComboBox, QPlainTextEdit { background: $ground; border: 1px solid $line; border-radius: 5px;
    padding: 5px 8px; selection-background-color: $accent_ground; selection-color: $text;
    placeholder-text-color: $quiet; }
QComboBox::drop-down { border: none; width: 22px; }
QLineEdit:focus, QComboBox:focus, QPlainTextEdit:focus { border-color: $accent; }
QLineEdit:disabled, QComboBox:disabled { color: $quiet; background: $panel; placeholder-text-color: $brake_off; }
QComboBox QAbstractItemView { background: $panel; border: 1px solid $line;
    selection-background-color: $accent_ground; selection-color: $text; }
QScrollArea { border: none; background: transparent; }
QScrollBar:vertical { background: transparent; width: 8px; margin: 0; }
QScrollBar::handle:vertical { background: $line; border-radius: 4px; min-height: 24px; }
QScrollBar:horizontal { background: transparent; height: 8px; margin: 0; }
QScrollBar::handle:horizontal { background: $line; border-radius: 4px; min-width: 24px; }
QScrollBar::add-line, QScrollBar::sub-line, QScrollBar::add-page, QScrollBar::sub-page { background: transparent;
    border: none; height: 0; width: 0; }
QTableWidget { background: $panel; border: none; }
QHeaderView, QHeaderView::section { background: $panel; color: $quiet; border: none; padding: 2px 6px; }
QSlider { background: transparent; min-height: 20px; }
QSlider::groove:horizontal { background: $line; height: 4px; border-radius: 2px; }
QSlider::sub-page:horizontal { background: $accent; height: 4px; border-radius: 2px; }
QSlider::handle:horizontal { background: $text; width: 14px; height: 14px; margin: -5px 0; border-radius: 7px; }
QSlider::handle:horizontal:focus { background: $accent; }
QSlider::handle:horizontal:disabled, QSlider::sub-page:horizontal:disabled { background: $brake_off; }
QCheckBox::indicator { width: 16px; height: 16px; border: 1px solid $quiet; border-radius: 3px;
    background: $ground; }
QCheckBox::indicator:checked { background: $accent; border-color: $accent; }
QCheckBox:disabled { color: $quiet; }
QCheckBox::indicator:checked:disabled { background: $brake_off; border-color: $brake_off; }
QCheckBox:focus { color: $text; outline: none; }
QCheckBox::indicator:focus { border-color: $accent; }
""")
