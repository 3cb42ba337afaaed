"""Dials: every number that can be set on Try, each a slider with its value beside it.

A parameter of controllers brings its own by its declaration; the others are listed here.
"""

import math
from typing import NamedTuple, Self

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QSlider, QStyle, QWidget

from app.ipc import messages as m
from app.window.widgets.parts import TAB_FOCUS, row, text_label
from core.control.controllers import PARAMETERS, Parameter
from experiments.plan import grouped
from experiments.protocol import Protocol

STEPS, LOG_STEP = 40, 0.02  # of a parameter's slider; decades, of a logarithmic one
HANDLE_PX = 14  # of a slider, as the sheet has it


class Dial(NamedTuple):
    """A number that can be set; shown = scale times the setting."""

    name: str  # of the parameter of controllers, or of the field of SandboxSettings
    label: str
    unit: str
    scale: float
    least: float  # shown
    most: float
    step: float  # of the slider; of a logarithmic one: decades
    log: bool = False

    @classmethod
    def of(cls, parameter: Parameter) -> Self:
        """The dial of a parameter of controllers."""
        least, most = parameter.slider
        log = least > 0.0
        step = LOG_STEP if log else (most - least) / STEPS
        return cls(parameter.name, parameter.word.capitalize(), parameter.unit, parameter.scale, least, most, step, log)

    def setting(self, s: m.SandboxSettings) -> float:
        """The value that is set."""
        return s.values[self.name] if self.name in s.values else getattr(s, self.name)

    def slider_position(self, shown: float) -> int:
        """The slider's position for a shown value."""
        scaled = math.log10(max(shown, self.least) / self.least) if self.log else shown - self.least
        return round(scaled / self.step)

    def value_at(self, place: int) -> float:
        """The shown value at a position of the slider."""
        if self.log:
            return float(f"{self.least * 10.0 ** (place * self.step):.2g}")
        return round(self.least + place * self.step, 6)


#: Those that do not belong to a controller.
DIALS = (
    Dial("blend_width_m", "Blend width", "mm", 1e3, 1.0, 100.0, 1.0),
    Dial("spring_N_m", "Hand spring", "N/m", 1.0, 100.0, 5000.0, LOG_STEP, log=True),
    Dial("brake_strength", "Brake strength", "%", 1e2, 5.0, 100.0, 1.0),
    Dial("backlash_deg", "Backlash", "°", 1.0, 0.0, 3.0, 0.05),
)


def dials_of(protocol: Protocol) -> list[Dial]:
    """Those of the parameters that the protocol's controllers have, then the others."""
    presets = protocol.controllers.values()
    own = {parameter.name: parameter for preset in presets for parameter in preset.algorithm.parameters}
    return [*(Dial.of(own[name]) for name in dict.fromkeys([*PARAMETERS, *own]) if name in own), *DIALS]


class Slider(QSlider):
    """A slider whose handle comes to where it is pressed, and can be dragged on from there."""

    def mousePressEvent(self, event: QMouseEvent) -> None:
        room = self.width() - HANDLE_PX
        at = QStyle.sliderValueFromPosition(0, self.maximum(), round(event.position().x() - 0.5 * HANDLE_PX), room)
        self.setValue(at)
        super().mousePressEvent(event)


class DialRow(QWidget):
    """Name, slider and value of a dial."""

    changed = Signal(float)  # the value of the setting

    def __init__(self, dial: Dial) -> None:
        super().__init__()
        self.setObjectName("clear")
        self.dial, self.name, self.value = dial, text_label(dial.label), text_label("")
        self.slider = Slider(Qt.Orientation.Horizontal, accessibleName=dial.label, focusPolicy=TAB_FOCUS)
        self.slider.setRange(0, dial.slider_position(dial.most))
        self.slider.valueChanged.connect(lambda place: self.changed.emit(dial.value_at(place) / dial.scale))
        self.value.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self.setLayout(row(self.name, self.slider, self.value))
        policy = self.slider.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        self.slider.setSizePolicy(policy)
        self.slider.hide()  # until there is a value

    def show_value(self, setting: float) -> None:
        """The value that is set; a slider in hand stays where it is."""
        shown = setting * self.dial.scale
        self.slider.show()
        self.value.setText(f"{grouped(float(f'{shown:.4g}'))} {self.dial.unit}")
        if not self.slider.isSliderDown():
            with QSignalBlocker(self.slider):
                self.slider.setValue(self.dial.slider_position(shown))
