"""The Try page on a server that is made up: what it sends, what it shows, how it compares passes."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from drawn_ways import trail_of
from fake_client import PRESETS, before, movement, opened, paper, ready
from page_driver import PageDriver
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QPushButton
from texts_on_screen import faults
from tried import INITIAL, ended, tried

from app.ipc import messages as m
from app.window.sandbox.dials import DIALS, Dial
from app.window.sandbox.pass_view import GAP
from app.window.sandbox.try_page import BACK, NO_PASS, TryPage
from core import tick_log
from core.control.controllers import PARAMETERS, Preset
from experiments.assumptions import IDEAL


class Held(PageDriver):
    """The page Try, at the front."""

    def __init__(self) -> None:
        super().__init__(TryPage, (1256, 610))
        self.page.show_opened(opened(""))
        self.page.begin()

    def sends(self, settings: m.SandboxSettings) -> bool:
        """Whether these settings are sent last, at once or soon."""
        self.until(lambda: bool(self.sent) and self.sent[-1] == m.SetSandbox(settings))
        return True

    def cells(self, row: int) -> list[str]:
        table = self.page.table
        return [table.item(row, column).text() for column in range(table.columnCount())]


@pytest.fixture
def held() -> Iterator[Held]:
    made = Held()
    made.page.show_snapshot(tried())
    yield made
    made.close()


class Seen(NamedTuple):
    """What Try shows of what the server says."""

    said: m.Snapshot
    large: str = ""  # the line on the canvas
    notice: str = NO_PASS  # beside the table
    warning: str = ""  # under the dials
    changed: str = ""  # what reset takes back
    can: str = ""  # the dials that can be set; "": not looked at
    gap: bool = False  # its layer can be shown
    sends: list[Any] = []  # noqa: RUF012  (never changed) of Space


def of(controller: int, **parameters: float) -> m.SandboxSettings:
    return INITIAL._replace(controller=controller).with_parameters(**parameters)


ALWAYS, DRAG = "blend_width_m spring_N_m brake_strength backlash_deg", "the brakes' own drag is larger"
REAL = {"fixed": ("device", *ALWAYS.split()[1:]), "by_start": True}
RESET = {"controller": 4, "path": 2, "device": "four-brake"}
TRY = {
    "rails": Seen(tried(of(2)), can=ALWAYS),
    "with a gap": Seen(tried(of(3, gap_m=0.008)), can=f"gap_m {ALWAYS}", changed="gap", gap=True),
    "a guide": Seen(tried(of(4)), can=f"gap_m gain_N_s_m {ALWAYS}"),
    "a weak guide": Seen(tried(of(5, gain_N_s_m=5.0)), warning=DRAG, changed="gain"),
    "real, in a pass": Seen(tried(**REAL), warning="next pass", can="blend_width_m"),
    "real": Seen(before(sandbox=tried(**REAL).sandbox), "Ready", warning="next pass", sends=[m.Start()]),
    "brakes off": Seen(before(sandbox=tried().sandbox, brakes_off="Esc", notice="This pass."), "Brakes off", ""),
    "refused": Seen(tried()._replace(notice="It cannot be.", notice_bad=True), notice="It cannot be."),
    "changed": Seen(tried(INITIAL._replace(**RESET, rules="literal", spring_N_m=400.0)), changed="rules · hand spring"),
}  # fmt: skip


@pytest.mark.parametrize("state", TRY)
def test_what_can_be_read_and_set_in_each_state(held: Held, state: str) -> None:
    page, seen = held.page, TRY[state]
    if seen.said.running is None:
        page.show_ticks(movement(1, "AEB", 2.0), True)
    page.show_snapshot(seen.said)
    controls = page.controls
    assert seen.large in page.large.text() and page.notice.text() == seen.notice
    assert seen.warning in controls.warning.text() and controls.warning.isVisible() == bool(seen.warning)
    assert controls.reset.isVisible() == bool(seen.changed) and controls.changes.text().endswith(seen.changed)
    assert faults(page) == []
    can = {name for name, dial in controls.dials.items() if dial.isEnabled()}
    assert not seen.can or can == set(seen.can.split())
    assert controls.segments["device"].isEnabled() == ("device" not in seen.said.sandbox.fixed)
    assert page.workspace.layers[GAP].isEnabled() == seen.gap
    held.sent.clear()
    page.keys()["start"]()
    assert held.sent == seen.sends
    if seen.changed == "rules · hand spring":
        held.click(controls.reset)
        assert held.sends(INITIAL._replace(**RESET)) and not controls.changes.text()
    if seen.said.running is None and not seen.sends:
        assert not np.hypot(*page.canvas.instant.hand) and page.error.text() != "–", "of the pass that was stopped"
        page.show_snapshot(tried(INITIAL._replace(path=2)))
        assert {figure.text() for figure in (page.error, page.force, page.time)} == {"–"}


def test_the_page_opens_try_with_the_servers_settings_and_ends_it_and_in_a_session_says_why_not(held: Held) -> None:
    assert held.sent == [m.SetSandbox(None)]
    assert held.page.controls.settings == INITIAL and held.page.controls.guides[2].isChecked()
    held.page.end()
    assert held.sent[-1] == m.EndSandbox()
    held.sent.clear()
    held.page.show_opened(opened("01"))
    held.page.show_snapshot(ready(1, notice="Participant 01: 57 of 60 trials left."))
    held.page.begin()
    assert not held.sent and held.page.large.text() == "A session is open" and not held.page.notice.text()
    assert not held.page.controls.guides[1].isEnabled()
    held.page.show_opened(opened(""))
    assert [type(command) for command in held.sent] == [m.SetSandbox]


def test_a_refusal_brings_the_settings_back(held: Held) -> None:
    held.page.controls.dials["brake_strength"].slider.setValue(0)
    assert (
        held.sends(INITIAL._replace(brake_strength=0.05))
        and held.page.controls.changes.text() == "Changed: brake strength"
    )
    held.page.show_snapshot(tried()._replace(notice="It cannot be.", notice_bad=True))
    assert held.page.controls.settings == INITIAL


def test_a_controller_is_chosen_by_what_it_feels_like_by_pointer_or_by_key_wherever_the_keyboard_is(
    held: Held,
) -> None:
    feels = [guide.feel.text() for guide in held.page.controls.guides.values()]
    assert feels == [
        "only the brakes' own drag", "as on rails", "on rails, 5 mm free to each side", "a strong guide",
        "a weak guide",
    ]  # fmt: skip
    QTest.mouseClick(held.page.controls.guides[3], Qt.MouseButton.LeftButton)
    assert held.sends(of(3, **PRESETS[3].named))
    held.page.activateWindow()
    held.until(held.page.isActiveWindow)
    held.page.controls.more.setFocus()
    QTest.keyClick(held.page.controls.more, Qt.Key.Key_5)
    assert held.sends(of(5, gap_m=0.0, gain_N_s_m=500.0))


def test_every_place_of_a_slider_is_a_value_that_has_this_place() -> None:
    for dial in (*map(Dial.of, PARAMETERS.values()), *DIALS):
        places = list(range(dial.slider_position(dial.most) + 1))
        back = [dial.slider_position(dial.value_at(place)) for place in places]
        assert back == pytest.approx(places, abs=1 if dial.log else 0), dial.name
        assert dial.value_at(0) == dial.least and dial.value_at(places[-1]) == pytest.approx(dial.most, rel=0.03)


def test_another_protocol_brings_its_own_controllers_and_a_slider_for_each_of_their_parameters(held: Held) -> None:
    shown = {name: dial.dial.label for name, dial in held.page.controls.dials.items()}
    assert shown.items() >= {"gap_m": "Gap", "gain_N_s_m": "Gain"}.items() and "wall_N_m" not in shown
    slave = {1: Preset("Slave", "reflect", (0.0, 2000.0))}
    held.page.show_opened(opened("", paper(controllers=slave)))
    settings = INITIAL._replace(controller=1, values=slave[1].named)
    held.page.show_snapshot(tried(settings, initial=settings))
    assert list(held.page.controls.guides) == [1]
    assert "gain_N_s_m" not in held.page.controls.dials
    wall = held.page.controls.dials["wall_N_m"]
    assert (wall.isEnabled(), wall.value.text()) == (True, "2\u202f000 N/m")
    wall.slider.setValue(wall.dial.slider_position(500.0))
    assert held.sends(settings.with_parameters(wall_N_m=500.0))
    held.page.controls.reset.click()
    assert held.sends(settings)


def test_a_setting_has_one_row_with_its_newest_pass_on_each_device_the_newest_on_top(held: Held) -> None:
    passes = (
        ended(1, 1, 0.004), ended(2, 2, 0.010, brake_strength=0.5), ended(3, 2, 0.003, device="four-brake"),
        ended(4, 2, 0.008, path=2), ended(5, 2, 0.009, changed=True), ended(6, 4, 0.030, status="timeout"),
        ended(7, 3, 0.001, values={"gap_m": 0.008, "gain_N_s_m": 10_000.0}), ended(8, 2, 0.002), ended(9, 2, None),
        ended(10, 1, 0.005, device="four-brake"),
    )  # fmt: skip
    held.page.show_snapshot(tried(INITIAL, *passes))
    assert [held.cells(row)[1:6] for row in range(7)] == [
        ["No control", "–", "1", "4.0", "5.0"], ["SDOF", "–", "1", "–", "3.0"],
        ["SDOF with gap", "gap 8 mm", "1", "1.0", "–"],
        ["Proportional, high gain", "10\u202f000 N s/m", "1", "time was up", "–"],
        ["SDOF", "changed on the way", "1", "9.0", "–"], ["SDOF", "–", "2", "8.0", "–"],
        ["SDOF", "brake strength 50 %", "1", "10", "–"],
    ]  # fmt: skip
    assert held.cells(0)[6:] == ["3.0", "3.0", "40", "40"]
    assert held.cells(3)[6:] == 4 * ["–"], "of a part of the path: nothing that could be compared"
    assert "Pass 10, 2.5 s; four-brake, path 1, settled rules" in held.page.table.item(0, 5).toolTip()


def test_what_the_newest_tick_is_stands_on_the_canvas(held: Held) -> None:
    rows = movement(1, "AEB", 2.0)
    rows[:, tick_log.PATH_DISTANCE] = -0.0042
    held.page.show_ticks(rows[:500], True)
    held.page.show_ticks(rows[500:1500], True)
    page = held.page
    assert (page.large.text(), page.error.text(), page.time.text()) == ("Go", "4.2 mm", "1.5 s")
    assert np.array_equal(trail_of(page.canvas), rows[:1500, tick_log.TIP_X : tick_log.TIP_Y + 1])
    assert page.canvas.tip == pytest.approx(tuple(rows[1499, tick_log.TIP_X : tick_log.TIP_Y + 1]))
    page.show_ticks(rows[1500:1510], False)
    assert "pointer" in page.small.text()
    rows[-1, tick_log.PHASE] = tick_log.END
    page.show_ticks(rows[-1:], True)
    assert page.large.text() == BACK.large
    page.show_snapshot(tried(INITIAL, ended(1)))
    assert len(trail_of(page.canvas)) == 1510  # to be looked at until the next movement
    page.show_ticks(rows[:1], True)
    assert len(trail_of(page.canvas)) == 1


def test_the_controller_sees_the_truth_or_what_encoders_give_of_a_simulated_device(held: Held) -> None:
    assert not held.page.controls.rare.isVisible(), "what is rarely set is behind More"
    held.page.controls.more.click()
    sensing = held.page.controls.segments["sensing"]
    assert sensing.isVisible()
    ideal, encoders = sensing.findChildren(QPushButton)
    assert sensing.value() == IDEAL and "15 ms" in sensing.toolTip()
    QTest.mouseClick(encoders, Qt.MouseButton.LeftButton)
    assert held.sends(INITIAL._replace(sensing="encoders")) and held.page.controls.changes.text() == "Changed: sensing"
    held.page.show_snapshot(tried(fixed=("sensing",), by_start=True))
    assert not sensing.isEnabled()
