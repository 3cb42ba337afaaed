"""Traces, timing strip and energy ledger: what they show of ticks, and that nothing of a tick is lost."""

import os

import numpy as np
import pytest
from fake_ticks import ALONG, quiet, trial

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
from PySide6.QtGui import QColor, QImage
from PySide6.QtWidgets import QApplication

from app.ipc.messages import Timing
from app.window.console_window import RIGHT_PX
from app.window.painting import theme
from app.window.painting.energy_panel import EnergyPanel, Ledger
from app.window.painting.panel import PAD
from app.window.painting.strip import WINDOW_S, Strip, range_for
from app.window.painting.theme import text_width
from app.window.painting.timing_strip import Bars, TimingStrip, share_of
from app.window.painting.traces import NOTHING, Traces
from core import tick_log
from core.device import load_device

THREE, FOUR = load_device("three-brake"), load_device("four-brake")


def shown(qtbot, widget, width: int = 360, height: int = 480):
    theme.dress(QApplication.instance())
    qtbot.addWidget(widget)
    widget.resize(width, height)
    widget.show()
    return widget


@pytest.fixture
def traces(qtbot) -> Traces:
    traces = shown(qtbot, Traces())
    traces.show_trial(FOUR, ALONG)
    return traces


def pixels(image: QImage) -> np.ndarray:
    """Red, green, blue of every pixel (height, width, 3)."""
    image = image.convertToFormat(QImage.Format.Format_RGBA8888)
    flat = np.frombuffer(image.constBits(), dtype=np.uint8).reshape(image.height(), image.bytesPerLine() // 4, 4)
    return flat[:, : image.width(), :3].astype(int)


def drawn(strip: Strip, colour: str, tolerance: int = 60) -> np.ndarray:
    """Where (height, width) a strip shows a colour."""
    wanted = np.array(QColor(colour).getRgb()[:3])
    return np.abs(pixels(strip.pixmap.toImage()) - wanted).max(axis=2) < tolerance


# ------------------------------------------------------------------------------------------------------------- strip


def test_a_spike_of_one_tick_is_seen_and_scrolls_out(qtbot) -> None:
    strip = Strip(["#ffffff"], 1.0)
    strip.fit(300, 60, 1.0)
    t = 1e-3 * np.arange(3000)
    values = np.full((1, 3000), 0.1)
    values[0, 1234] = 0.95
    for begin in range(0, 3000, 16):
        strip.add(t[begin : begin + 16], values[:, begin : begin + 16])
    high = drawn(strip, "#ffffff")[:15]
    assert high.any()
    at = np.flatnonzero(high.any(axis=0)).mean()
    assert at == pytest.approx(300 * (1.0 - (t[-1] - 1.234) / WINDOW_S), abs=3)
    strip.add(3.0 + 1e-3 * np.arange(6000), np.full((1, 6000), 0.1))
    assert not drawn(strip, "#ffffff")[:15].any()


@pytest.mark.parametrize("ratio", (1.0, 1.5, 2.0))
@pytest.mark.parametrize("piece", (1, 7, 16, 333))
def test_a_strip_painted_piece_by_piece_looks_as_if_painted_at_once(qtbot, piece: int, ratio: float) -> None:
    generator = np.random.default_rng(5)
    t = 1e-3 * np.arange(9000)
    values = np.cumsum(generator.normal(size=(2, 9000)), axis=1)
    values = (values - values.min()) / np.ptp(values)
    strip = Strip(["#ffffff", "#3fb68b"], 1.0)
    strip.fit(200, 50, ratio)
    for begin in range(0, 9000, piece):
        strip.add(t[begin : begin + piece], values[:, begin : begin + piece])
    piecewise = pixels(strip.pixmap.toImage())
    begun = strip._next
    strip.redraw()
    once = pixels(strip.pixmap.toImage())
    late = (strip._next - begun) * strip._step  # columns that still waited
    if late:
        once, piecewise = once[:, :-late], piecewise[:, late:]
    differs = np.abs(once - piecewise).max(axis=2) > 60
    assert differs[:, 2:-2].mean() < 0.002


def test_the_lines_are_interrupted_where_there_is_no_value(qtbot) -> None:
    strip = Strip(["#ffffff"], 1.0)
    strip.fit(300, 60, 1.0)
    values = np.full((1, 6000), 0.5)
    values[0, 2000:4000] = np.nan
    strip.add(1e-3 * np.arange(6000), values)
    columns = drawn(strip, "#ffffff", 130).any(axis=0)
    assert columns[10:95].all() and not columns[105:195].any() and columns[205:290].all()


def test_ranges_are_round_hold_their_value_and_only_grow(traces: Traces) -> None:
    for value in (0.001, 0.2, 3.3, 10.0, 17.0, 999.0, 1234.0):
        assert value <= range_for(value, 1e-9) <= 2.0 * value
    assert range_for(3.0, 10.0) == 10.0
    traces.add(quiet(HAND_FX=37.0))
    assert traces.force.strip.end == 40.0
    traces.add(quiet(start_s=0.016, HAND_FX=1.0))
    assert traces.force.strip.end == 40.0
    traces.clear()
    assert traces.force.strip.end == 10.0


def test_what_is_kept_does_not_grow_with_the_length_of_a_trial(qtbot) -> None:
    strip = Strip(["#ffffff"], 1.0)
    strip.fit(300, 60, 1.0)
    for second in range(120):
        strip.add(second + 1e-3 * np.arange(1000), np.zeros((1, 1000)))
    assert strip._values.nbytes + strip._t.nbytes < 1e6


# ------------------------------------------------------------------------------------------------------------ traces


def test_each_trace_says_its_value_with_its_unit(traces: Traces) -> None:
    traces.add(quiet(HAND_FX=3.0, HAND_FY=-4.0, TIP_VX=0.06, TIP_VY=0.08, CURRENT_E=0.8, CURRENT_C=0.25))
    assert traces.error.value == "10.0 mm"
    assert traces.force.value == "5.0 N" and traces.speed.value == "0.10 m/s"
    assert traces.currents.words == ["A 0.00", "E 0.80", "B 0.00", "C 0.25"]


def test_the_error_counts_from_go_to_the_end(traces: Traces) -> None:
    traces.add(quiet(phase=tick_log.HOLD))
    assert traces.error.value == f"{NOTHING} mm" and traces.force.value == "0.0 N"
    traces.add(quiet(start_s=0.2))
    assert traces.error.value == "10.0 mm"


def test_another_device_has_other_brakes(traces: Traces) -> None:
    traces.show_trial(THREE, ALONG)
    assert traces.currents.words == [f"{joint} {NOTHING}" for joint in "AEB"]
    traces.add(quiet(CURRENT_B=0.5))
    assert traces.currents.words[-1] == "B 0.50"


def test_a_blind_console_hides_the_currents_and_nothing_else(traces: Traces) -> None:
    one, other = quiet(2000, CURRENT_E=0.8, HAND_FX=2.0), quiet(2000, CURRENT_B=0.3, HAND_FX=2.0)
    pictures = []
    for rows in (one, other):
        traces.show_trial(FOUR, ALONG)
        traces.set_blind(True)
        traces.add(rows)
        pictures.append(traces.grab().toImage())
    assert pictures[0] == pictures[1] and traces.force.value == "2.0 N"
    assert traces.currents.value == f"A {NOTHING} E {NOTHING} B {NOTHING} C {NOTHING} A"
    traces.set_blind(False)
    assert traces.currents.words[2] == "B 0.30" and traces.grab().toImage() != pictures[0]


# ------------------------------------------------------------------------------------------------------------ timing


def test_a_late_tick_stands_out_in_its_colour(qtbot) -> None:
    strip = shown(qtbot, TimingStrip(), 360, 120)
    strip.grab()
    lateness = np.full(3000, 14.0)
    lateness[1000], lateness[2000] = 300.0, 2500.0
    for begin in range(0, 3000, 16):
        rows = quiet(16, start_s=1e-3 * begin)[: 3000 - begin]
        rows[:, tick_log.LATENESS_US] = lateness[begin : begin + 16]
        strip.add(rows)
    columns = [np.flatnonzero(drawn(strip.strip, colour).any(axis=0)) for colour in (theme.CAUTION, theme.BAD)]
    assert all(0 < len(found) <= 2 * Bars.bin_px for found in columns) and columns[0].max() < columns[1].min()
    assert (np.diff(share_of(np.array([1.0, 14.0, 100.0, 1000.0, 1e4]))) > 0.0).all()


def test_timing_is_said_in_words_and_a_missed_tick_is_no_small_print(qtbot) -> None:
    strip = shown(qtbot, TimingStrip(), 360, 120)
    strip.show_timing(Timing(14.2, 31.4, 402.0, 0, "real-time: FIFO 50, core 0"))
    assert strip.said == "p99 31 · max 402 µs · 0 missed" and strip.foot == "p50 14 µs · real-time: FIFO 50, core 0"
    before = strip.grab().toImage()
    strip.show_timing(Timing(14.2, 31.4, 402.0, 1, "real-time: FIFO 50, core 0"))
    assert strip.said.endswith("1 missed") and strip.grab().toImage() != before
    strip.show_timing(Timing(29.0, 14_830.0, 124_230.0, 6_400, "default, short slice"))
    title = text_width("Loop lateness", theme.NORMAL, bold=True)
    assert title + text_width(strip.said, theme.SMALL) + 2.0 * PAD < RIGHT_PX  # they share a line


# ------------------------------------------------------------------------------------------------------------ energy


def test_the_ledger_closes_and_says_that_no_brake_added_energy(qtbot) -> None:
    panel = shown(qtbot, EnergyPanel(), 300, 110)
    rows = trial(FOUR)
    for begin in range(0, len(rows), 16):
        panel.add(rows[begin : begin + 16])
    ledger = panel.ledger
    assert ledger.hand == pytest.approx(ledger.brakes + ledger.kinetic + ledger.stops) and ledger.brakes > 0.0
    assert abs(ledger.residual) < 1e-12 and "no brake added energy" in panel.said
    panel.clear()
    assert panel.ledger.hand == 0.0 and "hand 0.00 J" in panel.said


def test_heat_that_falls_is_said_in_red() -> None:
    ledger = Ledger()
    rows = quiet(20)
    rows[:, tick_log.ENERGY_BRAKES] = np.linspace(0.0, 0.1, 20)
    rows[10:, tick_log.ENERGY_BRAKES] -= 0.02
    ledger.add(rows[:10])
    assert ledger.added <= 0.0
    ledger.add(rows[10:])  # the fall is between two messages
    assert ledger.added == pytest.approx(0.02 - 0.1 / 19)


def test_a_fall_of_heat_is_shown(qtbot) -> None:
    panel = shown(qtbot, EnergyPanel(), 300, 110)
    rows = quiet(200)
    rows[100:, tick_log.ENERGY_BRAKES] = -0.003
    panel.add(rows)
    assert "a brake added 3 mJ" in panel.said and "no brake" not in panel.said
