"""Live plots and energy ledger: what they show of ticks, and that nothing of a tick is lost."""

import numpy as np
import pytest
from fake_ticks import quiet, trial
from PySide6.QtCore import QPointF
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QApplication

from app.window.run.energy import Ledger
from app.window.run.live import Live
from app.window.run.strip import Strip
from app.window.widgets import theme
from app.window.widgets.parts import Figures
from app.window.widgets.plots import NO_TRIAL, NOTHING, WINDOW_S, TimingStrip, Trace, range_for
from app.window.widgets.theme import COLOURS
from core import tick_log
from core.device import load_device

THREE, FOUR = load_device("three-brake"), load_device("four-brake")


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


def test_a_curve_paints_a_few_points_a_pixel_however_long_the_trial(trace: Trace) -> None:
    for second in range(60):
        trace.add(second + 1e-3 * np.arange(1000), np.sin(np.arange(1000.0))[None] * 0.5 + 0.5)
    assert len(drawn(trace)[0]) <= 2 * trace.graph.width() + 4
    trace.item.vb.sigRangeChangedManually.emit([True, False])  # somebody has moved the plot
    trace.item.setXRange(0.0, 60.0, padding=0.0)
    x, _ = drawn(trace)
    assert len(x) <= 2 * trace.graph.width() + 4 and x[0] < 1.0 and x[-1] > 59.0


def test_a_plot_that_was_moved_stays_until_the_next_trial(trace: Trace) -> None:
    t = 1e-3 * np.arange(1000)
    for second in range(8):
        trace.add(second + t, np.full((1, 1000), 0.5))
    assert trace.item.viewRange()[0] == pytest.approx([1.999, 7.999], abs=1e-6)
    trace.item.vb.sigRangeChangedManually.emit([True, False])
    trace.item.setXRange(0.0, 2.0, padding=0.0)
    trace.add(8.0 + t, np.full((1, 1000), 0.5))
    assert trace.item.viewRange()[0] == [0.0, 2.0]
    trace.clear()
    assert trace.item.viewRange()[0] == [0.0, WINDOW_S]


def test_the_curve_is_interrupted_where_there_is_no_value(trace: Trace) -> None:
    values = np.full((1, 6000), 0.5)
    values[0, 2000:4000] = np.nan
    trace.add(1e-3 * np.arange(6000), values)
    x, y = drawn(trace)
    known = x[np.isfinite(y)]
    assert np.isnan(y).any() and not ((known > 2.05) & (known < 3.95)).any()


def test_the_pointer_reads_the_tick_under_it(live: Live, strip: Strip) -> None:
    rows = quiet(500, HAND_FX=3.0, HAND_FY=-4.0, CURRENT_E=0.8)
    for part in (live, strip):
        add(part, rows)
    assert strip.currents.read_at(QPointF(0.2, 0.5)) == "0.200 s: A 0.00 A, E 0.80 A, B 0.00 A, C 0.00 A"
    assert live.force.read_at(QPointF(0.2, 1.0)) == "0.200 s: 5.0 N"
    assert live.force.read_at(QPointF(7.0, 1.0)) == ""


def test_ranges_are_round_hold_their_value_and_only_grow(live: Live) -> None:
    for value in (0.001, 0.2, 3.3, 10.0, 17.0, 999.0, 1234.0):
        assert value <= range_for(value, 1e-9) <= 2.0 * value
    assert range_for(3.0, 10.0) == 10.0
    add(live, quiet(HAND_FX=37.0))
    assert live.force.end == 40.0
    add(live, quiet(start_s=0.016, HAND_FX=1.0))
    assert live.force.end == 40.0
    live.clear()
    assert live.force.end == 4.0


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


@pytest.mark.parametrize(
    ("device", "tick", "value"),
    [
        ("three-brake", {"CURRENT_B": 0.5}, "A 0.00 E 0.00 B 0.50"),
        ("er-two-brake", {"CURRENT_B": 2.5}, "A 0.00 B 2.50"),
        ("pter", {"CURRENT_E": 0.5}, "A 0.00 A-B 0.50 B 0.00 A+B 0.00"),
    ],
)
def test_a_device_has_its_own_brakes_in_the_unit_of_its_file_and_couplings_by_what_they_couple(
    strip, device, tick, value
) -> None:
    strip.show_trial(load_device(device))
    assert strip.currents.figures.text().count(NOTHING) == value.count("0.") + value.count("2.")
    add(strip, quiet(**tick))
    strip.refresh_text()
    assert strip.currents.figures.text() == value
    assert strip.currents.title.text() == f"Currents, {load_device(device).command_unit}"


def test_a_late_tick_is_a_point_in_its_colour(qtbot) -> None:
    strip = shown(qtbot, TimingStrip(), 360, 120)
    lateness = np.full(3000, 14.0)
    lateness[1000], lateness[2000] = 300.0, 2500.0
    for begin in range(0, 3000, 16):
        rows = quiet(16, start_s=1e-3 * begin)[: 3000 - begin]
        rows[:, tick_log.LATENESS_US] = lateness[begin : begin + 16]
        strip.add_ticks(rows[:, tick_log.T], rows[:, tick_log.LATENESS_US])
    points = strip.late.points()
    assert [round(point.pos().x(), 3) for point in points] == [1.0, 2.0]
    assert [point.brush().color() for point in points] == [theme.shade(COLOURS.caution), theme.shade(COLOURS.bad)]
    strip.clear()
    assert not len(strip.late.points())


def test_a_line_without_room_loses_its_end_and_never_the_first_digits_of_a_number(qtbot) -> None:
    for width in (30, 50, 70):
        narrow = [shown(qtbot, Figures(theme.NORMAL, right), width, 20) for right in (False, True)]
        for figures in narrow:
            figures.show_parts(("1064", COLOURS.text), ("µs late", COLOURS.quiet))
        left, right = (figures.grab().toImage() for figures in narrow)
        assert left == right, "both begin at the left edge"
    wide = shown(qtbot, Figures(theme.NORMAL, right=True), 300, 20)
    wide.show_parts(("1064", COLOURS.text))
    begins = 300 - round(theme.text_width("1064", theme.NORMAL))
    seen = wide.grab().toImage()
    assert not ink(seen, range(begins - 1)) and ink(seen, range(begins, 300))


def ink(image: QImage, columns: range) -> bool:
    """Whether something is written in these columns of a picture."""
    return len({image.pixel(x, y) for x in columns for y in range(image.height())}) > 1


def words(parts: list[tuple[str, str]]) -> str:
    return " ".join(text for text, _ in parts)


def test_the_ledger_closes_and_says_that_no_brake_added_energy() -> None:
    ledger, rows = Ledger(), trial(FOUR)
    assert words(ledger.whole) == words(ledger.short) == NO_TRIAL
    for begin in range(0, len(rows), 16):
        ledger.add(rows[begin : begin + 16])
    assert ledger.hand == pytest.approx(ledger.brakes + ledger.kinetic + ledger.stops, abs=1e-12)
    assert ledger.brakes > 0.0
    assert "no brake added energy" in words(ledger.whole)


def test_heat_that_falls_is_said_in_red_and_opens_the_strip_once(strip: Strip) -> None:
    ledger = Ledger()
    rows = quiet(20)
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
    assert "a brake added 3 mJ" in strip.figures.text() and "no brake" not in strip.figures.text()
    strip.open.click()
    strip.balance(rows)
    assert strip.curves.isHidden(), "what was closed by hand stays closed in this trial"
