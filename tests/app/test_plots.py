"""Live plots and energy ledger: what they show of ticks, and that nothing of a tick is lost."""

import numpy as np
import pytest
from fake_ticks import quiet, trial
from PySide6.QtWidgets import QApplication

from app.window.run.energy import Ledger
from app.window.run.live import Live
from app.window.run.strip import Strip
from app.window.widgets import theme
from app.window.widgets.plots import NOTHING, WINDOW_S, TimingStrip, Trace
from app.window.widgets.theme import COLOURS
from core import tick_log
from core.device import load_device

FOUR = load_device("four-brake")


def shown(qtbot, widget, width: int = 360, height: int = 480):
    qtbot.addWidget(widget)
    widget.resize(width, height)
    widget.show()
    return widget


@pytest.fixture
def live(qtbot) -> Live:
    live = Live()
    shown(qtbot, live.panel)
    return live


@pytest.fixture
def strip(qtbot) -> Strip:
    strip = shown(qtbot, Strip(), 900, 260)
    strip.show_trial(FOUR)
    return strip


@pytest.fixture
def trace(qtbot) -> Trace:
    trace = shown(qtbot, Trace("Path error", "mm", ["#ffffff"], 1.0, 1), 360, 120)
    return trace


def add(part: Live | Strip, rows: np.ndarray) -> None:
    """These ticks are of the movement."""
    part.add(rows[:, tick_log.T], rows)


def drawn(trace: Trace) -> tuple[np.ndarray, np.ndarray]:
    """The points that the curve paints."""
    QApplication.processEvents()
    return trace.curves[0].curve.getData()


def test_a_spike_of_one_tick_is_drawn_and_scrolls_out(trace: Trace) -> None:
    t = 1e-3 * np.arange(3000)
    values = np.full((1, 3000), 0.1)
    values[0, 1234] = 0.95
    for begin in range(0, 3000, 48):
        trace.add(t[begin : begin + 48], values[:, begin : begin + 48])
    x, y = drawn(trace)
    assert y.max() == 0.95 and x[y.argmax()] == pytest.approx(1.234, abs=2.0 * WINDOW_S / 300)
    trace.add(3.0 + 1e-3 * np.arange(6000), np.full((1, 6000), 0.1))
    assert drawn(trace)[1].max() == pytest.approx(0.1)


def test_a_plot_that_was_moved_stays_until_the_next_trial_and_paints_few_points_of_however_many(trace: Trace) -> None:
    for second in range(60):
        trace.add(second + 1e-3 * np.arange(1000), np.sin(np.arange(1000.0))[None] * 0.5 + 0.5)
    assert trace.item.viewRange()[0] == pytest.approx([53.999, 59.999], abs=1e-6)
    trace.item.vb.sigRangeChangedManually.emit([True, False])
    trace.item.setXRange(0.0, 60.0, padding=0.0)
    x, _ = drawn(trace)
    assert len(x) <= 2 * trace.graph.width() + 4 and x[0] < 1.0 and x[-1] > 59.0
    trace.add(60.0 + 1e-3 * np.arange(1000), np.full((1, 1000), 0.5))
    assert trace.item.viewRange()[0] == [0.0, 60.0]
    trace.clear()
    assert trace.item.viewRange()[0] == [0.0, WINDOW_S]


def test_the_curve_is_interrupted_where_there_is_no_value(trace: Trace) -> None:
    values = np.full((1, 6000), 0.5)
    values[0, 2000:4000] = np.nan
    trace.add(1e-3 * np.arange(6000), values)
    x, y = drawn(trace)
    known = x[np.isfinite(y)]
    assert np.isnan(y).any() and not ((known > 2.05) & (known < 3.95)).any()


def test_each_trace_says_its_value_with_its_unit(live: Live, strip: Strip) -> None:
    rows = quiet(HAND_FX=3.0, HAND_FY=-4.0, TIP_VX=0.06, TIP_VY=0.08, CURRENT_E=0.8, CURRENT_C=0.25)
    strip.figures.resize(900, 20)
    strip.balance(rows)
    for part in (live, strip):
        add(part, rows)
        part.refresh_text()
    assert live.error.figures.text() == "10.0 mm" and live.force.figures.text() == "5.0 N"
    assert live.time.text() == "0.0 s" and strip.speed.figures.text() == "0.10 m/s"
    assert (strip.currents.title.text(), strip.currents.figures.text()) == (
        "Currents, A",
        "A 0.00 E 0.80 B 0.00 C 0.25",
    )
    line = strip.figures.text()
    assert all(part in line for part in ("E 0.80", "0.10 m/s", "taken by brakes"))
    strip.set_blind(True)
    strip.refresh_text()
    assert "Currents" not in strip.figures.text() and "Energy" not in strip.figures.text()


def test_a_device_has_its_own_brakes_in_the_unit_of_its_file_and_couplings_by_what_they_couple(strip: Strip) -> None:
    for name, tick, value in (
        ("er-two-brake", {"CURRENT_B": 2.5}, "A 0.00 B 2.50"),
        ("pter", {"CURRENT_E": 0.5}, "A 0.00 A-B 0.50 B 0.00 A+B 0.00"),
    ):
        strip.show_trial(device := load_device(name))
        assert strip.currents.figures.text().count(NOTHING) == len(value.split()) // 2
        add(strip, quiet(**tick))
        strip.refresh_text()
        assert strip.currents.figures.text() == value
        assert strip.currents.title.text() == f"Currents, {device.command_unit}"


def test_a_late_tick_is_a_point_in_its_colour(qtbot) -> None:
    strip = shown(qtbot, TimingStrip(), 360, 120)
    lateness = np.full(3000, 14.0)
    lateness[1000], lateness[2000] = 300.0, 2500.0
    for begin in range(0, 3000, 16):
        strip.add_ticks(1e-3 * np.arange(begin, min(begin + 16, 3000)), lateness[begin : begin + 16])
    points = strip.late.points()
    assert [round(point.pos().x(), 3) for point in points] == [1.0, 2.0]
    assert [point.brush().color() for point in points] == [theme.shade(COLOURS.caution), theme.shade(COLOURS.bad)]


def test_the_ledger_closes_and_heat_that_falls_is_said_in_red_and_opens_the_strip_once(strip: Strip) -> None:
    whole, rows = Ledger(), trial(FOUR)
    for begin in range(0, len(rows), 16):
        whole.add(rows[begin : begin + 16])
    assert whole.hand == pytest.approx(whole.brakes + whole.kinetic + whole.stops, abs=1e-12)
    assert whole.brakes > 0.0 and "no brake added energy" in " ".join(text for text, _ in whole.whole)
    ledger, rows = Ledger(), quiet(20)
    rows[:, tick_log.ENERGY_BRAKES] = np.linspace(0.0, 0.1, 20)
    rows[10:, tick_log.ENERGY_BRAKES] -= 0.02
    ledger.add(rows[:10])
    assert ledger.added <= 0.0
    ledger.add(rows[10:])  # the fall is between two messages
    assert ledger.added == pytest.approx(0.02 - 0.1 / 19)
    rows = quiet(200)
    strip.balance(rows)
    assert strip.curves.isHidden()
    rows[100:, tick_log.ENERGY_BRAKES] = -0.003
    strip.balance(rows)
    strip.refresh_text()
    assert strip.curves.isVisible() and strip.ledger.short == [("a brake added 3 mJ", COLOURS.bad)]
    strip.open.click()
    strip.balance(rows)
    assert strip.curves.isHidden(), "what was closed by hand stays closed in this trial"
