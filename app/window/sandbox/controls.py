"""What can be set on Try: controllers, device, path and their parameters; behind *More* everything else."""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtWidgets import QPushButton, QScrollArea, QSizePolicy, QWidget

from app.ipc import messages as m
from app.window.sandbox.dials import DIALS, DialRow, dials_of
from app.window.widgets import theme
from app.window.widgets.keys import add_key
from app.window.widgets.parts import (
    NO_FOCUS,
    PART,
    OneLine,
    Panel,
    Part,
    Segments,
    button,
    column,
    holder,
    keep_room,
    panel,
    row,
    text_label,
    wrapped_label,
)
from app.window.widgets.words import GAIN, feel
from core.control.controllers import Preset
from core.control.rule_sets import RULE_SETS
from experiments.assumptions import SENSINGS
from experiments.plan import grouped
from experiments.protocol import Protocol

RIGHT_PX, NAME_PX, RARE_PX, VALUE_PX, GUIDE_PX = 340, 84, 104, 98, 50  # wide; high
#: setting -> what it is
HINTS = {
    "rules": "How the controller decides. Literal: the paper's rules to the letter, which can hold you fast at rest. "
    "Settled: the same rules with thresholds against that.",
    "sensing": "What the controller sees. Ideal: the true motion. Encoders, as on the bench: joint angles by their "
    "counts, the velocity as the slope over the last 15 ms, all of it 1 ms late.",
    "gap_m": "Up to this distance from the path, to each side, nothing guides.",
    "gain_N_s_m": "How much the brakes brake for each m/s across the desired direction.",
    "blend_width_m": "From this distance on you are guided straight to the path; nearer, more and more along it.",
    "spring_N_m": "How stiff the spring is by which the pointer pulls the handle.",
    "brake_strength": "How strong the simulated brakes are, of what they really have.",
    "backlash_deg": "So far a joint turns freely before its brake grips.",
}
REAL = "Real brakes: what you change acts in the next pass, and each pass waits for Space."
GAP = "gap_m"
MORE, LESS = "More  ▾", "Less  ▴"


def preset_of(s: m.SandboxSettings, controllers: Mapping[int, Preset]) -> Preset:
    """The controller with its parameters as they are set."""
    return controllers[s.controller].replaced(**s.values)


class GuideButton(QPushButton):
    """A controller: its name, its key, and below them what it feels like."""

    def __init__(self, name: str, colour: str, key: str) -> None:
        super().__init__(objectName="key", checkable=True, accessibleName=name, focusPolicy=NO_FOCUS)
        self.setMinimumHeight(GUIDE_PX)
        self.key, bar, title = key, Panel(colour), OneLine(name, "", theme.NORMAL, bold=True)
        bar.setFixedWidth(6)
        self.feel = OneLine("", "quiet", theme.SMALL)
        words = (column(1, title, self.feel, 1, spacing=0), 1)
        self.setLayout(row(bar, words, text_label(key, "quiet"), margins=(1, 1, 12, 1)))
        for part in self.findChildren(QWidget):
            part.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        if key:
            add_key(key, self, self.click)


class Controls(QScrollArea):
    """The settings of Try as they are shown, and what sets them."""

    changed = Signal()  # emitted when the user changes a setting

    def __init__(self) -> None:
        super().__init__(widgetResizable=True)
        self.viewport().setObjectName("clear")
        self.setFixedWidth(RIGHT_PX)
        self.settings: m.SandboxSettings | None = None  # none before the server has sent its own
        self._now: m.SandboxState | None = None  # of the server
        self._controllers: Mapping[int, Preset] = {}
        self.guides: dict[int, GuideButton] = {}
        self.dials: dict[str, DialRow] = {}
        self.segments: dict[str, Segments] = {}

    def show_protocol(self, protocol: Protocol) -> None:
        """The controllers, devices and paths of another protocol, and the dials."""
        self.guides, self.dials, self.segments, self.settings = {}, {}, {}, None
        self._controllers = protocol.controllers
        for place, (number, preset) in enumerate(protocol.controllers.items(), start=1):
            colour = theme.colour_of(number, protocol.controllers)
            guide = self.guides[number] = GuideButton(preset.name, colour, str(place) if place < 10 else "")
            guide.clicked.connect(partial(self._choose, number))
        devices = {device.name: device.name for device in protocol.devices}
        chosen = [self._segments("device", devices), self._segments("path", {n: str(n) for n in protocol.paths})]
        rare: list[Part] = [self._segments(name, {one: one.capitalize() for one in among}, RARE_PX)
                            for name, among in (("rules", RULE_SETS), ("sensing", SENSINGS))]  # fmt: skip
        own: list[Part] = []
        for dial in dials_of(protocol):
            dial_row = self.dials[dial.name] = DialRow(dial)
            dial_row.name.setFixedWidth(RARE_PX if dial in DIALS else NAME_PX)
            dial_row.value.setFixedWidth(VALUE_PX)
            dial_row.setToolTip(HINTS.get(dial.name, ""))
            dial_row.changed.connect(partial(self._turn, dial.name))
            (rare if dial in DIALS else own).append(dial_row)
        self.warning = wrapped_label("", "caution")
        self.changes = OneLine("", "quiet", theme.SMALL)
        hint = "All of these as the protocol has them, for this controller, device and path"
        self.reset = button("Reset", self._reset, "small", hint)
        keep_room(self.reset)
        self.more, self.rare = button(MORE, self._turn_more, "link"), holder(column(*rare, spacing=6))
        self.rare.hide()
        foot = row(self.more, self.changes, self.reset)
        guides = column(*self.guides.values(), spacing=5)
        parts = (*chosen, *own, self.warning, self.rare, 1, foot)
        self.setWidget(panel("Controller", guides, holder(column(spacing=4)), *parts, spacing=6))

    def _segments(self, field: str, among: Mapping[Any, str], name_px: int = NAME_PX) -> Part:
        name, segments = text_label(field.capitalize(), "quiet"), Segments(among, field.capitalize())
        segments.changed.connect(partial(self._turn, field))
        segments.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        for part in (name, segments):
            part.setToolTip(HINTS.get(field, ""))
        name.setFixedWidth(name_px)
        self.segments[field] = segments
        return row(name, segments)

    # what is set

    def _turn_more(self) -> None:
        """Show what is rarely set, or hide it."""
        self.rare.setVisible(self.rare.isHidden())
        self.more.setText(MORE if self.rare.isHidden() else LESS)
        QTimer.singleShot(0, lambda: self.ensureWidgetVisible(self.more))  # once it is laid out

    def _choose(self, number: int, _clicked: bool = False) -> None:
        """A controller, with the parameters that the protocol gives it."""
        if self._now is not None:
            self._set(controller=number, values={**self._now.initial.values, **self._controllers[number].named})

    def _turn(self, name: str, value: Any) -> None:
        """A parameter of controllers, or another setting."""
        if self.settings is not None:
            values = self.settings.values
            self._set(**({"values": {**values, name: value}} if name in values else {name: value}))

    def _reset(self) -> None:
        if self.settings is not None and self._now is not None:
            self._set(**self._of_protocol(self.settings, self._now)._asdict())

    def _set(self, **what: Any) -> None:
        if self.settings is not None:
            self.show_settings(self.settings._replace(**what), self._now)
            self.changed.emit()

    def _of_protocol(self, s: m.SandboxSettings, now: m.SandboxState) -> m.SandboxSettings:
        """The settings as the protocol has them, for the controller, device and path that are chosen."""
        chosen = now.initial._replace(device=s.device, path=s.path, controller=s.controller)
        return chosen.with_parameters(**self._controllers[s.controller].named)

    # what is shown

    def show_settings(self, s: m.SandboxSettings | None, now: m.SandboxState | None) -> None:
        """These settings; now: what the server says of them, without which nothing can be set."""
        self.settings, self._now = s, now
        self.setEnabled(now is not None)
        if s is None or now is None:
            return
        for number, guide in self.guides.items():
            guide.setChecked(number == s.controller)
            preset = preset_of(s, self._controllers) if number == s.controller else self._controllers[number]
            guide.feel.setText(feel(preset, self._controllers))
        for field, segments in self.segments.items():
            segments.show_value(getattr(s, field))
            segments.setEnabled(field not in now.fixed)
        own = preset_of(s, self._controllers).named
        for name, dial in self.dials.items():
            dial.show_value(dial.dial.setting(s))
            has_it = name not in s.values or (name in own and not (name == GAP and self._has_gap_beside(s.controller)))
            dial.setEnabled(name not in now.fixed and has_it)
        weak = own.get(GAIN, math.inf) < now.least_gain_N_s_m
        drag = f"At {grouped(own.get(GAIN, 0.0))} N s/m the brakes' own drag is larger: you will feel nothing."
        self.warning.setText(drag if weak else REAL if now.by_start else "")
        self.warning.setVisible(bool(self.warning.text()))
        first = self._of_protocol(s, now)
        changed = [field for field in ("rules", "sensing") if getattr(s, field) != getattr(first, field)]
        changed += [
            row.dial.label.lower() for row in self.dials.values() if row.dial.setting(s) != row.dial.setting(first)
        ]
        self.changes.setText(f"Changed: {PART.join(changed)}" if changed else "")
        self.reset.setVisible(bool(changed))

    def _has_gap_beside(self, number: int) -> bool:
        """Whether a controller without a gap is in the protocol with one, too: its gap is set there, by its name."""
        preset = self._controllers[number]
        others = (other for other in self._controllers.values() if other.kind == preset.kind and other.value(GAP))
        return not preset.value(GAP) and any(others)

    @property
    def gap_m(self) -> float:
        """The half-width of the band without control, as it is set."""
        return preset_of(self.settings, self._controllers).value(GAP) if self.settings is not None else 0.0
